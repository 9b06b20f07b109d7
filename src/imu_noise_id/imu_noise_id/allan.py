"""Overlapping Allan deviation with intervals, right across gaps.

    sigma^2(m tau_0) = 1/2 <(ybar_{k+m} - ybar_k)^2>,  ybar_k the mean of samples k to k+m-1

``allan`` is the estimator to use: every sample starts a difference up to m = 31, every m/16 or
finer beyond (``pyramid``), one pass over the record.  ``allan_exact`` starts a difference at every
sample for any m, and is there to check it.  ``feed`` and ``curve`` (with ``pyramid.Pyramid``) are
``allan`` for a stream, the same bits for any size of batch.

Gaps: a window counts if three quarters of its samples were observed, a difference if both of its
windows do.  Scattered loss is then corrected exactly on average for any noise; a gap of up to a
quarter of one window leaves white noise unbiased and changes a random walk's deviation by less than
2 %.  A difference with a longer gap is left out, so a gap costs differences, not bias.

Intervals: chi-square with the equivalent degrees of freedom of Greenhall and Riley (2003),
*Uncertainty of Stability Variances Based on Finite Differences*, PTTI 35, their sum evaluated for
the stride really used, for the noise type that the curve itself shows at each tau.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy import special

from imu_noise_id.compiled import njit
from imu_noise_id.pyramid import (
    LEVELS,
    PER_OCTAVE,
    WHOLE,
    WIDEST,
    Pyramid,
    empty_pyramid,
    feed,
    mean_excess,
    totals,
)
from imu_noise_id.recording import Floats, Mask
from imu_noise_id.series import Series

__all__ = ["AllanCurve", "allan", "allan_exact", "curve", "degrees_of_freedom", "feed", "warm_up"]

Integers = NDArray[np.int64]

ENOUGH = 1 << 16
STRETCH = 1 << 13
PHASE_SHARE = 0.1
"""Part of the variance due to quantization and lines from which a stride of m/16 is too coarse."""

LEAST_CERTAIN = 0.4
"""Weight of a share that is read from a few windows."""


@dataclass(frozen=True)
class AllanCurve:
    """Allan deviation against averaging time.

    Attributes
    ----------
    tau_s : (t,) float64
        Averaging time.
    deviation, lower, upper : (t,) float64
        In the channel's unit; lower and upper bound the ``confidence`` interval.
    confidence : float
    degrees_of_freedom : (t,) float64
        Equivalent number of independent squared differences.
    averaging_factor : (t,) int64
        Samples in a window.
    differences : (t,) int64
        Differences used.
    note : str
        Why the curve is empty or cut; empty when nothing is to be said.
    """

    tau_s: Floats
    deviation: Floats
    lower: Floats
    upper: Floats
    confidence: float
    degrees_of_freedom: Floats
    averaging_factor: Integers
    differences: Integers
    note: str = ""


@dataclass(frozen=True)
class _Sums:
    """Mean squared differences before the intervals, one row a tau.

    ``whole`` is how many differences a record without gaps would have, ``used`` how many there are.
    """

    m: Integers
    stride: Integers
    variance: Floats
    used: Integers
    whole: Integers

    def take(self, kept: Mask | Integers) -> _Sums:
        """Return the rows that are kept."""
        return _Sums(*(getattr(self, field.name)[kept] for field in fields(self)))


def allan(series: Series, confidence: float = 0.95) -> AllanCurve:
    """Overlapping Allan deviation of a series, from the sample period to a third of the record.

    Where the curve falls faster than white noise (quantization, lines), a stride would lose degrees
    of freedom, so there every sample starts a difference.

    Parameters
    ----------
    series : Series
    confidence : float
        Coverage of the intervals.

    Returns
    -------
    AllanCurve
        Empty, with a note, where no two adjacent windows were observed.
    """
    pyramid = feed(empty_pyramid(), series.values, series.observed)
    strided = _read(pyramid)
    steep = _needs_every_sample(strided, series.values.size)
    if steep.any():
        dense = _dense(series, strided.m[steep])
        for part in ("stride", "variance", "used", "whole"):
            getattr(strided, part)[steep] = getattr(dense, part)
    return _with_intervals(strided, series.sample_time_s, confidence)


def curve(pyramid: Pyramid, sample_time_s: float, confidence: float = 0.95) -> AllanCurve:
    """Allan deviation of everything that a pyramid was fed, strided at m/16 or finer throughout."""
    return _with_intervals(_read(pyramid), sample_time_s, confidence)


def allan_exact(
    series: Series, averaging_factors: Integers | None = None, confidence: float = 0.95
) -> AllanCurve:
    """Allan deviation with a difference starting at every sample: n operations per tau.

    Parameters
    ----------
    series : Series
    averaging_factors : (t,) int64, optional
        Samples per window; those of ``allan`` when left out.
    confidence : float
    """
    m = allan(series).averaging_factor if averaging_factors is None else averaging_factors
    sums = _dense(series, np.asarray(m, dtype=np.int64))
    return _with_intervals(sums.take(sums.used > 0), series.sample_time_s, confidence)


def warm_up() -> None:
    """Compile what ``allan`` and the stream need into numba's cache, for a build to call."""
    for loss in (7, 5000):
        observed = np.arange(5000) % loss != 3
        observed[:3000] = True
        allan_exact(Series(np.zeros(5000), observed, 1.0))


