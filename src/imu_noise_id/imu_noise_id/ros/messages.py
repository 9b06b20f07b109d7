"""Findings and models to messages of noise_msgs, and models back."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray

from imu_noise_id.cca import Cca
from imu_noise_id.effects import CATALOGUE, kind_of
from imu_noise_id.live import ChannelFindings, Findings
from imu_noise_id.model import (
    ChannelModel,
    Estimate,
    FittedEffect,
    NoiseModel,
    TemperatureCourse,
    UpperBound,
)
from imu_noise_id.reconcile.loop import FALSE_ALARM_RATE
from imu_noise_id.reconcile.result import ChannelReconciliation, Gap
from noise_msgs import msg as noise

FORMAT = "model/1"
DISCREPANCY_FORMAT = "reconcile/1"


def to_time(stamp_ns: int) -> Time:
    """Nanoseconds as a message; stamps outside its range are cut to it."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    if not -(2**31) <= seconds < 2**31:
        return Time(sec=min(max(seconds, -(2**31)), 2**31 - 1), nanosec=0)
    return Time(sec=seconds, nanosec=nanoseconds)


def to_ns(time: Time) -> int:
    """A message's time as nanoseconds."""
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def finite(value: float | None) -> float:
    """Return 0.0 for what is not known: no NaN leaves the program."""
    return 0.0 if value is None or not math.isfinite(value) else float(value)


def allan_messages(found: Findings) -> list[noise.AllanCurve]:
    """One curve a channel; channels too short for one are left out."""
    messages = []
    for channel in found.channels:
        curve = channel.allan
        if curve is None or curve.tau_s.size == 0:
            continue
        model = found.model.channel(channel.name)
        message = noise.AllanCurve(
            topic=model.topic,
            channel=model.name,
            unit=model.unit,
            rate_hz=finite(model.rate_hz),
            samples=channel.samples,
            duration_s=finite(model.duration_s),
            mean=finite(model.mean),
            tau_s=curve.tau_s,
            deviation=curve.deviation,
            lower=curve.lower,
            upper=curve.upper,
            confidence=curve.confidence,
        )
        message.header.stamp = to_time(channel.newest_ns)
        message.header.frame_id = found.frame_id
        messages.append(message)
    return messages


def model_message(found: Findings) -> noise.NoiseModel:
    """Return the model of a live run with the span that it describes."""
    details = {channel.name: channel for channel in found.channels}
    span = noise.StateSpan(from_s=found.span.from_s, to_s=found.span.to_s, reason=found.span.what)
    message = noise.NoiseModel(
        format=FORMAT,
        source=found.model.source,
        start=to_time(found.start_ns),
        span=span,
        channels=[_channel(model, details[model.name]) for model in found.model.channels],
        notes=[*found.model.notes, *found.notes],
    )
    message.header.stamp = to_time(max((c.newest_ns for c in found.channels), default=0))
    message.header.frame_id = found.frame_id
    if found.model.temperature is not None:
        message.temperature_time_s = found.model.temperature.time_s
        message.temperature_degc = found.model.temperature.temperature_degc
    return message


def discrepancy_message(found: Findings) -> noise.DiscrepancyReport:
    """Return where the buffer differs from the reference model, channel by channel."""
    message = noise.DiscrepancyReport(
        format=DISCREPANCY_FORMAT,
        channels=[_discrepancy(channel) for channel in found.discrepancies],
        false_alarm_rate=FALSE_ALARM_RATE,
    )
    message.header.stamp = to_time(max((c.newest_ns for c in found.channels), default=0))
    message.header.frame_id = found.frame_id
    return message


def to_model(message: noise.NoiseModel) -> NoiseModel:
    """Return the model that a message holds; terms without a value are left out.

    Raises
    ------
    ValueError
        For an effect that is not in the catalogue or not with these parameters.
    """
    course = None
    if len(message.temperature_time_s):
        course = TemperatureCourse(
            np.array(message.temperature_time_s), np.array(message.temperature_degc)
        )
    channels = tuple(_to_channel(channel) for channel in message.channels)
    return NoiseModel(channels, course, message.source, tuple(message.notes))


def _channel(model: ChannelModel, found: ChannelFindings) -> noise.ChannelModel:
    message = noise.ChannelModel(
        topic=model.topic,
        name=model.name,
        unit=model.unit,
        rate_hz=finite(model.rate_hz),
        samples=found.samples,
        duration_s=finite(model.duration_s),
        mean=finite(model.mean),
        effects=[_effect(fitted) for fitted in model.effects],
        bounds=[
            noise.UpperBound(
                effect=b.name,
                parameter=b.parameter,
                upper=finite(b.upper),
                unit=b.unit,
                note=b.note,
            )
            for b in model.bounds
        ],
        transfer_function_known=found.cca is not None,
        quality=_quality(found),
    )
    if model.log_covariance is not None:
        message.log_covariance = _flat(model.log_covariance)
    if found.cca is not None:
        message.transfer_function = _transfer_function(found.cca)
    return message


def _effect(fitted: FittedEffect) -> noise.Effect:
    parameters = [
        _parameter(parameter.name, estimate)
        for parameter, estimate in zip(fitted.effect.parameters, fitted.estimates, strict=True)
    ]
    form = fitted.effect.form
    return noise.Effect(name=fitted.name, form=form, parameters=parameters, note=fitted.note)


def _parameter(name: str, estimate: Estimate) -> noise.EffectParameter:
    value = estimate.value
    word = isinstance(value, str)
    number = value if isinstance(value, float | int) else None
    interval = (estimate.std_error, estimate.lower, estimate.upper)
    return noise.EffectParameter(
        name=name,
        value=finite(number),
        text=value if word else "",
        value_known=number is not None and math.isfinite(number),
        interval_known=all(x is not None and math.isfinite(x) for x in interval),
        std_error=finite(interval[0]),
        lower=finite(interval[1]),
        upper=finite(interval[2]),
        unit=estimate.unit,
    )


