"""What hides the noise: holds, clipping, rounding and hits, found on the samples themselves.

These come before every likelihood: a hit passes for louder white noise, rounding for white noise, a
hold for another noise on every channel.  Each function compares what the samples show with what the
model says and returns the difference, if there is one, with samples that are free of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, gammaincc, ndtr, ndtri

from imu_noise_id.effects.base import Effect
from imu_noise_id.effects.dropouts import Dropouts, dropout_parameters, gap_lengths
from imu_noise_id.effects.held_samples import HeldSamples, fresh_samples, held_factor
from imu_noise_id.effects.outliers import THRESHOLD, Outliers, outlier_mask, outlier_parameters
from imu_noise_id.effects.output_rounding import FINEST, OutputRounding, rounding_step
from imu_noise_id.effects.quantization import Quantization
from imu_noise_id.effects.saturation import Saturation, saturation_limit
from imu_noise_id.effects.timestamp_jitter import TimestampJitter, jitter_std
from imu_noise_id.hits import NO_HITS, Answer, Mixture, hit_mixtures
from imu_noise_id.reconcile.compare import Finding
from imu_noise_id.reconcile.impulses import robust_sigma
from imu_noise_id.reconcile.null import z_of
from imu_noise_id.reconcile.result import ADD, REFIT, REMOVE, Where
from imu_noise_id.recording import Channel, Floats, Mask

CERTAIN_Z = 60.0
SAME_STEP = 0.03
LEAST_HELD_SAMPLES = 64
MOST_OF_ALL = 0.5
JITTER_RESOLUTION_S = 1e-6
GOLDEN = 0.6180339887498949
"""Multiples of it lie evenly between whole numbers, in no order."""
TAIL_BANDS = (2.5, 3.0, 3.5, 4.0, 4.5, 5.0)


@dataclass(frozen=True)
class Change:
    """A difference between samples and model that needs no likelihood to be seen.

    Attributes
    ----------
    action : str
    effect : Effect
    log_p : float
        Chance of seeing it under the model.
    where : Where
    """

    action: str
    effect: Effect
    log_p: float
    where: Where


def finding_of(change: Change) -> Finding:
    """A change as a statistic that the model leaves unanswered."""
    return Finding(change.effect.name, change.log_p, z_of(change.log_p), change.where)


def timing_changes(channel: Channel, given: dict[str, Effect], log_level: float) -> list[Change]:
    """Differences in gaps and jitter of one topic's stamps.

    Parameters
    ----------
    channel : Channel
        Any of the topic's.
    given : dict
        The model's transport effects of the topic by name.
    log_level : float
        Logarithm of the p-value below which a difference counts.
    """
    found = [*_dropouts(channel, given.get("dropouts")), *_jitter(channel, given)]
    return [change for change in found if change.log_p < log_level]


def _dropouts(channel: Channel, given: Effect | None) -> list[Change]:
    rate, length_s = dropout_parameters(channel.stamp_ns, channel.rate_hz)
    duration_s = max(channel.duration_s, 1e-9)
    gaps = gap_lengths(channel.stamp_ns, channel.rate_hz).size
    place = Where("timing", 0.0, duration_s, "s", float(np.sqrt(gaps)))
    if not isinstance(given, Dropouts):
        if gaps == 0:
            return []
        log_p = -2.0 * gaps - 6.0  # a model without gaps shows none
        return [Change(ADD, Dropouts(rate, length_s), log_p, place)]
    expected = given.rate * duration_s
    tail = 1.0 - gammaincc(gaps, expected) if gaps > expected else gammaincc(gaps + 1, expected)
    log_p = float(np.log(np.clip(2.0 * tail, 1e-300, 1.0)))
    if gaps == 0:
        return [Change(REMOVE, given, log_p, place)]
    ratio = gaps * length_s / given.mean_length_s  # geometric lengths: about gamma
    spread = min(chdtrc(2.0 * gaps, 2.0 * ratio), 1.0 - chdtrc(2.0 * gaps, 2.0 * ratio))
    log_p = min(log_p, float(np.log(np.clip(2.0 * spread, 1e-300, 1.0)))) + float(np.log(2.0))
    return [Change(REFIT, Dropouts(rate, length_s), log_p, place)]


def _jitter(channel: Channel, given: dict[str, Effect]) -> list[Change]:
    seen = jitter_std(channel.stamp_ns, channel.rate_hz)
    said = given.get("timestamp_jitter")
    expected = said.std_s if isinstance(said, TimestampJitter) else 0.0
    floor = max(JITTER_RESOLUTION_S, 1e-4 / channel.rate_hz)
    if max(seen, expected) < floor:
        return []
    # second differences of n stamps: about n/2.8 degrees of freedom
    dof = max(channel.stamp_ns.size / 2.8, 1.0)
    z = float(np.log(max(seen, floor) / max(expected, floor)) * np.sqrt(2.0 * dof))
    place = Where("timing", 0.0, seen, "s", float(np.clip(z, -CERTAIN_Z, CERTAIN_Z)))
    log_p = -0.5 * z * z if abs(z) > 2.0 else 0.0
    if seen < floor and said is not None:
        return [Change(REMOVE, said, log_p, place)]
    action = REFIT if expected > 0.0 else ADD
    return [Change(action, TimestampJitter(max(seen, floor)), log_p, place)]


def hold_change(values: list[Floats], given: Effect | None) -> tuple[Change | None, float]:
    """Difference in held samples of one topic, and the factor that its samples show."""
    seen = held_factor(values)
    said = given.factor if isinstance(given, HeldSamples) else 1.0
    if (values and values[0].size / seen < LEAST_HELD_SAMPLES) or seen < 1.02:
        seen = 1.0
    if abs(seen / said - 1.0) < 0.02:
        return None, said
    place = Where("timing", seen, seen, "1", CERTAIN_Z)
    log_p = -0.5 * CERTAIN_Z**2
    if seen == 1.0:
        assert given is not None
        return Change(REMOVE, given, log_p, place), 1.0
    return Change(ADD if said == 1.0 else REFIT, HeldSamples(seen), log_p, place), seen


def fresh_index(values: list[Floats], factor: float) -> NDArray[np.int64]:
    """Samples that are new, one per hold."""
    n = values[0].size
    if factor == 1.0:
        return np.arange(n)
    fresh = np.flatnonzero(np.any([fresh_samples(v) for v in values], axis=0))
    if factor != round(factor):
        return fresh
    step = round(factor)
    phase = int(np.argmax(np.bincount(fresh % step, minlength=step)))
    return np.arange(phase, n, step)


def rounding_change(values: Floats, given: Effect | None) -> tuple[Change | None, float]:
    """Difference in the comb of the values, and the step that they show (0.0: none)."""
    seen = rounding_step(values) or 0.0
    said = given.step if isinstance(given, OutputRounding) else 0.0
    spread = float(np.std(values))
    if said and (abs(seen / said - 1.0) < SAME_STEP or (not seen and said < 2.0 * FINEST * spread)):
        return None, said
    if seen == said:
        return None, seen
    place = Where("amplitude", 0.0, seen, "step", CERTAIN_Z)
    log_p = -0.5 * CERTAIN_Z**2
    if not seen:
        assert given is not None
        return Change(REMOVE, given, log_p, place), 0.0
    return Change(REFIT if said else ADD, OutputRounding(seen), log_p, place), seen


def angle_change(
    comb: Change, step: float, sample_time_s: float, given: dict[str, Effect]
) -> Change | None:
    """The comb of an angle's rounding, differenced: quantization, if the model has none yet."""
    if "quantization" in given:
        return None
    return replace(comb, effect=Quantization(step * sample_time_s / float(np.sqrt(12.0))))


