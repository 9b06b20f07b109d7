"""What a live filter was fed since it began: a model that is known later is still used from there.

A live filter does not wait for its noise model.  It begins with what is known, keeps what it is
fed for ``longest_s``, and when a better model comes (from ``identify``, or of the leading part in
which the platform rested) a new filter is fed the same from the beginning and takes over: it is
in the state, to the last bit, in which ``fuse --bag`` with that model would be.  Later a model
takes effect at the next start.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice

import numpy as np
from imu_noise_id.cdr import Decoded
from imu_noise_id.columns import TopicColumns

from imu_noise_id import cdr
from nav_fusion.engine import Engine
from nav_fusion.feeding import feed

FIRST_LOOK_S = 60.0
"""The leading rest is identified when this much has come, and at every doubling while it lasts."""


class Beginning:
    """Batches of decoded messages in the order of arrival, up to a length."""

    def __init__(self, longest_s: float = 600.0) -> None:
        self._longest_s = longest_s
        self._batches: list[tuple[str, str, Decoded, Sequence[int]]] = []
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

    def add(self, topic: str, msgtype: str, decoded: Decoded, log_ns: Sequence[int]) -> None:
        """Keep a batch; when it is more than is kept, forget all."""
        if not self.kept or decoded.stamp_ns.size == 0:
            return
        if msgtype == cdr.IMU:
            if self._first_ns is None:
                self._first_ns = int(decoded.stamp_ns[0])
            self._span_s = (int(decoded.stamp_ns[-1]) - self._first_ns) * 1e-9
        self._batches.append((topic, msgtype, decoded, log_ns))
        if not self.kept:
            self.forget()

    def forget(self) -> None:
        """Give the batches up; a replay that is running ends."""
        self._batches.clear()

    def replay(self, engine: Engine, begin: int = 0) -> int:
        """Feed all batches from ``begin`` on to an engine; return the number of the next.

        Batches may be added meanwhile by another thread.  The rows that the engine gives have been
        published already.
        """
        for _, msgtype, decoded, _ in islice(self._batches, begin, None):
            feed(engine, msgtype, decoded)
            begin += 1
        return begin

    def columns(self) -> list[TopicColumns]:
        """Everything as the topics of a recording."""
        topics: dict[tuple[str, str], list[tuple[Decoded, Sequence[int]]]] = {}
        for topic, msgtype, decoded, log_ns in self._batches:
            topics.setdefault((topic, msgtype), []).append((decoded, log_ns))
        return [
            TopicColumns(
                topic,
                msgtype,
                np.concatenate([d.stamp_ns for d, _ in parts]),
                np.concatenate([np.asarray(log, dtype=np.int64)[d.valid] for d, log in parts]),
                np.concatenate([d.values for d, _ in parts], axis=1),
            )
            for (topic, msgtype), parts in topics.items()
        ]
