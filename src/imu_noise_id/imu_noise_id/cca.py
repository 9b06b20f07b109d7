"""Canonical correlation analysis: of an input and an output, and of an output's past and future.

``driven`` is the thesis's method (Alkan 2021, eqs. 54 to 69): the coefficients of H(z) are the
canonical vectors of lagged input and lagged output, found by QR and SVD without inverting a
covariance.  ``past_future`` needs the output only (Akaike 1975; Larimore 1990): the canonical
variates of its past are the states of an innovations model, refined by exact likelihood
(``innovations``).  ``joint`` does the same for the three axes of a sensor.

Scales.  A state that is slow and lies under white noise shows only against a past as long as its
memory.  So past and future are 20 block means each, in blocks of 1, 4, 16, ... samples, and
the scale whose first correlation stands highest above chance is taken.  States are added one (or a
complex pair) at a time: the innovations of the model so far are searched again, the new state is
put in cascade, all is refined at the full rate, and it stays if Schwarz's criterion says so.

Chance.  The lagged products of white noise are independent, so the correlations of its past and
future are the singular values of a Hankel matrix of independent normals over sqrt(rows); the level
that the largest exceeds in 1 % of records (all scales together) is simulated once.  A correlation
below it is not ``significant`` and the model then has no state.

Normalisation, as the thesis prints it: the input has unit variance and the numerator unit norm.

Gaps.  Rows that touch an unobserved sample are skipped (beyond ``DATA_ROWS`` rows, where lagged
covariances replace the QR of the data, lagged products that touch one); the likelihood is exact.
Those covariances are only where the refinement starts; their relative error, the condition number
times 1e-16, does not reach the model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from imu_noise_id import innovations, joint_innovations, transfer_function
from imu_noise_id.innovations import Innovations
from imu_noise_id.recording import Floats, Mask
from imu_noise_id.series import Series
from imu_noise_id.spectrum import block_means
from imu_noise_id.transfer_function import (
    Complexes,
    ContinuousTransfer,
    DiscreteTransfer,
    bandwidth_3db_hz,
    rise_time_s,
    settling_time_s,
    stationary_covariance,
    to_continuous,
)

LAGS = (1, 2, 3, 5, 7, 10, 14, 20)
"""Lags of past and of future; the most that leave 20 rows a column."""
SCALE = 4
DATA_ROWS = 1 << 15
"""Rows up to which the data themselves are factored; beyond, their lagged covariances."""
JOINT_ROWS = 1 << 17
"""Rows at most from which a joint model is refined."""
CLIMB_ROWS = 1 << 18
"""Samples from which a new state is refined: the leading ones, or its block means if it is slow."""
LAST_STEPS = 4
"""Steps of the final refinement on the whole of a record that is longer."""
FALSE_ALARM = 0.01
MOST_STATES = 6
SHORTEST = 60
"""Fewest rows of a scale that is searched."""
_EVERY = 1 << 14

WHAT_AN_INPUT_CAN_FIND = (
    "With the true driving input, canonical correlation recovers H(z) exactly (correlation 1). "
    "With an input that has nothing to do with the sensor, such as simulated white noise, the "
    "correlation is at chance level: poles, zeros, bandwidth, settling time and phase are those "
    "of the noise realisation, half of the fits are unstable, and only the scale of the output "
    "means anything. The past and the future of the output need no input and find its dynamics."
)


@dataclass(frozen=True)
class Cca:
    """A transfer function from unit white noise to a channel, found by canonical correlation.

    Attributes
    ----------
    method : {"past_future", "driven"}
    order : int
        Number of states; 0 where nothing exceeds chance.
    canonical_correlations : (c,) float64
        Descending.
    chance_level : float
        What the first of them would exceed by chance in 1 % of records.
    significant : bool
    H_z : DiscreteTransfer
    H_s : ContinuousTransfer or None
        By Tustin; None where it does not exist.
    innovation_variance : float or None
        Variance of the one-sample prediction error; None for ``driven``.
    rows : int
        Rows from which the correlations were computed.
    block : int
        Samples averaged into one lag of those rows.
    notes : tuple of str
    """

    method: str
    order: int
    canonical_correlations: Floats
    chance_level: float
    significant: bool
    H_z: DiscreteTransfer
    H_s: ContinuousTransfer | None
    innovation_variance: float | None
    rows: int
    block: int
    notes: tuple[str, ...] = ()

    @property
    def poles(self) -> Complexes:
        """Poles of H(s) in rad/s."""
        return self.H_s.poles if self.H_s else np.empty(0, dtype=complex)

    @property
    def zeros(self) -> Complexes:
        """Zeros of H(s) in rad/s."""
        return self.H_s.zeros if self.H_s else np.empty(0, dtype=complex)

    @property
    def minimum_phase(self) -> bool:
        """Whether every zero of H(z) lies within the unit circle."""
        return self.H_z.minimum_phase

    @cached_property
    def settling_time_s(self) -> float | None:
        """Time of H(s) to 2 % of a step's change."""
        return settling_time_s(self.H_s) if self.H_s else None

    @cached_property
    def rise_time_s(self) -> float | None:
        """Time of H(s) from 10 to 90 % of a step's change."""
        return rise_time_s(self.H_s) if self.H_s else None

    @property
    def bandwidth_rise_hz(self) -> float | None:
        """0.35 / rise time."""
        rise = self.rise_time_s
        return 0.35 / rise if rise else None

    @cached_property
    def bandwidth_3db_hz(self) -> float | None:
        """Frequency at which |H(s)| has fallen by 3 dB; None where it never does."""
        return bandwidth_3db_hz(self.H_s) if self.H_s else None


