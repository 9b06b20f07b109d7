"""First part of reconciliation: take away, and name, what is not noise by its spectrum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imu_noise_id.dither import dithered
from imu_noise_id.effects.base import Effect, StochasticEffect, TransportEffect
from imu_noise_id.effects.held_samples import HeldSamples
from imu_noise_id.effects.output_rounding import OutputRounding
from imu_noise_id.effects.periodic import Periodic
from imu_noise_id.effects.saturation import one_sided_limit
from imu_noise_id.effects.variance_change import VarianceChange
from imu_noise_id.lattice import angle_note, of_an_angle
from imu_noise_id.model import ChannelModel
from imu_noise_id.ordinates import fast_length
from imu_noise_id.reconcile import unrounded
from imu_noise_id.reconcile.compare import Finding
from imu_noise_id.reconcile.contamination import (
    Change,
    angle_change,
    finding_of,
    fresh_index,
    hold_change,
    mend,
    rounding_change,
    saturation_change,
    timing_changes,
)
from imu_noise_id.reconcile.explain import quieten
from imu_noise_id.reconcile.filling import (
    filled,
    filled_as_heard,
    hollow_spectrum,
    lifted,
)
from imu_noise_id.reconcile.lines import PRESENT_NATS, given_span, has_span, line_index, steadied
from imu_noise_id.reconcile.null import load_null, log_p_of, z_of
from imu_noise_id.reconcile.outliers import answer_hits
from imu_noise_id.reconcile.prior import given_effects
from imu_noise_id.reconcile.result import ADD, REFIT, REMOVE, Where
from imu_noise_id.reconcile.state import State, analyse, inverse_psd
from imu_noise_id.reconcile.unrounded import (
    SHORTEST,
    first_draw,
    too_few_values,
    white_deviation,
    white_stride,
)
from imu_noise_id.reconcile.work import (
    GIVEN_LOG_P,
    TYPED_SIZE_ERROR,
    Work,
    drafted,
    initial_state,
    variance_within,
)
from imu_noise_id.recording import DERIVED, Channel, Floats, Recording
from imu_noise_id.series import Series, to_series

COARSE = 0.8
MOST_BRIDGED = 0.01
"""Share of missing samples that may be bridged: what is slow has as much more power."""
STAIRS = frozenset(
    {"kurtosis", "skewness", "extreme", "burst", "patch", "levels", "modulation", "line"}
)
"""Statistics of what stands still for a while and jumps, under any spectrum."""
_ONE_SIDED = (
    "samples pile up at {:.4g} {} and go beyond it on the other side: clipped on one side only, "
    "which no full scale does"
)
_STAIRS = "in steps of {:.3g} {} it hardly moves from one sample to the next: {} alone is compared"
_DRAWN = (
    "steps of {:.3g} {} are {:.1f} standard deviations of its noise, {} distinct values: what is "
    "compared are draws of what was rounded"
)
_NOISELESS = (
    "the model has no noise here: its gap is told as if it had a millionth of the recording's"
)
ON_A_STEP = 0.1
"""Steps from the nearest multiple; what was mended is nowhere."""
NOISELESS = 1e-6
"""Of the record's own fast noise under a model that has none, which no finite gap is from."""


def open_topic(
    channels: list[Channel],
    models: dict[str, ChannelModel],
    recording: Recording,
    log_level: float,
    rng: np.random.Generator,
) -> list[Work]:
    """Work on every channel of one topic, with its transport and its contamination answered."""
    given: dict[str, Effect] = {}
    for channel in channels:
        for fitted in models[channel.name].effects:
            if isinstance(fitted.effect, TransportEffect):
                given.setdefault(fitted.name, fitted.effect)
    timing = timing_changes(channels[0], given, log_level)
    measured = [c for c in channels if c.name not in DERIVED] or channels
    hold, factor = hold_change([c.values for c in measured], given.get("held_samples"))
    series = {c.name: to_series(c, recording.start_ns) for c in channels}
    grids = [series[c.name].values for c in measured]
    fresh = fresh_index(grids, factor) if len({g.size for g in grids}) == 1 else None
    out = []
    for channel in channels:
        model = models[channel.name]
        whole = series[channel.name]
        if whole.values.size < SHORTEST or np.ptp(whole.values[whole.observed]) == 0.0:
            continue
        if too_few_values(channel, model):
            continue
        picked = fresh if fresh is not None else np.arange(whole.values.size)
        said = given.get("held_samples")
        given_hold = said.factor if isinstance(said, HeldSamples) else 1.0
        work = _open(channel, model, whole, recording, given_hold, picked, factor, rng)
        changes = [*timing, *([hold] if hold else [])]
        out.append(_settle(work, changes, whole, recording, picked, factor, rng))
    return out


