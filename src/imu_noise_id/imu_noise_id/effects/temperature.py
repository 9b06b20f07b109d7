"""Temperature sensitivity: the bias follows the recorded temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import CourseEffect, Parameter
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class Temperature(CourseEffect):
    """x(t) = c (T(t) - T_first); the level at T_first belongs to the mean.

    Attributes
    ----------
    coefficient : float
        c, unit/K, of either sign.
    """

    coefficient: float

    name: ClassVar[str] = "temperature"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("coefficient", "{u}/K", False, "Change of the bias per kelvin"),
    )

    def course(self, time_s: Floats, temperature: Floats | None) -> Floats:
        """Coefficient times the change of temperature; zero where no temperature is known."""
        if temperature is None or temperature.size == 0:
            return np.zeros_like(time_s)
        return self.coefficient * (temperature - temperature[0])


def temperature_coefficient(values: Floats, temperature: Floats) -> float:
    """Least-squares slope of the values on the temperature, a starting value; unit/K."""
    rise = temperature - temperature.mean()
    power = float(rise @ rise)
    return float(rise @ values) / power if power > 0.0 else 0.0
