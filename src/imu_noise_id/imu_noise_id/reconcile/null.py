"""Null distributions of the battery: simulated once per length, kept on disk.

The battery sees whitened records, which look alike under every right model, so the null depends on
the number of samples and the sample time only.  Beyond the simulated 90 % point each statistic has
an exponential tail, whose mean excess depends on neither: ``EXCESS_NATS``.
"""

from __future__ import annotations

import os
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.fft import next_fast_len
from scipy.special import log_ndtr, ndtri

from imu_noise_id.reconcile.battery import NAMES, battery, white_record
from imu_noise_id.recording import Floats

VERSION = 9
SIMULATIONS = 900
TAIL_FROM = 0.90
EXCESS_NATS = {
    "spectrum": 1.02,
    "band": 1.13,
    "line": 1.05,
    "modulation": 1.04,
    "kurtosis": 0.88,
    "skewness": 0.82,
    "extreme": 1.02,
    "burst": 1.16,
    "levels": 1.10,
    "patch": 1.14,
}
"""Slopes of the tails beyond the 90 % point, of 25 000 simulated records (``levels``: 9000,
``patch``: 11 500).

Of 30 000 to 120 000 samples at 10 and 200 Hz: halfway between the mean excess (standard error 0.02)
and the slope to one in 10^4, which differ by 0.08 nats at most.  By the 90 excesses of one null
they would be known to a tenth, 0.7 nats where it counts.  ``study/study_null.py`` makes them again.
"""
LENGTHS_PER_OCTAVE = 6
LEAST_LOG_P = -1e6


@dataclass(frozen=True)
class Null:
    """Sorted statistics of simulated white records.

    Attributes
    ----------
    names : tuple of str
    nats : (simulations, statistics) float64
        Each column rising.
    """

    names: tuple[str, ...]
    nats: Floats

    def log_p(self, name: str, nats: float) -> float:
        """Logarithm of the chance that a right model shows ``nats`` or more."""
        column = self.nats[:, self.names.index(name)]
        start = float(np.quantile(column, TAIL_FROM))
        if nats > start:
            excess = EXCESS_NATS.get(name) or float(np.mean(column[column > start] - start))
            return float(np.log(1.0 - TAIL_FROM) - (nats - start) / excess)
        above = column.size - int(np.searchsorted(column, nats, side="left"))
        return float(np.log((above + 0.5) / (column.size + 1.0)))


def z_of(log_p: float) -> float:
    """Standard deviations whose two-sided tail has this logarithm, 1400 at most."""
    log_p = max(log_p, LEAST_LOG_P)
    if log_p > -700.0:
        return float(-ndtri(0.5 * np.exp(min(log_p, 0.0))))
    z = np.sqrt(-2.0 * log_p)
    for _ in range(4):
        z = np.sqrt(-2.0 * (log_p + np.log(z * np.sqrt(0.5 * np.pi))))
    return float(z)


def log_p_of(z: float) -> float:
    """Logarithm of the two-sided tail of a standard normal deviate."""
    return float(np.log(2.0) + log_ndtr(-abs(z)))


def load_null(
    samples: int, sample_time_s: float, workers: int = 2, simulations: int = SIMULATIONS
) -> Null:
    """Null for a length, from the cache or simulated and cached.

    Lengths within 6 % share a null: the maxima move by the logarithm of that, 0.06 nats.

    Parameters
    ----------
    samples : int
    sample_time_s : float
    workers : int
        Threads; the result does not depend on their number.
    simulations : int
    """
    octave = np.round(np.log2(samples) * LENGTHS_PER_OCTAVE) / LENGTHS_PER_OCTAVE
    n = next_fast_len(round(2.0 ** float(octave)), real=True)
    interval = float(f"{sample_time_s:.2g}")
    path = _cache_folder() / f"null_v{VERSION}_{n}_{interval:g}_{simulations}.npz"
    return _stored_or_simulated(path, n, interval, workers, simulations)


@lru_cache(maxsize=8)
def _stored_or_simulated(
    path: Path, n: int, interval: float, workers: int, simulations: int
) -> Null:
    """Read or simulated once a process: where nothing can be stored every channel asks again."""
    if path.is_file():
        with np.load(path) as stored:
            if tuple(stored["names"]) == NAMES:
                return Null(NAMES, stored["nats"])
    null = simulate_null(n, interval, workers, simulations)
    _store(path, null)
    return null


def simulate_null(n: int, sample_time_s: float, workers: int, simulations: int) -> Null:
    """Battery of simulated white records of n samples, the same on any number of workers."""

    def one(seed: np.random.SeedSequence) -> list[float]:
        samples = np.random.default_rng(seed).standard_normal(n)
        return [s.nats for s in battery(white_record(samples, sample_time_s))]

    seeds = np.random.SeedSequence([VERSION, n]).spawn(simulations)
    with ThreadPoolExecutor(max(workers, 1)) as pool:
        rows = list(pool.map(one, seeds))
    return Null(NAMES, np.sort(np.array(rows), axis=0))


def _cache_folder() -> Path:
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "imu_noise_id"


def _store(path: Path, null: Null) -> None:
    """Write whole or not at all; a folder that cannot be written costs the cache, not the run."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".npz", delete=False) as file:
            np.savez(file, names=np.array(null.names), nats=null.nats)
        Path(file.name).replace(path)
    except OSError:
        return
