"""Real recordings through the filter, scored against what knows better: error beside sigma.

Run: ``python study/study_fusion_real.py [--data ../shared/data]``.
The recordings are not part of the project.  No noise model of their sensors is at hand: stated
MEMS values are used, and the receiver's noise where it is known because it was added here.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from nav_fusion.alignment import matrix_of
from nav_fusion.consistency import innovations_of
from nav_fusion.earth import ecef_from_geodetic, geodetic_from_ecef, level_axes
from nav_fusion.engine import Engine, Status, joined
from nav_fusion.noise import AidNoise, mems_defaults
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.parameters import Parameters
from nav_fusion.solution import solve
from numpy.typing import NDArray
from scipy.optimize import minimize
from simulation import markov

Floats = NDArray[np.float64]

START_NS = 1_700_000_000_000_000_000
WHITE_M, COLOUR_M, COLOUR_S = 0.3, 0.8, 30.0
HELD_S = (80.0, 100.0)
SETTINGS = Parameters(use_velocity=False, use_magnetometer=False)


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


@dataclass(frozen=True)
class Compared:
    """A run against a reference: seconds since its start, error and sigma (k, 3) in m."""

    name: str
    t_s: Floats
    error: Floats
    sigma: Floats
    status: Status

    def row(self, from_s: float, to_s: float = np.inf) -> str:
        """One row of the table: root mean square error beside sigma between two times."""
        k = (self.t_s >= from_s) & (self.t_s <= to_s)
        within = np.mean(np.abs(self.error[k]) < 2 * self.sigma[k], axis=0)
        rms, sigma = (np.sqrt(np.mean(x[k] ** 2, axis=0)) for x in (self.error, self.sigma))
        cells = [
            f"{r:.2f} / {v:.2f} ({100 * w:.0f} %)"
            for r, v, w in zip(rms, sigma, within, strict=True)
        ]
        s = self.status
        verdicts = [n.split(":")[0] for n in s.notes if n.startswith("the covariance is")]
        said = "; ".join(dict.fromkeys(verdicts))
        return (
            f"| {self.name} | {' | '.join(cells)} | {s.used} / {s.gated} "
            f"| {s.nis_mean:.2f} [{s.nis_lower:.2f}, {s.nis_upper:.2f}] | {said or '-'} |"
        )


def compared(name: str, engine: Engine, rows, true_ns, true_ecef: Floats) -> Compared:  # type: ignore[no-untyped-def]
    """Error and sigma of the antenna at the reference's times."""
    latitude, longitude, altitude = geodetic_from_ecef(true_ecef[0])
    origin = (float(np.degrees(latitude)), float(np.degrees(longitude)), float(altitude))
    lever = engine.parameters.lever_arm_m
    s = solve(rows.stamp_ns, rows.values, origin, lever)
    inside = (true_ns > rows.stamp_ns[0]) & (true_ns < rows.stamp_ns[-1])
    T = level_axes(latitude, longitude)
    true = (true_ecef[inside] - ecef_from_geodetic(latitude, longitude, altitude)) @ T.T
    error, sigma = np.empty_like(true), np.empty_like(true)
    arm = matrix_of(s.orientation) @ np.array(lever)
    for a in range(3):
        found = s.position[:, a] + arm[:, a]
        error[:, a] = np.interp(true_ns[inside], rows.stamp_ns, found) - true[:, a]
        variance = np.interp(true_ns[inside], rows.stamp_ns, s.pose_covariance[:, a, a])
        sigma[:, a] = np.sqrt(variance)
    t_s = (true_ns[inside] - true_ns[0]) * 1e-9
    return Compared(name, t_s, error, sigma, engine.status())


@dataclass(frozen=True)
class Walk:
    """The walk's samples, its RTK fixes with their stamps, and their seconds."""

    imu: tuple[NDArray[np.int64], Floats, Floats]
    fix_ns: NDArray[np.int64]
    fix: Floats

    @property
    def t_s(self) -> Floats:
        """Seconds of the fixes since the first."""
        return (self.fix_ns - self.fix_ns[0]) * 1e-9

    @property
    def ecef(self) -> Floats:
        """Fixes in ECEF, m."""
        return ecef_from_geodetic(
            np.radians(self.fix[:, 0]), np.radians(self.fix[:, 1]), self.fix[:, 2]
        )