@dataclass(frozen=True)
class StateSpace:
    """x' = A x + K e, y = C x + e with e white of covariance ``innovation_covariance``."""

    A: Floats
    C: Floats
    K: Floats
    innovation_covariance: Floats
    sample_time_s: float


@dataclass(frozen=True)
class Joint:
    """One innovations model for several channels (the axes of a sensor), see ``Cca``."""

    order: int
    canonical_correlations: Floats
    chance_level: float
    significant: bool
    state_space: StateSpace
    rows: int
    block: int
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Correlations:
    """Canonical correlations of past and future, and the factor of the lagged data behind them.

    ``factor`` is R of the lag matrix [past | future] (columns: lag 1 ... p, then lead 0 ... f-1, d
    channels each), ``variates`` the canonical vectors of the past.
    """

    values: Floats
    variates: Floats
    factor: Floats
    rows: int
    lags: int
    block: int
    chance_level: float

    @property
    def excess(self) -> float:
        """First correlation over the level of chance."""
        return float(self.values[0] / self.chance_level)


def driven(
    x: Floats,
    y: Floats,
    sample_time_s: float,
    orders: tuple[int, int] = (1, 1),
    observed: Mask | None = None,
) -> Cca:
    """Thesis's CCA of an input x and an output y: QR of the lagged data, SVD, canonical vectors.

    Parameters
    ----------
    x, y : (n,) float64
    sample_time_s : float
    orders : (int, int)
        Highest lag p of the input (numerator) and q of the output (denominator).
    observed : (n,) bool, optional
        Rows that touch an unobserved sample are skipped.

    Raises
    ------
    ValueError
        When fewer than ten rows a column are left, or x or y is constant.
    """
    p, q = orders
    observed = np.ones(y.size, dtype=bool) if observed is None else observed
    R, rows = _pair_triangle(_centred(x, observed), _centred(y, observed), p, q, observed)
    Rx, rest = R[: p + 1, : p + 1], R[:, p + 1 :]
    Qy, Ry = np.linalg.qr(rest)
    if min(abs(np.diag(Rx)).min(), abs(np.diag(Ry)).min()) == 0.0:
        raise ValueError("the input or the output is constant")
    U, S, Vt = np.linalg.svd(Qy[: p + 1], full_matrices=False)
    scale = np.sqrt(rows - 1.0)
    a = scale * linalg.solve_triangular(Rx, U[:, 0])
    b = scale * linalg.solve_triangular(Ry, Vt[0])
    sign = np.sign(b[0]) or 1.0
    H_z = DiscreteTransfer(sign * a, sign * b, sample_time_s)
    chance = _independent_chance(Ry.T @ Ry / rows, p, q, rows)
    notes = [] if S[0] > chance else ["correlation at chance level: only the scale means anything"]
    H_s = _continuous(H_z, notes)
    return Cca(
        method="driven",
        order=max(p, q),
        canonical_correlations=np.minimum(S, 1.0),
        chance_level=chance,
        significant=bool(S[0] > chance),
        H_z=H_z,
        H_s=H_s,
        innovation_variance=None,
        rows=rows,
        block=1,
        notes=tuple(notes),
    )


