"""From what was found on each channel to verdicts, estimates and the mended model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imu_noise_id.effects.base import Effect
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.model import (
    ChannelModel,
    Estimate,
    FittedEffect,
    NoiseModel,
    TemperatureCourse,
)
from imu_noise_id.reconcile.evidence import sentence
from imu_noise_id.reconcile.lines import span_note
from imu_noise_id.reconcile.prior import UnseenDrift
from imu_noise_id.reconcile.result import (
    ADD,
    AGREES,
    EXPLAINED,
    REFIT,
    REMOVE,
    UNEXPLAINED,
    ChannelReconciliation,
    Gap,
    Step,
    Where,
    distinct,
)
from imu_noise_id.reconcile.unrounded import too_few_values
from imu_noise_id.reconcile.work import SIZE_NAMES, Draft, Work
from imu_noise_id.recording import Channel, Floats, Recording
from imu_noise_id.simulate import in_order

QUANTILE = 1.959963984540054
UNKNOWN = 3.0
"""Relative standard error from which the interval would be of five decades."""
TEMPERATURE_POINTS = 500


def channel_result(work: Work, log_level: float) -> ChannelReconciliation:
    """Verdict, gaps and steps of one channel."""
    findings = work.findings
    remaining = findings.significant(log_level)
    unmet = findings.log_p < log_level
    verdict = UNEXPLAINED if unmet else EXPLAINED if work.drafts else AGREES
    after = Gap(work.unseen(work.local), float(np.exp(findings.log_p)), remaining if unmet else ())
    before = after
    if work.drafts:
        first = work.drafts[0]
        log_p = min(d.log_p for d in work.drafts) + float(np.log(len(findings.all)))
        places = distinct(tuple(sorted((d.where for d in work.drafts), key=lambda w: -abs(w.z))))
        before = Gap(first.held_out.gap_before, float(np.exp(min(log_p, 0.0))), places)
    steps = tuple(_step(work, draft) for draft in _ordered(work.drafts))
    channel = work.channel
    identity = channel.topic, channel.name, verdict
    return ChannelReconciliation(*identity, before, after, steps, work.notes)


def uncompared(channel: Channel, model: ChannelModel | None) -> ChannelReconciliation:
    """Result of a channel that cannot be compared: the note says why.

    Nothing disagrees where there is too little to compare; a constant where the model has noise
    does, and no effect of the catalogue makes one.
    """
    verdict, gap, note = AGREES, Gap(float("nan"), float("nan")), "too few samples to compare"
    if model is None:
        note = "the model has no such channel"
    elif channel.values.size > 1 and np.ptp(channel.values) == 0.0:
        note = "every sample has the same value"
        if model.effects and not model.find("output_rounding"):
            verdict, note = UNEXPLAINED, f"{note}, and the model has noise: a sensor that hangs?"
            value = float(channel.values[0]) + 0.0  # never -0
            gap = Gap(float("nan"), 0.0, (Where("amplitude", value, value, channel.unit, -np.inf),))
    elif distinct := too_few_values(channel, model):
        note = f"too coarse to compare in the spectrum: {distinct} distinct values"
    return ChannelReconciliation(channel.topic, channel.name, verdict, gap, gap, (), (note,))


def mended_model(model: NoiseModel, works: dict[str, Work], recording: Recording) -> NoiseModel:
    """The given model with the steps of every channel."""
    channels = tuple(
        mended_channel(works[c.name]) if c.name in works and works[c.name].drafts else c
        for c in model.channels
    )
    temperature = model.temperature
    added = any(d.effect.name == "temperature" for w in works.values() for d in w.drafts)
    if added and recording.temperature is not None:
        temperature = _course(recording.temperature, recording.start_ns)
    return replace(model, channels=channels, temperature=temperature)


def mended_channel(work: Work) -> ChannelModel:
    """One channel's model with its steps and the values that the recording gives."""
    answers = _answers(work)
    kept: list[FittedEffect] = []
    spectral = _spectral_estimates(work)
    used = 0
    for given in work.model.effects:
        name = given.name
        draft = answers.get(given.effect)
        if draft is not None and draft.action == REMOVE:
            continue
        if used < len(spectral) and spectral[used].name == name:
            kept.append(replace(spectral[used], note=given.note))
            used += 1
        elif draft is not None:
            kept.append(_estimated(work, draft))
        else:
            kept.append(given)
    kept += spectral[used:]
    spectral_names = {e.name for e in spectral}
    for draft in work.drafts:
        if draft.action == ADD and draft.effect.name not in spectral_names:
            kept.append(_estimated(work, draft))
    order = in_order(e.effect for e in kept)
    kept.sort(key=lambda e: next(i for i, o in enumerate(order) if o is e.effect))
    model = work.model
    return replace(
        model,
        rate_hz=model.rate_hz or work.channel.rate_hz,
        mean=float(np.mean(work.channel.values)),
        duration_s=work.channel.duration_s,
        effects=tuple(kept),
        log_covariance=_covariance(work, kept, spectral),
    )


