"""A line: a sinusoid of constant frequency and amplitude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, StateSpace, StochasticEffect
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class Periodic(StochasticEffect):
    """A cos(2 pi f t + phase), phase random; harmonics and sidebands are lines of their own.

    The spectrum is a pair of deltas of power A^2/4 at +-f and has no continuous part; the Allan
    variance is A^2 sin^4(pi f tau)/(m sin(pi f dt))^2 for m = tau/dt samples.

    Attributes
    ----------
    frequency_hz : float
    amplitude : float
        A, unit; the standard deviation is A/sqrt(2).
    """

    frequency_hz: float
    amplitude: float

    name: ClassVar[str] = "periodic"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("frequency_hz", "Hz", True, "frequency of the line"),
        Parameter("amplitude", "{u}", True, "half of peak to peak"),
    )

    def psd(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """No continuous spectrum."""
        return np.zeros_like(frequency_hz)

    def psd_gradient(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """No continuous spectrum."""
        return np.zeros((2, frequency_hz.size))

    def allan_variance(self, tau_s: Floats, sample_time_s: float) -> Floats:
        """A^2 sin^4(pi f tau)/(m sin(pi f dt))^2."""
        m_sine = tau_s / sample_time_s * np.sin(np.pi * self.frequency_hz * sample_time_s)
        return (self.amplitude * np.sin(np.pi * self.frequency_hz * tau_s) ** 2 / m_sine) ** 2

    def state_space(self, sample_time_s: float) -> StateSpace:
        """Two states that rotate for ever."""
        angle = 2.0 * np.pi * self.frequency_hz * sample_time_s
        c, s = np.cos(angle), np.sin(angle)
        F = np.array([[c, -s], [s, c]])
        none = np.zeros((2, 2))
        P = 0.5 * self.amplitude**2 * np.eye(2)
        return StateSpace(F, np.array([[1.0, 0.0]]), none, np.zeros((1, 1)), P, (False, False))

    def simulate(self, n: int, sample_time_s: float, rng: np.random.Generator) -> Floats:
        """A sinusoid of random phase."""
        phase = rng.uniform(0.0, 2.0 * np.pi)
        cycles = self.frequency_hz * sample_time_s * np.arange(n)
        return self.amplitude * np.cos(2.0 * np.pi * cycles + phase)
