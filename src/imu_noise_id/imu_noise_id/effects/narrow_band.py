"""Narrow-band noise: a resonance driven by noise, a vibration whose phase wanders."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, StateSpace, StochasticEffect
from imu_noise_id.effects.lorentzian import allan_of_geometric, lorentzian
from imu_noise_id.ordinates import LEAST_SCORE, Residual
from imu_noise_id.recording import Floats

WIDEST = 0.3


def _window_sum(values: Floats, width: int) -> Floats:
    total = np.concatenate(([0.0], np.cumsum(values)))
    return total[width:] - total[:-width]


@dataclass(frozen=True)
class NarrowBand(StochasticEffect):
    """Complex pole pair; r(h) = sigma^2 exp(-pi b |h|) cos(2 pi f0 h).

    S(f) = sigma^2/2 (L(f - f0) + L(f + f0)) with L the sampled Lorentzian of full width b at half
    power.

    Attributes
    ----------
    frequency_hz : float
        f0, the centre.
    bandwidth_hz : float
        b, full width at half power; damping ratio b/(2 f0).
    sigma : float
        Standard deviation, unit.
    """

    frequency_hz: float
    bandwidth_hz: float
    sigma: float

    name: ClassVar[str] = "narrow_band"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("frequency_hz", "Hz", True, "centre"),
        Parameter("bandwidth_hz", "Hz", True, "full width at half power"),
        Parameter("sigma", "{u}", True, "standard deviation"),
    )

    def limits(self, sample_time_s: float, duration_s: float) -> tuple[tuple[float, float], ...]:
        """Bandwidth from 1/T (below, it is a line) to 0.3 f (beyond, it imitates a filter)."""
        lowest, highest = 10.0 / duration_s, 0.5 / sample_time_s
        narrowest = 1.0 / duration_s
        widest = max(WIDEST * self.frequency_hz, 2.0 * narrowest)
        return (lowest, highest), (narrowest, widest), (0.0, float("inf"))

    @classmethod
    def starts(cls, residual: Residual) -> tuple[StochasticEffect, ...]:
        """Window whose excess power gains most nats, over all places and doubling widths."""
        return tuple(start for _, start in cls.windows(residual)[:1])

    @classmethod
    def windows(cls, residual: Residual) -> list[tuple[float, NarrowBand]]:
        """For every width the window whose excess power gains most, with its nats; most first.

        dof/2 (r - 1 - log r) for a mean power of r times the model's: counted in standard
        deviations, single ordinates, whose tail is long, hid a band of several bins.
        """
        ordinates = residual.ordinates
        weight = 0.5 * ordinates.dof
        misfit = ordinates.power / residual.psd - 1.0
        half_bin = 0.25 * ordinates.dof / ordinates.duration_s
        found: list[tuple[float, NarrowBand]] = []
        for bins in (2**i for i in range(12)):
            if 4 * bins > misfit.size:
                break
            low = ordinates.frequency_hz[: misfit.size - bins + 1] - half_bin[: 1 - bins or None]
            high = ordinates.frequency_hz[bins - 1 :] + half_bin[bins - 1 :]
            middle, bandwidth = 0.5 * (low + high), high - low
            total = _window_sum(weight, bins)
            excess_ratio = np.maximum(_window_sum(weight * misfit, bins) / total, 0.0)
            nats = total * (excess_ratio - np.log1p(excess_ratio))
            nats[bandwidth > 2.0 * WIDEST * middle] = 0.0
            best = int(np.argmax(nats))
            if nats[best] > 0.5 * LEAST_SCORE:
                inside = slice(best, best + bins)
                excess = (ordinates.power - residual.psd)[inside] * weight[inside]
                power = 4.0 * max(excess.sum(), 0.0) / ordinates.duration_s
                sigma = float(np.sqrt(2.0 * power)) if power > 0.0 else 0.0
                narrow = min(0.5 * bandwidth[best], 0.8 * WIDEST * middle[best])
                width = max(float(narrow), 1.5 / ordinates.duration_s)
                start = cls(float(middle[best]), width, sigma)
                if sigma > 0.0:
                    found.append((float(nats[best]), start))
        return sorted(found, key=lambda item: -item[0])

    def psd(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """Sampled Lorentzians about +-f0."""
        decay = np.pi * self.bandwidth_hz * sample_time_s
        plus = lorentzian(frequency_hz - self.frequency_hz, decay, sample_time_s)[0]
        minus = lorentzian(frequency_hz + self.frequency_hz, decay, sample_time_s)[0]
        return 0.5 * self.sigma**2 * (plus + minus)

    def psd_gradient(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """By log centre, log bandwidth and log sigma."""
        decay = np.pi * self.bandwidth_hz * sample_time_s
        plus = lorentzian(frequency_hz - self.frequency_hz, decay, sample_time_s)
        minus = lorentzian(frequency_hz + self.frequency_hz, decay, sample_time_s)
        by_centre = self.frequency_hz * (minus[2] - plus[2])
        by_bandwidth = plus[1] + minus[1]
        by_sigma = 2.0 * (plus[0] + minus[0])
        return 0.5 * self.sigma**2 * np.stack((by_centre, by_bandwidth, by_sigma))

    def allan_variance(self, tau_s: Floats, sample_time_s: float) -> Floats:
        """Exact for the sampled process."""
        rate = complex(-np.pi * self.bandwidth_hz, 2.0 * np.pi * self.frequency_hz)
        return self.sigma**2 * allan_of_geometric(rate * sample_time_s, tau_s / sample_time_s)

    def state_space(self, sample_time_s: float) -> StateSpace:
        """Two states that rotate and decay."""
        rho = np.exp(-np.pi * self.bandwidth_hz * sample_time_s)
        angle = 2.0 * np.pi * self.frequency_hz * sample_time_s
        c, s = np.cos(angle), np.sin(angle)
        P = self.sigma**2 * np.eye(2)
        F = rho * np.array([[c, -s], [s, c]])
        H = np.array([[1.0, 0.0]])
        return StateSpace(F, H, (1.0 - rho**2) * P, np.zeros((1, 1)), P, (False, False))

    def simulate(self, n: int, sample_time_s: float, rng: np.random.Generator) -> Floats:
        """Exact complex recursion from the stationary distribution; the real part is kept."""
        from scipy.signal import lfilter  # half a second to import, and only simulation needs it

        decay = np.pi * self.bandwidth_hz * sample_time_s
        scale = self.sigma * np.sqrt(-np.expm1(-2.0 * decay))
        drive = scale * (rng.standard_normal(n) + 1j * rng.standard_normal(n))
        drive[:1] *= 1.0 / np.sqrt(-np.expm1(-2.0 * decay))
        pole = np.exp(complex(-decay, 2.0 * np.pi * self.frequency_hz * sample_time_s))
        return np.asarray(lfilter([1.0], [1.0, -pole], drive).real)