def _answers(work: Work) -> dict[Effect, Draft]:
    """The step, if any, that refits or removes each effect of the given model."""
    given = [f.effect for f in work.model.effects]
    out: dict[Effect, Draft] = {}
    for draft in work.drafts:
        same = [e for e in given if draft.action != ADD and _kin(e, draft.effect)]
        if same:
            out[min(same, key=lambda e: _apart(e, draft.effect))] = draft
    return out


def _kin(a: Effect, b: Effect) -> bool:
    return a.name == b.name and getattr(a, "other", "") == getattr(b, "other", "")


def _apart(a: Effect, b: Effect) -> float:
    """Distance of lines and bands in frequency, of steps in time."""
    for key in ("frequency_hz", "time_s"):
        if hasattr(a, key):
            return abs(float(getattr(a, key)) - float(getattr(b, key)))
    return 0.0


def _ordered(drafts: tuple[Draft, ...]) -> list[Draft]:
    """What was missing comes before what it changed in the rest."""
    return sorted(drafts, key=lambda d: (ADD, REMOVE, REFIT).index(d.action))


def _step(work: Work, draft: Draft) -> Step:
    channel = work.channel
    fitted = _estimated(work, draft)
    unseen = (draft.held_out.gap_before, draft.held_out.gap_after)
    between = f"between {draft.effect.name} and {draft.rival}" if draft.rival else ""
    note = "; ".join(text for text in (fitted.note, between) if text)
    return Step(
        draft.action,
        replace(fitted, note=note),
        draft.whole[0],
        draft.whole[1],
        float(np.exp(max(draft.log_p, -700.0))),
        draft.held_out,
        sentence(channel.name, channel.unit, draft.action, replace(fitted, note=note), unseen),
    )


def _spectral_estimates(work: Work) -> list[FittedEffect]:
    """Spectral effects with intervals, in the order of the state."""
    out, row = [], 0
    covariance = _fit_covariance(work)
    for effect in work.found.fit.effects:
        free = effect.free()
        effect_out = _unheld(effect, work.hold)
        errors: dict[str, float] = {}
        for name in free:
            errors[name] = float(np.sqrt(max(covariance[row, row], 0.0)))
            errors[name] *= float(getattr(effect_out, name))
            row += 1
        if not isinstance(effect, UnseenDrift):
            out.append(_with_errors(effect_out, errors, work.channel.unit))
    return out


def _fit_covariance(work: Work) -> Floats:
    """Of the fit's log parameters, wider by what coarse rounding took of the information."""
    level, variance = work.information_left
    wider = [
        variance**-0.5 if isinstance(effect, WhiteNoise) else 1.0 / level
        for effect in work.found.fit.effects
        for _ in effect.free()
    ]
    return np.asarray(work.found.fit.covariance * np.outer(wider, wider))


def _column_errors(work: Work) -> Floats:
    return np.asarray(work.found.errors / np.sqrt(work.information_left[0]))


def _unheld(effect: Effect, hold: float) -> Effect:
    if isinstance(effect, WhiteNoise):
        return effect.replace(density=effect.density / float(np.sqrt(hold)))
    return effect


