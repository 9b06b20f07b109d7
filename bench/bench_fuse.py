"""The filter beside pyins and filterpy: seconds of processor time for a second of 1 kHz IMU.

A platform at rest with white noise, 1 kHz IMU and 10 Hz fixes, heading given.  Ours is fed as the
live node is (a block of samples, then a fix), with fixes in time and 0.2 s late, and once with the
samples alone; and how much of that passes inside the compiled filter.  pyins runs its
feedback filter on the same arrays with its own time step; filterpy's ``KalmanFilter`` predicts per
sample and updates per fix with 15 states and no mechanisation at all.  All in one process, in
turns; medians over the turns.  Peers that are not installed are left out with a line.
Writes ``fuse.json`` and ``fuse.md`` into ``--output``.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from nav_fusion.engine import Engine
from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.parameters import Parameters
from numpy.typing import NDArray

from nav_fusion import core

RATE_HZ, FIX_RATE_HZ = 1000.0, 10.0
PLACE = (47.0, 8.0, 400.0)
GYRO_DENSITY, ACCEL_DENSITY, FIX_SIGMA_M = 1.7e-4, 2e-3, 0.3
GYRO_BIAS, ACCEL_BIAS = 0.003, 0.05
INSIDE = "ours, fixes in time: inside the compiled filter"
SETTINGS = Parameters(
    initial_heading_rad=0.0,
    use_velocity=False,
    use_magnetometer=False,
    zero_velocity_updates=False,
)


@dataclass(frozen=True)
class Scene:
    """Samples in forward-left-up axes and fixes (deg, deg, m), the same for everybody."""

    t: NDArray[np.float64]
    rate: NDArray[np.float64]
    force: NDArray[np.float64]
    fix_at: NDArray[np.int64]
    fix: NDArray[np.float64]


def scene(seconds: float, rng: np.random.Generator) -> Scene:
    """Make a platform at rest."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    rate = rng.normal(0, GYRO_DENSITY * np.sqrt(RATE_HZ), (t.size, 3))
    force = rng.normal((0, 0, 9.80863), ACCEL_DENSITY * np.sqrt(RATE_HZ), (t.size, 3))
    fix_at = np.arange(0, t.size, round(RATE_HZ / FIX_RATE_HZ))
    per_degree = np.array((1.11e5, 7.6e4, 1.0))
    fix = PLACE + rng.normal(0, FIX_SIGMA_M, (fix_at.size, 3)) / per_degree
    return Scene(t, rate, force, fix_at, fix)


def noise() -> NavigationNoise:
    """Return white noise and constant biases: what pyins can be told as well."""
    gyro = AxisNoise(GYRO_DENSITY, (SlowTerm(GYRO_BIAS, float("inf"), 0.0, "turn_on_bias"),))
    accel = AxisNoise(ACCEL_DENSITY, (SlowTerm(ACCEL_BIAS, float("inf"), 0.0, "turn_on_bias"),))
    white = AidNoise(FIX_SIGMA_M)
    return NavigationNoise((gyro,) * 3, (accel,) * 3, (white,) * 3, (white,) * 3, white)


def ours(s: Scene, late_s: float = 0.0, until_s: float = np.inf) -> None:
    """Feed the engine; fixes ``late_s`` late, none stamped after ``until_s``."""
    engine = Engine(noise(), SETTINGS)
    stamp_ns = np.rint(s.t * 1e9).astype(np.int64)
    begin = 0
    for k, at in enumerate(s.fix_at):
        end = min(int(at + late_s * RATE_HZ) + 1, s.t.size)
        engine.add_imu(stamp_ns[begin:end], s.rate[begin:end], s.force[begin:end])
        begin = end
        if s.t[at] <= until_s:
            engine.add_fix(int(stamp_ns[at]), *s.fix[k])
    engine.add_imu(stamp_ns[begin:], s.rate[begin:], s.force[begin:])
    assert engine.running


@contextmanager
def compiled_calls_timed() -> Iterator[list[float]]:
    """Gather the seconds that pass inside the compiled filter, of all that the engine calls."""
    spent: list[float] = []
    kept = {name: getattr(core, name) for name in ("feed", "insert")}

    def timed(call: Callable[..., object]) -> Callable[..., object]:
        def wrapped(*arguments: object) -> object:
            begun = time.perf_counter()
            result = call(*arguments)
            spent.append(time.perf_counter() - begun)
            return result

        return wrapped

    for name, call in kept.items():
        setattr(core, name, timed(call))
    try:
        yield spent
    finally:
        for name, call in kept.items():
            setattr(core, name, call)


