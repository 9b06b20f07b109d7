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
ENOUGH = 2**18
"""Ordinates that tell their median well enough."""


def dithered(
    values: Floats, sample_time_s: float, rng: np.random.Generator
) -> tuple[Floats, Floats, float]:
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
    coefficients : (n,) float64
        Their DCT-II.
    psd : float
        Two-sided density of what was added, unit^2/Hz.
    """
    coefficients = cosine_coefficients(values)
    last = max(int(LINEAR_WIDTH_HZ * 2.0 * values.size * sample_time_s), LEAST_ORDINATES)
    some = coefficients[1 :: 1 + values.size // ENOUGH]
    variance = DEPTH * float(np.median(some**2))
    if float(np.mean(coefficients[-last:] ** 2)) >= variance:
        return values, coefficients, 0.0
    values = values + rng.standard_normal(values.size) * np.sqrt(variance)
    return values, cosine_coefficients(values), variance * sample_time_s
