"""A known floor beneath records whose spectrum ends in a zero at half the rate.

A digital low pass leaves next to nothing there: what its ordinates show is the two ends of the
record and the shape of the filter within one bin, each a large multiple of a spectrum of zero.
White noise of known density, far beneath the rest, makes every ordinate what the likelihood takes
it for; the density is a known part of the spectrum and is never estimated.
"""

from __future__ import annotations

import numpy as np

from imu_noise_id.ordinates import LINEAR_WIDTH_HZ, cosine_coefficients
from imu_noise_id.recording import Floats

DEPTH = 1e-4
"""Power of the dither over that of the median ordinate: 40 dB beneath it."""
LEAST_ORDINATES = 4


def dithered(
    values: Floats, sample_time_s: float, rng: np.random.Generator
) -> tuple[Floats, float]:
    """Record with white noise added where its last ordinates are as good as empty.

    Parameters
    ----------
    values : (n,) float64
        Complete, n >= 32.
    sample_time_s : float
    rng : numpy.random.Generator
        Left alone where nothing is added.

    Returns
    -------
    values : (n,) float64
        The same array where nothing is added.
    psd : float
        Two-sided density of what was added, unit^2/Hz.
    """
    power = cosine_coefficients(values)[1:] ** 2 * sample_time_s
    last = max(int(LINEAR_WIDTH_HZ * 2.0 * values.size * sample_time_s), LEAST_ORDINATES)
    psd = DEPTH * float(np.median(power))
    if float(np.mean(power[-last:])) >= psd:
        return values, 0.0
    return values + rng.standard_normal(values.size) * np.sqrt(psd / sample_time_s), psd
