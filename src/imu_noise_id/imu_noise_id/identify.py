"""Recording -> noise model of every channel, with what the data say and do not say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.recording import Channel, Recording
from imu_noise_id.series import Series

if TYPE_CHECKING:
    from imu_noise_id.allan import AllanCurve
    from imu_noise_id.cca import CcaModel


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
