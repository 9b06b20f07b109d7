"""First-order Gauss-Markov process: a bias that wanders and is forgotten."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, StateSpace, StochasticEffect
from imu_noise_id.effects.lorentzian import allan_of_geometric, lorentzian
from imu_noise_id.ordinates import LEAST_SCORE, Residual
from imu_noise_id.recording import Floats

SHORTEST_SAMPLES = 3.0
LONGEST_RECORDS = 20.0


@dataclass(frozen=True)
class GaussMarkov(StochasticEffect):
    """x' = -x/T_c + sqrt(2/T_c) sigma w, sampled; r(h) = sigma^2 exp(-|h|/T_c).

    S(f) = sigma^2 dt (1 - a^2)/((1 - a)^2 + 4 a sin^2(pi f dt)), a = exp(-dt/T_c); the thesis's
    drive is q_c = sigma sqrt(2/T_c), thesis (42)-(47).

    Attributes
    ----------
    sigma : float
        Stationary standard deviation, unit.
    correlation_time_s : float
        T_c.
    """

    sigma: float
    correlation_time_s: float

    name: ClassVar[str] = "gauss_markov"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("sigma", "{u}", True, "stationary standard deviation"),
        Parameter("correlation_time_s", "s", True, "time after which the memory falls to 1/e"),
    )

    def limits(self, sample_time_s: float, duration_s: float) -> tuple[tuple[float, float], ...]:
        """Correlation times from 3 samples (below, it imitates a filter) to 20 records."""
        shortest = SHORTEST_SAMPLES * sample_time_s
        return (0.0, float("inf")), (shortest, max(LONGEST_RECORDS * duration_s, 2 * shortest))

    @classmethod
    def starts(cls, residual: Residual) -> tuple[StochasticEffect, ...]:
        """Correlation time of the largest score on a grid of four per octave, then its sigma."""
        ordinates = residual.ordinates
        dt = ordinates.sample_time_s
        octaves = max(np.log2(ordinates.duration_s / dt / SHORTEST_SAMPLES), 1.0)
        times = SHORTEST_SAMPLES * dt * 2.0 ** np.arange(0.0, octaves, 0.5)
        laws = np.array([lorentzian(ordinates.frequency_hz, dt / t, dt)[0] for t in times])
        amount, chi2 = residual.score(laws)
        best = int(np.argmax(chi2))
        if chi2[best] < LEAST_SCORE:
            return ()
        return (cls(float(np.sqrt(amount[best])), float(times[best])),)

    def psd(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """Sampled Lorentzian about 0 Hz."""
        decay = sample_time_s / self.correlation_time_s
        return self.sigma**2 * lorentzian(frequency_hz, decay, sample_time_s)[0]

    def psd_gradient(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """By log sigma and log correlation time."""
        decay = sample_time_s / self.correlation_time_s
        law, by_decay, _ = lorentzian(frequency_hz, decay, sample_time_s)
        return self.sigma**2 * np.stack((2.0 * law, -by_decay))

    def allan_variance(self, tau_s: Floats, sample_time_s: float) -> Floats:
        """Exact for the sampled process; thesis (46) where tau is many samples."""
        log_pole = complex(-sample_time_s / self.correlation_time_s)
        return self.sigma**2 * allan_of_geometric(log_pole, tau_s / sample_time_s)

    def state_space(self, sample_time_s: float) -> StateSpace:
        """One state, stationary from the start."""
        decay = sample_time_s / self.correlation_time_s
        one = np.ones((1, 1))
        variance = self.sigma**2
        Q = one * variance * -np.expm1(-2.0 * decay)
        return StateSpace(one * np.exp(-decay), one, Q, np.zeros((1, 1)), one * variance, (False,))

    def simulate(self, n: int, sample_time_s: float, rng: np.random.Generator) -> Floats:
        """Exact recursion from the stationary distribution, at any rate."""
        from scipy.signal import lfilter  # half a second to import, and only simulation needs it

        decay = sample_time_s / self.correlation_time_s
        drive = self.sigma * np.sqrt(-np.expm1(-2.0 * decay)) * rng.standard_normal(n)
        drive[:1] *= 1.0 / np.sqrt(-np.expm1(-2.0 * decay))
        return np.asarray(lfilter([1.0], [1.0, -np.exp(-decay)], drive))
