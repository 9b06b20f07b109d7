"""Real recordings through the filter, scored against what knows better: error beside sigma.

Run: ``python study/study_fusion_real.py [--data ../shared/data]``.
The recordings are not part of the project.  No noise model of their sensors is at hand: stated
MEMS values are used, and the receiver's noise where it is known because it was added here.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from nav_fusion.earth import ecef_from_geodetic, geodetic_from_ecef, level_axes
from nav_fusion.engine import Engine, joined
from nav_fusion.noise import AidNoise, mems_defaults
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.parameters import Parameters
from nav_fusion.solution import solve
from numpy.typing import NDArray
from simulation import markov

Floats = NDArray[np.float64]

START_NS = 1_700_000_000_000_000_000
WHITE_M, COLOUR_M, COLOUR_S = 0.3, 0.8, 30.0


def ns(t: Floats, first: float) -> NDArray[np.int64]:
    """Seconds of a recording as stamps."""
    return START_NS + np.rint((t - first) * 1e9).astype(np.int64)


def run(engine: Engine, imu, fixes):  # type: ignore[no-untyped-def]
    """Feed samples and fixes in order of their stamps; return the rows."""
    stamp_ns, rate, force = imu
    rows, begin = [], 0
    for k, end in enumerate(np.searchsorted(stamp_ns, fixes[0], side="right")):
        rows.append(engine.add_imu(stamp_ns[begin:end], rate[begin:end], force[begin:end]))
        begin = end
        engine.add_fix(int(fixes[0][k]), *fixes[1][k])
    rows.append(engine.add_imu(stamp_ns[begin:], rate[begin:], force[begin:]))
    return joined(rows)


def scored(name: str, engine: Engine, rows, true_ns, true_ecef: Floats, from_s: float) -> str:  # type: ignore[no-untyped-def]
    """One row of the table: horizontal and vertical error beside sigma, after ``from_s``."""
    latitude, longitude, altitude = geodetic_from_ecef(true_ecef[0])
    origin = (float(np.degrees(latitude)), float(np.degrees(longitude)), float(altitude))
    s = solve(rows.stamp_ns, rows.values, origin)
    inside = (true_ns > rows.stamp_ns[0] + from_s * 1e9) & (true_ns < rows.stamp_ns[-1])
    T = level_axes(latitude, longitude)
    true = (true_ecef[inside] - ecef_from_geodetic(latitude, longitude, altitude)) @ T.T
    error, variance = np.empty_like(true), np.empty_like(true)
    for a in range(3):
        error[:, a] = np.interp(true_ns[inside], rows.stamp_ns, s.position[:, a]) - true[:, a]
        variance[:, a] = np.interp(true_ns[inside], rows.stamp_ns, s.pose_covariance[:, a, a])
    status = engine.status()
    within = np.mean(np.abs(error) < 2 * np.sqrt(variance), axis=0)
    rms, sigma = np.sqrt(np.mean(error**2, axis=0)), np.sqrt(np.mean(variance, axis=0))
    cells = [
        f"{r:.2f} / {v:.2f} ({100 * w:.0f} %)" for r, v, w in zip(rms, sigma, within, strict=True)
    ]
    return (
        f"| {name} | {' | '.join(cells)} | {status.used} / {status.gated} "
        f"| {status.nis_mean:.2f} [{status.nis_lower:.2f}, {status.nis_upper:.2f}] |"
    )


def walk(data: Path) -> list[str]:
    """RTK as truth; fed with errors of a plain receiver, and with an outage of 20 s."""
    f = np.load(data / "rtkx_walk0827.npz")
    first = float(min(f["t"][0], f["gnss_t"][0]))
    imu = ns(f["t"], first), f["gyro"], f["accel"]
    fix_ns, llh = ns(f["gnss_t"], first), f["gnss_llh"]
    rng = np.random.default_rng(1)
    truth = ecef_from_geodetic(np.radians(llh[:, 0]), np.radians(llh[:, 1]), llh[:, 2])
    rows = []
    colour = (SlowTerm.gauss_markov(COLOUR_M, COLOUR_S, "gauss_markov"),)
    plain = replace(
        mems_defaults(), position=(AidNoise(WHITE_M, colour),) * 3, position_claimed=False
    )
    metres = rng.normal(0, WHITE_M, (len(llh), 3)) + np.stack(
        [markov(len(llh), 0.25, COLOUR_M, COLOUR_S, rng) for _ in range(3)], 1
    )
    degraded = llh + np.stack(
        [
            metres[:, 1] / 1.111e5,
            metres[:, 0] / (1.113e5 * np.cos(np.radians(llh[:, 0]))),
            metres[:, 2],
        ],
        1,
    )
    settings = Parameters(use_velocity=False, use_magnetometer=False)
    engine = Engine(plain, settings)
    rows.append(
        scored(
            "walk, RTK with errors added",
            engine,
            run(engine, imu, (fix_ns, degraded)),
            fix_ns,
            truth,
            30.0,
        )
    )
    cm = replace(mems_defaults(), position=(AidNoise(0.03),) * 3, position_claimed=False)
    t = (fix_ns - fix_ns[0]) * 1e-9
    kept = (t < 80) | (t > 100)
    engine = Engine(cm, settings)
    result = run(engine, imu, (fix_ns[kept], llh[kept]))
    held = ~kept
    rows.append(
        scored(
            "walk, RTK left out from 80 s to 100 s, scored there",
            engine,
            result,
            fix_ns[held],
            truth[held],
            30.0,
        )
    )
    return rows


def car(data: Path) -> list[str]:
    """u-blox fixes; the reference is an optimiser's that used the same receiver."""
    f = np.load(data / "comma2k19_ex1.npz")
    first = float(min(f["t"][0], f["gnss_t"][0]))
    imu = ns(f["t"], first), f["gyro"], f["accel"]
    fixes = ns(f["gnss_t"], first), f["gnss_raw"][:, [0, 1, 4]]
    settings = Parameters(
        use_velocity=False, use_magnetometer=False, mounting_rpy_rad=(np.pi, 0.0, 0.0)
    )
    engine = Engine(mems_defaults(), settings)
    rows = run(engine, imu, fixes)
    return [scored("car, 10 Hz u-blox", engine, rows, ns(f["ref_t"], first), f["ref_ecef"], 20.0)]


def main() -> None:
    """Write the page."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--data", type=Path, default=Path("../shared/data"))
    arguments.add_argument("--output", type=Path, default=Path("docs/study_fusion_real.md"))
    options = arguments.parse_args()
    lines = [
        "# Real recordings: error beside sigma",
        "",
        "One recording each, so nothing here is a test of a claim.  MEMS values for the IMU; "
        "no magnetometer, no velocity.  Root mean square error / root mean square sigma in m, and "
        "how many errors are within 2 sigma (95 % if all were true and Gaussian).  Slow errors "
        "make few of the samples independent.",
        "",
        "| recording | east | north | up | fixes used / gated | NIS |",
        "|---|---|---|---|---|---|",
        *walk(options.data),
        *car(options.data),
        "",
        "The walk's errors added to RTK: white 0.3 m and Gauss-Markov 0.8 m, 30 s, and the model "
        "says so.  The car's reference is the pose of a camera, by an optimiser that used the same "
        "receiver: its offset from the antenna is in the error.",
        "",
    ]
    options.output.write_text("\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