def past_future(series: Series, order: int | None = None) -> Cca:
    """Innovations model of one channel from the canonical correlations of its past and future.

    Parameters
    ----------
    series : Series
    order : int, optional
        Number of states; chosen where left out.

    Raises
    ------
    ValueError
        When fewer than 60 samples were observed, or all are equal.
    """
    values, observed = _centred(series.values, series.observed), series.observed
    if observed.sum() < SHORTEST:
        raise ValueError(f"{int(observed.sum())} samples are too few, {SHORTEST} are needed")
    if not np.any(values[observed]):
        raise ValueError("all samples are equal")
    first = _search(values, observed)
    model, found, rest = innovations.white(values, observed), first, values
    most = MOST_STATES if order is None else order
    while model.order < most and (order is not None or found[0].excess > 1.0):
        grown = _grow(values, observed, model, rest, found, most - model.order)
        if grown is None or (order is None and _schwarz(grown) >= _schwarz(model)):
            break
        model = grown
        rest = innovations.residuals(values, observed, model)
        found = _search(rest, observed)
    if model.order and observed.sum() > CLIMB_ROWS:
        model = innovations.maximise(values, observed, model, LAST_STEPS)
    return _described(model, first[0], series.sample_time_s)


def joint(channels: tuple[Series, ...], order: int | None = None) -> Joint:
    """One innovations model of several channels on the same grid.

    The state is the canonical variates at the scale that stands highest above chance; A, C, K come
    by regression and are refined by Gauss and Newton on ln det of the innovations' covariance over
    at most ``JOINT_ROWS`` rows of that scale.

    Parameters
    ----------
    channels : tuple of Series
        Of one grid; a sample counts where all of them were observed.
    order : int, optional

    Raises
    ------
    ValueError
        When too few samples were observed on all channels, or one is constant.
    """
    observed = np.logical_and.reduce([channel.observed for channel in channels])
    if observed.sum() < SHORTEST * len(channels):
        raise ValueError(f"{int(observed.sum())} samples observed on all channels are too few")
    values = np.stack([_centred(channel.values, observed) for channel in channels], axis=1)
    sigma = np.sqrt(np.mean(values[observed] ** 2, axis=0))
    if not np.all(sigma > 0.0):
        raise ValueError("a channel is constant")
    best = max(_scan(values / sigma, observed), key=lambda c: c.excess)
    states = int(np.sum(best.values > best.chance_level)) if order is None else order
    states = min(states, MOST_STATES)
    means, seen = values / sigma, observed
    for _ in range(round(np.log(best.block) / np.log(SCALE))):
        means, seen = _blocks(means, seen, SCALE)
    start = _regressed(best, states, channels[0].sample_time_s * best.block)
    A, C, K, covariance = joint_innovations.maximise(
        means[:JOINT_ROWS], seen[:JOINT_ROWS], start.A, start.C, start.K
    )
    notes = []
    if best.block > 1:
        notes.append(f"model of the means of {best.block} samples, where the slow state shows")
    scaled = StateSpace(
        A, sigma[:, None] * C, K / sigma, covariance * np.outer(sigma, sigma), start.sample_time_s
    )
    return Joint(
        order=states,
        canonical_correlations=best.values,
        chance_level=best.chance_level,
        significant=best.excess > 1.0,
        state_space=scaled,
        rows=best.rows,
        block=best.block,
        notes=tuple(notes),
    )


def warm_up() -> None:
    """Compile what the models need into numba's cache, for a build to call."""
    innovations.warm_up()
    transfer_function.warm_up()
    rng = np.random.default_rng(0)
    channels = tuple(
        Series(rng.standard_normal(400), np.ones(400, dtype=bool), 1.0) for _ in range(2)
    )
    joint(channels, order=1)


