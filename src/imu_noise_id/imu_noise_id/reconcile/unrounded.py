"""Draws of what was rounded: a coarse record as its model says that it was before rounding.

Rounding in steps of more than the noise is no white error (Widrow 1961): the variance, the
skewness and how much of a slow course comes through are what the place of the level between two
steps makes them, and move with it.  Under the model, though, what was rounded is known but for
where in its step each sample lay; drawn from there (Tanner and Wong 1987), the record has the
model's own law where the model is right, at any place, and every statistic its usual null.

A record is s + w, w white of the least density of the model's spectrum, s all the rest.  Given s,
each w is Gaussian between the edges of its sample's step; given the sum, s is Gaussian, each
coefficient of the cosine transform by itself.  The two are drawn in turn (Gibbs).  What a model
lacks, a draw shows by what share of the information the rounding leaves, so a model that has been
changed has its own draws.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import fft
from scipy.special import ndtr, ndtri

from imu_noise_id.effects.output_rounding import rounding_step
from imu_noise_id.model import ChannelModel
from imu_noise_id.reconcile.prior import spectral
from imu_noise_id.reconcile.state import inverse_psd
from imu_noise_id.recording import Channel, Floats, Mask
from imu_noise_id.rounded import likeliest_means, rounded_noise

COARSE = 1.25
"""Steps, in standard deviations of the white part, from which on records are drawn: finer ones add
white noise to 4e-6 of their variance."""
COARSEST = 6.0
"""Steps beyond which a sample says too little of what it was for the draws to settle."""
ROUNDS = 4
"""Of drawing both parts between two fits of a model."""
BLOCK = 1024
FEW = 3
"""Distinct values, of which no more say nothing of noise that is finer yet."""
SHOWS = 0.3
"""Deviation in steps from which on noise shows by a third value, one in 2000, at any level."""
SHORTEST = 256
MOVED = 0.645
"""Root mean square of a rounded record's differences, in steps, from which on its errors are white:
then the course itself moves by half a step, and they are correlated by exp(-2 pi^2/4)."""
_LEAST_TAIL = 1e-200
_RARE = 1e-6
"""Chance of a step that no noise explains."""


@dataclass(frozen=True)
class Steps:
    """Samples as they were recorded, in steps.

    Attributes
    ----------
    values : (n,) float64
        As recorded.
    missing : (n,) bool
        Samples that were not recorded.
    step : float
    drawn : (n,) float64
        What stands in their stead.
    seed : tuple of int
        Of the draws.
    loudness : (n,) float64
        Deviation of each sample's white part over the model's: bursts, which ``drawn`` is without.
    """

    values: Floats
    missing: Mask
    step: float
    drawn: Floats
    seed: tuple[int, ...]
    loudness: Floats


def white_deviation(inverse_psd: Floats, sample_time_s: float) -> float:
    """Standard deviation a sample of the white part: that of the least of the spectrum."""
    largest = float(inverse_psd.max())
    return 1.0 / float(np.sqrt(largest * sample_time_s)) if largest > 0.0 else 0.0


def first_draw(
    values: Floats, missing: Mask, step: float, sigma: float, seed: tuple[int, ...]
) -> Steps:
    """White noise of this deviation within the steps, about the likeliest level of each block.

    No sample is louder than another yet.
    """
    size = min(BLOCK, values.size)
    count = values.size // size
    means = likeliest_means(values[: count * size].reshape(count, size), step, sigma)
    middle = size * (np.arange(count) + 0.5)
    steps = Steps(values, missing, step, values, seed, np.ones(values.size))
    mean = np.asarray(np.interp(np.arange(values.size), middle, means))
    return replace(steps, drawn=_within(steps, mean, sigma, np.random.default_rng((*seed, 0))))


def draw(
    steps: Steps, course: Floats, inverse_psd: Floats, sample_time_s: float, number: int
) -> Steps:
    """Draw what was rounded anew, given the steps and a model.

    Parameters
    ----------
    steps : Steps
    course : (n,) float64
        Known courses.
    inverse_psd : (n,) float64
        1/S of the model at the ordinates of the DCT-II; 0 for the level, of which nothing is known.
    sample_time_s : float
    number : int
        How many draws came before.
    """
    rng = np.random.default_rng((*steps.seed, number + 1))
    sigma = white_deviation(inverse_psd, sample_time_s)
    keep = np.maximum(1.0 - sigma**2 * sample_time_s * inverse_psd, 0.0)
    scatter = sigma * np.sqrt(keep)
    sums = steps.drawn
    for _ in range(ROUNDS):
        C = keep * np.asarray(fft.dct(sums - course, norm="ortho"))
        slow = fft.idct(C + scatter * rng.standard_normal(C.size), norm="ortho")
        sums = _within(steps, np.asarray(course + slow), sigma, rng)
    return replace(steps, drawn=sums)


def too_few_values(channel: Channel, model: ChannelModel) -> int:
    """Number of a channel's values where they are few and say nothing of its noise, else 0.

    So it is where the model's noise is far beneath the step, and how often the values come speaks
    of no louder one.
    """
    if np.unique(channel.values[:SHORTEST]).size > FEW:
        return 0
    distinct = int(np.unique(channel.values).size)
    step = rounding_step(channel.values) if distinct <= FEW else None
    effects = spectral(tuple(fitted.effect for fitted in model.effects))
    if step is None or not effects or not channel.rate_hz:
        return 0
    inverse = inverse_psd(effects, channel.values.size, 1.0 / channel.rate_hz, 0.0)
    finer = step > COARSEST * white_deviation(inverse, 1.0 / channel.rate_hz)
    return distinct if finer and not _shows(channel.values, step) else 0


def _shows(values: Floats, step: float) -> bool:
    """Whether the counts of the values speak of noise that the steps do not hide."""
    noise = rounded_noise(values, step)
    return noise is None or noise.sigma * np.exp(-3.0 * noise.relative_error) > SHOWS * step


def white_stride(values: Floats, step: float) -> int:
    """Samples after which a rounded record has moved enough for white errors; 0 if it never has."""
    stride = 1
    while values.size // stride >= SHORTEST:
        if float(np.mean((values[stride:] - values[:-stride]) ** 2)) >= (MOVED * step) ** 2:
            return stride
        stride += max(stride // 4, 1)
    return 0


def information_left(
    steps: Steps, course: Floats, inverse_psd: Floats, sample_time_s: float
) -> tuple[float, float]:
    """Shares of what the samples said of their level and of their variance that rounding left.

    Variance of the score's mean within a step over that of the score (Orchard and Woodbury 1972),
    the white part Gaussian about the rest.  Of a spectrum other than white it is the product of the
    levels of two samples, so that the share is the level's squared.
    """
    sigma = white_deviation(inverse_psd, sample_time_s)
    keep = np.maximum(1.0 - sigma**2 * sample_time_s * inverse_psd, 0.0)
    mean = course + fft.idct(
        keep * np.asarray(fft.dct(steps.drawn - course, norm="ortho")), norm="ortho"
    )
    low, high, mirrored = _edges(steps, np.asarray(mean), sigma)
    chance = np.maximum(ndtr(high) - ndtr(low), _LEAST_TAIL)
    at_low, at_high = (np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) for z in (low, high))
    level = np.where(mirrored, -1.0, 1.0) * (at_low - at_high) / chance
    square = 1.0 + (low * at_low - high * at_high) / chance
    seen = ~steps.missing & (chance > _RARE)
    shares = float(np.var(level[seen])), 0.5 * float(np.var(square[seen]))
    return min(shares[0], 1.0), min(shares[1], 1.0)


def _edges(steps: Steps, mean: Floats, sigma: float) -> tuple[Floats, Floats, Mask]:
    """Edges of each sample's step about a mean, in deviations, mirrored where both are above it.

    The lower tail keeps its digits.
    """
    deviation = sigma * steps.loudness
    below = (steps.values - 0.5 * steps.step - mean) / deviation
    above = below + steps.step / deviation
    mirrored = below + above > 0.0
    return np.where(mirrored, -above, below), np.where(mirrored, -below, above), mirrored


def _within(steps: Steps, mean: Floats, sigma: float, rng: np.random.Generator) -> Floats:
    """Gaussian samples about a mean, each between the edges of its step, of one deviation then."""
    low, high, mirrored = _edges(steps, mean, sigma)
    first, last = ndtr(low), ndtr(high)
    chance = first + rng.random(mean.size) * (last - first)
    z = np.clip(ndtri(np.maximum(chance, _LEAST_TAIL)), low, high)
    z = np.where(mirrored, -z, z)
    if steps.missing.any():
        z = np.where(steps.missing, rng.standard_normal(mean.size), z)
    return np.asarray(mean + sigma * z)