def _open(
    channel: Channel,
    model: ChannelModel,
    whole: Series,
    recording: Recording,
    given_hold: float,
    picked: np.ndarray,
    factor: float,
    rng: np.random.Generator,
) -> Work:
    """Work on the samples as they are (thinned as the model says), nothing answered yet."""
    index = picked if given_hold == factor else np.arange(whole.values.size)
    hold = factor if given_hold == factor else 1.0
    state = _state(model, whole, recording, index, hold, rng)
    null = load_null(state.values.size, state.sample_time_s)
    work = Work(channel, model, null, state, analyse(state), hold)
    silent = not _has_noise(state) and model.find("output_rounding") is None
    notes = (_NOISELESS,) if silent else ()
    return replace(work, skip=_skips(model, work), notes=notes)


def _has_noise(state: State) -> bool:
    return any(isinstance(e, StochasticEffect) for e in state.effects)


def _skips(model: ChannelModel, work: Work) -> frozenset[str]:
    skip = set()
    if model.find("random_telegraph"):
        skip.add("levels")
    if model.find("outliers"):
        skip |= {"extreme", "kurtosis"}
    return frozenset(skip) | _coarse(work.state)


def _coarse(state: State) -> frozenset[str]:
    """Rounding that shows in the distribution even under the right model."""
    coarse = state.rounding_step > COARSE * _neighbours_deviation(state)
    return frozenset({"kurtosis", "extreme"}) if coarse else frozenset()


def _neighbours_deviation(state: State) -> float:
    """Of a sample from its neighbours: what is fast, whatever drifts beneath it."""
    return max(float(np.sqrt(0.5 * np.mean(np.diff(state.values) ** 2))), 1e-300)


def _state(
    model: ChannelModel,
    whole: Series,
    recording: Recording,
    index: np.ndarray,
    hold: float,
    rng: np.random.Generator,
) -> State:
    index = index[: fast_length(index.size)]  # a transform of a prime length costs ten times more
    values, missing = whole.values[index], ~whole.observed[index]
    values = mend(values, missing, _fast_sigma(values, missing), rng)
    dt = whole.sample_time_s * hold
    start_s = whole.start_s + float(index[0]) * whole.sample_time_s
    temperature = None
    if recording.temperature is not None and recording.temperature.values.size > 1:
        regressor = recording.temperature
        regressor_s = (regressor.stamp_ns - recording.start_ns) * 1e-9
        time_s = start_s + dt * np.arange(values.size)
        temperature = np.interp(time_s, regressor_s, regressor.values)
    hollow = hollow_spectrum(values, missing, dt) if missing.any() and not missing.all() else None
    values = _drawn(model, values, missing, dt, hold, hollow, rng)
    values, _, dither = dithered(values, dt, rng, 0.0 if hollow is None else float(missing.mean()))
    state = initial_state(model, values, dt, start_s, temperature, hold)
    if not state.floor and not _has_noise(state):
        state = replace(state, floor=(NOISELESS * _neighbours_deviation(state)) ** 2 * dt)
    return replace(state, floor=state.floor + dither, dither=dither)