def read_walk(data: Path) -> Walk:
    """Read the recording."""
    f = np.load(data / "rtkx_walk0827.npz")
    first = float(min(f["t"][0], f["gnss_t"][0]))
    imu = ns(f["t"], first), f["gyro"], f["accel"]
    return Walk(imu, ns(f["gnss_t"], first), f["gnss_llh"])


def degraded(walk: Walk) -> Compared:
    """RTK as truth; fed with the errors of a plain receiver, which the model is told."""
    rng = np.random.default_rng(1)
    colour = (SlowTerm.gauss_markov(COLOUR_M, COLOUR_S, "gauss_markov"),)
    noise = replace(
        mems_defaults(), position=(AidNoise(WHITE_M, colour),) * 3, position_claimed=False
    )
    count = len(walk.fix)
    metres = rng.normal(0, WHITE_M, (count, 3)) + np.stack(
        [markov(count, 0.25, COLOUR_M, COLOUR_S, rng) for _ in range(3)], 1
    )
    per_degree = np.stack(
        [np.full(count, 1.111e5), 1.113e5 * np.cos(np.radians(walk.fix[:, 0])), np.ones(count)], 1
    )
    engine = Engine(noise, SETTINGS)
    fixes = walk.fix + metres[:, [1, 0, 2]] / per_degree
    rows = run(engine, walk.imu, (walk.fix_ns, fixes))
    return compared("walk, RTK with errors added", engine, rows, walk.fix_ns, walk.ecef)


@dataclass(frozen=True)
class Tuning:
    """What is not known of the platform: delay, lever arm, and how loud its IMU is in use."""

    delay_s: float = 0.0
    lever_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyro: float = 1.0
    accel: float = 1.0

    def engine(self, gate: float = Parameters().gate_confidence) -> Engine:
        """Return a filter with these values; fixes of 3 cm."""
        plain = mems_defaults()
        louder = [
            tuple(replace(a, white_density=a.white_density * factor) for a in axes)
            for axes, factor in ((plain.gyro, self.gyro), (plain.accel, self.accel))
        ]
        noise = replace(
            plain,
            gyro=louder[0],
            accel=louder[1],
            position=(AidNoise(0.03),) * 3,
            position_claimed=False,
        )
        settings = replace(
            SETTINGS, gnss_delay_s=self.delay_s, lever_arm_m=self.lever_m, gate_confidence=gate
        )
        return Engine(noise, settings)


def held_out(walk: Walk, name: str, tuning: Tuning) -> Compared:
    """Leave the RTK fixes of ``HELD_S`` out; the errors are against all of them."""
    kept = (walk.t_s < HELD_S[0]) | (walk.t_s > HELD_S[1])
    engine = tuning.engine()
    rows = run(engine, walk.imu, (walk.fix_ns[kept], walk.fix[kept]))
    return compared(name, engine, rows, walk.fix_ns, walk.ecef)


def tuned(walk: Walk, delay_alone: bool = False) -> Tuning:
    """Most likely tuning on the fixes *before* the held-out part, by Nelder and Mead."""
    kept = walk.t_s < HELD_S[0]

    def of(x: Floats) -> Tuning:
        if delay_alone:
            return Tuning(float(x[0]))
        return Tuning(float(x[0]), tuple(map(float, x[1:4])), *map(float, np.exp(x[4:6])))

    def cost(x: Floats) -> float:
        if abs(x[0]) > 0.5 or np.max(np.abs(x)) > 8.0:
            return 1e6
        engine = of(x).engine(gate=1 - 1e-12)
        run(engine, walk.imu, (walk.fix_ns[kept], walk.fix[kept]))
        found = innovations_of(engine)
        each = np.minimum(found.nis, 100.0) + 2 * np.log(found.sigma).sum(axis=1)
        return float(np.mean(each[60:]))

    start = np.zeros(1) if delay_alone else np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0])
    steps = np.array([0.05] if delay_alone else [0.05, 0.1, 0.1, 0.1, 1.0, 1.0])
    simplex = np.vstack([start, start + np.diag(steps)])
    best = minimize(
        cost, start, method="Nelder-Mead", options={"initial_simplex": simplex, "maxfev": 160}
    )
    return of(best.x)


