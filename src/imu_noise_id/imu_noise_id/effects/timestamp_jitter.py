"""Time-stamp jitter: stamps that scatter about the uniform grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from imu_noise_id.effects.base import Parameter, Stage, TransportEffect
from imu_noise_id.recording import Floats, Stamps


@dataclass(frozen=True)
class TimestampJitter(TransportEffect):
    """Stamps t_k + N(0, std^2), in the order of sending.

    Attributes
    ----------
    std_s : float
        Standard deviation of a stamp about the uniform grid.
    """

    std_s: float

    name: ClassVar[str] = "timestamp_jitter"
    stage = Stage.STAMP
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("std_s", "s", True, "Standard deviation of a stamp about the uniform grid"),
    )

    def transport(
        self, stamp_s: Floats, sample_time_s: float, rng: np.random.Generator
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Scatter the stamps; those that would overtake one another are put in order."""
        scattered = np.sort(stamp_s + rng.normal(0.0, self.std_s, stamp_s.size))
        return scattered, np.arange(stamp_s.size)


def jitter_std(stamp_ns: Stamps, rate_hz: float) -> float:
    """Standard deviation of the stamps about a grid that may drift slowly, s.

    From second differences of stamps without a gap between them, whose variance is 6 std^2: a
    constant rate and a slow drift of the clock leave them.

    Parameters
    ----------
    stamp_ns : (n,) int64
    rate_hz : float
    """
    step = np.diff(stamp_ns).astype(np.float64) * 1e-9
    second = np.diff(step)
    whole = np.maximum(step[1:], step[:-1]) < 1.7 / rate_hz
    if not whole.any():
        return 0.0
    return float(np.sqrt(np.mean(second[whole] ** 2) / 6.0))