def _drawn(
    model: ChannelModel,
    bridged: Floats,
    missing: np.ndarray,
    sample_time_s: float,
    hold: float,
    hollow: tuple[Floats, Floats] | None,
    rng: np.random.Generator,
) -> Floats:
    """Bridged values with the missing ones drawn from the model, where they are many.

    And where the record is as good as empty at some frequencies: then as it is there itself.
    """
    if missing.all() or (hollow is None and missing.mean() <= MOST_BRIDGED):
        return bridged
    state = initial_state(model, bridged, sample_time_s, 0.0, None, hold)
    if not state.effects:
        return bridged
    inverse = inverse_psd(state.effects, bridged.size, sample_time_s, state.floor)
    inverse[0] = inverse[1]
    # as loud as the record's fast noise is, whatever the model's
    fast = 2.0 * np.sin(0.5 * np.pi * np.arange(bridged.size) / bridged.size) ** 2
    said = float(np.mean(2.0 * fast / inverse)) / sample_time_s
    both = ~(missing[1:] | missing[:-1])
    seen = (_fast_sigma(bridged, missing) ** 2) if both.any() else 0.0
    scale = 2.0 * seen / said if seen > 0.0 else 1.0
    if hollow is not None:
        return filled_as_heard(bridged, missing, scale / inverse, sample_time_s, hollow, rng)
    psd = lifted(bridged, scale / inverse, sample_time_s)
    return filled(bridged, missing, psd, sample_time_s, rng)


def _fast_sigma(values: Floats, missing: np.ndarray) -> float:
    """Robust deviation of the fast noise, from differences of neighbours that are both there."""
    both = ~(missing[1:] | missing[:-1])
    difference = np.abs(np.diff(values)[both])
    return float(np.median(difference)) / 0.6745 / np.sqrt(2.0) if difference.size else 0.0


def _settle(
    work: Work,
    changes: list[Change],
    whole: Series,
    recording: Recording,
    picked: np.ndarray,
    factor: float,
    rng: np.random.Generator,
) -> Work:
    """Answer timing, hold, clipping, rounding, the model's bursts and hits, in this order."""
    model = work.model
    raw = work.channel.values
    effects = {f.name: f.effect for f in model.effects}
    comb, step = rounding_change(raw, effects.get("output_rounding"))
    seen, sample_time_s = whole.values[picked][whole.observed[picked]], factor * whole.sample_time_s
    if comb and comb.action == ADD and of_an_angle(seen, step, sample_time_s):
        work = _on_an_angle(work, step, sample_time_s)
        comb, step = angle_change(comb, step, sample_time_s, effects), 0.0
    clipped, _ = saturation_change(raw, effects.get("saturation"), rng)
    if step and white_stride(raw, step) != 1:
        clipped = None  # a stair at the top is as long as the course stays there
    elif (limit := one_sided_limit(raw)) is not None:
        work = replace(work, notes=(*work.notes, _ONE_SIDED.format(limit, work.channel.unit)))
    pending = [*changes, *(c for c in (clipped, comb) if c)]
    work = replace(work, unmet=tuple(finding_of(c) for c in pending))
    for change in pending:
        rest = tuple(f for f in work.unmet if f.name != change.effect.name)
        after = replace(work, unmet=rest)
        if change.effect.name == "held_samples":
            state = _state(model, whole, recording, picked, factor, rng)
            null = load_null(state.values.size, state.sample_time_s)
            after = replace(after, hold=factor, null=null).analysed(state)
        elif change.effect.name == "output_rounding":
            after = _rounded(after, step, whole, recording, picked, rng)
        elif change.effect.name == "quantization":
            after = _with_source(after, change.effect)
        elif change.effect.name == "saturation":
            after = _unclip(after, change.effect, rng)
        work = drafted(work, after, change.action, change.effect, finding_of(change))
    if step and not comb:
        work = _rounded(work, step, whole, recording, picked, rng)
    if not clipped and effects.get("saturation"):
        work = _unclip(work, effects["saturation"], rng)
    work = _given_lines(_given_burst(work))
    return answer_hits(work, rng)