def car(data: Path) -> Compared:
    """u-blox fixes; the reference is an optimiser's that used the same receiver."""
    f = np.load(data / "comma2k19_ex1.npz")
    first = float(min(f["t"][0], f["gnss_t"][0]))
    imu = ns(f["t"], first), f["gyro"], f["accel"]
    fixes = ns(f["gnss_t"], first), f["gnss_raw"][:, [0, 1, 4]]
    engine = Engine(mems_defaults(), replace(SETTINGS, mounting_rpy_rad=(np.pi, 0.0, 0.0)))
    rows = run(engine, imu, fixes)
    return compared("car, 10 Hz u-blox", engine, rows, ns(f["ref_t"], first), f["ref_ecef"])


def draw(runs: tuple[Compared, ...], file: Path) -> None:
    """Errors over time inside two sigma, one row of panels a run."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(
        len(runs), 3, figsize=(11, 2.3 * len(runs)), sharex="row", squeeze=False
    )
    for one, line in zip(runs, panels, strict=True):
        for a, (panel, axis) in enumerate(zip(line, ("east", "north", "up"), strict=True)):
            k = one.t_s > 25.0
            t, error, two = one.t_s[k], one.error[k, a], 2 * one.sigma[k, a]
            panel.fill_between(t, -two, two, color="#9ecae1", label="2 sigma")
            panel.plot(t, error, color="#b2182b", lw=0.8, label="error")
            panel.set_title(f"{one.name}: {axis}", fontsize=7)
            panel.set_ylabel("m")
    panels[0, 0].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(file, dpi=80)


def main() -> None:
    """Write the page."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--data", type=Path, default=Path("../shared/data"))
    arguments.add_argument("--output", type=Path, default=Path("docs/study_fusion_real.md"))
    arguments.add_argument("--picture", type=Path, default=Path("docs/pictures/fusion_real.png"))
    options = arguments.parse_args()
    walk = read_walk(options.data)
    delay, all_of_it = tuned(walk, delay_alone=True), tuned(walk)
    print(delay, all_of_it)
    kept = "walk, 80 s to 100 s without fixes"
    held = (
        held_out(walk, f"{kept}, as it is", Tuning()),
        held_out(walk, f"{kept}, delay", delay),
        held_out(walk, f"{kept}, tuned", all_of_it),
    )
    plain, on_road = degraded(walk), car(options.data)
    draw((plain, *held, on_road), options.picture)
    x, y, z = all_of_it.lever_m
    lines = [
        "# Real recordings: error beside sigma",
        "",
        "One recording each, so nothing here is a test of a claim.  MEMS values for the IMU; "
        "no magnetometer, no velocity.  Root mean square error / root mean square sigma in m, and "
        "how many errors are within 2 sigma (95 % if all were true and Gaussian).  Slow errors "
        "make few of the samples independent.  The last column is what the filter itself says.",
        "",
        "| recording | east | north | up | fixes used / gated | NIS | the filter says |",
        "|---|---|---|---|---|---|---|",
        plain.row(30.0),
        *(one.row(*HELD_S) for one in held),
        on_road.row(20.0),
        "",
        "The walk's errors added to RTK: white 0.3 m and Gauss-Markov 0.8 m, 30 s, and the model "
        "says so.  The car's reference is the pose of a camera, by an optimiser that used the same "
        "receiver: its offset from the antenna is in the error.",
        "",
        "The walk without fixes is scored in that span only.  *As it is*: no delay, no lever arm.  "
        f"*Delay*: the most likely delay on the first 80 s, {delay.delay_s:+.3f} s.  *Tuned*: the "
        f"most likely delay {all_of_it.delay_s:+.3f} s, lever arm ({x:.2f}, {y:.2f}, {z:.2f}) m "
        f"and white noise of the IMU in use ({all_of_it.gyro:.1f} times the gyro's, "
        f"{all_of_it.accel:.1f} times the accelerometer's) on the first 80 s.",
        "",
        f"![Error and sigma over time]({options.picture.parent.name}/{options.picture.name})",
        "",
    ]
    options.output.write_text("\n".join(lines))
    print("\n".join(lines))


if __name__ == "__main__":
    main()
