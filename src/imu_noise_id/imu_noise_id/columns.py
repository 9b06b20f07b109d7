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
        self._allocate(max(self.capacity, 1))

    def _allocate(self, capacity: int) -> None:
        self.capacity = capacity
        self._stamp_ns = np.empty(capacity, np.int64)
        self._log_ns = np.empty(capacity, np.int64)
        self._values = np.empty((len(LAYOUTS[self.type].columns), capacity))

    def append(self, decoded: Decoded, log_ns: Stamps) -> None:
        """Add decoded messages and the log time of each message that was given to `decode`."""
        begin, end = self.size, self.size + decoded.stamp_ns.size
        if end > self.capacity:
            old = self._stamp_ns, self._log_ns, self._values
            self._allocate(max(end, 2 * self.capacity))
            self._stamp_ns[:begin], self._log_ns[:begin] = old[0][:begin], old[1][:begin]
            self._values[:, :begin] = old[2][:, :begin]
        self._stamp_ns[begin:end] = decoded.stamp_ns
        self._log_ns[begin:end] = log_ns[decoded.valid]
        self._values[:, begin:end] = decoded.values
        self.size = end
        self.invalid += decoded.valid.size - decoded.stamp_ns.size
        if len(self.frame_ids) < 8:
            self.frame_ids |= decoded.frame_ids

    def columns(self) -> TopicColumns:
        """What has come so far, without copying it."""
        return TopicColumns(
            self.topic,
            self.type,
            self._stamp_ns[: self.size],
            self._log_ns[: self.size],
            self._values[:, : self.size],
            frozenset(self.frame_ids),
            self.invalid,
        )
