"""How long a sample waits, from its reception to the odometry that holds it."""

from __future__ import annotations

import numpy as np

KEPT = 32768
"""Eleven minutes of output at 50 Hz."""


class Latency:
    """The newest ``KEPT`` times, in seconds."""

    def __init__(self) -> None:
        self._seconds = np.zeros(KEPT)
        self._count = 0
        self._worst_s = 0.0

    def count(self, seconds: float) -> None:
        """Add one."""
        self._seconds[self._count % KEPT] = seconds
        self._count += 1
        self._worst_s = max(self._worst_s, seconds)

    def median_s(self) -> float:
        """Of the newest hundred; 0 before the first."""
        newest = np.arange(max(self._count - 100, 0), self._count) % KEPT
        return float(np.median(self._seconds[newest])) if self._count else 0.0

    def worst_s(self) -> float:
        """Return the longest since this was last asked."""
        worst, self._worst_s = self._worst_s, 0.0
        return worst

    def numbers(self) -> dict[str, float]:
        """For diagnostics, ms: of all that are kept; none before the first."""
        if not self._count:
            return {}
        half, most, longest = np.percentile(self._seconds[: self._count], (50, 99, 100)) * 1e3
        return {
            "latency_median_ms": float(half),
            "latency_p99_ms": float(most),
            "latency_max_ms": float(longest),
        }
