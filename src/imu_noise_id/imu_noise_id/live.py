"""What a live run finds in its buffer: the offline identification, small enough to send."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from imu_noise_id.allan import AllanCurve
from imu_noise_id.assemble import to_recording
from imu_noise_id.columns import TopicColumns
from imu_noise_id.identify import ChannelResult, Identification, identify_recording
from imu_noise_id.model import NoiseModel
from imu_noise_id.recording import Quality, Recording

if TYPE_CHECKING:
    from imu_noise_id.cca import CcaModel

SOURCE = "live"


@dataclass(frozen=True)
class ChannelFindings:
    """One channel: its curve and its model's surroundings, without samples.

    Attributes
    ----------
    name : str
        The model of that name in `Findings.model` belongs to it.
    newest_ns : int
        Stamp of the newest sample used.
    samples : int
    quality : Quality
    allan : AllanCurve or None
    cca : CcaModel or None
    notes : tuple of str
    """

    name: str
    newest_ns: int
    samples: int
    quality: Quality
    allan: AllanCurve | None
    cca: CcaModel | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Span:
    """A stretch of the run in seconds since its first stamp, and what was made of it."""

    from_s: float
    to_s: float
    what: str


@dataclass(frozen=True)
class Findings:
    """Model, curves and qualities of a live buffer.

    Attributes
    ----------
    start_ns : int
        First stamp; every time in the model counts from here.
    frame_id : str
        Of the IMU's messages.
    span : Span
    model : NoiseModel
    channels : tuple of ChannelFindings
    notes : tuple of str
    """

    start_ns: int
    frame_id: str
    span: Span
    model: NoiseModel
    channels: tuple[ChannelFindings, ...]
    notes: tuple[str, ...] = ()


def identify_columns(
    columns: Sequence[TopicColumns], last_s: float | None = None, workers: int = 1
) -> Findings:
    """Identify what a buffer holds, exactly as the same samples in a bag.

    Parameters
    ----------
    columns : sequence of TopicColumns
        In order of the kinds of sensors.
    last_s : float, optional
        Only the last seconds.
    workers : int
        Threads.

    Raises
    ------
    InputError
        When no topic has two samples in order.
    """
    if last_s is not None:
        newest = max((int(c.stamp_ns[-1]) for c in columns if c.stamp_ns.size), default=0)
        columns = [c.last(newest - round(last_s * 1e9)) for c in columns]
    recording = to_recording(columns, SOURCE)
    frames = columns[0].frame_ids if columns else frozenset()
    frame_id = min(frames).decode(errors="replace") if frames else ""
    return findings(identify_recording(recording, workers), frame_id)


def findings(identification: Identification, frame_id: str) -> Findings:
    """Leave out the samples."""
    recording = identification.recording
    return Findings(
        recording.start_ns,
        frame_id,
        _span(recording),
        identification.model,
        tuple(_channel(result) for result in identification.channels),
        (*recording.notes, *identification.notes),
    )


def _channel(result: ChannelResult) -> ChannelFindings:
    channel = result.channel
    return ChannelFindings(
        channel.name,
        int(channel.stamp_ns[-1]),
        int(channel.still.sum()),
        channel.quality,
        result.allan,
        result.cca,
        result.notes,
    )


def _span(recording: Recording) -> Span:
    newest = max(int(c.stamp_ns[-1]) for c in recording.channels)
    return Span(0.0, (newest - recording.start_ns) * 1e-9, "everything received")