def _estimated(work: Work, draft: Draft) -> FittedEffect:
    """The step's effect with the values and intervals of the final fit; as given if removed."""
    if draft.action == REMOVE:
        kin = [f for f in work.model.effects if _kin(f.effect, draft.effect)]
        # what acts on a topic's transport may stand in the model of another of its channels
        typed = _with_errors(draft.effect, {}, work.channel.unit)
        return min(kin, key=lambda f: _distance(f.effect, draft.effect), default=typed)
    same = [e for e in _spectral_estimates(work) if e.name == draft.effect.name]
    if same:
        return min(same, key=lambda e: _distance(e.effect, draft.effect))
    name = draft.effect.name
    for index, column in enumerate(work.state.columns):
        if column.effect.name != name or not _same_column(column.effect, draft.effect):
            continue
        size, error = float(work.found.sizes[index]), float(_column_errors(work)[index])
        if name == "periodic":
            return _line(work, draft, index)
        size_name = SIZE_NAMES[name]
        effect = draft.effect.replace(**{size_name: size})
        errors = {size_name: error}
        if name == "bias_step":
            errors["time_s"] = max((error / size) ** 2 * work.channel.duration_s, 1.0 / _rate(work))
            return _within_the_record(_with_errors(effect, errors, work.channel.unit), work)
        return _with_errors(effect, errors, work.channel.unit)
    errors = {n: e * float(getattr(draft.effect, n)) for n, e in draft.log_errors.items()}
    errors = errors or _direct_errors(work, draft.effect)
    return _with_errors(draft.effect, errors, work.channel.unit)


def _within_the_record(step: FittedEffect, work: Work) -> FittedEffect:
    """A step whose time's interval ends where the record does, in which it was seen."""
    time_s, height = step.estimates
    first_s = work.state.start_s
    last_s = first_s + work.state.values.size * work.state.sample_time_s
    lower, upper = max(time_s.lower or first_s, first_s), min(time_s.upper or last_s, last_s)
    return replace(step, estimates=(replace(time_s, lower=lower, upper=upper), height))


def _rate(work: Work) -> float:
    return 1.0 / work.state.sample_time_s


def _distance(a: Effect, b: Effect) -> float:
    values = [(getattr(a, n), getattr(b, n)) for n in a.free()]
    pairs = [(float(x), float(y)) for x, y in values if not isinstance(x, str)]
    return sum(abs(float(np.log(max(x, 1e-300) / max(y, 1e-300)))) for x, y in pairs)


def _same_column(a: Effect, b: Effect) -> bool:
    key = {"periodic": "frequency_hz", "bias_step": "time_s"}.get(a.name)
    return key is None or getattr(a, key) == getattr(b, key)


def _line(work: Work, draft: Draft, index: int) -> FittedEffect:
    amplitude = float(np.hypot(*work.found.sizes[index : index + 2]))
    error = float(np.mean(_column_errors(work)[index : index + 2]))
    span_s = work.state.columns[index].span_s
    start_s, end_s = span_s or (0.0, work.state.values.size * work.state.sample_time_s)
    # Rife and Boorstyn (1974): sd(f) = sqrt(6) sd(A)/(pi T A) with sd(A)^2 = 2 S/T
    frequency_error = (
        float(np.sqrt(3.0)) * error / (np.pi * (end_s - start_s) * max(amplitude, 1e-300))
    )
    effect = draft.effect.replace(amplitude=amplitude)
    errors = {"frequency_hz": frequency_error, "amplitude": error}
    fitted = _with_errors(effect, errors, work.channel.unit)
    if span_s is None:
        return fitted
    return replace(fitted, note=span_note(span_s))


