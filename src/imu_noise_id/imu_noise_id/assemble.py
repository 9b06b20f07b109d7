"""Topics to a recording: one function for bags and live buffers, so that both say the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from imu_noise_id import cdr
from imu_noise_id.cdr import LAYOUTS
from imu_noise_id.clock_ticks import evened
from imu_noise_id.columns import TopicColumns
from imu_noise_id.errors import InputError
from imu_noise_id.geodesy import enu_about_mean
from imu_noise_id.heading import heading
from imu_noise_id.motion import Intervals, moving_intervals
from imu_noise_id.recording import (
    Channel,
    Floats,
    Quality,
    ReceiverClaim,
    Recording,
    unit_of,
)
from imu_noise_id.stamps import Timing, examine, spread_batches

_NO_FIX = -1
_WIDEST = np.array((90.0, 360.0, 1e7))
"""Latitude and longitude in degrees and altitude in metres that can be."""
_ABSURD = 1e100
"""No sensor's value; counted as not finite, so that squares can be taken."""
_COUNTED_FROM_ZERO_NS = 1_000_000_000_000_000_000
"""Stamps before 2001 are a simulation's, which may begin at 0."""
_SPREAD_NS = 86_400_000_000_000


@dataclass(frozen=True)
class _Samples:
    """A topic whose stamps are in order: values (k, n) under channel names."""

    topic: str
    timing: Timing
    names: tuple[str, ...]
    values: Floats
    notes: tuple[str, ...] = ()


def to_recording(
    topics: Sequence[TopicColumns], source: str, notes: Sequence[str] = ()
) -> Recording:
    """Make channels of topics: put stamps in order, convert, judge quality, find motion.

    Parameters
    ----------
    topics : sequence of TopicColumns
        At most one of each kind of sensor.
    source : str
        The bag's path, or ``live``.
    notes : sequence of str
        What the reader has to say already.

    Returns
    -------
    Recording

    Raises
    ------
    InputError
        When no topic has two samples in order.
    """
    said = list(notes)
    used = [_used_stamps(t, said) for t in topics if t.stamp_ns.size]
    samples = []
    claim = None
    for columns in used:
        timing = _timing(columns)
        if timing.stamp_ns.size < 2:
            said.append(_too_few(columns, timing))
            continue
        ordered = columns
        if not timing.kept.all():
            ordered = replace(columns, values=columns.values[:, timing.kept])
        if columns.type == cdr.NAV_SAT_FIX:
            claim = _claim(ordered, timing)
        samples.append(_samples(ordered, timing))
    field_of, imu = _of_kind(samples, "magnetic_field.x"), _of_kind(samples, "angular_velocity.x")
    if field_of and imu:
        samples.append(_heading_samples(field_of, imu))
    moving = moving_intervals([(s.names, s.timing.stamp_ns, s.values) for s in samples])
    channels = [c for s in samples for c in _channels(s, moving, said)]
    temperature = next((c for c in channels if c.name == "temperature"), None)
    channels = [c for c in channels if c.name != "temperature"]
    if not channels:
        raise InputError(f"{source}: {'; '.join(said) or 'no message'}")
    starts = [int(c.stamp_ns[0]) for c in channels]
    if max(starts) - min(starts) > _SPREAD_NS:
        said.append("the topics' stamps lie more than a day apart: their clocks differ")
    start_ns = min(starts)
    channels = [_with_motion(c, moving, start_ns) for c in channels]
    return Recording(source, start_ns, tuple(channels), temperature, claim, tuple(said))


def _timing(columns: TopicColumns) -> Timing:
    """Stamps in order; those of a coarse clock or of a batch are spread evenly first."""
    stamp_ns = columns.stamp_ns
    fresh = np.ones(stamp_ns.size, dtype=bool)
    if shared := (stamp_ns[1:] == stamp_ns[:-1]).any():
        fresh[1:] = (columns.values[:, 1:] != columns.values[:, :-1]).any(axis=0)
    spread, notes = evened(stamp_ns, fresh)
    if shared and not notes:
        spread, notes = spread_batches(stamp_ns, fresh)
    timing = examine(spread, columns.log_ns)
    return replace(timing, notes=(*notes, *timing.notes))


def _too_few(columns: TopicColumns, timing: Timing) -> str:
    count = columns.stamp_ns.size
    if timing.notes and not timing.stamp_ns.size:
        return f"topic {columns.topic}: {timing.notes[0]}; make the driver stamp its messages"
    if count == 1:
        return f"topic {columns.topic} has one message; record for longer"
    return (
        f"the {count} messages of topic {columns.topic} all bear the stamp {columns.stamp_ns[0]} "
        "ns; make the driver stamp them"
    )


def _used_stamps(columns: TopicColumns, said: list[str]) -> TopicColumns:
    """Header stamps, log times where those are zero (and zero is no time of a simulation)."""
    if columns.invalid:
        kind = columns.type.replace("/msg/", "/")
        said.append(f"{columns.invalid} messages of topic {columns.topic} are no {kind}: left out")
    if len(columns.frame_ids) > 1:
        frames = ", ".join(sorted(repr(f.decode(errors="replace")) for f in columns.frame_ids))
        said.append(f"topic {columns.topic} has messages of several frames ({frames})")
    zero = columns.stamp_ns == 0
    count = int(np.count_nonzero(zero))
    if count == 0 or (count < zero.size and columns.stamp_ns.max() < _COUNTED_FROM_ZERO_NS):
        return columns
    every = "all" if count == zero.size else f"{count} of {zero.size}"
    said.append(
        f"{every} header stamps of topic {columns.topic} are zero: the time of reception is used"
    )
    return replace(columns, stamp_ns=np.where(zero, columns.log_ns, columns.stamp_ns))


