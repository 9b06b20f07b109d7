"""The samples of one topic as they were received, before anything is made of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from imu_noise_id.cdr import LAYOUTS, Decoded
from imu_noise_id.recording import Floats, Stamps


@dataclass(frozen=True)
class TopicColumns:
    """All messages of one topic.

    Attributes
    ----------
    topic, type : str
        Name, and message type (a key of `cdr.LAYOUTS`).
    stamp_ns, log_ns : (n,) int64
        Header stamps, and the times of reception, in the order of reception.
    values : (k, n) float64
        One row for each of the layout's `columns`.
    frame_ids : frozenset of bytes
    invalid : int
        Messages left out because they are not of the type.
    """

    topic: str
    type: str
    stamp_ns: Stamps
    log_ns: Stamps
    values: Floats
    frame_ids: frozenset[bytes] = frozenset()
    invalid: int = 0

    def last(self, first_ns: int) -> TopicColumns:
        """Only the messages stamped `first_ns` or later."""
        keep = self.stamp_ns >= first_ns
        return TopicColumns(
            self.topic,
            self.type,
            self.stamp_ns[keep],
            self.log_ns[keep],
            self.values[:, keep],
            self.frame_ids,
            self.invalid,
        )


@dataclass
class ColumnBuffer:
    """Columns that grow; memory is claimed as samples come, not before.

    `capacity` is a first guess; a right one saves copies.
    """

    topic: str
    type: str
    capacity: int = 1024
    size: int = 0
    invalid: int = 0
    frame_ids: set[bytes] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.capacity = max(self.capacity, 1)
        self._arrays = self._room(self.capacity)

    def _room(self, capacity: int) -> tuple[Stamps, Stamps, Floats]:
        values = np.empty((len(LAYOUTS[self.type].columns), capacity))
        return np.empty(capacity, np.int64), np.empty(capacity, np.int64), values

    def _grow(self, capacity: int) -> None:
        """Make room; what is there moves over before another thread can see the new arrays."""
        grown = self._room(capacity)
        for old, new in zip(self._arrays, grown, strict=True):
            new[..., : self.size] = old[..., : self.size]
        self.capacity, self._arrays = capacity, grown

    def append(self, decoded: Decoded, log_ns: Stamps) -> None:
        """Add decoded messages and the log time of each message that was given to `decode`."""
        begin, end = self.size, self.size + decoded.stamp_ns.size
        if end > self.capacity:
            self._grow(max(end, 2 * self.capacity))
        stamps, logs, values = self._arrays
        stamps[begin:end] = decoded.stamp_ns
        logs[begin:end] = log_ns[decoded.valid]
        values[:, begin:end] = decoded.values
        self.size = end
        self.invalid += decoded.valid.size - decoded.stamp_ns.size
        if len(self.frame_ids) < 8:
            self.frame_ids |= decoded.frame_ids

    def columns(self) -> TopicColumns:
        """What has come so far, without copying it."""
        stamps, logs, values = self._arrays
        return TopicColumns(
            self.topic,
            self.type,
            stamps[: self.size],
            logs[: self.size],
            values[:, : self.size],
            frozenset(self.frame_ids),
            self.invalid,
        )
