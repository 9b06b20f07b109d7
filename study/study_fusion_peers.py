"""Position error beside pyins' feedback filter, on the same simulated drives.

Run: ``python study/study_fusion_peers.py [--runs 100]`` (pyins: PyPI ``python-ins``, which
``tools/build bench`` installs).  Both start from the same heading (0.05 rad off by chance), level
on the same second of rest and are told the same white noise and biases of the IMU; pyins, which has
no Gauss-Markov bias, takes it as a walk of the same drive.  It has no coloured fixes either and is
given their whole variance as white.

Both are scored at every IMU sample, a fix that holds at just that sample used.  Our rows never hold
it (a row uses nothing that comes with its sample or after it), pyins' always do: scored by rows,
ours looks 0.3 % worse by that alone.  What pyins gives is appended by line to ``--results``; ours
is computed for each page.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from nav_fusion.earth import ecef_from_geodetic
from nav_fusion.engine import Engine, joined
from nav_fusion.state import R
from numpy.typing import NDArray
from simulation import Sensed, SensorErrors, sense
from study_fusion import COLOURED, PARAMETERS, WHITE, true_noise
from trajectories import Motion, Truth, driving, flying, truth

Floats = NDArray[np.float64]

YAW, HEADING_SIGMA = 0.7, 0.05
SCORED_FROM_S = 60.0
FLIP = np.array((1.0, -1.0, -1.0))


def ours(true: Truth, sensed: Sensed, e: SensorErrors, heading: float) -> tuple[float, float]:
    """Root mean square position error after a minute, m, and processor seconds."""
    p = replace(
        PARAMETERS,
        initial_heading_rad=heading,
        initial_heading_sigma_rad=HEADING_SIGMA,
        publish_rate_hz=1 / true.t[1],
    )
    begun = time.process_time()
    engine, rows, begin = Engine(true_noise(e), p), [], 0
    after = np.full((true.t.size, 3), np.nan)  # the place when the fix of a sample is used
    ends = np.searchsorted(sensed.stamp_ns, sensed.fix_ns, side="right")
    for k, end in enumerate(ends):
        part = slice(begin, end)
        rows.append(engine.add_imu(sensed.stamp_ns[part], sensed.rate[part], sensed.force[part]))
        begin = end
        engine.add_fix(int(sensed.fix_ns[k]), *sensed.fix[k])
        if engine.running:
            after[end - 1] = engine.state()[R : R + 3]
    every = joined(rows)
    spent = time.process_time() - begun
    index = np.rint((every.stamp_ns - sensed.stamp_ns[0]) * 1e-9 / true.t[1]).astype(int)
    found = np.where(np.isnan(after[index]), every.values[:, 0:3], after[index])
    return scored(true, index, found), spent


def pyins(true: Truth, sensed: Sensed, e: SensorErrors, heading: float) -> tuple[float, float]:
    """Return the same of pyins, in its north-east-down axes."""
    import pandas as pd
    from pyins import filters, inertial_sensor, measurements, strapdown

    columns = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
    rate, force = sensed.rate * FLIP, sensed.force * FLIP
    imu = pd.DataFrame(np.hstack((rate, force)), index=true.t, columns=columns)
    up = -force[:100].mean(axis=0)
    roll, pitch = math.atan2(up[1], up[2]), math.atan2(-up[0], math.hypot(up[1], up[2]))
    names = ["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"]
    angles = np.degrees((roll, pitch, math.pi / 2 - heading))
    start = pd.Series((*sensed.fix[0], 0.0, 0.0, 0.0, *angles), index=names, name=0.0)
    fix_s = (sensed.fix_ns - sensed.stamp_ns[0]) * 1e-9
    fixes = pd.DataFrame(sensed.fix[1:], index=fix_s[1:], columns=names[:3])
    sigma = math.hypot(e.fix_white, e.fix_markov[0])

    def model(density: float, gm: tuple[float, float], turn_on: float):  # type: ignore[no-untyped-def]
        walk = gm[0] * math.sqrt(2 / gm[1])
        return inertial_sensor.EstimationModel(math.hypot(turn_on, gm[0]), density, walk)

    begun = time.process_time()
    result = filters.run_feedback_filter(
        start,
        sigma,
        0.1,
        math.degrees(math.hypot(e.accel_turn_on, e.accel_markov[0]) / 9.8),
        math.degrees(HEADING_SIGMA),
        strapdown.compute_increments_from_imu(imu, "rate"),
        model(e.gyro_density, e.gyro_markov, e.gyro_turn_on),
        model(e.accel_density, e.accel_markov, e.accel_turn_on),
        [measurements.Position(fixes, sigma)],
    )
    spent = time.process_time() - begun
    t = result.trajectory
    index = np.rint(t.index.to_numpy() / true.t[1]).astype(int)
    found = ecef_from_geodetic(np.radians(t.lat), np.radians(t.lon), t.alt.to_numpy())
    return scored(true, index, np.asarray(found)), spent


def scored(true: Truth, index: NDArray[np.int64], found: Floats) -> float:
    """Root mean square distance after ``SCORED_FROM_S``, m."""
    late = true.t[index] >= SCORED_FROM_S
    error = found[late] - ecef_from_geodetic(*true.geodetic[index[late]].T)
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


CASES: tuple[tuple[str, Motion, SensorErrors], ...] = (
    ("driving, white fixes", driving(YAW), WHITE),
    ("driving, coloured fixes", driving(YAW), COLOURED),
    ("flying, white fixes", flying(YAW), WHITE),
    ("flying, coloured fixes", flying(YAW), COLOURED),
)


def row(name: str, lines: list[dict[str, float]]) -> str:
    """Both errors, the ratio of their mean squares with its standard error, seconds of both."""
    a, b = (np.array([x[k] for x in lines]) ** 2 for k in ("ours_m", "pyins_m"))
    ratio = math.sqrt(a.mean() / b.mean())
    error = float(np.std(a - ratio**2 * b, ddof=1)) / math.sqrt(a.size) / (2 * ratio * b.mean())
    spent = [float(np.median([x[k] for x in lines])) for k in ("ours_s", "pyins_s")]
    return (
        f"| {name} | {math.sqrt(a.mean()):.3f} | {math.sqrt(b.mean()):.3f} "
        f"| {ratio:.4f} ({error:.4f}) | {spent[0]:.2f} / {spent[1]:.2f} | {a.size} |"
    )


def theirs_by_run(file: Path) -> dict[tuple[str, int], dict[str, float]]:
    """Return the lines of pyins' results by case and seed."""
    lines = file.read_text().splitlines() if file.exists() else []
    return {(x["case"], x["seed"]): x for x in map(json.loads, lines)}


