"""Recording -> noise model of every channel, with what the data say and do not say."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from imu_noise_id.allan import AllanCurve, allan
from imu_noise_id.estimation import estimate_series
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.recording import Channel, Recording
from imu_noise_id.series import Series, to_series

if TYPE_CHECKING:
    from imu_noise_id.cca import CcaModel

SHORTEST = 32


@dataclass(frozen=True)
class ChannelResult:
    """One channel with its curves and its model.

    Attributes
    ----------
    channel : Channel
    series : Series
        The channel on a uniform grid, as recorded (nothing mended).
    allan : AllanCurve or None
        Of the recording as it is; None where it is too short.
    model : ChannelModel
    cca : CcaModel or None
        Past-future canonical variates; None where the channel is too short or constant.
    notes : tuple of str
        What a reader should know, one sentence each.
    """

    channel: Channel
    series: Series
    allan: AllanCurve | None
    model: ChannelModel
    cca: CcaModel | None
    notes: tuple[str, ...] = ()


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

    def channel(self, name: str) -> ChannelResult:
        """Return the channel of that name; raise KeyError when there is none."""
        for result in self.channels:
            if result.channel.name == name:
                return result
        raise KeyError(name)


def identify_recording(recording: Recording, workers: int = 2) -> Identification:
    """Identify every channel of a recording.

    Parameters
    ----------
    recording : Recording
    workers : int
        Threads over channels; the result does not depend on their number.

    Returns
    -------
    Identification
    """
    notes = [
        f"{c.topic} {c.name}: the platform moved throughout, nothing identified"
        for c in recording.channels
        if not c.still.any()
    ]
    channels = [c for c in recording.channels if c.still.any()]
    with ThreadPoolExecutor(max(workers, 1)) as pool:
        results = tuple(pool.map(lambda c: identify_channel(c, recording), channels))
    model = NoiseModel(tuple(r.model for r in results), None, recording.source)
    return Identification(recording, results, model, tuple(notes))


def identify_channel(channel: Channel, recording: Recording) -> ChannelResult:
    """Curves and model of one channel that has a still sample."""
    series = to_series(channel, recording.start_ns)
    model, notes = identify_series(series, channel)
    return ChannelResult(channel, series, allan(series), model, None, notes)


def identify_series(series: Series, channel: Channel) -> tuple[ChannelModel, tuple[str, ...]]:
    """Noise model of one series, and what a reader should know about it."""
    seen = series.values[series.observed]
    empty = ChannelModel(
        channel.name,
        channel.topic,
        channel.unit,
        channel.rate_hz,
        series.mean,
        (),
        None,
        channel.duration_s,
    )
    if seen.size < SHORTEST:
        return empty, (f"{seen.size} samples: too few for a noise model ({SHORTEST} are needed)",)
    if np.all(seen == seen[0]):
        return empty, ("constant: no noise is seen",)
    found = estimate_series(series, channel.unit)
    model = ChannelModel(
        channel.name,
        channel.topic,
        channel.unit,
        channel.rate_hz,
        found.mean,
        found.effects,
        found.log_covariance,
        channel.duration_s,
        found.bounds,
    )
    return model, found.notes
