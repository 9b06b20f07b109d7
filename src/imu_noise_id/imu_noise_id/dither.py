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
DEPTH_FILLED = 1e-2
"""The same where samples were filled in: what is wrong with each lies well beneath."""
LOUDER = 3.0
"""There, power of the dither over that of the emptiest ordinates, at least."""
UNHEARD = 0.1
"""Power of a wrongly filled sample over that of the dither."""
LEAST_ORDINATES = 4
LEAST_FILLED = 32
"""Ordinates that are looked at together where some samples were filled in."""
ENOUGH = 2**18
"""Ordinates that tell their median well enough."""


def fill_floor(coefficients: Floats, sample_time_s: float, unseen: float) -> float:
    """White density that filling has put beneath a record whose last ordinates are else empty.

    A sample filled in wrongly is an impulse; an unseen share of such has at most about twice that
    share of the median.

    Parameters
    ----------
    coefficients : (n,) float64
        DCT-II of the filled record.
    sample_time_s : float
    unseen : float
        Share of the samples that was filled in.

    Returns
    -------
    float
        0 where the last ordinates hold more, which is the signal's own, or so little that what is
        wrong with each filled sample will be lost in the dither.
    """
    last = float(_parts(coefficients, sample_time_s, LEAST_FILLED)[0])
    median = _median(coefficients)
    least = UNHEARD * DEPTH * unseen * median
    return last * sample_time_s if least < last < min(2.0 * unseen, 0.5) * median else 0.0


def dithered(
    values: Floats, sample_time_s: float, rng: np.random.Generator, unseen: float = 0.0
) -> tuple[Floats, Floats, float]:
    """Record with white noise added where its last ordinates are as good as empty.

    Where samples were filled in, where any ordinates are.

    Parameters
    ----------
    values : (n,) float64
        Complete, n >= 32.
    sample_time_s : float
    rng : numpy.random.Generator
        Left alone where nothing is added.
    unseen : float
        Share of the samples that was drawn: of a wrong fill, draws have left less than a quarter.

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
    median = _median(coefficients)
    if unseen:
        emptiest = float(_parts(coefficients, sample_time_s, LEAST_FILLED).min())
        variance = max(DEPTH_FILLED * median, LOUDER * emptiest)
    else:
        emptiest = float(_parts(coefficients, sample_time_s, LEAST_ORDINATES)[0])
        variance = DEPTH * median
    if emptiest >= max(DEPTH, 0.25 * unseen) * median:
        return values, coefficients, 0.0
    values = values + rng.standard_normal(values.size) * np.sqrt(variance)
    return values, cosine_coefficients(values), variance * sample_time_s


def _parts(coefficients: Floats, sample_time_s: float, least: int) -> Floats:
    """Mean squares of the ordinates of every 0.1 Hz, at least so many, down from the last."""
    size = max(int(LINEAR_WIDTH_HZ * 2.0 * coefficients.size * sample_time_s), least)
    size = min(size, coefficients.size)
    some = coefficients[coefficients.size % size :]
    return np.asarray(np.mean(some[::-1].reshape(-1, size) ** 2, axis=1))


def _median(coefficients: Floats) -> float:
    """Median square of the ordinates."""
    return float(np.median(coefficients[1 :: 1 + coefficients.size // ENOUGH] ** 2))