def _on_an_angle(work: Work, step: float, sample_time_s: float) -> Work:
    """Said so; where its steps are coarse they show in the distribution under the right model."""
    coarse = step > COARSE * _neighbours_deviation(work.state)
    shown = {"kurtosis", "skewness", "extreme"} if coarse else set()
    note = angle_note(step, sample_time_s, work.channel.unit)
    return replace(work, skip=work.skip | shown, notes=(*work.notes, note))


def _with_source(work: Work, source: Effect) -> Work:
    """With one more noise of the source, fitted from its value there."""
    return work.analysed(replace(work.state, effects=(*work.state.effects, source)))


def _rounded(
    work: Work,
    step: float,
    whole: Series,
    recording: Recording,
    picked: np.ndarray,
    rng: np.random.Generator,
) -> Work:
    """With the noise of rounding, on samples so far apart that it is white.

    Sripad and Snyder (1977): errors of rounding a course that moves by d between two samples are
    correlated by exp(-2 pi^2 E[d^2]/step^2).  A course that is slow on the scale of the step leaves
    stairs, which no spectrum of white errors fits.
    """
    index = picked if work.hold > 1.0 else np.arange(whole.values.size)
    drawn = _unrounded(work, step, whole.observed[index], rng)
    if drawn is not None:
        return drawn
    stride = white_stride(whole.values[index], step)
    if stride != 1:
        compared = f"every {stride}th sample" if stride else "its spectrum"
        note = _STAIRS.format(step, work.channel.unit, compared)
        work = replace(work, skip=work.skip | STAIRS, notes=(*work.notes, note))
    if stride > 1:
        hold = work.hold * stride
        state = _state(work.model, whole, recording, index[::stride], hold, rng)
        null = load_null(state.values.size, state.sample_time_s)
        work = replace(work, hold=hold, null=null).analysed(state)
    floor = OutputRounding(step).added_psd(work.state.sample_time_s) if step else 0.0
    work = work.analysed(replace(work.state, floor=floor + work.state.dither))
    return replace(work, skip=work.skip | _coarse(work.state))


def _unrounded(
    work: Work, step: float, observed: np.ndarray, rng: np.random.Generator
) -> Work | None:
    """Work on draws of what was rounded, where the steps are coarse but not too much so."""
    state = work.state
    effects = given_effects(state.effects, state.prior)
    if not (step and effects) or state.dither:
        return None
    inverse = inverse_psd(effects, state.values.size, state.sample_time_s, 0.0)
    sigma = white_deviation(inverse, state.sample_time_s)
    if not unrounded.COARSE * sigma < step <= unrounded.COARSEST * sigma:
        return None
    values = state.values
    base = np.quantile(values, 0.5, method="lower")
    off = np.abs((values - base) / step - np.rint((values - base) / step)) > ON_A_STEP
    seed = tuple(rng.integers(2**32, size=2).tolist())
    steps = first_draw(values, off | ~observed[: values.size], step, sigma, seed)
    drawn = replace(state, values=steps.drawn, effects=effects, floor=0.0)
    work = replace(work, steps=steps).analysed(drawn).drawn_under(effects)
    distinct = np.unique(np.rint((values[~off] - base) / step)).size
    note = _DRAWN.format(step, work.channel.unit, step / sigma, distinct)
    return replace(work, skip=_skips(work.model, work), notes=(*work.notes, note))


def _unclip(work: Work, given: Effect, rng: np.random.Generator) -> Work:
    _, mended = saturation_change(work.state.values, given, rng)
    if mended is work.state.values:
        return work
    return work.analysed(work.state.with_values(mended))


