"""Canonical correlations of a record's past and future, and the states that they make.

Scales.  A state that is slow and lies under white noise shows only against a past as long as its
memory.  So past and future are 20 block means each, in blocks of 1, 4, 16, ... samples, and
the scale whose first correlation stands highest above chance is taken.

Gaps.  Rows that touch an unobserved sample are skipped (beyond ``DATA_ROWS`` rows, where lagged
covariances replace the QR of the data, lagged products that touch one).  Those covariances are only
where a refinement by likelihood starts; their relative error, the condition number times 1e-16,
does not reach the model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from imu_noise_id import spectrum
from imu_noise_id.chance import FALSE_ALARM, correlation_by_chance
from imu_noise_id.compiled import njit
from imu_noise_id.recording import Floats, Mask
from imu_noise_id.series import Series
from imu_noise_id.spectrum import block_means

LAGS = (1, 2, 3, 5, 7, 10, 14, 20)
"""Lags of past and of future; the most that leave 20 rows a column."""
SCALE = 4
DATA_ROWS = 1 << 15
"""Rows up to which the data themselves are factored; beyond, their lagged covariances."""
SHORTEST = 60
"""Fewest rows of a scale that is searched."""
_EVERY = 1 << 11
"""Rows that are factored at a time: they stay in the cache."""
STRETCH = 1 << 11
"""Samples over which all lags are summed before the next stretch: they stay in the cache."""


@dataclass(frozen=True)
class Correlations:
    """Canonical correlations of past and future, and the factor of the lagged data behind them.

    ``factor`` is R of the lag matrix [past | future] (columns: lag 1 ... p, then lead 0 ... f-1, d
    channels each), ``variates`` the canonical vectors of the past; ``means`` (m, d) and
    ``observed`` (m,) are the block means that were correlated.
    """

    values: Floats
    variates: Floats
    factor: Floats
    rows: int
    lags: int
    block: int
    chance_level: float
    means: Floats
    observed: Mask

    @property
    def excess(self) -> float:
        """First correlation over the level of chance."""
        return float(self.values[0] / self.chance_level)


@dataclass(frozen=True)
class StateSpace:
    """x' = A x + K e, y = C x + e with e white of covariance ``innovation_covariance``."""

    A: Floats
    C: Floats
    K: Floats
    innovation_covariance: Floats
    sample_time_s: float


def search(values: Floats, observed: Mask) -> list[Correlations]:
    """Correlations at every scale, the highest above chance first."""
    return sorted(scan(values[:, None], observed), key=lambda c: -c.excess)


