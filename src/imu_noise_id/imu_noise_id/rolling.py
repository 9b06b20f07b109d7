"""The newest messages of a topic in bounded memory.

Blocks of preallocated columns are filled in order of reception and handed out, oldest first, once
the rest alone covers the span asked for or the most samples allowed are held.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from imu_noise_id.cdr import LAYOUTS, Decoded
from imu_noise_id.columns import ColumnBuffer, TopicColumns
from imu_noise_id.recording import Stamps
from imu_noise_id.stamps import onward

BLOCK = 512


@dataclass
class _Block:
    buffer: ColumnBuffer
    span_ns: int = 0


class RollingColumns:
    """Columns of one topic that forget their oldest block.

    Attributes
    ----------
    topic, type : str
    span_s : float
        What is kept is at least this long (and less than a block longer), unless ...
    most : int
        ... more samples than this were held: stamps that stand still cannot fill the memory.
    forgotten : int
        Samples handed out so far.
    """

    def __init__(self, topic: str, msgtype: str, span_s: float, most: int) -> None:
        self.topic = topic
        self.type = msgtype
        self.span_s = span_s
        self.most = most
        self.forgotten = 0
        self._blocks: deque[_Block] = deque()
        self._held = 0
        self._span_ns = 0
        self._newest: tuple[int, int] | None = None
        self._invalid = 0

    @property
    def size(self) -> int:
        """Samples held."""
        return self._held

    @property
    def buffered_s(self) -> float:
        """Time that the samples held cover; clock steps and gaps beyond a day count nothing."""
        return self._span_ns * 1e-9

    @property
    def full(self) -> bool:
        """Whether the oldest block is no longer needed."""
        if len(self._blocks) < 2:
            return False
        return (
            self._span_ns - self._blocks[0].span_ns >= self.span_s * 1e9 or self._held > self.most
        )

    def append(self, decoded: Decoded, log_ns: Stamps) -> None:
        """Add decoded messages and the time of reception of each that was given to `decode`."""
        size = decoded.stamp_ns.size
        block = self._blocks[-1] if self._blocks else None
        if block is None or block.buffer.size + size > block.buffer.capacity:
            block = _Block(ColumnBuffer(self.topic, self.type, max(BLOCK, size)))
            self._blocks.append(block)
        span = self._advance(decoded.stamp_ns, log_ns[decoded.valid])
        block.buffer.append(decoded, log_ns)
        block.span_ns += span
        self._span_ns += span
        self._held += size
        self._invalid += decoded.valid.size - size

    def forget(self) -> TopicColumns:
        """Take out the oldest block; only when `full`."""
        block = self._blocks.popleft()
        self._span_ns -= block.span_ns
        self._held -= block.buffer.size
        self.forgotten += block.buffer.size
        return block.buffer.columns()

    def columns(self) -> TopicColumns:
        """Everything held, copied into one piece."""
        parts = [block.buffer.columns() for block in self._blocks]
        rows = len(LAYOUTS[self.type].columns)
        return TopicColumns(
            self.topic,
            self.type,
            np.concatenate([p.stamp_ns for p in parts] or [np.empty(0, np.int64)]),
            np.concatenate([p.log_ns for p in parts] or [np.empty(0, np.int64)]),
            np.concatenate([p.values for p in parts] or [np.empty((rows, 0))], axis=1),
            frozenset().union(*(p.frame_ids for p in parts)),
            self._invalid,
        )

    def _advance(self, stamp_ns: Stamps, log_ns: Stamps) -> int:
        """Time that passed with these samples, in nanoseconds."""
        if not stamp_ns.size:
            return 0
        times = stamp_ns if stamp_ns.any() else log_ns
        before, log_before = self._newest or (int(times[0]), int(log_ns[0]))
        self._newest = int(times[-1]), int(log_ns[-1])
        steps, passed = np.diff(times, prepend=before), np.diff(log_ns, prepend=log_before)
        return int(onward(steps, passed).sum())
