"""Records for the tests of identification, made by numpy alone."""

from __future__ import annotations

import numpy as np
from imu_noise_id.recording import Channel, Recording, unit_of
from imu_noise_id.series import Series
from numpy.typing import NDArray
from scipy.signal import lfilter

Floats = NDArray[np.float64]
DT = 0.01


def white(n: int, rng: np.random.Generator, density: float = 1.0) -> Floats:
    return rng.standard_normal(n) * density / np.sqrt(DT)


def walk(n: int, rng: np.random.Generator, k: float) -> Floats:
    return np.cumsum(rng.standard_normal(n)) * k * np.sqrt(DT)


def markov(n: int, rng: np.random.Generator, sigma: float, memory_s: float) -> Floats:
    a = np.exp(-DT / memory_s)
    drive = rng.standard_normal(n) * sigma * np.sqrt(1.0 - a * a)
    drive[0] = sigma * rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -a], drive))


def series(values: Floats) -> Series:
    return Series(values, np.ones(values.size, dtype=bool), DT)


def recording(columns: dict[str, Floats], rate_hz: float = 100.0) -> Recording:
    """One topic with the given channels."""
    n = next(iter(columns.values())).size
    stamp_ns = np.rint(np.arange(n) * (1e9 / rate_hz)).astype(np.int64)
    channels = tuple(
        Channel("/imu/data", name, unit_of(name), stamp_ns, v, np.ones(n, dtype=bool), rate_hz)
        for name, v in columns.items()
    )
    return Recording("test", 0, channels)