def saturation_change(
    values: Floats, given: Effect | None, rng: np.random.Generator
) -> tuple[Change | None, Floats]:
    """Difference in clipping, and samples drawn from beyond the limit in place of clipped ones."""
    limit, count = saturation_limit(values)
    said = given.limit if isinstance(given, Saturation) else None
    if limit is None:
        reached = said is not None and float(np.abs(values).max()) > said * (1.0 + 1e-6)
        if not reached or given is None:
            return None, values
        place = Where("amplitude", 0.0, float(np.abs(values).max()), "limit", CERTAIN_Z)
        return Change(REMOVE, given, -0.5 * CERTAIN_Z**2, place), values
    mended = _beyond(values, limit, rng)
    if said is not None and abs(limit / said - 1.0) < 0.01:
        return None, mended
    place = Where("amplitude", limit, limit, "limit", min(float(np.sqrt(count)), CERTAIN_Z))
    return Change(REFIT if said else ADD, Saturation(limit), -1.5 * count, place), mended


def _beyond(values: Floats, limit: float, rng: np.random.Generator) -> Floats:
    """Clipped samples replaced by draws of a normal law beyond the limit."""
    out = values.copy()
    middle = float(np.median(values))
    low, high = np.quantile(values, [0.16, 0.5])
    lower_side = float(high - low)
    low2, high2 = np.quantile(values, [0.5, 0.84])
    sigma = max(lower_side, float(high2 - low2)) / 0.9945
    for sign in (1.0, -1.0):
        clipped = sign * values >= limit * (1.0 - 1e-9)
        if not clipped.any() or sigma <= 0.0:
            continue
        edge = ndtr(-(limit - sign * middle) / sigma)
        tail = -ndtri(np.maximum(edge * rng.random(int(clipped.sum())), 1e-300))
        out[clipped] = sign * (sign * middle + sigma * np.maximum(tail, 0.0))
    return out


