"""Standard deviation of noise that was rounded in steps as coarse as itself.

Rounding in steps q adds q^2/12 of white noise while ``exp(-2 pi^2 (sigma/q)^2)`` is nothing
(Bennett 1948; Widrow 1961): 4e-4 at 1.6 sigma a step, but 11 % at 3, where the variance that comes
out is anything from 1.2 to 2.3 sigma^2, by where the mean lies between two steps.  There it is how
often each value comes that says sigma: the likelihood of their counts in blocks, Gaussian about
unknown means of which every place is as likely (integrated over, so that many means cost no bias).
How long the mean stays, and so the length of the blocks, is what makes the counts likeliest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import special

from imu_noise_id.recording import Floats

FINE = 1.6
"""Standard deviations a step; of finer steps the error is white, q^2/12 (to 0.2 % of sigma^2)."""
_COARSEST = 16.0
_BLOCKS = (128, 1024, 4096)
_REACH = 8
"""Steps from a block's middle; values beyond count as lying there."""
_SIGMAS = 60
_PLACES = (np.arange(512) - 255.5) * (1.5 / 512)
_EDGES = np.arange(-_REACH - 0.5, _REACH + 1.0)
_REFINED = 4
_LEAST_WORTH = 0.01
_STRAY = 1e-6
"""Chance of a value that no noise explains."""


@dataclass(frozen=True)
class RoundedNoise:
    """Noise about the mean of its block.

    Attributes
    ----------
    sigma : float
        Likeliest standard deviation before rounding.
    relative_error : float
        Standard error of its logarithm.
    added : float
        Variance after rounding less sigma^2; negative where the mean lies amid a coarse step.
    worth : float
        Information on sigma, of what the variance of as many Gaussian samples has that are
        ``added`` (no less than nothing) louder; at most 1.
    """

    sigma: float
    relative_error: float
    added: float
    worth: float


def rounded_noise(values: Floats, step: float) -> RoundedNoise | None:
    """Noise of values rounded to multiples of a step; None where the step is fine, or too little.

    Parameters
    ----------
    values : (n,) float64
    step : float
    """
    blocks = [size for size in _BLOCKS if 2 * size <= values.size]
    if not blocks:
        return None
    middle = np.quantile(values, 0.5, method="lower")  # one of the steps, wherever these lie
    comb = np.rint((values - middle) / step)
    comb = comb[: comb.size // blocks[-1] * blocks[-1]]
    counts = [_counts(comb, size) for size in blocks]
    if _variance(counts[0]) > 1.0 / FINE**2 + 1.0 / 12.0:
        return None
    grid = np.log(np.geomspace(1.0 / _COARSEST, 1.0 / FINE + 0.1, _SIGMAS))
    likelihood = np.array([[_log_likelihood(c, x) for x in grid] for c in counts])
    best, top = np.unravel_index(int(likelihood.argmax()), likelihood.shape)
    inside = min(max(int(top), 1), _SIGMAS - 2)
    log_sigma, curvature = _peak(counts[best], float(grid[inside]), float(grid[1] - grid[0]))
    variance, sigma = _variance(counts[best]), float(np.exp(log_sigma))
    error = 1.0 / np.sqrt(curvature)
    louder = max(variance / sigma**2, 1.0)
    worth = float(np.clip(louder**2 / (2.0 * comb.size * error**2), _LEAST_WORTH, 1.0))
    return RoundedNoise(sigma * step, error, (variance - sigma**2) * step**2, worth)


def likeliest_means(blocks: Floats, step: float, sigma: float) -> Floats:
    """Means before rounding of Gaussian noise of known deviation, one for each block; (b,).

    Parameters
    ----------
    blocks : (b, m) float64
        Samples in steps; single ones may lie anywhere.
    step, sigma : float
    """
    middle = np.quantile(blocks, 0.5, method="lower")
    comb = np.rint((blocks - middle) / step)
    each = _counts(comb, blocks.shape[1]) @ np.log(np.maximum(_shares(sigma / step), _STRAY)).T
    return np.asarray(middle + step * (_middles(comb)[:, 0] + _PLACES[np.argmax(each, axis=1)]))


def _counts(comb: Floats, size: int) -> Floats:
    """How often each step about the middle of a block comes in it, (blocks, steps)."""
    blocks = comb.reshape(-1, size)
    steps = np.clip(blocks - _middles(blocks), -_REACH, _REACH)
    width = 2 * _REACH + 1
    place = (steps + _REACH).astype(np.int64) + width * np.arange(blocks.shape[0])[:, np.newaxis]
    counts = np.bincount(place.ravel(), minlength=width * blocks.shape[0])
    return counts.reshape(-1, width).astype(np.float64)


def _middles(blocks: Floats) -> Floats:
    return np.asarray(np.rint(blocks.mean(axis=1, keepdims=True)))


def _variance(counts: Floats) -> float:
    """Mean variance within blocks, steps^2."""
    steps = np.arange(-_REACH, _REACH + 1)
    size = counts[0].sum()
    mean, square = counts @ steps / size, counts @ steps**2 / size
    return float(np.mean(square - mean**2)) * size / (size - 1.0)


def _log_likelihood(counts: Floats, log_sigma: float) -> float:
    """Of the standard deviation in steps, the mean's place in each block integrated over."""
    each = counts @ np.log(np.maximum(_shares(float(np.exp(log_sigma))), 1e-300)).T
    return float(np.sum(special.logsumexp(each, axis=1) - np.log(_PLACES.size)))


def _shares(sigma: float) -> Floats:
    """Chance of each step for a mean at each place, (places, steps); sigma in steps."""
    z = (_EDGES - _PLACES[:, np.newaxis]) / sigma
    z[:, 0], z[:, -1] = -np.inf, np.inf
    near = np.where(z[:, :-1] > 0.0, -1.0, 1.0)  # the tail that keeps its digits
    return np.asarray(np.abs(special.ndtr(near * z[:, 1:]) - special.ndtr(near * z[:, :-1])))


def _peak(counts: Floats, start: float, reach: float) -> tuple[float, float]:
    """Place and curvature of the highest likelihood by parabolas within reach of a start."""
    x, curvature = start, 1e-6
    for _ in range(_REFINED):
        below, here, above = (_log_likelihood(counts, x + d) for d in (-reach, 0.0, reach))
        curvature = max((2.0 * here - below - above) / reach**2, 1e-6)
        x += float(np.clip((above - below) / (2.0 * reach * curvature), -reach, reach))
        reach = min(reach, curvature**-0.5)
    return x, curvature
