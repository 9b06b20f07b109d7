"""Power spectral density for pictures: averaged over segments and log bins, with intervals.

Two-sided, unit^2/Hz: half of what ``scipy.signal.welch`` returns.  Segments of up to ``SEGMENT``
samples under a Hann window, half overlapping; the decades below a segment come from block means.
A segment counts if nine tenths of its samples were observed; straight lines bridge what is missing
in it, which lowers the density by at most the lost part (5 % of white noise for 5 % loss at high
frequency).  Identification does not use this estimate: see ``whittle``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from imu_noise_id.compiled import njit
from imu_noise_id.recording import Floats, Mask
from imu_noise_id.series import Series

SEGMENT = 1 << 15
SHORTEST = 64
OBSERVED = 0.9
"""Part of a segment that must have been observed."""
DROOP = 0.05
"""Frequency times block length up to which block means stand for samples (0.8 % low there)."""
HANN_NEIGHBOURS = (4.0 / 9.0, 1.0 / 36.0)
"""Squared correlation of ordinates one and two apart; the second also of half-overlapping ones."""


@dataclass(frozen=True)
class Spectrum:
    """Two-sided power spectral density.

    Attributes
    ----------
    frequency_hz : (f,) float64
        Mean frequency of each bin.
    psd, lower, upper : (f,) float64
        unit^2/Hz, and the ends of the ``confidence`` interval (chi-square).
    degrees_of_freedom : (f,) float64
    confidence : float
    note : str
        Why it is empty; empty when nothing is to be said.
    """

    frequency_hz: Floats
    psd: Floats
    lower: Floats
    upper: Floats
    degrees_of_freedom: Floats
    confidence: float
    note: str = ""


@dataclass(frozen=True)
class _Ordinates:
    """Averaged periodogram: frequencies, density, and degrees of freedom of one ordinate."""

    frequency_hz: Floats
    psd: Floats
    degrees_of_freedom: float


def spectrum(series: Series, bins_per_decade: int = 30, confidence: float = 0.95) -> Spectrum:
    """Power spectral density of a series in log bins, from about 4/T to half the sample rate.

    Parameters
    ----------
    series : Series
    bins_per_decade : int
    confidence : float

    Returns
    -------
    Spectrum
        Empty, with a note, where no stretch of 64 samples was observed.
    """
    parts: list[Floats] = []
    reached_hz = 0.0
    for block in _block_lengths(series.values.size)[::-1]:
        means = block_means(series, block)
        ordinates = _welch(means.values, means.observed, means.sample_time_s)
        if ordinates is None:
            continue
        top_hz = np.inf if block == 1 else DROOP / means.sample_time_s
        parts.append(_binned(ordinates, reached_hz, top_hz, bins_per_decade))
        reached_hz = top_hz
    if not parts:
        empty = np.empty(0)
        note = f"too short: no stretch of {SHORTEST} samples was observed"
        return Spectrum(empty, empty, empty, empty, empty, confidence, note)
    frequency_hz, psd, freedom = np.concatenate(parts, axis=1)
    tail = (1.0 - confidence) / 2.0
    return Spectrum(
        frequency_hz=frequency_hz,
        psd=psd,
        lower=psd * freedom / special.chdtri(freedom, tail),
        upper=psd * freedom / special.chdtri(freedom, 1.0 - tail),
        degrees_of_freedom=freedom,
        confidence=confidence,
    )


def block_means(series: Series, block: int) -> Series:
    """Means of blocks of ``block`` samples, of which three quarters must have been observed."""
    if block == 1:
        return series
    means, count = _means(series.values, series.observed, block)
    enough = count >= 0.75 * block
    means = np.where(enough, means, 0.0)
    return Series(means, enough, series.sample_time_s * block, series.start_s)


@njit(cache=True, nogil=True)
def _means(values, observed, block):  # type: ignore[no-untyped-def]
    """Mean of the observed samples of each block, summed about the first, and their number."""
    size = values.size // block
    means, count = np.zeros(size), np.zeros(size, dtype=np.int64)
    for i in range(size):
        total, reference, seen = 0.0, 0.0, 0
        for k in range(i * block, (i + 1) * block):
            if observed[k]:
                reference = values[k] if seen == 0 else reference
                total += values[k] - reference
                seen += 1
        means[i], count[i] = reference + total / max(seen, 1), seen
    return means, count


def warm_up() -> None:
    """Compile the means into numba's cache, for a build to call."""
    for values in (np.zeros(4), np.zeros((4, 2))[:, 0]):
        block_means(Series(values, np.ones(4, dtype=bool), 1.0), 2)


