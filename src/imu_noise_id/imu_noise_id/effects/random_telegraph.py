"""Random telegraph noise: the bias jumps between two levels (popcorn noise)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

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
        return np.asarray(power * (1.0 - a * a) / ((1.0 - a) ** 2 + 4.0 * a * s))

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
        return np.asarray(2.0 * (0.5 * self.height) ** 2 / r * factor)

    def simulate(self, n: int, sample_time_s: float, rng: np.random.Generator) -> Floats:
        """Jumps as a Poisson process of rate 1/tau from a level drawn at even odds."""
        jumps = rng.poisson(sample_time_s / self.mean_dwell_s, n)
        jumps[0] = rng.integers(2)
        return np.asarray(0.5 * self.height * (1.0 - 2.0 * (np.cumsum(jumps) % 2)))


@dataclass(frozen=True)
class Decoded:
    """Two-level course read from noisy block means.

    Attributes
    ----------
    upper : (b,) bool
        Most likely level of every block.
    low, high : float
        Levels.
    sigma : float
        Standard deviation of a block mean about its level.
    mean_dwell : float
        Blocks.
    log_likelihood : float
        Of the block means, all courses summed over.
    path_log_likelihood : float
        Of the block means given the most likely course.
    """

    upper: NDArray[np.bool_]
    low: float
    high: float
    sigma: float
    mean_dwell: float
    log_likelihood: float
    path_log_likelihood: float


def decode(means: Floats, dwell: float, rounds: int = 12) -> Decoded:
    """Two-state hidden Markov model of block means by Baum and Welch (1970), course by Viterbi.

    Parameters
    ----------
    means : (b,) float64
        Some hundreds of block means.
    dwell : float
        Starting value of the mean dwell, blocks.
    rounds : int
        Steps of expectation and maximisation.
    """
    low, high = (float(q) for q in np.quantile(means, [0.15, 0.85]))
    sigma = max(0.5 * (high - low), 1e-300)
    stay = 1.0 - 1.0 / max(dwell, 2.0)
    total = 0.0
    for _ in range(rounds):
        density = _densities(means, low, high, sigma)
        total, upper, switches = _smooth(density, stay)
        weight = float(upper.sum())
        high = float(upper @ means) / max(weight, 1e-9)
        low = float((1.0 - upper) @ means) / max(means.size - weight, 1e-9)
        spread = upper * (means - high) ** 2 + (1.0 - upper) * (means - low) ** 2
        sigma = max(float(np.sqrt(np.mean(spread))), 1e-300)
        stay = float(np.clip(1.0 - switches / (means.size - 1), 0.02, 1.0 - 0.5 / means.size))
    density = _densities(means, low, high, sigma)
    total = _smooth(density, stay)[0]
    path = _viterbi(density, stay)
    given = float(np.sum(density[np.arange(means.size), path.astype(int)]))
    # a chance p of another level after one block is (1 - exp(-2/dwell))/2
    dwell = -2.0 / float(np.log(max(2.0 * stay - 1.0, 1e-3)))
    return Decoded(path, low, high, sigma, dwell, total, given)


def _densities(means: Floats, low: float, high: float, sigma: float) -> Floats:
    """Log densities of the block means in either state, (b, 2)."""
    z = (means[:, None] - np.array([low, high])) / sigma
    return np.asarray(-0.5 * z**2 - np.log(sigma) - 0.5 * np.log(2.0 * np.pi))


def _smooth(log_density: Floats, stay: float) -> tuple[float, Floats, float]:
    """Forward and backward passes: log-likelihood, P(upper) (b,), expected switches."""
    top = log_density.max(axis=1)
    a, b = np.exp(log_density - top[:, None]).T.tolist()
    size, go = len(a), 1.0 - stay
    forward = [(0.0, 0.0)] * size
    scale = [0.0] * size
    p, q = 0.5, 0.5
    for k in range(size):
        if k:
            p, q = p * stay + q * go, p * go + q * stay
        p, q = p * a[k], q * b[k]
        scale[k] = p + q
        p, q = p / scale[k], q / scale[k]
        forward[k] = (p, q)
    upper = np.empty(size)
    switches, u, v = 0.0, 1.0, 1.0
    upper[-1] = forward[-1][1]
    for k in range(size - 2, -1, -1):
        e, g = a[k + 1] * u / scale[k + 1], b[k + 1] * v / scale[k + 1]
        p, q = forward[k]
        switches += p * go * g + q * go * e
        u, v = stay * e + go * g, go * e + stay * g
        upper[k] = q * v
    return float(np.sum(np.log(scale)) + top.sum()), upper, switches


def _viterbi(log_density: Floats, stay: float) -> NDArray[np.bool_]:
    keep, change = float(np.log(stay)), float(np.log1p(-stay))
    a, b = log_density.T.tolist()
    size = len(a)
    came = np.zeros((size, 2), dtype=bool)  # whether the best way into a state was a switch
    p, q = a[0], b[0]
    for k in range(1, size):
        into_low, into_high = q + change > p + keep, p + change > q + keep
        came[k] = into_low, into_high
        p, q = (
            (q + change if into_low else p + keep) + a[k],
            (p + change if into_high else q + keep) + b[k],
        )
    path = np.zeros(size, dtype=bool)
    path[-1] = q > p
    for k in range(size - 1, 0, -1):
        path[k - 1] = path[k] ^ came[k, int(path[k])]
    return path
