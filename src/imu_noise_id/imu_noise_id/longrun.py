"""A run of any length in bounded memory: block averages of what a buffer has forgotten.

A block average is the mean of the finite samples of ``block_s`` seconds.  It keeps the density of
white noise and everything slower than a few blocks; what is faster is found in the buffer.  When
``MOST`` blocks are full, neighbours are merged and ``block_s`` doubles: a day at 1 kHz is 86 400
blocks of a second.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imu_noise_id import cdr
from imu_noise_id.cdr import LAYOUTS
from imu_noise_id.columns import TopicColumns
from imu_noise_id.recording import Floats, Mask, Stamps
from imu_noise_id.stamps import onward

MOST = 1 << 17
FIRST_BLOCK_S = 1.0
_AVERAGED = {cdr.IMU: 6, cdr.TEMPERATURE: 1}
_OTHERS = 3
_WHOLE = 0.5


@dataclass
class LongRun:
    """Block averages of one topic.

    Attributes
    ----------
    topic, type : str
    block_s : float
    most : int
        Blocks kept at the most.
    start_ns : int or None
        Stamp of the first sample.
    elapsed_ns : int
        Time since then of the newest sample; clock steps count nothing.
    frame_ids : frozenset of bytes
    sums : (k, b) float64
        Of deviations from ``centre``, to keep digits.
    counts : (b,) int64
    centre : (k,) float64
    """

    topic: str
    type: str
    block_s: float = FIRST_BLOCK_S
    most: int = MOST
    start_ns: int | None = None
    elapsed_ns: int = 0
    frame_ids: frozenset[bytes] = frozenset()
    sums: Floats = field(default_factory=lambda: np.empty((0, 0)))
    counts: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    centre: Floats = field(default_factory=lambda: np.empty(0))
    newest_ns: int = 0
    newest_log_ns: int = 0

    @property
    def empty(self) -> bool:
        """Whether nothing has been fed."""
        return self.start_ns is None

    def feed(self, columns: TopicColumns) -> None:
        """Add samples in the order of reception."""
        rows = columns.values[: _AVERAGED.get(self.type, _OTHERS)]
        usable = np.isfinite(rows).all(axis=0) & _has_fix(columns)
        if not usable.any():
            return
        times = columns.stamp_ns if columns.stamp_ns.any() else columns.log_ns
        rows, times, log_ns = rows[:, usable], times[usable], columns.log_ns[usable]
        if self.start_ns is None:
            self.start_ns = self.newest_ns = int(times[0])
            self.newest_log_ns = int(log_ns[0])
            self.centre = rows[:, 0].copy()
            self.sums = np.zeros((rows.shape[0], 1))
            self.counts = np.zeros(1, np.int64)
        self.frame_ids |= columns.frame_ids
        self._add(rows - self.centre[:, np.newaxis], self._elapsed(times, log_ns))

    def columns(self) -> TopicColumns:
        """The block averages as messages of the topic, stamped at the middles of their blocks."""
        whole = self.counts >= _WHOLE * float(np.median(self.counts[self.counts > 0]))
        whole[self.elapsed_ns // round(self.block_s * 1e9) :] = False  # still filling
        cells = np.flatnonzero(whole)
        means = self.sums[:, cells] / self.counts[cells] + self.centre[:, np.newaxis]
        values = np.zeros((len(LAYOUTS[self.type].columns), cells.size))
        values[: means.shape[0]] = means
        assert self.start_ns is not None
        middles = (cells.astype(np.float64) + 0.5) * self.block_s * 1e9
        stamp_ns = self.start_ns + np.rint(middles).astype(np.int64)
        return TopicColumns(self.topic, self.type, stamp_ns, stamp_ns, values, self.frame_ids)

    def _elapsed(self, times: Stamps, log_ns: Stamps) -> Stamps:
        """Time since the start of each sample, in nanoseconds, never running backwards."""
        steps = np.diff(times, prepend=self.newest_ns)
        passed = np.diff(log_ns, prepend=self.newest_log_ns)
        elapsed: Stamps = self.elapsed_ns + np.cumsum(onward(steps, passed))
        self.newest_ns, self.elapsed_ns = int(times[-1]), int(elapsed[-1])
        self.newest_log_ns = int(log_ns[-1])
        return elapsed

    def _add(self, rows: Floats, elapsed_ns: Stamps) -> None:
        while self.elapsed_ns >= self.most * self.block_s * 1e9:
            self._merge()
        cells = elapsed_ns // round(self.block_s * 1e9)
        self._grow(int(cells[-1]) + 1)
        first = int(cells[0])
        local = cells - first
        span = slice(first, int(cells[-1]) + 1)
        self.counts[span] += np.bincount(local)
        for total, row in zip(self.sums, rows, strict=True):
            total[span] += np.bincount(local, row)

    def _grow(self, size: int) -> None:
        if size <= self.counts.size:
            return
        wanted = min(max(size, 2 * self.counts.size), self.most)
        extra = wanted - self.counts.size
        self.sums = np.pad(self.sums, ((0, 0), (0, extra)))
        self.counts = np.pad(self.counts, (0, extra))

    def _merge(self) -> None:
        odd = self.counts.size % 2
        self.sums = np.pad(self.sums, ((0, 0), (0, odd)))
        self.counts = np.pad(self.counts, (0, odd))
        self.sums = self.sums[:, 0::2] + self.sums[:, 1::2]
        self.counts = self.counts[0::2] + self.counts[1::2]
        self.block_s *= 2.0


def _has_fix(columns: TopicColumns) -> Mask:
    if columns.type != cdr.NAV_SAT_FIX:
        return np.ones(columns.stamp_ns.size, dtype=bool)
    status = LAYOUTS[columns.type].columns.index("status")
    fixed: Mask = columns.values[status] >= 0
    return fixed