def scan(values: Floats, observed: Mask, most_rows: int | None = None) -> list[Correlations]:
    """Correlations of past and future at every scale; values (n, d) with zero mean.

    ``most_rows`` limits what is looked at to the leading ones of each scale.
    """
    size, channels = values.shape
    blocks = [1]
    while size // (blocks[-1] * SCALE) >= SHORTEST:
        blocks.append(blocks[-1] * SCALE)
    found = []
    means, seen = values, observed
    for block in blocks:
        if block > 1:
            means, seen = blocks_of(means, seen, SCALE)
        leading, whole = means[:most_rows], seen[:most_rows]
        for lags in LAGS[::-1]:  # the most that leave enough rows
            rows = _count_rows(whole, 2 * lags)
            if rows >= max(SHORTEST // 2, 20 * lags * channels):
                factor = _factor(leading, whole, lags, rows)
                found.append(_correlate(means, seen, factor, (rows, lags, block), len(blocks)))
                break
    if not found:
        raise ValueError("no stretch is whole enough to set a past against a future")
    return found


def regressed(found: Correlations, order: int, sample_time_s: float) -> StateSpace:
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


def centred(values: Floats, observed: Mask) -> Floats:
    """Values about the mean of the observed ones, zero elsewhere."""
    if not observed.any():
        return np.zeros(values.size)
    reference = values[np.argmax(observed)]
    centred = np.where(observed, values - reference, 0.0)
    centred -= centred.sum() / observed.sum()
    return centred if observed.all() else np.where(observed, centred, 0.0)


def blocks_of(values: Floats, observed: Mask, block: int) -> tuple[Floats, Mask]:
    """Block means of each channel, (n, d), and which of them were whole enough."""
    means = [block_means(Series(column, observed, 1.0), block) for column in values.T]
    return np.stack([mean.values for mean in means], axis=1), means[0].observed


def whole_rows(observed: Mask, lags: int) -> NDArray[np.int64]:
    """First samples of the stretches of ``lags`` samples that were all observed."""
    if observed.all():
        return np.arange(observed.size - lags + 1)
    seen = np.concatenate(([0], np.cumsum(observed)))
    return np.flatnonzero(seen[lags:] - seen[:-lags] == lags)


def _count_rows(observed: Mask, lags: int) -> int:
    """How many such stretches there are."""
    return observed.size - lags + 1 if observed.all() else int(whole_rows(observed, lags).size)


def triangle(table: Callable[[NDArray[np.int64]], Floats], rows: NDArray[np.int64]) -> Floats:
    """R of the QR factorisation of a tall table, rows taken ``_EVERY`` at a time."""
    R = np.asarray(np.linalg.qr(table(rows[:_EVERY]), mode="r"))
    for begin in range(_EVERY, rows.size, _EVERY):
        part = np.vstack((R, table(rows[begin : begin + _EVERY])))
        R = np.asarray(np.linalg.qr(part, mode="r"))
    return R


def _correlate(
    means: Floats, observed: Mask, factor: Floats, size: tuple[int, int, int], scales: int
) -> Correlations:
    """Canonical correlations from R of [past | future], with its rows, lags and block."""
    (rows, lags, _), channels = size, means.shape[1]
    past = lags * channels
    Q, _ = np.linalg.qr(factor[:, past:])
    U, S, _ = np.linalg.svd(Q[:past], full_matrices=False)
    variates = np.sqrt(rows) * linalg.solve_triangular(factor[:past, :past], U)
    chance = correlation_by_chance(lags, channels, rows, FALSE_ALARM / scales)
    return Correlations(np.minimum(S, 1.0), variates, factor, *size, chance, means, observed)


def _factor(values: Floats, observed: Mask, lags: int, rows: int) -> Floats:
    """R of the table [past | future] of ``lags`` lags each, which has that many rows."""
    width = 2 * lags * values.shape[1]
    if rows > DATA_ROWS:
        return _covariance_factor(values, observed, 2 * lags, rows)
    if rows < width:
        return np.eye(width)
    whole = whole_rows(observed, 2 * lags)
    order = np.r_[np.arange(lags - 1, -1, -1), np.arange(lags, 2 * lags)]

    def lagged(chosen: NDArray[np.int64]) -> Floats:
        return values[chosen[:, None] + order].reshape(chosen.size, width)

    R = triangle(lagged, whole)
    # where the record has no variation in some direction, a floor far below it keeps R regular
    floor = 1e-14 * max(float(np.abs(R).max()), 1e-300)
    diagonal = np.diag_indices(width)
    R[diagonal] = np.where(np.abs(R[diagonal]) < floor, floor, R[diagonal])
    return R


def _covariance_factor(values: Floats, observed: Mask, lags: int, rows: int) -> Floats:
    """Factor from lagged covariances, for records long enough to make the ends negligible."""
    channels = values.shape[1]
    columns = np.ascontiguousarray(values.T)
    pairs = values.shape[0] - np.arange(lags, dtype=np.float64)
    if not observed.all():
        seen = observed.astype(np.float64)
        pairs = np.maximum(_lagged_products(seen, seen, lags), 1.0)
    covariance = np.empty((lags, channels, channels))
    for i, j in np.ndindex(channels, channels):
        covariance[:, i, j] = _lagged_products(columns[i], columns[j], lags) / pairs
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


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def _lagged_products(late, early, lags):  # type: ignore[no-untyped-def]
    """Sums of late[k + lag] early[k] over k, (lags,); all lags of a stretch before the next."""
    products = np.zeros(lags)
    for begin in range(0, early.size, STRETCH):
        for lag in range(lags):
            ahead = late[begin + lag : begin + lag + STRETCH]
            behind = early[begin : begin + ahead.size]
            total = 0.0
            for k in range(ahead.size):
                total += ahead[k] * behind[k]
            products[lag] += total
    return products


def warm_up() -> None:
    """Compile what the correlations need into numba's cache, for a build to call."""
    spectrum.warm_up()
    _lagged_products(np.ones(3), np.ones(3), 2)
