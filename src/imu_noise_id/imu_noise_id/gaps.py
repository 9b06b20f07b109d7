"""Missing samples, drawn from what a fitted spectrum says of them given the samples seen.

The draw is Durbin and Koopman's (2002): an unconditional record x of the model, plus the
conditional mean of the missing samples given the seen ones of y - x.  In the DCT-II the precision
of the record is diagonal, so that mean solves a linear system whose product is two transforms;
conjugate gradients with the covariance as preconditioner need a few of them.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy import fft

from imu_noise_id.ordinates import fast_length
from imu_noise_id.recording import Floats, Mask

MARGIN = 512
TILE = 2**18
OVERLAP = 2**13
ITERATIONS = 80
TOLERANCE = 1e-4

Psd = Callable[[Floats], Floats]


def roughly_filled(values: Floats, observed: Mask, rng: np.random.Generator) -> Floats:
    """Straight lines and white noise as loud as neighbours differ: where a fit can start."""
    both = observed[1:] & observed[:-1]
    step = np.diff(values)[both]
    sigma = 1.4826 * float(np.median(np.abs(step))) / np.sqrt(2.0) if step.size else 0.0
    noise = np.where(observed, 0.0, sigma * rng.standard_normal(values.size))
    return interpolate(values, observed) + noise


def interpolate(values: Floats, observed: Mask) -> Floats:
    """Fill the missing samples by straight lines between their neighbours."""
    index = np.flatnonzero(observed)
    filled = values.copy()
    missing = np.flatnonzero(~observed)
    filled[missing] = np.interp(missing, index, values[index])
    return filled


def draw_missing(
    values: Floats, observed: Mask, sample_time_s: float, psd: Psd, rng: np.random.Generator
) -> Floats:
    """Record with its missing samples drawn given the others.

    Parameters
    ----------
    values : (n,) float64
        Filled in some way; only the seen samples matter beyond a start of the iteration.
    observed : (n,) bool
    sample_time_s : float
    psd : callable
        Two-sided PSD at frequencies (m,) > 0.
    rng : numpy.random.Generator
    """
    filled = values.copy()
    for first, last in windows(observed):
        inner = slice(max(first - OVERLAP, 0), min(last + OVERLAP, values.size))
        part = _draw(filled[inner], observed[inner], sample_time_s, psd, rng)
        filled[first:last] = part[first - inner.start : last - inner.start]
    return filled


def windows(observed: Mask) -> list[tuple[int, int]]:
    """Stretches (first, last) that are worked on at a time and hold every missing sample.

    Clusters of missing samples with as much as four of their lengths around them where these are a
    small part of the record; else all of it, in tiles where it is long.
    """
    missing = np.flatnonzero(~observed)
    if missing.size == 0:
        return []
    breaks = np.flatnonzero(np.diff(missing) > 2 * MARGIN)
    starts = missing[np.concatenate(([0], breaks + 1))]
    ends = missing[np.concatenate((breaks, [missing.size - 1]))] + 1
    total = int(np.sum(ends - starts)) + 2 * OVERLAP * starts.size
    if total < observed.size // 4:
        return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]
    longest = int(np.max(np.diff(np.flatnonzero(np.concatenate(([True], observed, [True]))))))
    tile = max(TILE, 4 * longest)
    edges = np.linspace(0, observed.size, max(observed.size // tile, 1) + 1).astype(int)
    return [(int(a), int(b)) for a, b in pairwise(edges) if not observed[a:b].all()]


def _draw(
    values: Floats, observed: Mask, sample_time_s: float, psd: Psd, rng: np.random.Generator
) -> Floats:
    size = fast_length(values.size)
    if size < values.size and not observed[size:].all():
        size = values.size
    head, seen = values[:size], observed[:size]
    frequency_hz = np.arange(1, size) / (2.0 * size * sample_time_s)
    variance = np.empty(size)
    variance[1:] = psd(frequency_hz) / sample_time_s
    variance[0] = np.inf
    coefficients = rng.standard_normal(size)
    coefficients[0] = 0.0
    coefficients[1:] *= np.sqrt(variance[1:])
    unconditional = np.asarray(fft.idct(coefficients, norm="ortho"))
    mean = _conditional_mean(head - unconditional, seen, variance)
    out = values.copy()
    out[:size] = np.where(seen, head, unconditional + mean)
    return out


def _conditional_mean(values: Floats, observed: Mask, variance: Floats) -> Floats:
    """Expected record given its seen samples; ``variance`` (n,) of its DCT-II coefficients."""
    precision = 1.0 / variance
    covariance = np.where(np.isinf(variance), 4.0 * variance[1], variance)
    missing = ~observed

    def apply(diagonal: Floats, x: Floats) -> Floats:
        transformed = fft.dct(x, norm="ortho")
        transformed *= diagonal
        return np.asarray(np.where(missing, fft.idct(transformed, norm="ortho"), 0.0))

    solution = interpolate(values, observed)
    residual = -apply(precision, solution)
    start = residual
    goal = 0.0
    direction = np.zeros_like(values)
    before = 1.0
    for iteration in range(ITERATIONS):
        steep = apply(covariance, residual)
        now = float(residual @ steep)
        goal = max(goal, TOLERANCE**2 * now) if iteration == 0 else goal
        if now <= max(goal, TOLERANCE**2 * missing.sum()) or not start.any():
            break
        direction = steep + (now / before if iteration else 0.0) * direction
        image = apply(precision, direction)
        length = now / float(direction @ image)
        solution = solution + length * direction
        residual = residual - length * image
        before = now
    return np.asarray(np.where(observed, values, solution))