def main() -> None:
    """Run pyins where it is not in the results, ours everywhere, and write the page."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=100)
    arguments.add_argument("--results", type=Path, default=Path("build/study_fusion_peers.jsonl"))
    arguments.add_argument("--output", type=Path, default=Path("docs/study_fusion_peers.md"))
    options = arguments.parse_args()
    theirs = theirs_by_run(options.results)
    truths = {name: truth(motion, 120.0, 100.0) for name, motion, _ in CASES}
    done: dict[str, list[dict[str, float]]] = {name: [] for name, _, _ in CASES}
    for seed in range(options.runs):
        for name, _, errors in CASES:
            sensed = sense(truths[name], errors, np.random.default_rng(seed))
            heading = YAW + np.random.default_rng(10**6 + seed).normal(0, HEADING_SIGMA)
            if (name, seed) not in theirs:
                b, b_s = pyins(truths[name], sensed, errors, heading)
                x = {"case": name, "seed": seed, "pyins_m": b, "pyins_s": b_s}
                theirs[name, seed] = x
                with options.results.open("a") as file:
                    file.write(json.dumps(x) + "\n")
            a, a_s = ours(truths[name], sensed, errors, heading)
            done[name].append({**theirs[name, seed], "ours_m": a, "ours_s": a_s})
    lines = [
        "# Position error beside pyins",
        "",
        "Simulated drives and flights of 120 s, 100 Hz and 10 Hz; root mean square of the position "
        f"error from {SCORED_FROM_S:.0f} s on, over all samples and runs.  Ratio ours / pyins with "
        "its standard error.  Start heading known to 0.05 rad, the same in both; the white noise "
        "and biases of the IMU are told to both, pyins takes the Gauss-Markov part as a walk and "
        "coloured fixes as white of the same variance, all that it can be told.  Processor time: "
        "median.",
        "",
        "| case | ours m | pyins m | ratio | s ours / pyins | runs |",
        "|---|---|---|---|---|---|",
        *(row(name, lines) for name, lines in done.items()),
        "",
    ]
    options.output.write_text("\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
