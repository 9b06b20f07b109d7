"""Parts of a sensor's error that are states of the filter: one state, or two for an aid."""

from __future__ import annotations

import math
from dataclasses import dataclass

from imu_noise_id.compiled import njit


@dataclass(frozen=True)
class SlowTerm:
    """One slow part of a sensor's error: b' = -b/T + w.

    Attributes
    ----------
    initial_sigma : float
        Standard deviation at the start, channel's unit.
    correlation_time_s : float
        T; ``inf`` for a walk or a constant.
    density : float
        Root of the two-sided spectrum of w, unit/s/sqrt(Hz); 0 for a constant.
    name : str
        The effect that it stands for.
    """

    initial_sigma: float
    correlation_time_s: float
    density: float
    name: str

    @staticmethod
    def gauss_markov(sigma: float, correlation_time_s: float, name: str) -> SlowTerm:
        """Stationary first-order Gauss-Markov process: density sigma sqrt(2/T)."""
        return SlowTerm(sigma, correlation_time_s, sigma * math.sqrt(2 / correlation_time_s), name)


@dataclass(frozen=True)
class PairTerm:
    """Second-order colour of an aid: x' = [-a, -w; w, -d] x + u, of which the first is seen.

    Both states have the stationary standard deviation sigma and u spectra 2 a sigma^2 and
    2 d sigma^2, so that the covariance is sigma^2 I at all times.

    Attributes
    ----------
    sigma : float
        Of what is seen, in the aid's unit.
    rates : (2,)
        a and d, 1/s.
    spin_rad_s : float
        w, not 0.
    name : str
        The effect that it stands for.
    """

    sigma: float
    rates: tuple[float, float]
    spin_rad_s: float
    name: str

    @property
    def memory_s(self) -> float:
        """Integral of the correlation, S(0)/(2 sigma^2) = d/(a d + w^2), s."""
        a, d = self.rates
        return d / (a * d + self.spin_rad_s**2)

    @staticmethod
    def narrow_band(sigma: float, frequency_hz: float, bandwidth_hz: float) -> PairTerm:
        """r(h) = sigma^2 exp(-pi b |h|) cos(2 pi f0 h): both states are driven."""
        decay = math.pi * bandwidth_hz
        return PairTerm(sigma, (decay, decay), 2 * math.pi * frequency_hz, "narrow_band")

    @staticmethod
    def low_pass(sigma: float, frequency_hz: float, damping: float, name: str) -> PairTerm:
        """White noise behind a low-pass of second order: x'' + 2 z w x' + w^2 x = u."""
        w = 2 * math.pi * frequency_hz
        return PairTerm(sigma, (0.0, 2 * damping * w), w, name)


@njit(cache=True)
def pair_step(a: float, d: float, w: float, dt: float) -> tuple[float, float, float, float]:
    """e^{F dt} by rows for F = [-a, -w; w, -d]: e^{mu dt} (cos(s dt) I + sin(s dt)/s (F - mu I)).

    mu = -(a + d)/2 and s^2 = w^2 - ((d - a)/2)^2; the hyperbolic functions where that is negative.
    """
    mu, half = -0.5 * (a + d), 0.5 * (d - a)
    s2 = w * w - half * half
    x = math.sqrt(abs(s2)) * dt
    e = math.exp(mu * dt)
    if x < 1e-6:
        c, s = e, e * dt
    elif s2 > 0.0:
        c, s = e * math.cos(x), e * math.sin(x) * dt / x
    else:
        slow, fast = math.exp(mu * dt + x), math.exp(mu * dt - x)
        c, s = 0.5 * (slow + fast), 0.5 * (slow - fast) * dt / x
    return c + s * half, -s * w, s * w, c - s * half
