"""Noisy sensors on a true trajectory, by numpy alone: what the filter under study is fed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from trajectories import Truth

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SensorErrors:
    """White density, Gauss-Markov (sigma, s), turn-on sigma of the IMU; of fixes white, colour."""

    gyro_density: float = 1.7e-4
    gyro_markov: tuple[float, float] = (1e-4, 300.0)
    gyro_turn_on: float = 0.003
    accel_density: float = 2e-3
    accel_markov: tuple[float, float] = (3e-3, 300.0)
    accel_turn_on: float = 0.05
    fix_white: float = 0.3
    fix_markov: tuple[float, float] = (0.8, 30.0)
    fix_rate_hz: float = 10.0


@dataclass(frozen=True)
class Sensed:
    """What is fed: stamps ns, rate, force; fixes' stamps and geodetic positions (deg, deg, m)."""

    stamp_ns: NDArray[np.int64]
    rate: Floats
    force: Floats
    fix_ns: NDArray[np.int64]
    fix: Floats


def markov(n: int, dt: float, sigma: float, time_s: float, rng: np.random.Generator) -> Floats:
    """n stationary samples of a Gauss-Markov process."""
    if sigma == 0:
        return np.zeros(n)
    a = np.exp(-dt / time_s)
    w = rng.normal(0, sigma * np.sqrt(1 - a * a), n)
    w[0] = rng.normal(0, sigma)
    return lfilter([1.0], [1.0, -a], w)


def sense(
    truth: Truth,
    errors: SensorErrors,
    rng: np.random.Generator,
    start_ns: int = 1_700_000_000_000_000_000,
) -> Sensed:
    """One realisation."""
    n = truth.t.size
    dt = float(truth.t[1] - truth.t[0])

    def axis(density: float, gm: tuple[float, float], turn_on: float) -> Floats:
        white = rng.normal(0, density / np.sqrt(dt), n)
        return white + markov(n, dt, *gm, rng) + rng.normal(0, turn_on)

    e = errors
    rate = truth.rate + np.stack(
        [axis(e.gyro_density, e.gyro_markov, e.gyro_turn_on) for _ in range(3)], -1
    )
    force = truth.force + np.stack(
        [axis(e.accel_density, e.accel_markov, e.accel_turn_on) for _ in range(3)], -1
    )
    every = round(1 / (dt * e.fix_rate_hz))
    k = np.arange(0, n, every)
    enu = np.stack(
        [
            rng.normal(0, e.fix_white, k.size) + markov(k.size, every * dt, *e.fix_markov, rng)
            for _ in range(3)
        ],
        -1,
    )
    latitude, longitude, altitude = truth.geodetic[k].T
    s2 = np.sin(latitude) ** 2
    N = 6378137.0 / np.sqrt(1 - 0.00669437999014 * s2)
    M = N * (1 - 0.00669437999014) / (1 - 0.00669437999014 * s2)
    fix = np.stack(
        [
            np.degrees(latitude + enu[:, 1] / (M + altitude)),
            np.degrees(longitude + enu[:, 0] / ((N + altitude) * np.cos(latitude))),
            altitude + enu[:, 2],
        ],
        -1,
    )
    stamp_ns = start_ns + np.rint(truth.t * 1e9).astype(np.int64)
    return Sensed(stamp_ns, rate, force, stamp_ns[k], fix)
