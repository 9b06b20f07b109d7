"""Rate random walk: the bias wanders without bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, StateSpace, StrengthEffect
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class RateRandomWalk(StrengthEffect):
    """x' = K w; sampled S(f) = K^2 dt^2/(4 sin^2(pi f dt)), near (K/(2 pi f))^2.

    Allan variance K^2 tau/3 (1 + dt^2/(2 tau^2)), the bracket for samples that do not average over
    their interval.  IEEE Std 952, thesis (50)-(51).

    Attributes
    ----------
    coefficient : float
        K, unit/sqrt(s).
    """

    coefficient: float

    name: ClassVar[str] = "rate_random_walk"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("coefficient", "{u}/sqrt(s)", True, "K: standard deviation after 1 s"),
    )

    @staticmethod
    def law(frequency_hz: Floats, sample_time_s: float) -> Floats:
        """dt^2/(4 sin^2(pi f dt))."""
        return (0.5 * sample_time_s / np.sin(np.pi * sample_time_s * frequency_hz)) ** 2

    def allan_variance(self, tau_s: Floats, sample_time_s: float) -> Floats:
        """K^2 tau/3 (1 + dt^2/(2 tau^2))."""
        sampled = 1.0 + 0.5 * (sample_time_s / tau_s) ** 2
        return self.coefficient**2 * tau_s / 3.0 * sampled

    def state_space(self, sample_time_s: float) -> StateSpace:
        """One state of unknown start."""
        one = np.ones((1, 1))
        Q = one * self.coefficient**2 * sample_time_s
        return StateSpace(one, one, Q, np.zeros((1, 1)), np.zeros((1, 1)), (True,))

    def simulate(self, n: int, sample_time_s: float, rng: np.random.Generator) -> Floats:
        """Sum of Gaussian steps of variance K^2 dt, from 0."""
        steps = rng.normal(0.0, self.coefficient * np.sqrt(sample_time_s), n)
        steps[:1] = 0.0
        return np.cumsum(steps)