def degrees_of_freedom(
    m: Integers, stride: Integers, count: Integers, alpha: Floats, phase_share: Floats
) -> Floats:
    """Equivalent degrees of freedom of ``count`` squared differences taken every ``stride``.

    Greenhall and Riley (2003), eqs. (5) to (12) with d = 2, no modification, S = m/stride, summed
    to the J = 3 S terms that matter (a full overlap of m > 32 as if every m/32).  A part
    ``phase_share`` of the variance that is differenced white noise (alpha = 2) has many more.

    Parameters
    ----------
    m, stride, count : (t,) int64
    alpha : (t,) float64
        Exponent of the spectrum, -2 (random walk) to 0 (white); between two integers the degrees
        of freedom are interpolated.
    phase_share : (t,) float64
        Between 0 and 1.
    """
    coarse = np.maximum(m / stride / 32.0, 1.0)
    overlap, terms = m / stride / coarse, np.maximum(np.floor(count / coarse), 1.0)
    walk, flicker, white = (_power_law_edf(a, m, overlap, terms) for a in (-2, -1, 0))
    edf = np.where(
        alpha < -1.0,
        (-1.0 - alpha) * walk + (2.0 + alpha) * flicker,
        -alpha * flicker + (1.0 + alpha) * white,
    )
    phase = phase_share**2
    return 1.0 / (phase / _white_phase_edf(m / stride, count) + (1.0 - phase) / edf)


def _power_law_edf(alpha: int, m: Integers, overlap: Floats, count: Floats) -> Floats:
    """Degrees of freedom where the spectrum is f^alpha: count / sum of squared correlations."""
    lag = np.arange(97)[:, None]
    correlation = _difference_covariance(lag / overlap, m, alpha)
    correlation = correlation / correlation[0]
    weight = np.where(lag < np.minimum(count, 3.0 * overlap + 1e-9), 1.0 - lag / count, 0.0)
    weight[1:] *= 2.0
    return np.maximum(count / (weight * correlation**2).sum(axis=0), 1.0)


def _white_phase_edf(overlap: Floats, count: Integers) -> Floats:
    """Degrees of freedom of differenced white noise: correlations -4/6 and 1/6 at m and 2m."""
    first, second = np.maximum(1.0 - np.outer((1.0, 2.0), overlap / count), 0.0)
    return np.maximum(count / (1.0 + 2.0 * (first * 16.0 + second) / 36.0), 1.0)


def _difference_covariance(t: Floats, m: Integers, alpha: int) -> Floats:
    """Covariance s_z(t, F, alpha, d = 2) of the differences, eq. (9), up to a factor."""

    def s_x(t: Floats) -> Floats:
        step = 1.0 / np.minimum(m, 1024)  # beyond, the second difference would lose its digits
        return 2 * _s_w(t, alpha) - _s_w(t - step, alpha) - _s_w(t + step, alpha)

    return 6 * s_x(t) - 4 * (s_x(t - 1) + s_x(t + 1)) + s_x(t - 2) + s_x(t + 2)


def _s_w(t: Floats, alpha: int) -> Floats:
    """Generalised autocovariance of pure power-law phase noise, table 1 of the paper."""
    size = np.abs(t)
    cube = size * size * size
    if alpha == -1:
        return np.asarray(-special.xlogy(cube * size, size))
    return cube if alpha == 0 else -cube * size * size