def _direct_errors(work: Work, effect: Effect) -> dict[str, float]:
    """Standard errors of what is read from counts and moments."""
    n = float(work.channel.values.size)
    v = {p.name: getattr(effect, p.name) for p in effect.parameters}
    if effect.name == "variance_change":
        told_hz = work.information_left[1] * _rate(work)  # samples' worth a second
        inside = max((v["to_s"] - v["from_s"]) * told_hz, 1.0)
        outside = max(work.state.values.size - inside, 1.0)
        edge = 6.0 / max(v["ratio"] - 1.0 - np.log(v["ratio"]), 1e-3) / _rate(work)
        error = v["ratio"] * np.sqrt(2.0 / inside + 2.0 / outside)
        return {"from_s": float(edge), "to_s": float(edge), "ratio": float(error)}
    if effect.name == "random_telegraph":
        jumps = max(work.channel.duration_s / v["mean_dwell_s"], 1.0)
        # either level is known as well as white noise lets it be over half of the record
        psd = float(1.0 / max(np.median(work.found.inverse_psd[1:]), 1e-300))
        error = 2.0 * np.sqrt(psd / work.channel.duration_s)
        return {"height": float(error), "mean_dwell_s": float(v["mean_dwell_s"] / np.sqrt(jumps))}
    if effect.name == "output_rounding":
        return {"step": 1e-6 * v["step"]}
    if effect.name == "cross_axis":
        return {"correlation": float((1.0 - v["correlation"] ** 2) / np.sqrt(n))}
    if effect.name == "dropouts":
        gaps = max(v["rate"] * work.channel.duration_s, 1.0)
        return {k: float(v[k] / np.sqrt(gaps)) for k in ("rate", "mean_length_s")}
    if effect.name == "timestamp_jitter":
        return {"std_s": float(v["std_s"] / np.sqrt(n / 1.4))}
    return {}


def _with_errors(effect: Effect, errors: dict[str, float], unit: str) -> FittedEffect:
    estimates, unknown = [], []
    for parameter in effect.parameters:
        value = getattr(effect, parameter.name)
        error = errors.get(parameter.name)
        lower = upper = None
        if error is not None and parameter.positive and error > UNKNOWN * value > 0.0:
            error = None  # no interval is better than one of decades
            unknown.append(f"{parameter.name} is not told by the record")
        elif error is not None and parameter.positive and value > 0.0:
            spread = float(np.exp(min(QUANTILE * error / value, 50.0)))
            lower, upper = value / spread, value * spread
        elif error is not None:
            lower, upper = value - QUANTILE * error, value + QUANTILE * error
        estimates.append(Estimate(value, error, lower, upper, parameter.unit_for(unit)))
    return FittedEffect(effect, tuple(estimates), "; ".join(unknown))


def _covariance(work: Work, kept: list[FittedEffect], spectral: list[FittedEffect]) -> Floats:
    """Covariance of all numeric parameters in order, positive ones as logarithms."""
    joint = _fit_covariance(work)
    real = [e for e in work.found.fit.effects if not isinstance(e, UnseenDrift)]
    joint = joint[np.ix_(*2 * [_seen_rows(work.found.fit.effects)])]
    keys: list[tuple[int, str]] = [(i, n) for i, e in enumerate(real) for n in e.free()]
    rows: list[int | None] = []
    variances: list[float] = []
    for fitted in kept:
        index = next((i for i, e in enumerate(spectral) if e.effect == fitted.effect), None)
        for parameter, estimate in zip(fitted.effect.parameters, fitted.estimates, strict=True):
            if isinstance(estimate.value, str):
                continue
            key = (index, parameter.name)
            rows.append(keys.index(key) if index is not None and key in keys else None)
            error = estimate.std_error or 0.0
            scale = float(estimate.value or 1.0) if parameter.positive else 1.0
            variances.append((error / scale) ** 2)
    out = np.diag(variances)
    for i, a in enumerate(rows):
        for j, b in enumerate(rows):
            if a is not None and b is not None:
                out[i, j] = joint[a, b]
    return out


def _seen_rows(effects: tuple[Effect, ...]) -> list[int]:
    """Rows of the parameters that belong to the answer."""
    owners = [e for e in effects for _ in e.free()]
    return [row for row, e in enumerate(owners) if not isinstance(e, UnseenDrift)]


def _course(temperature: Channel, start_ns: int) -> TemperatureCourse:
    step = max(temperature.values.size // TEMPERATURE_POINTS, 1)
    time_s: Floats = np.asarray((temperature.stamp_ns[::step] - start_ns) * 1e-9)
    return TemperatureCourse(time_s, temperature.values[::step])
