"""Quantization noise of an integrating sensor: the angle is rounded, the rate differenced."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, StateSpace, StrengthEffect
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class Quantization(StrengthEffect):
    """Difference of white noise; S(f) = (4 Q^2/dt) sin^2(pi f dt), Allan variance 3 Q^2/tau^2.

    IEEE Std 952, thesis (38)-(40).

    Attributes
    ----------
    coefficient : float
        Q, unit s.
    """

    coefficient: float

    name: ClassVar[str] = "quantization"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("coefficient", "{u} s", True, "Q of the Allan plot: sqrt(3) Q at 1 s"),
    )

    @staticmethod
    def law(frequency_hz: Floats, sample_time_s: float) -> Floats:
        """(4/dt) sin^2(pi f dt)."""
        return (4.0 / sample_time_s) * np.sin(np.pi * sample_time_s * frequency_hz) ** 2

    def allan_variance(self, tau_s: Floats, sample_time_s: float) -> Floats:
        """3 Q^2/tau^2, exact for sampled data."""
        return 3.0 * self.coefficient**2 / tau_s**2

    def state_space(self, sample_time_s: float) -> StateSpace:
        """States: this sample's rounding error over dt and the one before."""
        variance = (self.coefficient / sample_time_s) ** 2
        return StateSpace(
            F=np.array([[0.0, 0.0], [1.0, 0.0]]),
            H=np.array([[1.0, -1.0]]),
            Q=np.diag([variance, 0.0]),
            R=np.zeros((1, 1)),
            P0=variance * np.eye(2),
            diffuse=(False, False),
        )

    def simulate(self, n: int, sample_time_s: float, rng: np.random.Generator) -> Floats:
        """Difference of Gaussian noise of standard deviation Q/dt."""
        return np.diff(rng.normal(0.0, self.coefficient / sample_time_s, n + 1))