def spectral_exponent(m: Integers, variance: Floats, weight: Floats) -> Floats:
    """Exponent alpha, -2 to 0, of the noise that dominates at each tau.

    The slope mu of ln variance on ln tau is fitted over the octave on either side of each tau
    (three octaves back where the record ends), weighted by ``weight``; alpha = -1 - mu.
    """
    if not m.size:
        return np.empty(0)
    x, y = np.log2(m.astype(float)), np.log(np.maximum(variance, 1e-300))
    reach_back = np.clip(3.0 - (x[-1] - x), 1.0, 3.0)
    distance = x[None, :] - x[:, None]
    near = (distance >= -reach_back[:, None] - 1e-9) & (distance <= 1.0 + 1e-9)
    w = near * weight
    offset = x[None, :] - ((w * x).sum(axis=1) / w.sum(axis=1))[:, None]
    spread = (w * offset**2).sum(axis=1)
    slope = (w * offset * y).sum(axis=1) / np.where(spread > 0, spread, 1.0) / np.log(2.0)
    return np.asarray(np.clip(-1.0 - np.where(spread > 0, slope, -1.0), -2.0, 0.0))


def _read(pyramid: Pyramid) -> _Sums:
    """Log-spaced averaging factors of a pyramid, at most a third of the record."""
    square, excess, used = (part.ravel() for part in totals(pyramid))
    level, k = np.divmod(np.arange(LEVELS * (WIDEST + 1)), WIDEST + 1)
    stride = np.int64(1) << level
    sums = _Sums(
        m=k * stride,
        stride=stride,
        variance=_mean_square(square, excess, used) / 2.0,
        used=used.astype(np.int64),
        whole=pyramid.fed // stride - 2 * k + 1,
    )
    possible = sums.take((sums.used > 0) & (sums.m <= pyramid.fed // 3))
    possible = possible.take(np.lexsort((possible.stride, possible.m)))
    return possible.take(_log_spaced(possible.m))


def _phase_share(sums: _Sums) -> Floats:
    """Upper bound of the part of each variance that falls as 1/m^2 (quantization, lines).

    That part times m^2 is constant, so no larger than variance times m^2 at a sixteenth of m or
    less: the largest within an octave there, because a line vanishes at some taus.  (A line of a
    longer period is seen often enough by the stride.)
    """
    if not sums.m.size:
        return np.empty(0)
    scaled = np.maximum(sums.variance * sums.m.astype(float) ** 2, 1e-300)
    shorter = (32 * sums.m >= sums.m[:, None]) & (16 * sums.m <= sums.m[:, None])
    share = np.where(shorter, scaled, 0.0).max(axis=1) / scaled
    early = ~shorter.any(axis=1)  # nothing shorter to compare with: the same ratio forwards
    later = np.where(shorter.T, scaled, 0.0).max(axis=1)[early]
    share[early] = scaled[early] / np.maximum(later, scaled[early])
    return np.minimum(share, 1.0)


def _needs_every_sample(sums: _Sums, samples: int) -> Mask:
    """Where a stride would lose degrees of freedom, (t,) bool.

    The share is read from variances of n/m windows: where these are few, white noise alone seems
    to have one in many a record, and the interval is so wide that only a large one matters.  In a
    record of up to ``ENOUGH`` samples every sample costs nothing, and the share is taken as it is.
    """
    share = _phase_share(sums)
    if samples > ENOUGH:
        windows = np.maximum(sums.whole * sums.stride / sums.m, 1.0)
        share = share * np.clip(1.0 - np.sqrt(2.0 / windows), LEAST_CERTAIN, 1.0)
    return np.asarray((sums.stride > 1) & (share > PHASE_SHARE))


def _dense(series: Series, m: Integers) -> _Sums:
    """Mean squared differences that start at every sample."""
    if series.complete:
        # only digits depend on the centre: a mean of some samples is as good as that of all
        some = series.values[:: 1 + series.values.size // ENOUGH]
        prefix = _running_sum(series.values, float(np.mean(some)))
        square = _whole_squares(prefix, m) / m.astype(np.float64) ** 2
        used, excess = np.maximum(series.values.size - 2 * m + 1, 0), np.zeros(m.size)
    else:
        centre = series.mean if series.observed.any() else 0.0
        prefixes = _running_sums(series.values, series.observed, centre)
        rows = np.array([_masked_squares(prefixes, factor) for factor in m]).reshape(-1, 3)
        square, excess, used = rows.T
    return _Sums(
        m=m,
        stride=np.ones(m.size, dtype=np.int64),
        variance=_mean_square(square, excess, used) / 2.0,
        used=used.astype(np.int64),
        whole=np.maximum(series.values.size - 2 * m + 1, 1),
    )


def _with_intervals(sums: _Sums, sample_time_s: float, confidence: float) -> AllanCurve:
    """Put chi-square intervals around the variances."""
    note = "" if sums.m.size else "too short: no two adjacent windows within a third of the record"
    weight = sums.used * sums.stride / np.maximum(sums.m, 1)
    alpha = spectral_exponent(sums.m, sums.variance, weight)
    edf = degrees_of_freedom(sums.m, sums.stride, sums.whole, alpha, _phase_share(sums))
    edf = np.maximum(edf * sums.used / sums.whole, 1.0)
    tail = (1.0 - confidence) / 2.0
    return AllanCurve(
        tau_s=np.asarray(sums.m * sample_time_s, dtype=np.float64),
        deviation=np.sqrt(sums.variance),
        lower=np.sqrt(sums.variance * edf / special.chdtri(edf, tail)),
        upper=np.sqrt(sums.variance * edf / special.chdtri(edf, 1.0 - tail)),
        confidence=confidence,
        degrees_of_freedom=edf,
        averaging_factor=sums.m,
        differences=sums.used,
        note=note,
    )


def _mean_square(square: Floats, excess: Floats, used: Floats) -> Floats:
    """Mean squared difference less the excess of lossy windows, at most half of it."""
    return np.asarray(np.maximum(square - excess, 0.5 * square) / np.maximum(used, 1.0))


def _log_spaced(m: Integers) -> Integers:
    """Indices of ``PER_OCTAVE`` values an octave, and the last one; ``m`` ascends."""
    if not m.size:
        return np.empty(0, dtype=np.int64)
    octaves = np.floor(PER_OCTAVE * np.log2(m[-1]))
    wanted = 2.0 ** (np.arange(octaves + 1) / PER_OCTAVE)
    right = np.minimum(np.searchsorted(m, wanted), m.size - 1)
    left = np.maximum(right - 1, 0)
    nearest = np.where(wanted - m[left] < m[right] - wanted, left, right)
    return np.unique(np.append(nearest, m.size - 1))


@njit(cache=True, nogil=True)
def _running_sum(values: Floats, centre: float) -> Floats:
    """Compensated running sum about the centre, shape (n + 1,)."""
    prefix = np.zeros(values.size + 1)
    lost = 0.0
    for i in range(values.size):
        term = (values[i] - centre) - lost
        prefix[i + 1] = prefix[i] + term
        lost = (prefix[i + 1] - prefix[i]) - term
    return prefix


@njit(cache=True, nogil=True)
def _running_sums(values: Floats, observed: Mask, centre: float) -> Floats:
    """Compensated running sums of value, count and square about the centre, shape (3, n + 1)."""
    seen = np.where(observed, 1.0, 0.0)
    value = np.where(observed, values - centre, 0.0)
    prefixes = np.empty((3, values.size + 1))
    prefixes[0] = _running_sum(value, 0.0)
    prefixes[1] = _running_sum(seen, 0.0)
    prefixes[2] = _running_sum(value * value, 0.0)
    return prefixes


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def _whole_squares(prefix: Floats, factors: Integers) -> Floats:
    """Sums of squared differences of adjacent window sums, nothing missing, (t,).

    All factors go over a stretch of the record before the next, while it is in the cache.
    """
    squares = np.zeros(factors.size)
    for begin in range(0, prefix.size, STRETCH):
        for j in range(factors.size):
            m = factors[j]
            end = min(begin + STRETCH, prefix.size - 2 * m)
            square = 0.0
            for i in range(begin, end):
                difference = prefix[i + 2 * m] - 2.0 * prefix[i + m] + prefix[i]
                square += difference * difference
            squares[j] += square
    return squares


@njit(cache=True, nogil=True)
def _masked_squares(prefix: Floats, m: int) -> tuple[float, float, float]:
    """Sum of squared differences of window means, of their excess, and their number."""
    square, excess, used = 0.0, 0.0, 0.0
    for i in range(prefix.shape[1] - 2 * m):
        left = prefix[1, i + m] - prefix[1, i]
        right = prefix[1, i + 2 * m] - prefix[1, i + m]
        if left < WHOLE * m or right < WHOLE * m:
            continue
        left_sum = prefix[0, i + m] - prefix[0, i]
        right_sum = prefix[0, i + 2 * m] - prefix[0, i + m]
        square += (right_sum / right - left_sum / left) ** 2
        used += 1.0
        if left < m:
            excess += mean_excess(left_sum, left, prefix[2, i + m] - prefix[2, i], m)
        if right < m:
            excess += mean_excess(right_sum, right, prefix[2, i + 2 * m] - prefix[2, i + m], m)
    return square, excess, used