def _quality(found: ChannelFindings) -> noise.ChannelQuality:
    quality = found.quality
    return noise.ChannelQuality(
        gaps=quality.gaps,
        missing=quality.missing,
        duplicates=quality.duplicates,
        out_of_order=quality.out_of_order,
        non_finite=quality.non_finite,
        held=quality.held,
        is_static=quality.static,
        jitter_s=finite(quality.jitter_s),
        moving=[
            noise.StateSpan(from_s=begin, to_s=end, reason="the platform moved: left out")
            for begin, end in quality.moving_s
        ],
        notes=[*quality.notes, *found.notes],
    )


def _transfer_function(cca: Cca) -> noise.TransferFunction:
    """Return the shaping filter; poles and zeros are those of H(z)."""
    poles, zeros = np.roots(cca.H_z.denominator), np.roots(cca.H_z.numerator)
    message = noise.TransferFunction(
        method=cca.method,
        order=cca.order,
        canonical_correlations=_flat(cca.canonical_correlations),
        chance_level=finite(cca.chance_level),
        significant=bool(cca.significant),
        z_numerator=_flat(cca.H_z.numerator),
        z_denominator=_flat(cca.H_z.denominator),
        sample_time_s=finite(cca.H_z.sample_time_s),
        poles_real=_flat(poles.real),
        poles_imag=_flat(poles.imag),
        zeros_real=_flat(zeros.real),
        zeros_imag=_flat(zeros.imag),
        minimum_phase=bool(cca.minimum_phase),
        times_known=cca.settling_time_s is not None and cca.rise_time_s is not None,
        settling_time_s=finite(cca.settling_time_s),
        rise_time_s=finite(cca.rise_time_s),
        bandwidth_rise_hz=finite(cca.bandwidth_rise_hz),
        bandwidth_3db_known=cca.bandwidth_3db_hz is not None,
        bandwidth_3db_hz=finite(cca.bandwidth_3db_hz),
        innovation_variance=finite(cca.innovation_variance),
    )
    if cca.H_s is not None:
        message.s_numerator = _flat(cca.H_s.numerator)
        message.s_denominator = _flat(cca.H_s.denominator)
    return message


def _discrepancy(found: ChannelReconciliation) -> noise.Discrepancy:
    return noise.Discrepancy(
        topic=found.topic,
        name=found.name,
        verdict=found.verdict,
        before=_gap(found.before),
        after=_gap(found.after),
        steps=[
            noise.DiscrepancyStep(
                action=step.action,
                effect=_effect(step.effect),
                gap_before=finite(step.gap_before),
                gap_after=finite(step.gap_after),
                held_out_gap_before=finite(step.held_out.gap_before),
                held_out_gap_after=finite(step.held_out.gap_after),
                p_value=finite(step.p_value),
                evidence=step.evidence,
            )
            for step in found.steps
        ],
    )


def _gap(gap: Gap) -> noise.Gap:
    places = [
        noise.GapPlace(domain=w.domain, begin=finite(w.from_), end=finite(w.to), unit=w.unit, z=w.z)
        for w in gap.where
    ]
    return noise.Gap(score=finite(gap.score), p_value=finite(gap.p_value), where=places)


def _flat(matrix: NDArray[Any]) -> list[float]:
    return [finite(value) for value in np.ravel(matrix)]


def _to_channel(message: noise.ChannelModel) -> ChannelModel:
    fitted = [e for e in map(_to_effect, message.effects) if e is not None]
    complete = len(fitted) == len(message.effects)
    covariance = None
    if complete and len(message.log_covariance):
        side = math.isqrt(len(message.log_covariance))
        if side * side != len(message.log_covariance):
            raise ValueError(f"{message.name}: the covariance of its parameters is not square")
        covariance = np.array(message.log_covariance).reshape(side, side)
    return ChannelModel(
        message.name,
        message.topic,
        message.unit,
        message.rate_hz or None,
        message.mean,
        tuple(fitted),
        covariance,
        message.duration_s or None,
        tuple(UpperBound(b.effect, b.parameter, b.unit, b.upper, b.note) for b in message.bounds),
    )


def _to_effect(message: noise.Effect) -> FittedEffect | None:
    """Return the effect, or None where a parameter has no value."""
    if message.name not in CATALOGUE:
        raise ValueError(f"there is no effect '{message.name}'")
    if not all(p.value_known or p.text for p in message.parameters):
        return None
    kind = kind_of(message.name, message.form)
    whole = {f.name for f in dataclasses.fields(kind) if f.type in ("int", int)}
    values: dict[str, Any] = {
        p.name: p.text or (round(p.value) if p.name in whole else p.value)
        for p in message.parameters
    }
    if set(values) != {p.name for p in kind.parameters}:
        raise ValueError(f"{message.name}: parameters {_listed(values)} are not the effect's")
    in_order = {p.name: p for p in message.parameters}
    estimates = tuple(_to_estimate(in_order[p.name]) for p in kind.parameters)
    return FittedEffect(kind(**values), estimates, message.note)


def _to_estimate(message: noise.EffectParameter) -> Estimate:
    value: float | str = message.text or message.value
    if not message.interval_known:
        return Estimate(value, None, None, None, message.unit)
    return Estimate(value, message.std_error, message.lower, message.upper, message.unit)


def _listed(names: Iterable[str] | Sequence[str]) -> str:
    return ", ".join(sorted(names))