def bridged(values: Floats, observed: Mask) -> Floats:
    """Values with straight lines across what is missing, shape (n,)."""
    if observed.all():
        return values
    index = np.arange(values.size)
    return np.interp(index, index[observed], values[observed])


def _block_lengths(size: int) -> list[int]:
    """1 and powers of 64, as long as a few segments' worth of blocks remain."""
    lengths = [1]
    while size // (lengths[-1] * 64) >= 4 * SHORTEST and size // lengths[-1] > 2 * SEGMENT:
        lengths.append(lengths[-1] * 64)
    return lengths


def _welch(values: Floats, observed: Mask, sample_time_s: float) -> _Ordinates | None:
    """Average the periodograms of the longest segments of which there are two or more."""
    if not observed.any():
        return None
    filled = bridged(values, observed)
    length = min(SEGMENT, 1 << max(int(np.log2(max(values.size / 1.5, 1.0))), 0))
    while length >= SHORTEST:
        halves = observed[: observed.size - observed.size % (length // 2)].reshape(-1, length // 2)
        seen = np.count_nonzero(halves, axis=1)
        starts = np.flatnonzero(seen[:-1] + seen[1:] >= OBSERVED * length) * (length // 2)
        if starts.size:
            break
        length //= 2
    else:
        return None
    window = np.hanning(length + 1)[:-1]
    total = np.zeros(length // 2 + 1)
    for start in starts:
        part = filled[start : start + length]
        transform = np.fft.rfft(window * (part - part.mean()))
        total += transform.real**2 + transform.imag**2
    psd = total * sample_time_s / (starts.size * np.sum(window**2))
    frequency_hz = np.fft.rfftfreq(length, sample_time_s).astype(np.float64)
    overlap = 1.0 + 2.0 * HANN_NEIGHBOURS[1] * (1.0 - 1.0 / starts.size)
    # the window spreads the removed mean over ordinates 0 and 1; the last has half the freedom
    return _Ordinates(frequency_hz[2:-1], psd[2:-1], 2.0 * starts.size / overlap)


def _binned(ordinates: _Ordinates, low_hz: float, high_hz: float, per_decade: int) -> Floats:
    """Average ordinates from low to high in log bins: frequency, density, freedom, shape (3, f)."""
    kept = (ordinates.frequency_hz >= low_hz) & (ordinates.frequency_hz < high_hz)
    frequency_hz, psd = ordinates.frequency_hz[kept], ordinates.psd[kept]
    if not frequency_hz.size:
        return np.empty((3, 0))
    bins = np.floor(per_decade * np.log10(frequency_hz / frequency_hz[0]) + 1e-9)
    start = np.flatnonzero(np.diff(bins, prepend=-1.0))
    count = np.diff(np.append(start, frequency_hz.size)).astype(float)
    inflation = 1.0 + 2.0 * sum(
        np.maximum(1.0 - (lag + 1) / count, 0.0) * square
        for lag, square in enumerate(HANN_NEIGHBOURS)
    )
    return np.stack(
        [
            np.add.reduceat(frequency_hz, start) / count,
            np.add.reduceat(psd, start) / count,
            ordinates.degrees_of_freedom * count / inflation,
        ]
    )
