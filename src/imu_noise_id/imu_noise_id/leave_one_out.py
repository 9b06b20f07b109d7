"""Samples less what all the others of the record say of them.

A hit is an impulse on noise that has its own colour.  Of Gaussian noise with covariance S the
sample t less its mean given all the others is ``(S^-1 x)_t / (S^-1)_tt``: a hit of size h shifts it
by h, whatever the colour, and its variance, the harmonic mean of the spectrum over dt, is the least
that any linear filter leaves (Kolmogorov 1941, interpolation).  Deviations from medians have the
drift within a block instead, more of it far from the middle, and each median is drawn to its own
samples: of Gaussian noise they are not Gaussian.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

from imu_noise_id.gaps import interpolate
from imu_noise_id.ordinates import cosine_coefficients
from imu_noise_id.recording import Floats, Mask

ROUNDS, HARMLESS = 3, 5.0
"""How often doubtful samples are replaced by what the others say, and up to how many deviations
from that what stood there does the others no harm; noise that is nearly white needs one.
"""
WIDTH = 128
"""Ordinates in a bin: as one over their mean square is wanted, few would be far too much."""
QUIETEST = 0.01
"""Part of the median power beneath which no power is taken for more exact knowledge: what the
ends of a record leak is as large there as the noise.
"""


def misfits(values: Floats, doubtful: Mask) -> Floats:
    """Each sample less its mean given the others that are not doubtful, (n,).

    The spectrum is the record's own, in even bins.

    Parameters
    ----------
    values : (n,) float64
    doubtful : (n,) bool
        Samples that may be hit; fewer than all.
    """
    filled = interpolate(values, ~doubtful)
    for _ in range(ROUNDS):
        out = _from_all_others(filled)
        off = out[doubtful]
        filled[doubtful] -= off
        if float(np.abs(off).max(initial=0.0)) < HARMLESS * float(np.std(out)):
            break
    out[doubtful] = values[doubtful] - filled[doubtful]
    return out


def _from_all_others(values: Floats) -> Floats:
    """Each sample less its mean given all the others, the covariance diagonal in the DCT-II."""
    size = fft.next_fast_len(values.size, real=True)  # a transform of a prime length costs tenfold
    coefficients = cosine_coefficients(np.pad(values, (0, size - values.size), mode="symmetric"))
    inverse = _inverse_power(coefficients)
    return less_others(coefficients, inverse)[: values.size]


def less_others(coefficients: Floats, inverse: Floats) -> Floats:
    """Samples (n,) less their means given all the others: V^-1 x over the diagonal of V^-1.

    Parameters
    ----------
    coefficients, inverse : (n,) float64
        DCT-II of the record, and one over its spectrum there to any scale; 0 for the level.
    """
    return np.asarray(fft.idct(coefficients * (inverse / np.mean(inverse)), norm="ortho"))


def _inverse_power(coefficients: Floats) -> Floats:
    """One over the mean square of the coefficients about each; 0 for the level."""
    width = min(WIDTH, max(coefficients.size // 4, 1))
    edges = np.arange(1, coefficients.size - width // 2, width)  # the last bin half as wide or more
    count = np.diff(edges, append=coefficients.size)
    power = np.add.reduceat(coefficients**2, edges) / count
    inverse = 1.0 / np.maximum(power, max(QUIETEST * float(np.median(power)), 1e-300))
    return np.concatenate(([0.0], np.repeat(inverse, count)))
