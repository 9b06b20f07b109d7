"""White noise: angle random walk of a gyro, velocity random walk of an accelerometer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, StateSpace, StrengthEffect
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class WhiteNoise(StrengthEffect):
    """Independent samples; S(f) = N^2, Allan variance N^2/tau (IEEE Std 952, thesis (41)).

    Attributes
    ----------
    density : float
        N, unit/sqrt(Hz), two-sided: the per-sample sigma times sqrt(sample time).
    """

    density: float

    name: ClassVar[str] = "white_noise"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("density", "{u}/sqrt(Hz)", True, "Allan's N; root of the two-sided spectrum"),
    )

    @staticmethod
    def law(frequency_hz: Floats, sample_time_s: float) -> Floats:
        """1."""
        return np.ones_like(frequency_hz)

    def allan_variance(self, tau_s: Floats, sample_time_s: float) -> Floats:
        """N^2/tau."""
        return self.density**2 / tau_s

    def state_space(self, sample_time_s: float) -> StateSpace:
        """No state; R = N^2/dt."""
        none = np.zeros((0, 0))
        R = np.array([[self.density**2 / sample_time_s]])
        return StateSpace(none, np.zeros((1, 0)), none, R, none, ())

    def simulate(self, n: int, sample_time_s: float, rng: np.random.Generator) -> Floats:
        """Gaussian samples of variance N^2/dt."""
        return rng.normal(0.0, self.density / np.sqrt(sample_time_s), n)