def allan_deviation(transfer: DiscreteTransfer, averaging_factor: NDArray[np.int64]) -> Floats:
    """Allan deviation of the output of a stable H(z) driven by unit white noise, shape (t,).

    With V(m) the variance of a sum of m samples, sigma^2 = (4 V(m) - V(2m))/(2 m^2).

    Raises
    ------
    ValueError
        When H(z) is not stable.
    """
    if not transfer.stable:
        raise ValueError("an unstable model has no Allan deviation")
    lead = transfer.denominator[0]
    size = max(transfer.numerator.size, transfer.denominator.size)
    b = np.pad(transfer.numerator, (0, size - transfer.numerator.size)) / lead
    phi = np.pad(transfer.denominator, (0, size - transfer.denominator.size)) / lead
    if size == 1:
        return np.asarray(abs(b[0]) / np.sqrt(averaging_factor))
    order = size - 1
    A, K = np.eye(order, k=1), b[1:] - phi[1:] * b[0]
    A[:, 0] = -phi[1:]
    P = stationary_covariance(A, np.outer(K, K))
    direct, lagged = P[0, 0] + b[0] ** 2, A @ P[:, 0] + K * b[0]
    # the last block column of chain^m sums the powers of A with weights m - 1, m - 2, ...
    one, none = np.eye(order), np.zeros((order, order))
    chain = np.block([[A, one, none], [none, one, one], [none, none, one]])

    def variance_of_sum(m: int) -> float:
        weights = np.linalg.matrix_power(chain, int(m))[:order, 2 * order :]
        return float(m * direct + 2.0 * (weights @ lagged)[0])

    variance = [
        (4 * variance_of_sum(m) - variance_of_sum(2 * m)) / (2.0 * m * m)
        for m in averaging_factor.tolist()
    ]
    return np.sqrt(np.maximum(variance, 0.0))


def allan_distance(measured: Floats, modelled: Floats, degrees_of_freedom: Floats) -> float | None:
    """Root mean square of ln(modelled/measured), weighted by degrees of freedom up to 100.

    0.01 is one per cent; None where nothing is measured.
    """
    usable = (measured > 0.0) & (modelled > 0.0)
    if not usable.any():
        return None
    weight = np.minimum(degrees_of_freedom[usable], 100.0)
    return float(
        np.sqrt(np.average(np.log(modelled[usable] / measured[usable]) ** 2, weights=weight))
    )


def _centred(values: Floats, observed: Mask) -> Floats:
    """Values about the mean of the observed ones, zero elsewhere."""
    if not observed.any():
        return np.zeros(values.size)
    reference = values[np.argmax(observed)]
    centred = np.where(observed, values - reference, 0.0)
    return np.where(observed, centred - centred.sum() / observed.sum(), 0.0)


def _schwarz(model: Innovations) -> float:
    """Deviance with Schwarz's penalty of ln n a parameter."""
    return model.deviance + 2 * model.order * np.log(max(model.observed, 2))


def _search(values: Floats, observed: Mask) -> list[_Correlations]:
    """Correlations at every scale, the highest above chance first."""
    return sorted(_scan(values[:, None], observed), key=lambda c: -c.excess)


