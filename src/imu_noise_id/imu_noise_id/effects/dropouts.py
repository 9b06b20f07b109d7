"""Dropouts: messages that never arrive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from imu_noise_id.effects.base import Parameter, TransportEffect
from imu_noise_id.recording import Floats, Stamps
from imu_noise_id.stamps import cells

PAUSE, FEWEST_GAPS = 20.0, 3
"""What may be no dropout lasts so many times the mean of the other gaps, so many at least."""


@dataclass(frozen=True)
class Dropouts(TransportEffect):
    """Gaps start at ``rate`` per second; each loses a geometric number of messages, at least one.

    Attributes
    ----------
    rate : float
        Gaps per second.
    mean_length_s : float
        Mean time that the messages of one gap would have covered.
    """

    rate: float
    mean_length_s: float

    name: ClassVar[str] = "dropouts"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("rate", "1/s", True, "Gaps per second"),
        Parameter("mean_length_s", "s", True, "Mean length of a gap"),
    )

    def transport(
        self, stamp_s: Floats, sample_time_s: float, rng: np.random.Generator
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Leave messages out; the first one is always sent."""
        n = stamp_s.size
        start = np.flatnonzero(rng.random(n) < self.rate * sample_time_s)
        start = start[start > 0]
        mean_messages = max(self.mean_length_s / sample_time_s, 1.0)
        length = rng.geometric(1.0 / mean_messages, start.size)
        change = np.zeros(n + 1, dtype=np.int64)
        np.add.at(change, start, 1)
        np.add.at(change, np.minimum(start + length, n), -1)
        kept = np.flatnonzero(np.cumsum(change[:-1]) == 0)
        return stamp_s[kept], kept


def gap_lengths(stamp_ns: Stamps, rate_hz: float) -> NDArray[np.int64]:
    """Number of messages missing in each gap, rising; empty where none is missing.

    By the samples' cells: a late stamp makes one interval long and the next short, a lost message
    moves all that follow.  Pauses are left out: :func:`without_pauses`.
    """
    missing = np.diff(cells(stamp_ns, 1e9 / rate_hz)) - 1
    return without_pauses(missing[missing > 0])


def without_pauses(missing: NDArray[np.int64]) -> NDArray[np.int64]:
    """Gaps without those that the law of the others, geometric, would not give in 1000 records.

    A driver that was stopped for two minutes says nothing of how messages get lost.
    """
    kept = np.sort(missing)
    while kept.size > FEWEST_GAPS:
        largest, mean = float(kept[-1]), float(kept[:-1].mean())
        # a mean of one alone would leave no chance to two in a row
        chance = kept.size * np.exp((largest - 1.0) * np.log1p(-1.0 / (mean + 1.0)))
        if largest < PAUSE * mean or chance > 1e-3:
            break
        kept = kept[:-1]
    return kept


def dropout_parameters(stamp_ns: Stamps, rate_hz: float) -> tuple[float, float]:
    """Gaps per second and their mean length, (rate, mean_length_s); zeros where there is none."""
    missing = gap_lengths(stamp_ns, rate_hz)
    duration_s = float(stamp_ns[-1] - stamp_ns[0]) * 1e-9
    if missing.size == 0 or duration_s <= 0.0:
        return 0.0, 0.0
    return missing.size / duration_s, float(missing.mean()) / rate_hz
