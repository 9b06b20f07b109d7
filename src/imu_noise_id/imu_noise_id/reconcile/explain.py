"""Candidates: every effect of the catalogue that could close the gap on one channel, with its gain.

All gains are in nats of one objective, the likelihood of the record times the prior of the given
model, so that adding, refitting and removing compete on equal terms.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import fft

from imu_noise_id.effects.base import Effect
from imu_noise_id.effects.bias_step import BiasStep
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.effects.periodic import Periodic
from imu_noise_id.effects.random_telegraph import RandomTelegraph, decode
from imu_noise_id.effects.rate_ramp import RateRamp
from imu_noise_id.effects.temperature import Temperature
from imu_noise_id.effects.variance_change import VarianceChange, other_side, variance_scan
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.reconcile.amend import likely_starts, refits, removals, same_noise
from imu_noise_id.reconcile.battery import BURST_BLOCKS, band_places, band_starts
from imu_noise_id.reconcile.candidate import (
    PRICE_PER_PARAMETER,
    Candidate,
    candidate_of,
    count_of,
    given_count,
    rows_of,
)
from imu_noise_id.reconcile.compare import footings, with_column
from imu_noise_id.reconcile.lines import (
    beside_a_line,
    line_columns,
    line_span,
    steadied,
    strongest_line,
)
from imu_noise_id.reconcile.patches import band_gain, gain_of_fast
from imu_noise_id.reconcile.prior import (
    SLOW,
    without,
)
from imu_noise_id.reconcile.result import ADD, REFIT, REMOVE
from imu_noise_id.reconcile.smooth import best_course, without_steps
from imu_noise_id.reconcile.state import Analysis, State, analyse, course_column
from imu_noise_id.reconcile.steps import best_step
from imu_noise_id.recording import Floats
from imu_noise_id.selection import RESPONSES, SOURCES

PREFERENCE = 1.5
COURSES = ("temperature", "rate_ramp", "bias_step")
DRIFTS = (*SLOW, *COURSES)
TELEGRAPH_BLOCKS = 1500
LEAST_SLOW = 3.0
"""Nats of a slow term from which two levels are asked for."""
LEAST_JUMPS = 4
"""There and back twice."""
COLOURED_LOG_P = -9.0
BURST_ROUNDS, SETTLED = 4, 0.02
"""In which a burst is measured, till its ratio moves by less than that part."""
DISTINCTLY = 5.0
"""Nats by which one band must tell a window better than all of its noise: two names fit below."""
SAME_STEP_S, SAME_STEP = 1.0, 0.02
MOST_PER_CHANNEL = {"gauss_markov": 3, "narrow_band": 8, "periodic": 12, "bias_step": 6}


def candidates(
    state: State, found: Analysis, skip: frozenset[str] = frozenset()
) -> list[Candidate]:
    """Every candidate with a positive gain, best first; none that statistics to ``skip`` show."""
    out = [
        *_sources(state, found),
        *_responses(state, found),
        *_lines(state, found),
        *_courses(state, found),
        *([] if "burst" in skip else _bursts(state, found)),
        *refits(state, found),
        *removals(state, found),
    ]
    slow = [c for c in out if c.effect.name == "gauss_markov" and c.action != REMOVE]
    # one as slow as the model's own comes as its refit
    like = max(slow, key=lambda c: (c.action == ADD, c.net), default=None)
    if like is not None and like.gain > LEAST_SLOW and "levels" not in skip:
        out += _telegraph(state, found, like)
    return sorted((c for c in out if c.gain > 0.0), key=lambda c: -c.net - _preference(c))


def _preference(candidate: Candidate) -> float:
    """Nats in favour of one more kind of drift: values far outside their intervals are rarer.

    All kinds alike, or the bonus would choose among them; a course that the model has is one too.
    """
    kinds = DRIFTS if candidate.action == ADD else COURSES if candidate.action == REFIT else ()
    return PREFERENCE if candidate.effect.name in kinds else 0.0


def _sources(state: State, found: Analysis) -> list[Candidate]:
    out = []
    bases = footings(state, found)
    for kind in SOURCES:
        if count_of(state, kind.name) >= MOST_PER_CHANNEL.get(kind.name, 1):
            continue
        tried = []
        for effects, residual in bases:
            for start in band_starts(residual) if kind is NarrowBand else kind.starts(residual):
                price = PRICE_PER_PARAMETER * len(start.free())
                grown = replace(state, effects=(*effects, start))
                trial = candidate_of(ADD, start, price, found, grown)
                tried.append(replace(trial, price=price + _place_price(trial.effect, state)))
        own = [c for c in tried if not same_noise(c.effect, state.effects[: given_count(state)])]
        out += sorted(own, key=lambda c: -c.net)[:1]
    if not count_of(state, "white_noise"):
        low = float(np.quantile(found.ordinates.power, 0.1))
        start = WhiteNoise(float(np.sqrt(max(low, 1e-300))))
        grown = replace(state, effects=(*found.fit.effects, start))
        out.append(candidate_of(ADD, start, PRICE_PER_PARAMETER, found, grown))
    return out


def _place_price(effect: Effect, state: State) -> float:
    """Nats for the search of a frequency: log of how many places there are.

    The price of the parameter itself pays for e^3 of them.
    """
    n, dt = state.values.size, state.sample_time_s
    if isinstance(effect, NarrowBand):
        places = band_places(effect, n, dt)
    elif isinstance(effect, Periodic):
        places = float(n)  # sought at every half spacing
    else:
        return 0.0
    return max(float(np.log(places)) - PRICE_PER_PARAMETER, 0.0)


def _responses(state: State, found: Analysis) -> list[Candidate]:
    """Filters; what they cut may have been louder before them, so the level beneath is free."""
    out: list[Candidate] = []
    if any(count_of(state, kind.name) for kind in RESPONSES):
        return out
    for kind in RESPONSES:
        for start in likely_starts(kind, state, found, found.fit.spectrum.psd):
            price = PRICE_PER_PARAMETER * len(start.free())
            grown = replace(state, effects=(*found.fit.effects, start))
            out.append(_at_its_level(candidate_of(ADD, start, price, found, grown), found))
    return out


def _at_its_level(filtered: Candidate, before: Analysis) -> Candidate:
    """A filter weighed with the white noise free beneath it, where that explains it better.

    What a filter folds back raises the level that is seen, so that the right one with the old level
    may fit worse than a wrong one.  The level is refitted in a step of its own.
    """
    state = filtered.state
    index = next((i for i, e in enumerate(state.effects) if isinstance(e, WhiteNoise)), None)
    if index is None or index >= given_count(state):
        return filtered
    free = replace(state, prior=without(state.prior, rows_of(state, index)))
    gain, price = analyse(free).objective - before.objective, filtered.price + PRICE_PER_PARAMETER
    if gain - price <= filtered.net:
        return filtered
    alone = replace(before.state, effects=before.fit.effects, prior=free.prior)
    if gain - (analyse(alone).objective - before.objective) <= filtered.price:
        return filtered  # the level gains it, and a filter that does nothing comes with it
    return replace(filtered, gain=gain, price=price)


def _lines(state: State, found: Analysis) -> list[Candidate]:
    if count_of(state, "periodic") >= 2 * MOST_PER_CHANNEL["periodic"]:
        return []
    return [*_steady_line(state, found), *_passing_line(state, found)]


def _passing_line(state: State, found: Analysis) -> list[Candidate]:
    """The strongest line, if it is there for a while only: from and to are two parameters more."""
    seen = line_span(found.white.samples, state.sample_time_s)
    if seen is None:
        return []
    frequency_hz, *ends = seen
    start_s, end_s = (state.start_s + state.sample_time_s * end for end in ends)
    pair = line_columns(frequency_hz, state, (start_s, end_s))
    if beside_a_line(pair, state):
        return []
    grown = replace(state, columns=(*state.columns, *pair), effects=found.fit.effects)
    price = 4.0 * PRICE_PER_PARAMETER + _place_price(pair[0].effect, state)
    trial = candidate_of(ADD, pair[0].effect, price, found, grown)
    amplitude = float(np.hypot(*trial.found.sizes[-2:]))
    return [replace(trial, effect=Periodic(frequency_hz, max(amplitude, 1e-300)))]


def _steady_line(state: State, found: Analysis) -> list[Candidate]:
    frequency_hz = strongest_line(found.white.samples, state.sample_time_s)
    pair = line_columns(frequency_hz, state)
    if beside_a_line(pair, state):
        return []
    grown = replace(state, columns=(*state.columns, *pair), effects=found.fit.effects)
    trial = candidate_of(ADD, pair[0].effect, 0.0, found, grown)
    amplitude = float(np.hypot(*trial.found.sizes[-2:]))
    price = 2.0 * PRICE_PER_PARAMETER + _place_price(pair[0].effect, state)
    steady, wander = steadied(trial.state, trial.found, len(state.columns))
    if wander:
        trial = candidate_of(ADD, pair[0].effect, 0.0, found, steady)
        price += wander
    return [replace(trial, effect=Periodic(frequency_hz, max(amplitude, 1e-300)), price=price)]


def _courses(state: State, found: Analysis) -> list[Candidate]:
    out = []
    if count_of(state, "bias_step") < MOST_PER_CHANNEL["bias_step"]:
        best = best_step(state, found)
        if (
            best.gain > 0.0
            and not _known_step(state, best.time_s, best.gain)
            and not smoother(best.state, best.found)
        ):
            step, price = BiasStep(best.time_s, best.height), 2.0 * PRICE_PER_PARAMETER
            out.append(Candidate(ADD, step, best.gain, price, best.state, best.found))
    if not count_of(state, "rate_ramp"):
        out.append(_course(state, found, RateRamp(1.0), "slope", 1))
    T = state.temperature
    if T is not None and float(np.ptp(T)) > 1e-6 and not count_of(state, "temperature"):
        out.append(_course(state, found, Temperature(1.0), "coefficient", 1))
    return out


def smoother(state: State, found: Analysis) -> bool:
    """Whether one smooth course in place of all steps that were added explains a record better.

    It has a length too, one parameter more than a single step.
    """
    bare, steps = without_steps(state)
    course = best_course(bare)
    if course is None:
        return False
    more = PRICE_PER_PARAMETER * (3.0 - 2.0 * steps)
    return course.objective - more > found.objective + DISTINCTLY


def _known_step(state: State, time_s: float, gain: float) -> bool:
    """Whether the given model has a step there: then that one is to be refitted, not doubled.

    There: as far off as the place of a step of so many nats is uncertain.
    """
    uncertain_s = 2.0 * state.values.size * state.sample_time_s / (2.0 * gain)
    reach_s = max(SAME_STEP_S, SAME_STEP * time_s, uncertain_s)
    steps = [c.effect for c in state.columns if c.given]
    return any(isinstance(e, BiasStep) and abs(e.time_s - time_s) < reach_s for e in steps)


def _course(
    state: State, found: Analysis, effect: Effect, size_name: str, parameters: int
) -> Candidate:
    column = course_column(effect, state, size_name)  # type: ignore[arg-type]
    after = with_column(state, found, column)
    grown = replace(after.state, effects=after.fit.effects)
    fitted = effect.replace(**{size_name: float(after.sizes[-1])})
    gain, price = after.objective - found.objective, PRICE_PER_PARAMETER * parameters
    return Candidate(ADD, fitted, gain, price, grown, after)


def quieten(found: Analysis, first: int, last: int, ratio: float) -> tuple[Floats, float]:
    """Values as they would be without the fast noise of [first, last) ``ratio`` times as loud.

    The slow parts go on beneath it, so that an ordinate of which the fast noise is the share s is
    louder by 1 + (ratio - 1) s.  A moving mean would keep the white noise below its own cutoff,
    which a long burst shows as a slow noise.

    Returns
    -------
    values : (n,) float64
    log_volume : float
        Logarithm of the volume by which that scales the record, what its density gains: of the
        window's share of the ordinates.
    """
    state = found.state
    gain = 1.0 / np.sqrt(1.0 + (ratio - 1.0) * fast_share(found))
    louder = fft.idct(found.coefficients * (1.0 - gain), norm="ortho")
    out = state.values.copy()
    out[first:last] -= louder[first:last]
    log_volume = (last - first) / out.size * float(np.sum(np.log(gain)))
    return out, log_volume


def fast_share(found: Analysis) -> Floats:
    """Part of the power that is fast noise, the fit's white noise or what is left at the top."""
    inverse = found.inverse_psd
    densities = [e.density for e in found.fit.effects if isinstance(e, WhiteNoise)]
    upper = float(np.median(1.0 / inverse[inverse.size // 2 :]))
    level = max(sum(d * d for d in densities) + found.state.floor, upper)
    return np.asarray(np.minimum(level * inverse, 1.0))


def _bursts(state: State, found: Analysis) -> list[Candidate]:
    """The window of other variance; where it reaches an end of the record, the rest of it too.

    Both fit alike: which of the two levels is the given model's decides between them.
    """
    white = found.white.samples
    first, last, _, gain, _ = variance_scan(white, BURST_BLOCKS)
    if gain < 6.0:
        return []
    first, last = _sharpen(white, first, last, white.size // BURST_BLOCKS)
    whole, band = band_gain(white, first, last)
    whole = max(whole, gain_of_fast(white, first, last, fast_share(found)))
    if band > whole + DISTINCTLY:
        return []  # one band comes or goes, and the noise is what it was
    windows = [(first, last), other_side(first, last, white.size)]
    out = [_burst(state, found, *window) for window in windows if window is not None]
    return [burst for burst in out if burst is not None]


def _burst(state: State, found: Analysis, first: int, last: int) -> Candidate | None:
    white = found.white.samples
    if loudest_log_p(white[first:last]) < COLOURED_LOG_P:
        return None  # a tone or a ring that is there for a while, and no noise that is louder
    under, ratio = found, 0.0
    for _ in range(BURST_ROUNDS):  # the burst is in the fit by which it is measured
        before, ratio = ratio, _loudness(under, first, last)
        if abs(ratio - before) < SETTLED * ratio:
            break
        values, log_volume = quieten(under, first, last, ratio)
        quiet = state.with_values(values)
        after = analyse(replace(quiet, effects=found.fit.effects))
        under = replace(found, fit=after.fit)
    times = state.start_s + state.sample_time_s * np.array([first, last])
    effect = VarianceChange(float(times[0]), float(times[1]), ratio)
    quiet = replace(quiet, effects=after.fit.effects)
    gain = after.objective - found.objective + log_volume
    return Candidate(ADD, effect, gain, 3.0 * PRICE_PER_PARAMETER, quiet, after)


def _loudness(found: Analysis, first: int, last: int) -> float:
    """Variance of the fast noise of [first, last) over that outside."""
    white = found.white.samples
    inside = float(np.mean(white[first:last] ** 2))
    outside = float(np.mean(np.concatenate((white[:first], white[last:])) ** 2))
    if inside <= outside:
        return inside / outside
    # what is louder is the fast noise alone
    return 1.0 + (inside / outside - 1.0) / float(np.mean(fast_share(found)))


def loudest_log_p(samples: Floats) -> float:
    """Logarithm of the chance of the largest of white samples' ordinates over their mean.

    With m ordinates of mean 1 the largest share g of the sum: m (1 - g)^(m - 1) (Fisher 1929).
    """
    power = np.abs(fft.rfft(samples)[1 : (samples.size + 1) // 2]) ** 2
    m, total = power.size, float(power.sum())
    if m < 2 or total <= 0.0:
        return 0.0
    share = min(float(power.max()) / total, 1.0 - 1e-12)
    return min(float(np.log(m) + (m - 1) * np.log1p(-share)), 0.0)


def _sharpen(white: Floats, first: int, last: int, block: int) -> tuple[int, int]:
    """Edges of a burst to the sample: the best within a block of either side."""
    energy = np.concatenate(([0.0], np.cumsum(white**2)))
    n = white.size

    def gain(i: np.ndarray, j: np.ndarray) -> Floats:
        inside = energy[j] - energy[i]
        m = (j - i).astype(float)
        outside = energy[-1] - inside
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(
                -m * np.log(inside / m) - (n - m) * np.log(outside / np.maximum(n - m, 1.0))
            )

    starts = np.arange(max(first - block, 0), min(first + block, last - 2) + 1)
    if first > 0:
        first = int(starts[np.nanargmax(gain(starts, np.full(starts.size, last)))])
    ends = np.arange(max(last - block, first + 2), min(last + block, n) + 1)
    if last < n - block:
        last = int(ends[np.nanargmax(gain(np.full(ends.size, first), ends))])
    return first, last


def _telegraph(state: State, found: Analysis, like: Candidate) -> list[Candidate]:
    """Two levels with the spectrum of a Gauss-Markov candidate, decoded from block means.

    Whittle's likelihood of the record without the decoded course, plus what the hidden Markov model
    says of all courses against that one.
    """
    if count_of(state, "random_telegraph"):
        return []
    dwell_s = 2.0 * float(like.effect.correlation_time_s)  # type: ignore[attr-defined]
    n = state.values.size
    block = max(int(dwell_s / state.sample_time_s / 16.0), n // TELEGRAPH_BLOCKS, 1)
    count = n // block
    if count < 50:
        return []
    rest = np.asarray(fft.idct(found.coefficients, norm="ortho"))
    means = rest[: count * block].reshape(count, block).mean(axis=1)
    decoded = decode(means, dwell_s / state.sample_time_s / block)
    if np.count_nonzero(np.diff(decoded.upper)) < LEAST_JUMPS:
        return []  # a step, or a course that was taken for one
    course = np.repeat(decoded.upper, block).astype(float)
    course = np.concatenate((course, np.full(n - course.size, course[-1])))
    height = decoded.high - decoded.low
    effect = RandomTelegraph(height, decoded.mean_dwell * block * state.sample_time_s)
    blocks = analyse(
        replace(state.with_values(state.values - height * course), effects=found.fit.effects)
    )
    gain = blocks.objective - found.objective
    gain += decoded.log_likelihood - decoded.path_log_likelihood
    # to the sample only in what is taken out: in the gain the places of the jumps are not paid for
    course = to_the_sample(course, rest - 0.5 * (decoded.high + decoded.low), block)
    cleaned = state.with_values(state.values - height * course)
    after = analyse(replace(cleaned, effects=blocks.fit.effects))
    settled = replace(cleaned, effects=after.fit.effects)
    return [Candidate(ADD, effect, gain, 2.0 * PRICE_PER_PARAMETER, settled, after)]


def to_the_sample(course: Floats, values: Floats, reach: int) -> Floats:
    """Course of two levels with every jump at its most likely place within ``reach`` samples.

    ``values`` are counted from midway between the levels: before a jump upwards their sum is least,
    before one downwards greatest.  A pulse of blocks left at every edge was a Gauss-Markov term.
    """
    out = course.copy()
    total = np.concatenate(([0.0], np.cumsum(values)))
    jumps = np.flatnonzero(np.diff(course)) + 1
    ends = np.concatenate((jumps, [course.size]))
    last = 0
    for jump, end in zip(jumps.tolist(), ends[1:].tolist(), strict=True):
        low, high = (
            max(jump - reach, last + 1),
            min(jump + reach, (jump + end) // 2, course.size - 1),
        )
        sign = course[jump] - course[jump - 1]
        at = low + int(np.argmin(sign * total[low : high + 1]))
        out[min(at, jump) : max(at, jump)] = course[jump] if at < jump else course[jump - 1]
        last = at
    return out
