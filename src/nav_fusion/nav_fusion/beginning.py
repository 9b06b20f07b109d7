"""What a live filter was fed since it began: a model that is known later is still used from there.

A live filter does not wait for its noise model.  It begins with what is known, keeps what it is
fed for ``longest_s``, and when a better model comes (from ``identify``, or of the leading part in
which the platform rested) a new filter is fed the same from the beginning and takes over: it is
in the state, to the last bit, in which ``fuse --bag`` with that model would be.  Later a model
takes effect at the next start.
"""

from __future__ import annotations

from itertools import islice

from imu_noise_id.cdr import Decoded
from imu_noise_id.columns import ColumnBuffer, TopicColumns
from imu_noise_id.recording import Stamps

from imu_noise_id import cdr
from nav_fusion.engine import Engine
from nav_fusion.feeding import feed

FIRST_LOOK_S = 60.0
"""The leading rest is identified when this much has come, and at every doubling while it lasts."""


class Beginning:
    """Batches of decoded messages in the order of arrival, up to a length.

    The samples lie in one array a topic, and a batch is three numbers: objects that are kept by
    the ten thousand would be looked through by the garbage collector, for 40 ms at a time.
    """

    def __init__(self, longest_s: float = 600.0) -> None:
        self._longest_s = longest_s
        self._buffers: list[ColumnBuffer] = []
        self._batches: list[tuple[int, int, int]] = []
        self._first_ns: int | None = None
        self._span_s = 0.0
        self.look_at_s = FIRST_LOOK_S

    @property
    def kept(self) -> bool:
        """Whether everything since the beginning is here."""
        return self._span_s <= self._longest_s

    @property
    def span_s(self) -> float:
        """Length of the IMU samples kept."""
        return self._span_s

    def add(self, topic: str, msgtype: str, decoded: Decoded, log_ns: Stamps) -> None:
        """Keep a batch; when it is more than is kept, forget all."""
        if not self.kept or decoded.stamp_ns.size == 0:
            return
        if msgtype == cdr.IMU:
            if self._first_ns is None:
                self._first_ns = int(decoded.stamp_ns[0])
            self._span_s = (int(decoded.stamp_ns[-1]) - self._first_ns) * 1e-9
        if not self.kept:
            self.forget()
            return
        k = self._buffer_of(topic, msgtype)
        begin = self._buffers[k].size
        self._buffers[k].append(decoded, log_ns)
        self._batches.append((k, begin, self._buffers[k].size))

    def _buffer_of(self, topic: str, msgtype: str) -> int:
        for k, buffer in enumerate(self._buffers):
            if (buffer.topic, buffer.type) == (topic, msgtype):
                return k
        # room that is not used costs no memory; growing would copy it all while samples wait
        capacity = round(1000 * self._longest_s) if msgtype == cdr.IMU else 1024
        self._buffers.append(ColumnBuffer(topic, msgtype, capacity))
        return len(self._buffers) - 1

    def forget(self) -> None:
        """Give the batches up; a replay that is running ends."""
        self._batches.clear()
        self._buffers = []

    def replay(self, engine: Engine, begin: int = 0) -> int:
        """Feed all batches from ``begin`` on to an engine; return the number of the next.

        Batches may be added meanwhile by another thread.  The rows that the engine gives have been
        published already.
        """
        buffers = self._buffers
        for k, first, last in islice(self._batches, begin, None):
            columns = buffers[k].columns()
            part = slice(first, last)
            feed(engine, columns.type, columns.stamp_ns[part], columns.values[:, part])
            begin += 1
        return begin

    def columns(self) -> list[TopicColumns]:
        """Everything as the topics of a recording."""
        return [buffer.columns() for buffer in self._buffers]
