"""Bias instability: flicker (1/f) noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import numpy as np
from scipy import fft

from imu_noise_id.effects.base import Parameter, StateSpace, StrengthEffect
from imu_noise_id.recording import Floats

MEMORIES_S = 10.0 ** np.arange(-1.0, 5.0)


@cache
def _allan_factor(m: float) -> float:
    """(2/(pi m^2)) times the integral of sin^4(m u)/sin^3(u) over 0 ... pi/2.

    By Gauss-Legendre; beyond 64 samples it is 2 ln 2/pi to 1e-4.
    """
    if m >= 64.0:
        return float(2.0 * np.log(2.0) / np.pi)
    nodes, weights = np.polynomial.legendre.leggauss(4 * int(np.ceil(m)) + 16)
    u = 0.25 * np.pi * (nodes + 1.0)
    return float(0.5 * weights @ (np.sin(m * u) ** 4 / np.sin(u) ** 3) / m**2)


@dataclass(frozen=True)
class BiasInstability(StrengthEffect):
    """Half-integrated white noise (1 - z^-1)^(-1/2) of standard deviation B per sample.

    S(f) = B^2 dt/(2 sin(pi f dt)), near B^2/(2 pi f); the Allan deviation is flat at
    sqrt(2 ln 2/pi) B = 0.664 B from a few samples on (Kasdin 1995; IEEE Std 952; thesis (48)-(49)).

    Attributes
    ----------
    coefficient : float
        B, unit.
    """

    coefficient: float

    name: ClassVar[str] = "bias_instability"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("coefficient", "{u}", True, "B: flat Allan deviation over 0.664"),
    )

    @staticmethod
    def law(frequency_hz: Floats, sample_time_s: float) -> Floats:
        """dt/(2 sin(pi f dt))."""
        return 0.5 * sample_time_s / np.sin(np.pi * sample_time_s * frequency_hz)

    def allan_variance(self, tau_s: Floats, sample_time_s: float) -> Floats:
        """(2 ln 2/pi) B^2 where tau is many samples, the sampled integral below."""
        factor = [_allan_factor(float(m)) for m in np.round(tau_s / sample_time_s, 6)]
        return self.coefficient**2 * np.array(factor)

    def state_space(self, sample_time_s: float) -> StateSpace:
        """Sum of Gauss-Markov states a decade apart, memories 0.1 s to 10^4 s.

        Flicker has no finite form; variance B^2 ln(10)/pi per decade of memory follows B^2/(2 pi f)
        within 6 % between 1e-4 and 0.3 Hz.
        """
        a = np.exp(-sample_time_s / MEMORIES_S)
        variance = np.full(a.size, self.coefficient**2 * np.log(10.0) / np.pi)
        return StateSpace(
            F=np.diag(a),
            H=np.ones((1, a.size)),
            Q=np.diag(variance * (1.0 - a**2)),
            R=np.zeros((1, 1)),
            P0=np.diag(variance),
            diffuse=(False,) * a.size,
        )

    def simulate(self, n: int, sample_time_s: float, rng: np.random.Generator) -> Floats:
        """Half-integrate white noise that starts 3 n samples before the first one kept.

        The filter is exact over the whole band; what is lost is the memory beyond 3 records, which
        is a constant level to within a few per cent of B.
        """
        size = 4 * n
        lag = np.arange(1, size)
        weights = np.concatenate(([1.0], np.cumprod((lag - 0.5) / lag)))
        padded = fft.next_fast_len(2 * size, real=True)
        drive = fft.rfft(rng.normal(0.0, self.coefficient, size), padded)
        flicker = fft.irfft(drive * fft.rfft(weights, padded), padded)
        return np.asarray(flicker[size - n : size])
