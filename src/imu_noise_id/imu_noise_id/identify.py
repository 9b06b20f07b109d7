"""Recording -> noise model of every channel, with what the data say and do not say."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from imu_noise_id.allan import AllanCurve, allan
from imu_noise_id.allan_degrees import with_spectrum
from imu_noise_id.axes_together import AxesTogether, axes_together
from imu_noise_id.cca import Cca, past_future
from imu_noise_id.cross_axes import cross_axes, with_effects
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.estimation import estimate_series
from imu_noise_id.model import (
    ChannelModel,
    Estimate,
    FittedEffect,
    NoiseModel,
    TemperatureCourse,
)
from imu_noise_id.recording import Channel, Floats, Recording
from imu_noise_id.series import Series, to_series
from imu_noise_id.shaping_allan import allan_deviation, allan_distance
from imu_noise_id.transport import Transport, find_transport, without_repeats

SHORTEST = 32
LEAST_FOR_CCA = 200
COURSE_POINTS = 2000
HANDLED = 0.2
"""Share of moving samples from which a recording is one of handling, with a rest in it."""


def _say_nothing(name: str) -> None:
    """Who asks for no progress gets none."""


@dataclass(frozen=True)
class ChannelResult:
    """One channel with its curves and its model.

    Attributes
    ----------
    channel : Channel
    series : Series
        The channel on a uniform grid, as recorded (nothing mended).
    allan : AllanCurve or None
        Of the recording as it is, with intervals as wide as its spectrum asks; None where it is
        too short.
    model : ChannelModel
    cca : Cca or None
        Past-future canonical variates; None where the channel is too short or constant.
    notes : tuple of str
        What a reader should know, one sentence each.
    """

    channel: Channel
    series: Series
    allan: AllanCurve | None
    model: ChannelModel
    cca: Cca | None
    notes: tuple[str, ...] = ()

    @cached_property
    def cca_deviation(self) -> Floats | None:
        """Allan deviation of the canonical-correlation model at the measured averaging times."""
        curve = self.allan
        if self.cca is None or curve is None or not curve.tau_s.size or not self.cca.H_z.stable:
            return None
        return allan_deviation(self.cca.H_z, curve.averaging_factor)

    @property
    def cca_distance(self) -> float | None:
        """How far that is from the measured curve, see ``allan_distance``."""
        modelled = self.cca_deviation
        if modelled is None or self.allan is None:
            return None
        return allan_distance(self.allan.deviation, modelled, self.allan.degrees_of_freedom)


@dataclass(frozen=True)
class Identification:
    """What was identified in a recording, channel by channel.

    Attributes
    ----------
    recording : Recording
    channels : tuple of ChannelResult
        In the order of the recording's channels; channels without a still sample are left out.
    model : NoiseModel
        The channels' models together.
    notes : tuple of str
        What concerns several channels or none that could be used.
    """

    recording: Recording
    channels: tuple[ChannelResult, ...]
    model: NoiseModel
    notes: tuple[str, ...] = ()

    @cached_property
    def sensors(self) -> tuple[AxesTogether, ...]:
        """Models of the three axes of a sensor together; found when first asked for."""
        return axes_together(self.channels)

    def channel(self, name: str) -> ChannelResult:
        """Return the channel of that name; raise KeyError when there is none."""
        for result in self.channels:
            if result.channel.name == name:
                return result
        raise KeyError(name)


def identify_recording(
    recording: Recording, workers: int = 2, done: Callable[[str], None] = _say_nothing
) -> Identification:
    """Identify every channel of a recording.

    Parameters
    ----------
    recording : Recording
    workers : int
        Threads over channels; the result does not depend on their number.
    done : callable
        Told the name of each channel that is through, by any of the threads.

    Returns
    -------
    Identification
    """
    notes = tuple(
        f"{c.topic} {c.name}: the platform moved throughout, nothing identified"
        for c in recording.channels
        if not c.still.any()
    )
    channels = [_at_rest(c) for c in recording.channels if c.still.any()]
    groups = {t: tuple(c for c in channels if c.topic == t) for t in {c.topic for c in channels}}
    transports = {topic: find_transport(group) for topic, group in groups.items()}

    def work(channel: Channel) -> tuple[ChannelResult, NDArray[np.float32]]:
        group = groups[channel.topic]
        found = _identify_channel(channel, group, transports[channel.topic], recording)
        done(channel.name)
        return found

    with ThreadPoolExecutor(max(workers, 1)) as pool:
        found = list(pool.map(work, channels))
    tied = cross_axes([(r.channel.topic, r.channel.name, white) for r, white in found])
    results = tuple(
        dataclasses.replace(r, model=with_effects(r.model, tied.get(r.channel.name, ())))
        for r, _ in found
    )
    models = tuple(r.model for r in results)
    model = NoiseModel(models, _course(recording, models), recording.source)
    return Identification(recording, results, model, notes)


def _at_rest(channel: Channel) -> Channel:
    """Channel of which only the longest still stretch counts, where it was handled otherwise.

    After a move gravity and the field have other components; that is no noise.
    """
    if np.mean(~channel.still) < HANDLED:
        return channel
    edges = np.flatnonzero(np.diff(channel.still.astype(np.int8), prepend=0, append=0))
    begin, end = edges[0::2], edges[1::2]
    longest = int(np.argmax(end - begin))
    still = np.zeros_like(channel.still)
    still[begin[longest] : end[longest]] = True
    seen = f"{still.sum()} of {channel.still.sum()} still samples"
    note = f"handled: identified on the longest rest alone, {seen}"
    quality = dataclasses.replace(channel.quality, notes=(*channel.quality.notes, note))
    return dataclasses.replace(channel, still=still, quality=quality)


def _identify_channel(
    channel: Channel, group: tuple[Channel, ...], transport: Transport, recording: Recording
) -> tuple[ChannelResult, NDArray[np.float32]]:
    """Curves and model of one channel that has a still sample, and its white residual."""
    series = to_series(channel, recording.start_ns)
    fresh = series
    if transport.factor != 1.0:
        fresh = to_series(without_repeats(channel, group, transport.factor), recording.start_ns)
    model = ChannelModel(
        channel.name,
        channel.topic,
        channel.unit,
        channel.rate_hz,
        series.mean,
        transport.effects,
        None,
        channel.duration_s,
    )
    curve = allan(series)
    reason = _nothing_to_see(fresh)
    if reason:
        result = ChannelResult(channel, series, curve, model, None, (reason,))
        return result, np.zeros(0, dtype=np.float32)
    rng = np.random.default_rng(list(f"{channel.topic} {channel.name}".encode()))
    found = estimate_series(fresh, channel.unit, rng, _temperature(recording, fresh))
    curve = with_spectrum(curve, found.fit.ordinates)
    held = transport.factor**-0.5
    model = dataclasses.replace(
        model,
        mean=found.mean,
        effects=tuple(_as_sent(e, held) for e in found.effects),
        log_covariance=found.log_covariance,
        bounds=found.bounds,
    )
    model = with_effects(model, transport.effects)
    cca = past_future(series) if series.observed.sum() >= LEAST_FOR_CCA else None
    return ChannelResult(channel, series, curve, model, cca, found.notes), found.white


def _nothing_to_see(series: Series) -> str:
    """Why a series has no noise model, or an empty string."""
    seen = series.seen
    if seen.size < SHORTEST:
        return f"{seen.size} samples: too few for a noise model ({SHORTEST} are needed)"
    return "constant: no noise is seen" if np.all(seen == seen[0]) else ""


def _as_sent(fitted: FittedEffect, factor: float) -> FittedEffect:
    """White noise found at the rate of new samples, as a density at the rate of messages."""
    if factor == 1.0 or not isinstance(fitted.effect, WhiteNoise):
        return fitted
    (row,) = fitted.estimates

    def scaled(value: float | str | None) -> float | None:
        return None if value is None or isinstance(value, str) else factor * value

    changed = Estimate(
        scaled(row.value),
        scaled(row.std_error),
        scaled(row.lower),
        scaled(row.upper),
        row.unit,
    )
    return FittedEffect(WhiteNoise(factor * fitted.effect.density), (changed,), fitted.note)


def _temperature(recording: Recording, series: Series) -> Floats | None:
    """Recorded temperature at the samples of a series, held beyond its ends."""
    channel = recording.temperature
    if channel is None or channel.values.size < 2:
        return None
    stamps_s = (channel.stamp_ns - recording.start_ns) * 1e-9
    return np.interp(series.time_s, stamps_s, channel.values)


def _course(recording: Recording, models: tuple[ChannelModel, ...]) -> TemperatureCourse | None:
    """Decimated temperature, where a channel depends on it."""
    channel = recording.temperature
    if channel is None or not any(m.find("temperature") for m in models):
        return None
    keep = np.unique(np.linspace(0, channel.values.size - 1, COURSE_POINTS).astype(int))
    stamps_s = (channel.stamp_ns[keep] - recording.start_ns) * 1e-9
    return TemperatureCourse(stamps_s, channel.values[keep])