def _samples(columns: TopicColumns, timing: Timing) -> _Samples:
    """Channel names and values of a topic in order."""
    values = columns.values
    if not all((np.abs(row) < _ABSURD).all() for row in values):
        values = np.where(np.abs(values) < _ABSURD, values, np.nan)
    rows = dict(zip(LAYOUTS[columns.type].columns, values, strict=True))
    if columns.type == cdr.NAV_SAT_FIX:
        return _fix_samples(columns.topic, timing, rows)
    if columns.type in (cdr.TWIST, cdr.TWIST_WITH_COVARIANCE):
        names = tuple(f"velocity.{axis}" for axis in ("east", "north", "up"))
        return _Samples(columns.topic, timing, names, values[:3])
    return _Samples(columns.topic, timing, tuple(rows), values)


def _fix_samples(topic: str, timing: Timing, rows: dict[str, Floats]) -> _Samples:
    geodetic = np.array([rows[name] for name in ("latitude", "longitude", "altitude")])
    lost = rows["status"] <= _NO_FIX
    sound = np.abs(geodetic) <= _WIDEST[:, np.newaxis]
    usable = sound[:2].all(axis=0) & (sound[2] | np.isnan(geodetic[2])) & ~lost
    notes: tuple[str, ...] = ()
    if count := int(np.count_nonzero(lost)):
        notes = (f"{count} messages say that there is no fix: left out",)
    names = tuple(f"position.{axis}" for axis in ("east", "north", "up"))
    values = np.full((3, usable.size), np.nan)
    if usable.any():
        values[:, usable] = enu_about_mean(*geodetic[:, usable])
        values[2, ~sound[2]] = np.nan
    return _Samples(topic, timing, names, values, notes)


def _claim(columns: TopicColumns, timing: Timing) -> ReceiverClaim | None:
    """The covariance that the receiver gives with each fix, if it gives one."""
    rows = dict(zip(LAYOUTS[columns.type].columns, columns.values, strict=True))
    entries = np.array([rows[f"position_covariance.{k}"] for k in range(9)])
    given = (rows["covariance_type"] > 0) & (rows["status"] > _NO_FIX)
    given &= np.isfinite(entries).all(axis=0) & (entries[[0, 4, 8]] > 0).all(axis=0)
    if not given.any():
        return None
    return ReceiverClaim(timing.stamp_ns[given], entries[:, given].T.reshape(-1, 3, 3))


def _of_kind(samples: Sequence[_Samples], first_name: str) -> _Samples | None:
    return next((s for s in samples if s.names[0] == first_name), None)


def _heading_samples(field: _Samples, imu: _Samples) -> _Samples:
    values = heading(field.timing.stamp_ns, field.values, imu.timing.stamp_ns, imu.values[3:])
    return _Samples(field.topic, field.timing, ("heading",), values[np.newaxis], field.notes)


def _channels(samples: _Samples, moving: Intervals, said: list[str]) -> list[Channel]:
    """One channel for each row; rows without a finite sample are none, and that is noted."""
    timing = samples.timing
    still = moving.still(timing.stamp_ns)
    channels = []
    for name, row in zip(samples.names, samples.values, strict=True):
        finite = np.isfinite(row)
        count = int(np.count_nonzero(finite))
        if count < 2:
            why = f" ({'; '.join(samples.notes)})" if samples.notes else ""
            said.append(
                f"topic {samples.topic}, {name}: no finite sample{why}; the channel is left out"
            )
            continue
        stamp_ns, values, mask = timing.stamp_ns, row, still
        if count < row.size:
            stamp_ns, values, mask = stamp_ns[finite], values[finite], still[finite]
        quality = _quality(samples, values, row.size - count)
        channels.append(
            Channel(
                samples.topic, name, unit_of(name), stamp_ns, values, mask, timing.rate_hz, quality
            )
        )
    return channels


def _quality(samples: _Samples, values: Floats, non_finite: int) -> Quality:
    held = int(np.count_nonzero(values[1:] == values[:-1]))
    notes = [*samples.notes, *samples.timing.notes]
    if non_finite:
        notes.append(f"{non_finite} samples are not finite: left out")
    if held == values.size - 1:
        notes.append("every sample has the same value to the last bit: there is no noise to see")
    timing = samples.timing
    return Quality(
        gaps=timing.gaps,
        missing=timing.missing,
        duplicates=timing.duplicates,
        out_of_order=timing.out_of_order,
        non_finite=non_finite,
        held=held,
        jitter_s=timing.jitter_s,
        notes=tuple(notes),
    )


def _with_motion(channel: Channel, moving: Intervals, start_ns: int) -> Channel:
    """The channel with what is known of the platform's motion in its quality."""
    parts = moving.seconds_since(start_ns)
    if not parts:
        return channel
    notes = (*channel.quality.notes, moving.note(start_ns))
    quality = replace(channel.quality, static=False, moving_s=parts, notes=notes)
    return replace(channel, quality=quality)
