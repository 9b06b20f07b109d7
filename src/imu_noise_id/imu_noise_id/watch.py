"""What is wrong with a stream while it runs: counted batch by batch, for diagnostics."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from imu_noise_id.cdr import Decoded
from imu_noise_id.recording import Stamps
from imu_noise_id.stamps import STEP_AHEAD_NS, STEP_BACK_NS

_WINDOW_NS = 2_000_000_000
_FROZEN_NS = 500_000_000
_GAP = 1.5
_PERIODS = 64
_RATE_CHANGE = 1.2


@dataclass
class StreamWatch:
    """Counts of one topic since its start or the last reset.

    Attributes
    ----------
    received, invalid, non_finite, duplicates, out_of_order, gaps, missing, clock_steps : int
        As in `recording.Quality`; invalid messages are not of the topic's type.
    largest_step_s : float
        Of the clock, signed.
    rate_changes : int
        How often the sample period settled on another value.
    frozen : bool
        Messages come, their stamps stand still.
    offset_s : float
        Time of reception less header stamp, newest message.
    """

    received: int = 0
    invalid: int = 0
    non_finite: int = 0
    duplicates: int = 0
    out_of_order: int = 0
    gaps: int = 0
    missing: int = 0
    clock_steps: int = 0
    largest_step_s: float = 0.0
    rate_changes: int = 0
    frozen: bool = False
    offset_s: float = 0.0
    newest_log_ns: int = 0
    _newest_ns: int | None = None
    _moved_log_ns: int = 0
    _period_ns: float = 0.0
    _recent: deque[tuple[int, int]] = field(default_factory=deque)
    _steps: Stamps = field(default_factory=lambda: np.empty(0, np.int64))

    def feed(self, decoded: Decoded, log_ns: Stamps) -> None:
        """Count a batch."""
        self.received += decoded.valid.size
        self.invalid += decoded.valid.size - decoded.stamp_ns.size
        self._count_rate(decoded.valid.size, int(log_ns[-1]))
        if not decoded.stamp_ns.size:
            return
        finite = np.isfinite(decoded.values).all(axis=0)
        self.non_finite += finite.size - int(np.count_nonzero(finite))
        stamps = decoded.stamp_ns
        before = stamps[0] - 1 if self._newest_ns is None else self._newest_ns
        steps = np.diff(stamps, prepend=before)
        if self._newest_ns is None:
            steps = steps[1:]
        self._count_steps(steps)
        if (steps != 0).any() or self._newest_ns is None:
            self._moved_log_ns = int(log_ns[-1])
        self.frozen = int(log_ns[-1]) - self._moved_log_ns > _FROZEN_NS
        self._newest_ns = int(stamps[-1])
        self.offset_s = (int(log_ns[-1]) - int(stamps[-1])) * 1e-9

    def rate_at(self, now_ns: int) -> float:
        """Messages a second over the last two seconds before `now_ns`."""
        begin = now_ns - _WINDOW_NS
        return sum(count for at, count in self._recent if at > begin) / (_WINDOW_NS * 1e-9)

    def _count_rate(self, count: int, now_ns: int) -> None:
        self.newest_log_ns = now_ns
        self._recent.append((now_ns, count))
        while self._recent[0][0] < now_ns - _WINDOW_NS:
            self._recent.popleft()

    def _count_steps(self, steps: Stamps) -> None:
        back, ahead = steps < -STEP_BACK_NS, steps > STEP_AHEAD_NS
        jumps = steps[back | ahead]
        if jumps.size:
            self.clock_steps += jumps.size
            self.largest_step_s = float(jumps[np.argmax(np.abs(jumps))]) * 1e-9
        self.duplicates += int(np.count_nonzero(steps == 0))
        self.out_of_order += int(np.count_nonzero((steps < 0) & ~back))
        onward = steps[(steps > 0) & ~ahead]
        if onward.size == 0:
            return
        self._steps = np.concatenate((self._steps, onward))[-_PERIODS:]
        if self._steps.size >= _PERIODS // 4 or not self._period_ns:
            self._settle(float(np.median(self._steps)))
        absent = np.rint(onward / self._period_ns).astype(np.int64) - 1
        open_ = onward > _GAP * self._period_ns
        self.gaps += int(np.count_nonzero(open_))
        self.missing += int(absent[open_].sum())

    def _settle(self, period_ns: float) -> None:
        ratio = period_ns / self._period_ns if self._period_ns else 1.0
        if not 1 / _RATE_CHANGE < ratio < _RATE_CHANGE:
            self.rate_changes += 1
        self._period_ns = period_ns
