"""Canonical correlation analysis: of an input and an output, and of an output's past and future.

``driven`` is the thesis's method (Alkan 2021, eqs. 54 to 69): the coefficients of H(z) are the
canonical vectors of lagged input and lagged output, found by QR and SVD without inverting a
covariance.  ``past_future`` needs the output only (Akaike 1975; Larimore 1990): the canonical
variates of its past (``canonical_variates``) are the states of an innovations model, refined by
exact likelihood (``innovations``).  States are added one (or a complex pair) at a time: the
innovations of the model so far are searched again, and the new state stays if it gains more
likelihood than white noise gives away by chance (``state_growth``).  ``joint_cca`` does the same
for the three axes of a sensor.

``significant`` says that the first correlation exceeds the level of chance.  The order does not
wait for it: the likelihood shows weak slow states that the correlations do not.

Normalisation, as the thesis prints it: the input has unit variance and the numerator unit norm.

Gaps.  Rows that touch an unobserved sample are skipped; the likelihood is exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from imu_noise_id import canonical_variates, innovations, transfer_function
from imu_noise_id.canonical_variates import (
    SHORTEST,
    Correlations,
    centred,
    search,
    triangle,
    whole_rows,
)
from imu_noise_id.chance import FALSE_ALARM
from imu_noise_id.innovations import Innovations
from imu_noise_id.recording import Floats, Mask
from imu_noise_id.series import Series
from imu_noise_id.state_growth import CLIMB_ROWS, grow, likelier
from imu_noise_id.transfer_function import (
    Complexes,
    ContinuousTransfer,
    DiscreteTransfer,
    bandwidth_3db_hz,
    rise_time_s,
    settling_time_s,
    to_continuous,
)

LAST_STEPS = 4
"""Steps of the final refinement on the whole of a record that is longer than ``CLIMB_ROWS``."""
MOST_STATES = 6

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
        Number of states; 0 where none is likelier than chance.
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
    R, rows = _pair_triangle(centred(x, observed), centred(y, observed), p, q, observed)
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
    values, observed = centred(series.values, series.observed), series.observed
    if observed.sum() < SHORTEST:
        raise ValueError(f"{int(observed.sum())} samples are too few, {SHORTEST} are needed")
    if not np.any(values[observed]):
        raise ValueError("all samples are equal")
    first = search(values, observed)
    model, found = innovations.white(values, observed), first
    most = MOST_STATES if order is None else order
    while model.order < most:
        grown = grow(values, observed, model, found, most - model.order, order is not None)
        if grown is None or (order is None and not likelier(grown, model)):
            break
        model = grown
        rest = innovations.residuals(values, observed, model)
        found = search(rest, observed)
    if model.order and observed.sum() > CLIMB_ROWS:
        model = innovations.maximise(values, observed, model, LAST_STEPS)
    return _described(model, first[0], series.sample_time_s)


def warm_up() -> None:
    """Compile what the models need into numba's cache, for a build to call."""
    canonical_variates.warm_up()
    innovations.warm_up()
    transfer_function.warm_up()


def _pair_triangle(x: Floats, y: Floats, p: int, q: int, observed: Mask) -> tuple[Floats, int]:
    """R of the table [x_k ... x_{k-p} | y_k ... y_{k-q}], columns centred, and its rows."""
    columns = p + q + 2
    start = max(p, q)
    whole = start + whole_rows(observed, start + 1)
    if whole.size < 10 * columns:
        raise ValueError(f"{whole.size} whole rows are too few for {columns} coefficients")

    def lagged(rows: NDArray[np.int64]) -> Floats:
        inputs = x[rows[:, None] - np.arange(p + 1)]
        outputs = y[rows[:, None] - np.arange(q + 1)]
        return np.hstack((np.ones((rows.size, 1)), inputs, outputs))

    # the column of ones takes the mean of every lag out, exactly
    return triangle(lagged, whole)[1:, 1:], whole.size


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


def _described(model: Innovations, first: Correlations, sample_time_s: float) -> Cca:
    """Result in the thesis's normalisation: unit input, numerator of unit norm."""
    significant = first.excess > 1.0
    notes = []
    if model.order == 0:
        correlated = "above" if significant else "at"
        notes.append(
            f"past and future are correlated {correlated} chance level, and no state makes "
            "the record likelier than white noise does by chance"
        )
    elif not significant:
        notes.append("the likelihood shows a state that correlations do not tell from chance")
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
