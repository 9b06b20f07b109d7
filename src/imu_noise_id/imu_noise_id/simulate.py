"""Noise model -> recording: every effect plays, in physical order."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from imu_noise_id.effects.base import (
    CourseEffect,
    Effect,
    Stage,
    StochasticEffect,
    TransformEffect,
    TransportEffect,
)
from imu_noise_id.effects.cross_axis import CrossAxis, joint_drives
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.recording import Channel, Floats, Quality, Recording, Stamps

DEFAULT_RATE_HZ = {
    "angular_velocity": 200.0,
    "linear_acceleration": 200.0,
    "magnetic_field": 50.0,
    "heading": 50.0,
    "position": 10.0,
    "velocity": 10.0,
}
"""Rates of a hand-typed model that does not say, by kind of channel."""

TEMPERATURE_RATE_HZ = 1.0
TEMPERATURE_TOPIC = "/imu/temperature"


def simulate_recording(
    model: NoiseModel, duration_s: float, rng: np.random.Generator, start_ns: int = 0
) -> Recording:
    """Play a model: every channel at its own rate, mean included.

    Non-stationary parts (steps, bursts, ramps) come at their own times; the temperature follows the
    model's course, is held at its end and comes as a channel of its own; effects on the transport
    act on all channels of their topic alike; cross-axis noise is drawn once for both channels.

    Parameters
    ----------
    model : NoiseModel
    duration_s : float
        Time that the messages cover.
    rng : numpy.random.Generator
    start_ns : int
        Stamp of the first message.

    Returns
    -------
    Recording
        Static; ``source`` says which model it plays.

    Raises
    ------
    ValueError
        When the duration holds less than one sample of a channel.
    """
    channels: dict[str, Channel] = {}
    for rate_hz, group in _by_rate(model):
        n = round(duration_s * rate_hz)
        if n < 1:
            raise ValueError(f"{group[0].topic}: no sample at {rate_hz:g} Hz in {duration_s:g} s")
        time_s = np.arange(n) / rate_hz
        outputs = simulate_group(group, model, time_s, 1.0 / rate_hz, rng)
        for topic in dict.fromkeys(c.topic for c in group):
            members = [c for c in group if c.topic == topic]
            channels.update(_transport(members, outputs, time_s, rate_hz, rng, start_ns))
    return Recording(
        source=f"simulation of {model.source}" if model.source else "simulation",
        start_ns=start_ns,
        channels=tuple(channels[c.name] for c in model.channels),
        temperature=_temperature_channel(model, duration_s, start_ns),
    )


def simulate_group(
    group: list[ChannelModel],
    model: NoiseModel,
    time_s: Floats,
    sample_time_s: float,
    rng: np.random.Generator,
) -> dict[str, Floats]:
    """Samples of channels of one rate at ``time_s``, before the transport, by channel name.

    Parameters
    ----------
    group : list of ChannelModel
        Correlated drives are shared within the group.
    model : NoiseModel
        For its temperature course.
    time_s : (n,) float64
        Uniform times since the first stamp.
    sample_time_s : float
    rng : numpy.random.Generator
    """
    drives = _drives(group, time_s.size, rng)
    temperature = _temperature(model, time_s)
    return {
        channel.name: simulate_channel(
            channel, time_s, sample_time_s, rng, temperature, drives.get(channel.name)
        )
        for channel in group
    }


def simulate_channel(
    channel: ChannelModel,
    time_s: Floats,
    sample_time_s: float,
    rng: np.random.Generator,
    temperature: Floats | None = None,
    drive: Floats | None = None,
) -> Floats:
    """Samples of one channel at uniform times, before the transport, shape (n,).

    y = round(saturate(mean + bandwidth(sum of sources))): the stages of ``effects.base``.  A model
    that says how long it describes (``duration_s``) has its mean over that time, else the courses
    start at the mean.

    Parameters
    ----------
    channel : ChannelModel
    time_s : (n,) float64
        Uniform times since the first stamp.
    sample_time_s : float
    rng : numpy.random.Generator
    temperature : (n,) float64, optional
        At ``time_s``.
    drive : (n,) float64, optional
        White samples of unit variance that the white noise is made of, drawn here if not given.
    """
    effects = in_order(f.effect for f in channel.effects)
    values = _sources(effects, time_s, sample_time_s, rng, temperature, drive)
    for effect in effects:
        if isinstance(effect, TransformEffect) and effect.stage == Stage.BANDWIDTH:
            values = effect.apply(values, time_s, sample_time_s, rng)
    values = values + channel.mean - _course_mean(channel, effects, sample_time_s, temperature)
    for effect in effects:
        if isinstance(effect, TransformEffect) and effect.stage > Stage.BANDWIDTH:
            values = effect.apply(values, time_s, sample_time_s, rng)
    return values


def in_order(effects: Iterable[Effect]) -> list[Effect]:
    """Effects in the order in which they act."""
    return sorted(effects, key=lambda e: (e.stage, e.name))


def transport_effects(channels: list[ChannelModel]) -> list[TransportEffect]:
    """Transport effects of one topic, each once, in the order in which they act."""
    found: dict[str, Effect] = {}
    for channel in channels:
        for fitted in channel.effects:
            if isinstance(fitted.effect, TransportEffect):
                found.setdefault(fitted.name, fitted.effect)
    return [e for e in in_order(found.values()) if isinstance(e, TransportEffect)]


def _by_rate(model: NoiseModel) -> list[tuple[float, list[ChannelModel]]]:
    groups: dict[float, list[ChannelModel]] = {}
    for channel in model.channels:
        rate_hz = channel.rate_hz or DEFAULT_RATE_HZ[channel.name.split(".")[0]]
        groups.setdefault(rate_hz, []).append(channel)
    return list(groups.items())


def _sources(
    effects: list[Effect],
    time_s: Floats,
    sample_time_s: float,
    rng: np.random.Generator,
    temperature: Floats | None,
    drive: Floats | None,
) -> Floats:
    fast, slow = np.zeros(time_s.size), np.zeros(time_s.size)
    ends_hz = np.array([1.0 / (time_s.size * sample_time_s), 0.5 / sample_time_s])
    for effect in effects:
        if isinstance(effect, WhiteNoise) and drive is not None:
            fast += effect.density / np.sqrt(sample_time_s) * drive
        elif isinstance(effect, StochasticEffect):
            low, high = effect.psd(ends_hz, sample_time_s)
            target = fast if high >= low else slow
            target += effect.simulate(time_s.size, sample_time_s, rng)
        elif isinstance(effect, CourseEffect):
            slow += effect.course(time_s, temperature)
    for effect in effects:
        if isinstance(effect, TransformEffect) and effect.stage == Stage.SOURCE:
            fast = effect.apply(fast, time_s, sample_time_s, rng)
    return fast + slow


def _course_mean(
    channel: ChannelModel, effects: list[Effect], sample_time_s: float, temperature: Floats | None
) -> float:
    """Mean of the courses over the time that the model describes; 0.0 where it does not say."""
    if not channel.duration_s:
        return 0.0
    n = max(round(channel.duration_s / sample_time_s), 1)
    time_s = np.asarray(np.arange(n) * sample_time_s, dtype=np.float64)
    if temperature is not None:
        course_s = np.arange(temperature.size) * sample_time_s
        temperature = np.interp(time_s, course_s, temperature).astype(np.float64)
    courses = [e.course(time_s, temperature) for e in effects if isinstance(e, CourseEffect)]
    return float(sum(np.mean(course) for course in courses))


def _drives(group: list[ChannelModel], n: int, rng: np.random.Generator) -> dict[str, Floats]:
    names = [c.name for c in group]
    correlations = np.eye(len(names))
    for row, channel in enumerate(group):
        for fitted in channel.effects:
            if isinstance(fitted.effect, CrossAxis) and fitted.effect.other in names:
                column = names.index(fitted.effect.other)
                correlations[row, column] = correlations[column, row] = fitted.effect.correlation
    tied = np.flatnonzero(np.any(correlations != np.eye(len(names)), axis=1))
    if tied.size == 0:
        return {}
    rows = joint_drives(correlations[np.ix_(tied, tied)], n, rng)
    return {names[i]: row for i, row in zip(tied, rows, strict=True)}


def _temperature(model: NoiseModel, time_s: Floats) -> Floats | None:
    if model.temperature is None:
        return None
    return np.interp(time_s, model.temperature.time_s, model.temperature.temperature_degc)


def _temperature_channel(model: NoiseModel, duration_s: float, start_ns: int) -> Channel | None:
    if model.temperature is None:
        return None
    time_s = np.arange(max(round(duration_s * TEMPERATURE_RATE_HZ), 1)) / TEMPERATURE_RATE_HZ
    values = _temperature(model, time_s)
    assert values is not None
    return _channel(
        TEMPERATURE_TOPIC, "temperature", "degC", time_s, values, TEMPERATURE_RATE_HZ, start_ns
    )


def _transport(
    members: list[ChannelModel],
    outputs: dict[str, Floats],
    time_s: Floats,
    rate_hz: float,
    rng: np.random.Generator,
    start_ns: int,
) -> dict[str, Channel]:
    stamp_s, index = time_s, np.arange(time_s.size)
    for effect in transport_effects(members):
        stamp_s, carried = effect.transport(stamp_s, 1.0 / rate_hz, rng)
        index = index[carried]
    return {
        c.name: _channel(
            c.topic, c.name, c.unit, stamp_s, outputs[c.name][index], rate_hz, start_ns
        )
        for c in members
    }


def _channel(
    topic: str,
    name: str,
    unit: str,
    stamp_s: Floats,
    values: Floats,
    rate_hz: float,
    start_ns: int,
) -> Channel:
    stamp_ns: Stamps = start_ns + _increasing(np.rint(stamp_s * 1e9).astype(np.int64))
    still = np.ones(values.size, dtype=bool)
    return Channel(topic, name, unit, stamp_ns, values, still, rate_hz, Quality())


def _increasing(stamp_ns: Stamps) -> Stamps:
    """Stamps from 0 on, strictly increasing by 1 ns at least."""
    order = np.arange(stamp_ns.size)
    return np.maximum(np.maximum.accumulate(stamp_ns - order), 0) + order
