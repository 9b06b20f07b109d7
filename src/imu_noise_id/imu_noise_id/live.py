"""What a live run finds: the offline identification of its buffer, small enough to send.

While the run fits the buffer the answer is the offline one to the last digit.  Beyond, two
recordings are identified: the buffer, and the block averages of the whole run.  Slow effects
(walks, ramps, flicker, and what is correlated over more than `SLOW_BLOCKS` blocks) and the Allan
deviation from `SLOW_BLOCKS` blocks on are those of the whole run, the rest those of the buffer.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from imu_noise_id.allan import AllanCurve
from imu_noise_id.assemble import to_recording
from imu_noise_id.columns import TopicColumns
from imu_noise_id.identify import ChannelResult, Identification, identify_recording
from imu_noise_id.longrun import LongRun
from imu_noise_id.model import ChannelModel, FittedEffect, NoiseModel
from imu_noise_id.reconcile.loop import compare_recording
from imu_noise_id.recording import Quality, Recording

if TYPE_CHECKING:
    from imu_noise_id.cca import Cca
    from imu_noise_id.reconcile.result import ChannelReconciliation

SOURCE = "live"
SLOW_BLOCKS = 32
ALWAYS_SLOW = ("bias_instability", "rate_random_walk", "rate_ramp")
TIMES = {"gauss_markov": "correlation_time_s", "random_telegraph": "mean_dwell_s"}


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
    cca : Cca or None
    notes : tuple of str
    """

    name: str
    newest_ns: int
    samples: int
    quality: Quality
    allan: AllanCurve | None
    cca: Cca | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Span:
    """A stretch of the run in seconds since `Findings.start_ns`, and what was made of it."""

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
    discrepancies : tuple of ChannelReconciliation
        Where the buffer differs from the reference model; empty without one.
    """

    start_ns: int
    frame_id: str
    span: Span
    model: NoiseModel
    channels: tuple[ChannelFindings, ...]
    notes: tuple[str, ...] = ()
    discrepancies: tuple[ChannelReconciliation, ...] = ()


def identify_columns(
    columns: Sequence[TopicColumns],
    last_s: float | None = None,
    before: Sequence[LongRun] = (),
    reference: NoiseModel | None = None,
) -> Findings:
    """Identify what a buffer holds, exactly as the same samples in a bag.

    Parameters
    ----------
    columns : sequence of TopicColumns
        In order of the kinds of sensors.
    last_s : float, optional
        Only the last seconds; what was before the buffer is then left out.
    before : sequence of LongRun
        What the buffer has forgotten, topic by topic.
    reference : NoiseModel, optional
        A model that the buffer is compared with.

    Raises
    ------
    InputError
        When no topic has two samples in order.
    """
    recording = _recording(columns, last_s)
    found = findings(identify_recording(recording, 1), _frame(columns))
    if reference is not None:
        found = replace(found, discrepancies=compare_recording(recording, reference))
    forgotten = {run.topic: run for run in before if not run.empty}
    if last_s is not None or not forgotten:
        return found
    whole = []
    for part in columns:
        if part.topic in forgotten:
            run = copy.deepcopy(forgotten[part.topic])
            run.feed(part)
            whole.append(run)
    averages = to_recording([run.columns() for run in whole], SOURCE)
    return _with_slow(found, identify_recording(averages, 1), whole)


def _recording(columns: Sequence[TopicColumns], last_s: float | None) -> Recording:
    if last_s is not None:
        newest = max((int(c.stamp_ns[-1]) for c in columns if c.stamp_ns.size), default=0)
        columns = [c.last(newest - round(last_s * 1e9)) for c in columns]
    return to_recording(columns, SOURCE)


def _frame(columns: Sequence[TopicColumns]) -> str:
    """Frame of the first topic, the IMU's."""
    frames = columns[0].frame_ids if columns else frozenset()
    return min(frames).decode(errors="replace") if frames else ""


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


def _with_slow(found: Findings, slow: Identification, runs: Sequence[LongRun]) -> Findings:
    """Findings of a buffer with the slow effects of the whole run."""
    blocks = {run.topic: run.block_s for run in runs}
    by_name = {result.channel.name: result for result in slow.channels}
    models, channels = [], []
    for model, channel in zip(found.model.channels, found.channels, strict=True):
        result = by_name.get(model.name)
        if result is None:
            models.append(model)
            channels.append(channel)
            continue
        split_s = SLOW_BLOCKS * blocks[model.topic]
        models.append(_joined_model(model, result.model, split_s))
        curve = _joined_curve(channel.allan, result.allan, split_s)
        channels.append(replace(channel, allan=curve))
    begin_s = min((int(c.stamp_ns[0]) for c in slow.recording.channels), default=0)
    longest = max(blocks.values())
    what = f"the whole run as averages of {longest:g} s, its last part as it was received"
    span = Span((begin_s - found.start_ns) * 1e-9, found.span.to_s, what)
    return replace(
        found,
        span=span,
        model=replace(found.model, channels=tuple(models)),
        channels=tuple(channels),
        notes=(*found.notes, *slow.notes),
    )


def _is_slow(fitted: FittedEffect, split_s: float) -> bool:
    if fitted.name in TIMES:
        return bool(getattr(fitted.effect, TIMES[fitted.name]) > split_s)
    return fitted.name in ALWAYS_SLOW


def _joined_model(fast: ChannelModel, slow: ChannelModel, split_s: float) -> ChannelModel:
    effects = [e for e in fast.effects if not _is_slow(e, split_s)]
    effects += [e for e in slow.effects if _is_slow(e, split_s)]
    bounds = [b for b in fast.bounds if b.name not in ALWAYS_SLOW]
    bounds += [b for b in slow.bounds if b.name in ALWAYS_SLOW]
    return replace(
        fast,
        effects=tuple(sorted(effects, key=lambda e: e.effect.stage)),
        log_covariance=None,
        duration_s=slow.duration_s,
        bounds=tuple(bounds),
    )


def _joined_curve(
    fast: AllanCurve | None, slow: AllanCurve | None, split_s: float
) -> AllanCurve | None:
    """The buffer's curve up to a tau, the whole run's from there on."""
    if fast is None or slow is None or not (slow.tau_s >= split_s).any():
        return fast
    begin, end = fast.tau_s < split_s, slow.tau_s >= split_s
    parts: dict[str, Any] = {
        f.name: np.concatenate((getattr(fast, f.name)[begin], getattr(slow, f.name)[end]))
        for f in fields(AllanCurve)
        if isinstance(getattr(fast, f.name), np.ndarray)
    }
    return replace(fast, **parts)
