"""Rate ramp: a bias that drifts at a constant rate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from imu_noise_id.effects.base import CourseEffect, Parameter
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class RateRamp(CourseEffect):
    """x(t) = R t; Allan variance R^2 tau^2/2 (IEEE Std 952, thesis 3.1.6).

    Attributes
    ----------
    slope : float
        R, unit/s, of either sign.
    """

    slope: float

    name: ClassVar[str] = "rate_ramp"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("slope", "{u}/s", False, "Change of the bias per second"),
    )

    def course(self, time_s: Floats, temperature: Floats | None) -> Floats:
        """R t."""
        return self.slope * time_s


def ramp_slope(time_s: Floats, values: Floats) -> float:
    """Least-squares slope of the values, a starting value; unit/s."""
    t = time_s - time_s.mean()
    return float(t @ values / (t @ t)) if t.size > 1 else 0.0