def _given_burst(work: Work) -> Work:
    """Take a burst that the model has out of the record, or say that it is not there."""
    for fitted in work.model.effects:
        burst = fitted.effect
        if not isinstance(burst, VarianceChange):
            continue
        time_s = work.state.time_s
        inside = (time_s >= burst.from_s) & (time_s < burst.to_s)
        if not 8 <= inside.sum() <= inside.size - 8:
            continue
        quiet, ratio = _without_burst(work, burst, inside)
        error = float(np.sqrt(2.0 / inside.sum() / work.information_left[1]))
        known = (fitted.estimates[2].std_error or TYPED_SIZE_ERROR * burst.ratio) / burst.ratio
        z = float(np.log(ratio / burst.ratio) / np.hypot(error, known))
        if log_p_of(z) > GIVEN_LOG_P:
            work = quiet
            continue
        gone = log_p_of(np.log(ratio) / error) > GIVEN_LOG_P
        place = Where("time", burst.from_s, burst.to_s, "s", z)
        change = Change(
            REMOVE if gone else REFIT,
            burst if gone else burst.replace(ratio=ratio),
            log_p_of(z),
            place,
        )
        before = replace(work, unmet=(*work.unmet, finding_of(change)))
        after = work if gone else quiet
        work = drafted(before, after, change.action, change.effect, finding_of(change))
    return work


def _without_burst(work: Work, burst: VarianceChange, inside: np.ndarray) -> tuple[Work, float]:
    """Work on a record that is as loud inside as it is outside, and how loud it was."""
    if work.drawable:
        quiet, seen = work.drawn_with(burst)
        return quiet, seen.ratio
    ratio = variance_within(work.found.white.samples, inside)
    first, last = (int(i) for i in np.flatnonzero(inside)[[0, -1]])
    values, _ = quieten(work.found, first, last + 1, ratio)
    return work.analysed(work.state.with_values(values)), ratio


def _given_lines(work: Work) -> Work:
    """Take the wander of the model's lines out, and say where a line is not as large as given."""
    for fitted in work.model.effects:
        line = fitted.effect
        if not isinstance(line, Periodic):
            continue
        index = line_index(work.state, line.frequency_hz)
        if index is None:
            continue
        work = _given_for_a_while(work, index, has_span(fitted.note))
        amplitude = float(np.hypot(*work.found.sizes[index : index + 2]))
        error = float(np.mean(work.found.errors[index : index + 2]))
        if work.state.columns[index].span_s is None:
            steady, wander = steadied(work.state, work.found, index)
            work = work.analysed(steady) if wander else work
        known = fitted.estimates[1].std_error or 0.0
        scatter = np.sqrt(known**2 + error**2 + (TYPED_SIZE_ERROR * line.amplitude) ** 2)
        z = (amplitude - line.amplitude) / float(scatter)
        if log_p_of(z) > GIVEN_LOG_P:
            continue
        seen = work.state.columns[index].effect
        assert isinstance(seen, Periodic)
        place = Where("spectrum", seen.frequency_hz, seen.frequency_hz, "Hz", z)
        gone = 0.5 * (amplitude / error) ** 2 < PRESENT_NATS
        effect = line if gone else seen.replace(amplitude=amplitude)
        change = Change(REMOVE if gone else REFIT, effect, log_p_of(z), place)
        before = replace(work, unmet=(*work.unmet, finding_of(change)))
        columns = (*work.state.columns[:index], *work.state.columns[index + 2 :])
        after = work.analysed(replace(work.state, columns=columns)) if gone else work
        work = drafted(before, after, change.action, effect, finding_of(change))
    return work


def _given_for_a_while(work: Work, index: int, noted: bool) -> Work:
    """A line of the model that comes or goes is sized while it is there.

    That it is not there at other times is something that no other size explains, unless the model
    says so (``noted``).
    """
    seen = given_span(work.state, work.found, index)
    if seen is None:
        return work
    span_s, pair = seen
    columns = (*work.state.columns[:index], *pair, *work.state.columns[index + 2 :])
    after = work.analysed(replace(work.state, columns=columns))
    gain = after.found.objective - work.found.objective
    if gain < 2.0 * PRESENT_NATS or noted:
        return after if gain > 0.0 else work
    end_s = work.state.start_s + work.state.values.size * work.state.sample_time_s
    absent = max((work.state.start_s, span_s[0]), (span_s[1], end_s), key=lambda s: s[1] - s[0])
    finding = Finding("absent line", -gain, z_of(-gain), Where("time", *absent, "s", -z_of(-gain)))
    return replace(after, unmet=(*after.unmet, finding))
