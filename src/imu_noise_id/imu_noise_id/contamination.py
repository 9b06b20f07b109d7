"""What is not noise of the source: rounding and outliers, read from the samples themselves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from imu_noise_id.effects.outliers import THRESHOLD, Outliers, outlier_parameters
from imu_noise_id.effects.output_rounding import OutputRounding, rounding_step
from imu_noise_id.hits import Answer, hit_mixtures
from imu_noise_id.lattice import angle_note, of_an_angle
from imu_noise_id.leave_one_out import misfits
from imu_noise_id.model import Estimate, FittedEffect
from imu_noise_id.recording import Floats, Mask
from imu_noise_id.rounded import rounded_noise
from imu_noise_id.series import Series

MEDIAN_OVER_S = 2.0
LEAST_PER_BLOCK = 16
MOST_HIT = 0.05
"""Share of the samples; a wide tail of many small ones is another distribution."""
BY_CHANCE = 1e-4
LOUDEST = 5.0
"""Standard deviations of the rest up to which hits that gather are a part's louder noise.

A part that is louder yet shows by hits in a row; a driver that glitches for a while has far larger
ones.
"""
ENDS = 256
"""Samples at both ends that do not count: what a low pass leaves is so quiet that they show."""
LOUDER = "louder in a part of the recording: its samples are no outliers"
HEAVY = "amplitudes are heavy-tailed (kurtosis {:.3g}, Gaussian 3): another law, not outliers"
PARTS = 16
"""Of a record, in which the hits are counted: an outlier comes at any time."""
GOLDEN = 0.6180339887498949
"""Multiples of it leave remainders that fill 0 to 1 evenly."""
ENOUGH = 2**18
"""Samples that tell a step or a median well enough."""
COARSEST = 5.0
"""Steps beyond this many standard deviations of the fast noise may hide it."""
LEAST_KNOWN = 0.05
"""Relative standard error of a standard deviation that is seen through the rounding."""


@dataclass(frozen=True)
class Contamination:
    """What contaminates the samples of one series.

    Attributes
    ----------
    observed : (n,) bool
        Samples that were recorded and are no outliers.
    effects : tuple of FittedEffect
        ``outliers`` and ``output_rounding`` where they are there.
    floor : float
        Two-sided white spectrum that the rounding adds, unit^2/Hz; negative where it takes some.
    notes : tuple of str
    worth : float
        Share of the samples' information that the rounding leaves.
    """

    observed: Mask
    effects: tuple[FittedEffect, ...]
    floor: float
    notes: tuple[str, ...]
    worth: float = 1.0


def find_contamination(series: Series, unit: str) -> Contamination:
    """Outliers and rounding of a series.

    Parameters
    ----------
    series : Series
    unit : str
        Unit of the channel.
    """
    seen = series.seen
    deviation = deviation_from_medians(seen, series.sample_time_s)
    step = rounding_step(seen[:ENOUGH]) or 0.0
    sigma = robust_sigma(deviation, step)
    rounded = _rounding(seen, deviation, step, sigma, series.sample_time_s, unit)
    hit = np.abs(deviation) > THRESHOLD * max(sigma, rounded.step)
    observed = series.observed
    effects: tuple[FittedEffect, ...] = rounded.effects
    notes = rounded.notes
    if hit.mean() > MOST_HIT:
        notes = (*notes, "far from Gaussian: many samples lie beyond 5 standard deviations")
    elif sigma > 0.0 and _louder(hit, deviation / sigma):
        notes = (*notes, LOUDER)
    elif sigma > 0.0 and _come_singly(hit, deviation, sigma):
        among = _hits_among(misfits(seen, hit), hit, rounded.step, unit)
        effects, notes = (*among.effects, *effects), (*notes, *among.notes)
        observed = observed.copy()
        observed[np.flatnonzero(series.observed)[among.hit]] = False
    return Contamination(observed, effects, rounded.floor, notes, rounded.worth)


def deviation_from_medians(seen: Floats, sample_time_s: float) -> Floats:
    """Samples less the course of their 2 s medians, (m,)."""
    size = max(LEAST_PER_BLOCK, round(MEDIAN_OVER_S / sample_time_s))
    count = seen.size // size
    if count < 2:
        return seen - np.median(seen)
    medians = np.median(seen[: count * size].reshape(count, size), axis=1)
    first, last = size // 2, size // 2 + (count - 1) * size
    share = (np.arange(size) + 0.5 * (1 - size % 2)) / size  # of the way between two middles
    between = medians[:-1, np.newaxis] + np.outer(np.diff(medians), share)
    deviation = seen.copy()
    deviation[:first] -= medians[0]
    deviation[first:last] -= between.ravel()
    deviation[last:] -= medians[-1]
    return deviation


def robust_sigma(deviation: Floats, step: float = 0.0) -> float:
    """1.4826 times the median absolute deviation; the standard deviation where that is zero.

    Values rounded to a step are first spread over it: a median is one of the steps, and may be a
    third less than that of what was rounded.
    """
    some = deviation[:: 1 + deviation.size // ENOUGH]
    if step > 0.0:
        some = some + step * (np.mod(GOLDEN * np.arange(some.size), 1.0) - 0.5)
    sigma = 1.4826 * float(np.median(np.abs(some)))
    return sigma if sigma > 0.0 else float(np.std(deviation))


def _come_singly(hit: Mask, deviation: Floats, sigma: float) -> bool:
    """Whether the hits are more, or larger, than Gaussian samples explain, and come singly."""
    where = np.flatnonzero(hit)
    if where.size == 0:
        return False
    expected = 2.0 * special.ndtr(-THRESHOLD) * hit.size
    largest = float(np.abs(deviation).max()) / sigma
    by_number = special.pdtrc(where.size - 1, expected)
    by_size = hit.size * 2.0 * special.ndtr(-largest)
    apart = 1 + int(np.sum(np.diff(where) > 5))
    return bool(min(by_number, by_size) < BY_CHANCE and 2 * apart > where.size)


def _louder(hit: Mask, unit: Floats) -> bool:
    """Whether hits are the louder noise of a part of the record."""
    _, scale = outlier_parameters(unit[hit], hit.size, 1.0)
    return scale < LOUDEST and _gather(hit)


def _gather(hit: Mask) -> bool:
    """Whether hits gather in a part of the record: chi-square of their number in equal parts."""
    parts = np.array([part.sum() for part in np.array_split(hit, PARTS)], dtype=float)
    expected = parts.sum() / PARTS
    if expected < 1.0:
        return False
    return bool(special.chdtrc(PARTS - 1, np.sum((parts - expected) ** 2) / expected) < BY_CHANCE)


@dataclass(frozen=True)
class _Hits:
    hit: Mask
    effects: tuple[FittedEffect, ...] = ()
    notes: tuple[str, ...] = ()


def _hits_among(misfit: Floats, doubtful: Mask, step: float, unit_name: str) -> _Hits:
    """Samples that are hits, where they are that and no distribution of long tails.

    Parameters
    ----------
    misfit : (m,) float64
        Samples less what the others say of them.
    doubtful : (m,) bool
        Those of which it is asked.
    """
    sigma = robust_sigma(misfit, step)
    hit = doubtful & (np.abs(misfit) > THRESHOLD * max(sigma, step))
    none = _Hits(np.zeros_like(hit))
    if sigma == 0.0 or not _come_singly(hit, misfit, sigma):
        return none
    unit = misfit / sigma
    if _louder(hit, unit):
        return replace(none, notes=(LOUDER,))
    even = misfit + step * (np.mod(GOLDEN * np.arange(hit.size), 1.0) - 0.5)
    ends = min(ENDS, hit.size // 16)
    coarse = step / sigma if step > sigma else 0.0  # then rounding hides what is smaller
    start = outlier_parameters(unit[hit], hit.size, max(coarse, 1.0))
    inner = even[ends : hit.size - ends] / sigma
    answer = hit_mixtures(inner, *start, THRESHOLD * coarse)
    if answer.rate > MOST_HIT or answer.tails > 0.0:
        kurtosis = float(np.mean(misfit**4) / np.mean(misfit**2) ** 2)
        return replace(none, notes=(HEAVY.format(kurtosis),))
    odds = answer.best.odds(unit)
    drawn = np.mod(GOLDEN * np.arange(hit.size), 1.0) < odds / (1.0 + odds)
    return _Hits(hit | (drawn & (coarse == 0.0)), (_outliers(answer, sigma, unit_name),))


def _outliers(answer: Answer, sigma: float, unit: str) -> FittedEffect:
    rate, scale = answer.rate, answer.scale * float(answer.best.spread) * sigma
    found = answer.rate_error**-2  # hits that would be known as well, were all of them seen
    low = 0.5 * float(special.chdtri(2.0 * found, 0.975)) / found
    high = 0.5 * float(special.chdtri(2.0 * found + 2.0, 0.025)) / found
    spread = float(np.exp(1.96 * answer.scale_error))
    return FittedEffect(
        Outliers(rate, scale),
        (
            Estimate(rate, rate * answer.rate_error, rate * low, rate * high, "1"),
            Estimate(scale, scale * answer.scale_error, scale / spread, scale * spread, unit),
        ),
    )


@dataclass(frozen=True)
class _Rounding:
    step: float
    floor: float
    effects: tuple[FittedEffect, ...]
    notes: tuple[str, ...] = ()
    worth: float = 1.0


def _rounding(
    seen: Floats, deviation: Floats, step: float, sigma: float, sample_time_s: float, unit: str
) -> _Rounding:
    if step == 0.0:
        return _Rounding(0.0, 0.0, ())
    if of_an_angle(seen, step, sample_time_s):
        return _Rounding(0.0, 0.0, (), (angle_note(step, sample_time_s, unit),))
    effect = OutputRounding(step)
    effects = (FittedEffect(effect, (Estimate(step, None, None, None, unit),)),)
    usual = np.abs(deviation) <= THRESHOLD * max(sigma, step)
    noise = rounded_noise(seen[usual], step)
    if noise is None:
        return _Rounding(step, effect.added_psd(sample_time_s), effects)
    most = noise.sigma * np.exp(1.96 * noise.relative_error) * np.sqrt(sample_time_s)
    note = (
        f"rounding to {step:.3g} {unit} hides the fast noise: white noise is known from how often "
        f"each value comes, if it is Gaussian, and is at most {most:.2g} {unit}/sqrt(Hz)"
    )
    hidden = step > COARSEST * noise.sigma or noise.relative_error > LEAST_KNOWN
    notes = (note,) if hidden else ()
    return _Rounding(step, noise.added * sample_time_s, effects, notes, noise.worth)
