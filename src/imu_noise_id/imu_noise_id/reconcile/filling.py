"""Samples that are missing, drawn as a model has them between those that are there.

A level read from the neighbours repeats their noise: where two fifths are lost, what is below the
neighbours' span gets two fifths more power, which a reconciliation calls a wandering bias.  A draw
from the conditional law has the model's spectrum, and no other.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

from imu_noise_id.dither import DEPTH
from imu_noise_id.gaps import draw_missing
from imu_noise_id.ordinates import ordinates
from imu_noise_id.reconcile.battery import deviance
from imu_noise_id.recording import Floats, Mask

MOST_ITERATIONS = 60
BRIDGES = 1.5
"""Power of a bridged record over the model's that is the work of the bridges: 1.4 where four of ten
samples are missing."""
CERTAIN = 10.0
"""Nats by which more power than that must stand out."""
TOGETHER = (1, 16)
"""Bins that are looked at together: a line stands in one, a drift in many."""
SETTLED = 1e-4
"""Residual over the right side at which the solution counts."""
STRETCHES = (256, 64)
"""Samples of the complete stretches whose spectrum is read, the longest if there are enough."""
ENOUGH = 8
EMPTY = 0.05
"""Power of the emptiest frequencies over the median at which a fill of the wrong colour shows."""
SKIPPED = 4
"""Bins of a stretch that its mean and its taper spoil."""


def hollow_spectrum(
    values: Floats, missing: Mask, sample_time_s: float
) -> tuple[Floats, Floats] | None:
    """Frequencies and two-sided spectrum of a record, if it is as good as empty at some.

    A digital low pass leaves nothing at half the rate, and what is filled in there is seen over the
    whole record.  The spectrum is that of complete stretches, tapered (Welch 1967), so that it does
    not matter what any model says.
    """
    for size in STRETCHES:
        count = values.size // size
        whole = ~missing[: count * size].reshape(count, size).any(axis=1)
        if whole.sum() < ENOUGH:
            continue
        parts = values[: count * size].reshape(count, size)[whole]
        taper = np.hanning(size)
        spectra = np.abs(np.fft.rfft((parts - parts.mean(axis=1, keepdims=True)) * taper)) ** 2
        psd = spectra.mean(axis=0)[SKIPPED:] * sample_time_s / float(taper @ taper)
        if psd.min() > EMPTY * np.median(psd):
            return None
        return np.arange(SKIPPED, SKIPPED + psd.size) / (size * sample_time_s), psd
    return None


def filled_as_heard(
    bridged: Floats,
    missing: Mask,
    psd: Floats,
    sample_time_s: float,
    heard: tuple[Floats, Floats],
    rng: np.random.Generator,
) -> Floats:
    """A draw of the missing samples under a model's spectrum, from its first frequency the heard.

    Parameters
    ----------
    bridged : (n,) float64
    missing : (n,) bool
    psd : (n,) float64
        Two-sided, at the DCT's ordinates.
    sample_time_s : float
    heard : two (m,) float64
        Of :func:`hollow_spectrum`.
    rng : numpy.random.Generator
    """
    frequency_hz, seen = heard
    grid = np.arange(psd.size) / (2.0 * psd.size * sample_time_s)
    known = np.exp(np.interp(grid, frequency_hz, np.log(np.maximum(seen, 1e-300))))
    least = DEPTH * float(np.median(seen))
    whole = np.maximum(np.where(grid < frequency_hz[0], psd, known), least)

    def law(f: Floats) -> Floats:
        return np.asarray(np.interp(f, grid, whole))

    return draw_missing(bridged, ~missing, sample_time_s, law, rng)


def lifted(bridged: Floats, psd: Floats, sample_time_s: float) -> Floats:
    """The spectrum (n,) of a model, raised to the record's where that stands out.

    A model that lacks a drift or a line must not fill the gaps as if it were not there.
    """
    bins = ordinates(np.asarray(fft.dct(bridged, norm="ortho")), sample_time_s)
    at = bins.frequency_hz * 2.0 * psd.size * sample_time_s
    ratio = bins.power / np.interp(at, np.arange(psd.size), psd)
    lift = np.zeros(ratio.size)
    for count in TOGETHER:
        first = np.arange(0, ratio.size, count)
        dof = np.add.reduceat(bins.dof, first)
        mean = np.add.reduceat(ratio * bins.dof, first) / dof
        certain = (mean > BRIDGES) & (deviance(mean / BRIDGES, dof) > CERTAIN)
        lift = np.maximum(lift, np.repeat(np.where(certain, np.log(mean), 0.0), count)[: lift.size])
    return np.asarray(psd * np.exp(np.interp(np.arange(psd.size), at, lift)))


def filled(
    values: Floats, missing: Mask, psd: Floats, sample_time_s: float, rng: np.random.Generator
) -> Floats:
    """A draw of the missing samples given the others (Hoffman and Ribak 1991).

    With x* a draw of all samples, x = x* + K M' (M K M')^-1 (y - M x*) for the samples y that M
    picks; K is diagonal in the DCT-II, and the solution by conjugate gradients with M K^-1 M' for
    a preconditioner.

    Parameters
    ----------
    values : (n,) float64
        Those that are missing do not count.
    missing : (n,) bool
    psd : (n,) float64
        Two-sided spectrum at the DCT's ordinates.
    sample_time_s : float
    rng : numpy.random.Generator
    """
    there = ~missing
    level = float(values[there].mean())
    variance = psd / sample_time_s
    drawn = np.asarray(fft.idct(np.sqrt(variance) * rng.standard_normal(psd.size), norm="ortho"))

    def spread(some: Floats, weight: Floats) -> Floats:
        """K M' or K^-1 M' of what is there."""
        whole = np.zeros(psd.size)
        whole[there] = some
        return np.asarray(fft.idct(weight * fft.dct(whole, norm="ortho"), norm="ortho"))

    rest = values[there] - level - drawn[there]
    solved, target = np.zeros(rest.size), float(rest @ rest) * SETTLED**2
    ahead = spread(rest, 1.0 / variance)[there]
    way, slope = ahead, float(rest @ ahead)
    for _ in range(MOST_ITERATIONS):
        if float(rest @ rest) <= target:
            break
        turned = spread(way, variance)[there]
        step = slope / float(way @ turned)
        solved = solved + step * way
        rest = rest - step * turned
        ahead = spread(rest, 1.0 / variance)[there]
        slope, before = float(rest @ ahead), slope
        way = ahead + slope / before * way
    out = values.copy()
    out[missing] = (level + drawn + spread(solved, variance))[missing]
    return out
