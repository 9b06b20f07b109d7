"""What white noise reaches by chance: the first correlation of past and future, and a state's gain.

*Correlation.*  The lagged products of white noise are independent, so the correlations of its past
and future are the singular values of a Hankel matrix of independent normals over sqrt(rows); the
tail of the largest is simulated once.

*Gain.*  A state too many gains in deviance (twice the log-likelihood) what the best of all poles
and directions gains on white noise.  At a pole a = tanh u the gain is the square of p' Z(u) q, with
unit vectors p and q of the outputs and Z a matrix of standard normals whose correlation between two
poles is sech(u - u').  The tail of the largest of such a smooth field is its expected Euler
characteristic (Adler and Taylor 2007; for one output Davies 1977).  Poles count up to a memory of
the record, |a| < 1 - 1/n, so that u covers ln 2n.

A complex pair has a frequency and a bandwidth, as many independent ones as there are samples: there
Schwarz's ln n a parameter is about that level.
"""

from __future__ import annotations

from functools import lru_cache
from math import comb, gamma

import numpy as np
from scipy import special

from imu_noise_id.recording import Floats

FALSE_ALARM = 0.01


def correlation_by_chance(lags: int, channels: int, rows: int, tail: float) -> float:
    """First correlation that white noise exceeds with that chance, for blocks of lags."""
    centre, beta = _hankel_gumbel(lags, channels)
    return float((centre - beta * np.log(-np.log1p(-tail))) / np.sqrt(rows))


def gain_by_chance(samples: int, states: int, outputs: int = 1) -> float:
    """Gain in deviance that one state, or a pair, exceeds on white noise in 1 % of records."""
    if states > 1:
        return float(2 * states * outputs * np.log(max(samples, 2)))
    return _largest_of_field(float(np.log(2.0 * max(samples, 2))), outputs) ** 2


@lru_cache(maxsize=64)
def _largest_of_field(length: float, outputs: int) -> float:
    """Level that p' Z(u) q exceeds somewhere with chance ``FALSE_ALARM``."""
    sphere = _curvatures_of_sphere(outputs - 1)
    # p and q and their opposites are one point
    curvatures = np.convolve(np.convolve(sphere, sphere), [1.0, length]) / 2.0

    low, high = 2.0 * float(np.sqrt(outputs)), 30.0
    for _ in range(50):  # scipy.optimize would take a quarter of a second to import
        level = 0.5 * (low + high)
        above = float(curvatures @ _euler_densities(level, curvatures.size)) > FALSE_ALARM
        low, high = (level, high) if above else (low, level)
    return 0.5 * (low + high)


def _curvatures_of_sphere(dimension: int) -> Floats:
    """Lipschitz-Killing curvatures of the unit sphere, (dimension + 1,)."""

    def area(of: int) -> float:
        return float(2.0 * np.pi ** (of / 2.0) / gamma(of / 2.0))

    whole = [
        2.0 * comb(dimension, j) * area(dimension + 1) / area(dimension + 1 - j)
        if (dimension - j) % 2 == 0
        else 0.0
        for j in range(dimension + 1)
    ]
    return np.array(whole)


def _euler_densities(level: float, count: int) -> Floats:
    """Euler characteristic densities of a Gaussian field above a level, (count,)."""
    hermite = [1.0, level]  # He_0, He_1, ...
    for j in range(1, count):
        hermite.append(level * hermite[j] - j * hermite[j - 1])
    bell = np.exp(-0.5 * level * level)
    rest = [(2.0 * np.pi) ** (-0.5 * (j + 1)) * hermite[j - 1] * bell for j in range(1, count)]
    return np.array([float(special.ndtr(-level)), *rest])


@lru_cache(maxsize=64)
def _hankel_gumbel(lags: int, channels: int) -> tuple[float, float]:
    """Location and scale of that correlation's upper tail, from draws with a fixed seed."""
    rng = np.random.default_rng(20_26)
    draws = 2000 // channels**2
    lag = np.add.outer(np.arange(lags), np.arange(lags))
    products = rng.standard_normal((draws, 2 * lags - 1, channels, channels))
    hankel = products[:, lag].transpose(0, 1, 3, 2, 4).reshape(draws, lags * channels, -1)
    largest = np.sqrt(np.linalg.eigvalsh(hankel @ hankel.transpose(0, 2, 1))[:, -1])
    beta = float(np.std(largest)) * np.sqrt(6.0) / np.pi
    return float(np.mean(largest)) - np.euler_gamma * beta, beta