def by_pyins(s: Scene) -> None:
    """Run pyins' feedback filter on the scene, in its north-east-down axes."""
    import pandas as pd
    from pyins import filters, inertial_sensor, measurements, strapdown

    flip = np.array((1.0, -1.0, -1.0))
    columns = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
    imu = pd.DataFrame(np.hstack((s.rate * flip, s.force * flip)), index=s.t, columns=columns)
    names = ["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"]
    start = pd.Series((*PLACE, 0.0, 0.0, 0.0, 0.0, 0.0, 90.0), index=names, name=0.0)
    fixes = pd.DataFrame(s.fix, index=s.t[s.fix_at], columns=names[:3])
    filters.run_feedback_filter(
        start,
        1.0,
        1.0,
        0.1,
        5.0,
        strapdown.compute_increments_from_imu(imu, "rate"),
        inertial_sensor.EstimationModel(bias_sd=GYRO_BIAS, noise=GYRO_DENSITY),
        inertial_sensor.EstimationModel(bias_sd=ACCEL_BIAS, noise=ACCEL_DENSITY),
        [measurements.Position(fixes, FIX_SIGMA_M)],
    )


def by_filterpy(s: Scene) -> None:
    """Predict per sample and update per fix with filterpy's linear filter of 15 states."""
    from filterpy.kalman import KalmanFilter

    kalman = KalmanFilter(dim_x=15, dim_z=3)
    dt = 1 / RATE_HZ
    kalman.F[0:3, 3:6] = dt * np.eye(3)
    kalman.H[:, 0:3] = np.eye(3)
    kalman.Q *= 1e-8
    kalman.R *= FIX_SIGMA_M**2
    fixes = set(s.fix_at.tolist())
    for k in range(s.t.size):
        kalman.predict()
        if k in fixes:
            kalman.update(np.zeros(3))


def peers() -> dict[str, Callable[[Scene], None]]:
    """Return the peers that are installed; say which are not."""
    known: dict[str, tuple[str, Callable[[Scene], None]]] = {
        "pyins feedback filter": ("pyins", by_pyins),
        "filterpy, linear, 15 states": ("filterpy", by_filterpy),
    }
    found = {}
    for label, (module, run) in known.items():
        if importlib.util.find_spec(module) is None:
            print(f"{module} is not installed: left out")
        else:
            found[label] = run
    return found


def measured(seconds: float, peer_seconds: float, turns: int) -> list[dict[str, object]]:
    """Processor time per second of data of everybody, in turns."""
    rng = np.random.default_rng(1)
    long, short = scene(seconds, rng), scene(peer_seconds, rng)
    runs: dict[str, tuple[Callable[[Scene], None], Scene]] = {
        "ours, samples alone": (lambda s: ours(s, until_s=2.0), long),
        "ours, fixes in time": (ours, long),
        "ours, fixes 0.2 s late": (lambda s: ours(s, 0.2), long),
    }
    runs |= {label: (run, short) for label, run in peers().items()}
    spent: dict[str, list[float]] = {label: [] for label in runs}
    for run, _ in runs.values():
        run(scene(3.0, rng))  # compiles, imports
    for _ in range(turns):
        for label, (run, data) in runs.items():
            begun = time.process_time()
            run(data)
            spent[label].append((time.process_time() - begun) / data.t[-1])
        with compiled_calls_timed() as inside:
            ours(long)
        spent.setdefault(INSIDE, []).append(sum(inside) / long.t[-1])
    base = np.array(spent["ours, fixes in time"])
    return [
        {
            "what": label,
            "cpu_s_per_s": float(np.median(values)),
            "times_real_time": float(1 / np.median(values)),
            "times_real_time_best": float(1 / min(values)),
            "ratio_to_ours": float(np.median(np.array(values) / base)),
            "turns": turns,
        }
        for label, values in spent.items()
    ]


def table(rows: list[dict[str, object]], load: float) -> str:
    """Markdown."""
    lines = [
        "## Filter core at 1 kHz with 10 Hz fixes, one core\n",
        "| | times real time, median | best | processor time, of ours with fixes in time |",
        "|---|---|---|---|",
    ]
    for r in rows:
        lines.append(
            f"| {r['what']} | {r['times_real_time']:.3g} | {r['times_real_time_best']:.3g} "
            f"| {r['ratio_to_ours']:.3g} |"
        )
    turns = rows[0]["turns"]
    return "\n".join((*lines, "", f"{turns} turns; load of the machine {load:.1f}.", ""))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--seconds", type=float, default=60.0, help="of data, for ours")
    parser.add_argument("--peer-seconds", type=float, default=10.0, help="of data, for peers")
    parser.add_argument("--turns", type=int, default=5)
    options = parser.parse_args()
    rows = measured(options.seconds, options.peer_seconds, options.turns)
    text = table(rows, os.getloadavg()[0])
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / "fuse.json").write_text(json.dumps(rows, indent=1))
    (options.output / "fuse.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main()