@dataclass(frozen=True)
class Hits:
    """Outliers seen in a whitened record.

    Attributes
    ----------
    answer : Answer
    chance : (n,) float64
        That a sample was hit.
    log_p : float
        Chance of as many beyond the threshold, or of one as far out, without hits.
    """

    answer: Answer
    chance: Floats
    log_p: float

    @property
    def errors(self) -> dict[str, float]:
        """Standard errors of the parameters' logarithms."""
        return {"rate": self.answer.rate_error, "scale": self.answer.scale_error}

    @property
    def mask(self) -> Mask:
        """Samples that are more likely hit than not."""
        return np.asarray(self.chance > 0.5)

    def drawn(self, rng: np.random.Generator) -> Mask:
        """Samples that were hit, drawn by their chances: what is left has the noise's own law.

        Without all that are more likely hit than not, the noise would be without its tails.
        """
        return np.asarray(rng.random(self.chance.size) < self.chance)


def find_hits(white: Floats, step: float = 0.0) -> Hits:
    """Hits among unit white samples, sought where any lies beyond ``THRESHOLD`` robust sigma.

    Parameters
    ----------
    white : (n,) float64
    step : float
        To which the samples were rounded: they are spread over it, or the counts show the comb.
    """
    centred = white - np.median(white)
    first = outlier_mask(white)
    count = int(first.sum())
    no_hits = Answer(NO_HITS, 0.0, 0.0, 0.0, 0.0)
    none = Hits(no_hits, np.zeros(white.size), 0.0)
    if count == 0:
        return none
    unit = centred / robust_sigma(centred)
    rate, scale = outlier_parameters(unit[first], white.size, 1.0)
    if rate > MOST_OF_ALL:
        return none  # no few among many: another distribution, which the amplitudes show
    even = centred + step * (np.arange(white.size) * GOLDEN % 1.0 - 0.5)
    answer = hit_mixtures(even / robust_sigma(even), rate, scale)
    expected = white.size * 2.0 * ndtr(-THRESHOLD)
    many = 1.0 - gammaincc(count, expected)
    far = min(white.size * 2.0 * ndtr(-float(np.abs(unit).max())), 1.0)
    log_p = float(np.log(max(many, 1e-300))), float(np.log(max(far, 1e-300)))
    odds = answer.best.odds(unit)
    return Hits(answer, odds / (1.0 + odds), min(log_p) + float(np.log(2.0)))


def hit_effect(hits: Hits, sigma: float) -> Outliers:
    """The effect that plays such hits on a channel whose samples have deviation ``sigma``."""
    return Outliers(hits.answer.rate, hits.answer.scale * sigma)


def tails_log_p(white: Floats, mixed: Mixture) -> float:
    """Chance of the counts between 2.5 and 5 sigma under a mixture of clean samples and hits."""
    centred = np.abs(white - np.median(white))
    unit = centred / (1.4826 * float(np.median(centred)))
    edges = np.array(TAIL_BANDS)
    seen = np.histogram(unit, edges)[0].astype(float)
    clean = 2.0 * (ndtr(-edges[:-1] / mixed.spread) - ndtr(-edges[1:] / mixed.spread))
    hit = np.diff(mixed.within(edges))
    rate = mixed.rate
    expected = unit.size * ((1.0 - rate) * clean + rate * hit)
    # the hits' law is not the mixture's to the letter: their number there is known to a third
    variance = expected + (0.3 * unit.size * rate * hit) ** 2
    chi2 = float(np.sum((seen - expected) ** 2 / variance))
    return float(np.log(max(chdtrc(seen.size, chi2), 1e-300)))


def mend(values: Floats, mask: Mask, white_sigma: float, rng: np.random.Generator) -> Floats:
    """Values with the masked samples between their neighbours, scattered like the others."""
    if not mask.any() or mask.all():
        return values
    out = values.copy()
    out[mask] = _bridge(values, mask) + rng.normal(0.0, white_sigma, int(mask.sum()))
    return out


def _bridge(values: Floats, mask: Mask, least: int = 32) -> Floats:
    """Lines between the levels on both sides of each masked stretch, at the masked samples.

    A level is the mean of as many unmasked samples as the stretch has, and of 32 at least: that of
    fewer would put their noise, which the samples between had not in common, into a long stretch.
    """
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.view(np.int8), [0]))))
    begin, length = edges[::2], edges[1::2] - edges[::2]
    kept = values[~mask]
    total = np.concatenate(([0.0], np.cumsum(kept - kept[0])))
    place = begin - (np.cumsum(length) - length)  # unmasked samples before each stretch
    reach = np.maximum(length, least)
    low, high = np.maximum(place - reach, 0), np.minimum(place + reach, kept.size)
    # where the record begins or ends masked, the level of the other side
    until, since = np.where(low < place, place, high), np.where(place < high, place, low)
    before = kept[0] + (total[until] - total[low]) / (until - low)
    after = kept[0] + (total[high] - total[since]) / (high - since)
    part = np.arange(int(length.sum())) - np.repeat(np.cumsum(length) - length, length) + 1
    share = part / np.repeat(length + 1, length)
    return np.asarray(np.repeat(before, length) + share * np.repeat(after - before, length))