def _scan(values: Floats, observed: Mask) -> list[_Correlations]:
    """Correlations of past and future at every scale; values (n, d) with zero mean."""
    size, channels = values.shape
    blocks = [1]
    while size // (blocks[-1] * SCALE) >= SHORTEST:
        blocks.append(blocks[-1] * SCALE)
    found = []
    means, seen = values, observed
    for block in blocks:
        if block > 1:
            means, seen = _blocks(means, seen, SCALE)
        for lags in LAGS[::-1]:  # the most that leave enough rows
            rows = int(_whole_rows(seen, 2 * lags).size)
            if rows >= max(SHORTEST // 2, 20 * lags * channels):
                factor = _factor(means, seen, lags)[0]
                found.append(_correlate(factor, rows, lags, channels, block, len(blocks)))
                break
    if not found:
        raise ValueError("no stretch is whole enough to set a past against a future")
    return found


def _blocks(values: Floats, observed: Mask, block: int) -> tuple[Floats, Mask]:
    """Block means of each channel, (n, d), and which of them were whole enough."""
    means = [block_means(Series(column, observed, 1.0), block) for column in values.T]
    return np.stack([mean.values for mean in means], axis=1), means[0].observed


def _correlate(
    factor: Floats, rows: int, lags: int, channels: int, block: int, scales: int
) -> _Correlations:
    """Canonical correlations from R of [past | future]."""
    past = lags * channels
    Q, _ = np.linalg.qr(factor[:, past:])
    U, S, _ = np.linalg.svd(Q[:past], full_matrices=False)
    variates = np.sqrt(rows) * linalg.solve_triangular(factor[:past, :past], U)
    chance = _hankel_quantile(lags, channels, FALSE_ALARM / scales) / np.sqrt(rows)
    return _Correlations(np.minimum(S, 1.0), variates, factor, rows, lags, block, float(chance))


def _pair_triangle(x: Floats, y: Floats, p: int, q: int, observed: Mask) -> tuple[Floats, int]:
    """R of the table [x_k ... x_{k-p} | y_k ... y_{k-q}], columns centred, and its rows."""
    columns = p + q + 2
    start = max(p, q)
    whole = start + _whole_rows(observed, start + 1)
    if whole.size < 10 * columns:
        raise ValueError(f"{whole.size} whole rows are too few for {columns} coefficients")

    def lagged(rows: NDArray[np.int64]) -> Floats:
        inputs = x[rows[:, None] - np.arange(p + 1)]
        outputs = y[rows[:, None] - np.arange(q + 1)]
        return np.hstack((np.ones((rows.size, 1)), inputs, outputs))

    # the column of ones takes the mean of every lag out, exactly
    return _triangle(lagged, whole)[1:, 1:], whole.size


def _whole_rows(observed: Mask, lags: int) -> NDArray[np.int64]:
    """First samples of the stretches of ``lags`` samples that were all observed."""
    if observed.all():
        return np.arange(observed.size - lags + 1)
    seen = np.concatenate(([0], np.cumsum(observed)))
    return np.flatnonzero(seen[lags:] - seen[:-lags] == lags)


def _triangle(table: Callable[[NDArray[np.int64]], Floats], rows: NDArray[np.int64]) -> Floats:
    """R of the QR factorisation of a tall table, rows taken some thousands at a time."""
    R = np.asarray(np.linalg.qr(table(rows[:_EVERY]), mode="r"))
    for begin in range(_EVERY, rows.size, _EVERY):
        part = np.vstack((R, table(rows[begin : begin + _EVERY])))
        R = np.asarray(np.linalg.qr(part, mode="r"))
    return R


def _factor(values: Floats, observed: Mask, lags: int) -> tuple[Floats, int]:
    """R of the table [past | future] of ``lags`` lags each, and its number of rows."""
    whole = _whole_rows(observed, 2 * lags)
    width = 2 * lags * values.shape[1]
    if whole.size > DATA_ROWS:
        return _covariance_factor(values, observed, 2 * lags, whole.size), whole.size
    if whole.size < width:
        return np.eye(width), whole.size
    order = np.r_[np.arange(lags - 1, -1, -1), np.arange(lags, 2 * lags)]

    def lagged(chosen: NDArray[np.int64]) -> Floats:
        return values[chosen[:, None] + order].reshape(chosen.size, width)

    R = _triangle(lagged, whole)
    # where the record has no variation in some direction, a floor far below it keeps R regular
    floor = 1e-14 * max(float(np.abs(R).max()), 1e-300)
    diagonal = np.diag_indices(width)
    R[diagonal] = np.where(np.abs(R[diagonal]) < floor, floor, R[diagonal])
    return R, whole.size


def _covariance_factor(values: Floats, observed: Mask, lags: int, rows: int) -> Floats:
    """Factor from lagged covariances, for records long enough to make the ends negligible."""
    channels = values.shape[1]
    seen, columns = observed.astype(np.float64), np.ascontiguousarray(values.T)
    covariance = np.empty((lags, channels, channels))
    for lag in range(lags):
        end = values.shape[0] - lag
        pairs = end if observed.all() else float(seen[lag:] @ seen[:end])
        for i, j in np.ndindex(channels, channels):
            covariance[lag, i, j] = columns[i, lag:] @ columns[j, :end] / max(pairs, 1.0)
    half = lags // 2
    time = np.r_[-np.arange(1, half + 1), np.arange(half)]
    matrix = np.empty((lags, channels, lags, channels))
    for i in range(lags):
        for j in range(lags):
            shift = time[i] - time[j]
            matrix[i, :, j] = covariance[shift] if shift >= 0 else covariance[-shift].T
    flat = matrix.reshape(lags * channels, -1)
    ridge = 0.0
    for _ in range(12):
        try:
            return np.sqrt(rows) * np.linalg.cholesky(flat + ridge * np.eye(flat.shape[0])).T
        except np.linalg.LinAlgError:
            ridge = max(10.0 * ridge, 1e-14 * float(np.trace(flat)))
    raise ValueError("lagged covariances are not positive")


def _hankel_quantile(lags: int, channels: int, tail: float) -> float:
    """Level that sqrt(rows) times the first correlation of white noise exceeds with chance tail."""
    centre, beta = _hankel_gumbel(lags, channels)
    return float(centre - beta * np.log(-np.log1p(-tail)))


@lru_cache(maxsize=64)
def _hankel_gumbel(lags: int, channels: int) -> tuple[float, float]:
    """Location and scale of that correlation's upper tail, from draws with a fixed seed."""
    rng = np.random.default_rng(20_26)
    draws = 2000 // channels**2
    lag = np.add.outer(np.arange(lags), np.arange(lags))
    products = rng.standard_normal((draws, 2 * lags - 1, channels, channels))
    hankel = products[:, lag].transpose(0, 1, 3, 2, 4).reshape(draws, lags * channels, -1)
    largest = np.sqrt(np.linalg.eigvalsh(hankel @ hankel.transpose(0, 2, 1))[:, -1])
    beta = float(np.std(largest)) * np.sqrt(6.0) / np.pi
    return float(np.mean(largest)) - np.euler_gamma * beta, beta


def _independent_chance(Cyy: Floats, p: int, q: int, rows: int) -> float:
    """Level of the first correlation of a white input and an output that does not depend on it.

    The lagged products then are normal with the output's covariance, one draw a lag: 2000 draws
    with a fixed seed, 99 % quantile.
    """
    rng = np.random.default_rng(20_26)
    covariance = Cyy[0, : q + 1]
    covariance = np.pad(covariance, (0, max(p, 0)))
    shift = np.subtract.outer(np.arange(-p, q + 1), np.arange(-p, q + 1))
    values, vectors = np.linalg.eigh(covariance[np.abs(shift)])
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = rng.standard_normal((2000, p + q + 1)) @ root.T
    lag = np.subtract.outer(np.arange(q + 1), np.arange(p + 1)) + p
    whitened = np.linalg.solve(np.linalg.cholesky(Cyy), draws[:, lag])
    largest = np.linalg.svd(whitened, compute_uv=False)[:, 0]
    return float(min(np.quantile(largest, 1.0 - FALSE_ALARM) / np.sqrt(rows), 1.0))


def _regressed(found: _Correlations, order: int, sample_time_s: float) -> StateSpace:
    """A, C, K by regression on the first canonical variates (all products from the factor)."""
    past, channels = found.variates.shape[0], found.variates.shape[0] // found.lags
    width = found.factor.shape[1]
    now = np.zeros((width, order))
    now[:past] = found.variates[:, :order]
    output = np.eye(width)[:, past : past + channels]
    shifted = np.zeros((width, order))  # the next past is [y_k, past without its oldest lag]
    shifted[past : past + channels] = found.variates[:channels, :order]
    shifted[: past - channels] = found.variates[channels:, :order]
    R = found.factor
    C = np.linalg.lstsq(R @ now, R @ output, rcond=None)[0].T
    error = R @ (output - now @ C.T)
    both = np.linalg.lstsq(np.hstack((R @ now, error)), R @ shifted, rcond=None)[0].T
    covariance = error.T @ error / found.rows
    return StateSpace(both[:, :order], C, both[:, order:], covariance, sample_time_s)


def _polynomials(space: StateSpace) -> tuple[Floats, Floats]:
    """Phi and theta of a model with one output."""
    phi = np.poly(space.A) if space.A.size else np.ones(1)
    theta = np.poly(space.A - space.K @ space.C) if space.A.size else np.ones(1)
    return innovations.stable(np.real(phi)), innovations.stable(np.real(theta))


def _starts(
    found: _Correlations, room: int, rest: Floats, observed: Mask
) -> list[tuple[Floats, Floats]]:
    """Polynomials at the full rate of one more state, and of a pair where lags are samples."""
    pair = found.block == 1 and found.values[1:2] > found.chance_level
    orders = range(1, min(2 if pair else 1, room) + 1)
    starts = [_polynomials(_regressed(found, order, 1.0)) for order in orders]
    if found.block == 1:
        return starts
    if _too_slow(found.block, observed):
        means = block_means(Series(rest, observed, 1.0), found.block)
        coarse = innovations.evaluate(means.values, means.observed, *starts[0])
        climbed = innovations.maximise(means.values, means.observed, coarse)
        starts = [(climbed.phi, climbed.theta)]
    return [_finer(phi, theta, found.block) for phi, theta in starts if 0.0 < -phi[1] < 1.0]


def _too_slow(block: int, observed: Mask) -> bool:
    """Whether the leading samples from which a state is refined do not show it."""
    return bool(observed.sum() > CLIMB_ROWS and block > CLIMB_ROWS >> 10)


def _finer(phi: Floats, theta: Floats, block: int) -> tuple[Floats, Floats]:
    """First-order polynomials of block means, at the rate of the samples."""
    gain = theta.sum() / phi.sum()  # at zero frequency, whatever the rate
    pole = (-phi[1]) ** (1.0 / block)
    zero = np.clip(1.0 - (1.0 - pole) * gain, -0.99, 1.0 - 1e-9)
    return np.array([1.0, -pole]), np.array([1.0, -zero])


def _grow(
    values: Floats,
    observed: Mask,
    model: Innovations,
    rest: Floats,
    found: list[_Correlations],
    room: int,
) -> Innovations | None:
    """Put the new state in cascade with the model, refine, return the best by Schwarz."""
    by_order: dict[int, list[tuple[Floats, Floats]]] = {}
    blocks: dict[int, list[int]] = {}
    for scale in found:
        for phi, theta in _starts(scale, room, rest, observed):
            poles = innovations.admissible(np.asarray(np.polymul(model.phi, phi), float))
            zeros = innovations.admissible(np.asarray(np.polymul(model.theta, theta), float))
            by_order.setdefault(poles.size, []).append((poles, zeros))
            blocks.setdefault(poles.size, []).append(scale.block)
    chosen: list[tuple[Innovations, int]] = []
    for size, same in by_order.items():
        candidates = innovations.evaluate_all(values, observed, same)
        ranked = sorted(zip(candidates, blocks[size], strict=True), key=lambda c: _schwarz(c[0]))
        chosen += ranked[: 3 if size == 2 and values.size <= JOINT_ROWS else 1]
    refined = [
        _refined(values, observed, start, block)
        for start, block in chosen
        if np.isfinite(start.deviance)
    ]
    return min(refined, key=_schwarz, default=None)


def _refined(values: Floats, observed: Mask, start: Innovations, block: int) -> Innovations:
    """Climb from a start whose new state was found in blocks of that size."""
    if observed.sum() <= CLIMB_ROWS:
        return innovations.maximise(values, observed, start)
    if _too_slow(block, observed):
        return start
    end = int(np.searchsorted(np.cumsum(observed), CLIMB_ROWS)) + 1
    climbed = innovations.maximise(values[:end], observed[:end], start)
    return innovations.evaluate(values, observed, climbed.phi, climbed.theta)


def _described(model: Innovations, first: _Correlations, sample_time_s: float) -> Cca:
    """Result in the thesis's normalisation: unit input, numerator of unit norm."""
    significant = first.excess > 1.0
    notes = []
    if not significant:
        notes.append("past and future are correlated at chance level: the record is white")
    elif first.block > 1:
        notes.append(f"correlations of means of {first.block} samples, where they stand out most")
    norm = float(np.linalg.norm(model.theta))
    H_z = DiscreteTransfer(
        model.theta / norm, model.phi / (np.sqrt(model.variance) * norm), sample_time_s
    )
    return Cca(
        method="past_future",
        order=model.order,
        canonical_correlations=first.values,
        chance_level=first.chance_level,
        significant=significant,
        H_z=H_z,
        H_s=_continuous(H_z, notes),
        innovation_variance=model.variance,
        rows=first.rows,
        block=first.block,
        notes=tuple(notes),
    )


def _continuous(transfer: DiscreteTransfer, notes: list[str]) -> ContinuousTransfer | None:
    """Tustin, or None with a note where a pole lies at z = -1."""
    continuous = to_continuous(transfer)
    if continuous.denominator.size < max(transfer.numerator.size, transfer.denominator.size):
        notes.append("a pole at z = -1 has no continuous counterpart")
        return None
    if not transfer.stable:
        notes.append("the model is unstable: it has no settling time and no Allan curve")
    return continuous
