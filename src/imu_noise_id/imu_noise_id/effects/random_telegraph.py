"""Random telegraph noise: the bias jumps between two levels (popcorn noise)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, StochasticEffect
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class RandomTelegraph(StochasticEffect):
    """Levels +-h/2 with exponential dwell times of mean tau (Machlup 1954).

    R(t) = (h/2)^2 exp(-2|t|/tau): the spectrum of a Gauss-Markov term, not its distribution.

    Attributes
    ----------
    height : float
        Upper minus lower level, in the channel's unit.
    mean_dwell_s : float
        Mean time in either level.
    """

    height: float
    mean_dwell_s: float

    name: ClassVar[str] = "random_telegraph"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("height", "{u}", True, "Upper level minus lower level"),
        Parameter("mean_dwell_s", "s", True, "Mean time between jumps"),
    )

    def psd(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """S(f) = (h/2)^2 dt (1 - a^2)/(1 - 2 a cos(2 pi f dt) + a^2), a = exp(-2 dt/tau)."""
        a = np.exp(-2.0 * sample_time_s / self.mean_dwell_s)
        s = np.sin(np.pi * frequency_hz * sample_time_s) ** 2
        power = 0.25 * self.height**2 * sample_time_s
        return power * (1.0 - a * a) / ((1.0 - a) ** 2 + 4.0 * a * s)

    def psd_gradient(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """dS/d(log h) = 2 S; dS/d(log tau) by the chain rule through a."""
        a = np.exp(-2.0 * sample_time_s / self.mean_dwell_s)
        s = np.sin(np.pi * frequency_hz * sample_time_s) ** 2
        S = self.psd(frequency_hz, sample_time_s)
        denominator = (1.0 - a) ** 2 + 4.0 * a * s
        slope = S * (-2.0 * a / (1.0 - a * a) - (-2.0 * (1.0 - a) + 4.0 * s) / denominator)
        return np.stack([2.0 * S, slope * a * 2.0 * sample_time_s / self.mean_dwell_s])

    def allan_variance(self, tau_s: Floats, sample_time_s: float) -> Floats:
        """Of a Gauss-Markov term with sigma = h/2 and T = tau/2 (thesis (45))."""
        time = 0.5 * self.mean_dwell_s
        r = tau_s / time
        # 1 - (3 - 4 e^-r + e^-2r)/(2 r) -> r/3 - r^2/4 loses its digits to cancellation below 1e-3
        exact = 1.0 - (3.0 - 4.0 * np.exp(-r) + np.exp(-2.0 * r)) / (2.0 * r)
        factor = np.where(r < 1e-3, r / 3.0 - r**2 / 4.0, exact)
        return 2.0 * (0.5 * self.height) ** 2 / r * factor

    def simulate(self, n: int, sample_time_s: float, rng: np.random.Generator) -> Floats:
        """Jumps as a Poisson process of rate 1/tau from a level drawn at even odds."""
        jumps = rng.poisson(sample_time_s / self.mean_dwell_s, n)
        jumps[0] = rng.integers(2)
        return 0.5 * self.height * (1.0 - 2.0 * (np.cumsum(jumps) % 2))
