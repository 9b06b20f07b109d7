"""Is the fused covariance true?  NEES standing, driving, flying, in an outage; rates; length.

Run: ``python study/study_fusion.py [--runs 100] [--output docs/study_fusion.md]``.
The truth is analytic (``trajectories``), the sensors are numpy's (``simulation``): neither is the
filter's code.  Results are appended by line to ``--results``; runs that are there are not repeated,
and ``--runs 0`` makes the page of them.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from imu_noise_id.identify import identify_recording
from imu_noise_id.recording import Channel, Recording, unit_of
from nav_fusion.alignment import matrix_of
from nav_fusion.consistency import (
    covariance_of,
    is_symmetric_positive,
    mean_band,
    normalised_squares,
)
from nav_fusion.doubt import doubts_of
from nav_fusion.earth import ecef_from_geodetic, level_axes
from nav_fusion.engine import Engine, joined
from nav_fusion.noise import (
    AidNoise,
    AxisNoise,
    NavigationNoise,
    TurnOn,
    from_model,
    mems_defaults,
)
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.parameters import Parameters
from nav_fusion.solution import solve
from numpy.typing import NDArray
from scipy.signal import lfilter
from simulation import Sensed, SensorErrors, markov, sense
from trajectories import OMEGA, Motion, Truth, driving, flying, gravity, standing, truth

Floats = NDArray[np.float64]

WHITE = SensorErrors(fix_markov=(0.0, 30.0))
COLOURED = SensorErrors()
SCORED_S = (60.0, 120.0)
# of one degree at 47 degrees north, 450 m up; what rests there in east-north-up axes reads
NORTH_M, EAST_M = 111_178.695, 76_061.355
EARTH_RATE_47 = OMEGA * np.array([0.0, math.cos(math.radians(47.0)), math.sin(math.radians(47.0))])
GRAVITY_47 = float(gravity(np.radians(47.0), np.float64(450.0)))
PARAMETERS = Parameters(
    use_velocity=False,
    use_magnetometer=False,
    zero_velocity_updates=False,
    gate_confidence=1 - 1e-9,
)


@dataclass(frozen=True)
class Scored:
    """One run: NEES and errors at the scored epochs, (k, 3) position, velocity, attitude."""

    nees: list[list[float]]
    position_m: list[float]
    raw_m: float
    rmse_m: float


def true_noise(e: SensorErrors) -> NavigationNoise:
    """Return the model that the simulation really has."""

    def axis(density: float, gm: tuple[float, float], turn_on: float) -> AxisNoise:
        return AxisNoise(
            density,
            (
                SlowTerm(turn_on, math.inf, 0.0, "turn_on_bias"),
                SlowTerm.gauss_markov(*gm, "gauss_markov"),
            ),
        )

    colour = (SlowTerm.gauss_markov(*e.fix_markov, "gauss_markov"),) if e.fix_markov[0] else ()
    gyro = axis(e.gyro_density, e.gyro_markov, e.gyro_turn_on)
    accel = axis(e.accel_density, e.accel_markov, e.accel_turn_on)
    plain = mems_defaults()
    return NavigationNoise(
        (gyro,) * 3,
        (accel,) * 3,
        (AidNoise(e.fix_white, colour),) * 3,
        plain.velocity,
        plain.heading,
        False,
        "true",
    )


def colour_as_white(e: SensorErrors) -> NavigationNoise:
    """Return the model that has the right variance of the fixes and no colour."""
    sigma = math.hypot(e.fix_white, e.fix_markov[0])
    return replace(true_noise(e), position=(AidNoise(sigma),) * 3)


def identified(e: SensorErrors, seed: int, seconds: float = 900.0) -> NavigationNoise:
    """Identify the model from a static record of its own, made by the same laws."""
    rng = np.random.default_rng(10_000 + seed)
    channels = []
    for name, density, gm in (
        ("angular_velocity", e.gyro_density, e.gyro_markov),
        ("linear_acceleration", e.accel_density, e.accel_markov),
    ):
        for axis in "xyz":
            n = round(seconds * 100)
            values = rng.normal(0, density * 10, n) + markov(n, 0.01, *gm, rng)
            channels.append(_channel(f"{name}.{axis}", "/imu/data", values, 100.0))
    for axis in ("east", "north", "up"):
        n = round(seconds * e.fix_rate_hz)
        values = rng.normal(0, e.fix_white, n) + markov(n, 1 / e.fix_rate_hz, *e.fix_markov, rng)
        channels.append(_channel(f"position.{axis}", "/gps/fix", values, e.fix_rate_hz))
    model = identify_recording(Recording("study", 0, tuple(channels))).model
    return from_model(model, TurnOn(e.gyro_turn_on, e.accel_turn_on))


def _channel(name: str, topic: str, values: Floats, rate_hz: float) -> Channel:
    stamp_ns = np.rint(np.arange(values.size) * 1e9 / rate_hz).astype(np.int64)
    return Channel(
        topic, name, unit_of(name), stamp_ns, values, np.ones(values.size, bool), rate_hz
    )


def fuse(
    sensed: Sensed,
    noise: NavigationNoise,
    parameters: Parameters,
    outage_s: tuple[float, float] = (0.0, 0.0),
):  # type: ignore[no-untyped-def]
    """Feed a run; return the engine and its rows."""
    engine = Engine(noise, parameters)
    rows, begin = [], 0
    ends = np.searchsorted(sensed.stamp_ns, sensed.fix_ns)
    for k, end in enumerate(ends):
        part = slice(begin, end)
        rows.append(engine.add_imu(sensed.stamp_ns[part], sensed.rate[part], sensed.force[part]))
        begin = end
        t = (sensed.fix_ns[k] - sensed.stamp_ns[0]) * 1e-9
        if not outage_s[0] <= t < outage_s[1]:
            engine.add_fix(int(sensed.fix_ns[k]), *sensed.fix[k])
    rows.append(engine.add_imu(sensed.stamp_ns[begin:], sensed.rate[begin:], sensed.force[begin:]))
    return engine, joined(rows)


def score(true: Truth, sensed: Sensed, rows, at_s: tuple[float, ...]) -> Scored:  # type: ignore[no-untyped-def]
    """NEES and errors of a run against the truth, in the level axes of the start."""
    origin = np.degrees(true.geodetic[0, :2])
    place = (float(origin[0]), float(origin[1]), float(true.geodetic[0, 2]))
    s = solve(rows.stamp_ns, rows.values, place)
    index = np.rint((rows.stamp_ns - sensed.stamp_ns[0]) * 1e-9 / true.t[1]).astype(int)
    T = level_axes(*true.geodetic[0, :2])
    local = level_axes(true.geodetic[index, 0], true.geodetic[index, 1])
    start = ecef_from_geodetic(*true.geodetic[0])
    position = (ecef_from_geodetic(*true.geodetic[index].T) - start) @ T.T - s.position
    velocity = np.einsum("kji,kj->ki", local, true.velocity[index]) @ T.T - s.velocity
    turn = (
        T
        @ np.swapaxes(local, 1, 2)
        @ true.C_nb[index]
        @ np.swapaxes(matrix_of(s.orientation), 1, 2)
    )
    attitude = 0.5 * np.stack(
        [
            turn[:, 2, 1] - turn[:, 1, 2],
            turn[:, 0, 2] - turn[:, 2, 0],
            turn[:, 1, 0] - turn[:, 0, 1],
        ],
        axis=1,
    )
    if s.hypotheses[-1] > 1:  # heading not observable: tilt alone, from the vertical seen in body
        vertical = np.swapaxes(turn, 1, 2)[:, :, 2]  # the true vertical in the estimated level axes
        tilt = np.stack([vertical[:, 1], -vertical[:, 0]], axis=1)
        attitude_nees = normalised_squares(tilt, s.pose_covariance[:, 3:5, 3:5])
    else:
        attitude_nees = normalised_squares(attitude, s.pose_covariance[:, 3:, 3:])
    k = np.searchsorted((rows.stamp_ns - sensed.stamp_ns[0]) * 1e-9, np.array(at_s) - 0.02)
    nees = np.stack(
        [
            normalised_squares(position, s.pose_covariance[:, :3, :3])[k],
            normalised_squares(velocity, s.velocity_covariance)[k],
            attitude_nees[k],
        ],
        1,
    )
    moving = slice(k[0], None)
    raw = _raw_error(true, sensed)
    return Scored(
        nees.tolist(),
        np.linalg.norm(position[k], axis=1).tolist(),
        raw,
        float(np.sqrt(np.mean(np.sum(position[moving] ** 2, axis=1)))),
    )


def _raw_error(true: Truth, sensed: Sensed) -> float:
    """Root mean square of the fixes themselves, m."""
    k = np.rint((sensed.fix_ns - sensed.stamp_ns[0]) * 1e-9 / true.t[1]).astype(int)
    fixes = ecef_from_geodetic(
        np.radians(sensed.fix[:, 0]), np.radians(sensed.fix[:, 1]), sensed.fix[:, 2]
    )
    error = fixes - ecef_from_geodetic(*true.geodetic[k].T)
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))


@dataclass(frozen=True)
class Case:
    """What is run: name, motion by heading, errors, model by seed, outage, epochs.

    ``heading``: whether it is observable, so that all three angles are scored; ``given_rad``: its
    sigma where it is given at the start; ``rest``: use rest, and score the last epoch alone, for
    the tilt of one run is the same at both.
    """

    name: str
    motion: Callable[[float], Motion]
    errors: SensorErrors
    noise: Callable[[SensorErrors, int], NavigationNoise]
    outage_s: tuple[float, float] = (0.0, 0.0)
    at_s: tuple[float, ...] = SCORED_S
    heading: bool = True
    rest: bool = False
    given_rad: float | None = None

    def parameters(self, seed: int) -> Parameters:
        """Return the filter's settings in a run."""
        rest = replace(PARAMETERS, zero_velocity_updates=self.rest)
        if self.given_rad is None:
            return rest
        heading = 0.7 + np.random.default_rng(10**6 + seed).normal(0, self.given_rad)
        return replace(rest, initial_heading_rad=heading, initial_heading_sigma_rad=self.given_rad)


def _true(e: SensorErrors, seed: int) -> NavigationNoise:
    return true_noise(e)


def _as_white(e: SensorErrors, seed: int) -> NavigationNoise:
    return colour_as_white(e)


END = ((60.0, 120.0), (119.9,))
KNOWN = Case("driving, coloured fixes", driving, COLOURED, _true)
IDENTIFIED = Case("driving, coloured, model identified from 900 s", driving, COLOURED, identified)
AS_WHITE = Case("driving, coloured fixes taken for white", driving, COLOURED, _as_white)
CASES = (
    Case("standing, white fixes", standing, WHITE, _true, heading=False, rest=True),
    Case("standing, coloured fixes", standing, COLOURED, _true, heading=False, rest=True),
    Case(
        "standing, white fixes, heading given to 0.01 rad",
        standing,
        WHITE,
        _true,
        rest=True,
        given_rad=0.01,
    ),
    Case(
        "standing, coloured fixes, heading given to 0.01 rad",
        standing,
        COLOURED,
        _true,
        rest=True,
        given_rad=0.01,
    ),
    Case("driving, white fixes", driving, WHITE, _true),
    KNOWN,
    Case("flying, white fixes", flying, WHITE, _true),
    Case("flying, coloured fixes", flying, COLOURED, _true),
    Case("driving, white, end of a 60 s outage", driving, WHITE, _true, *END),
    Case("driving, coloured, end of a 60 s outage", driving, COLOURED, _true, *END),
    Case("flying, coloured, end of a 60 s outage", flying, COLOURED, _true, *END),
    IDENTIFIED,
    Case("driving, model identified, end of the outage", driving, COLOURED, identified, *END),
    Case(
        "standing, coloured fixes taken for white",
        standing,
        COLOURED,
        _as_white,
        heading=False,
        rest=True,
    ),
    AS_WHITE,
    Case("flying, coloured fixes taken for white", flying, COLOURED, _as_white),
    Case("the same, end of the outage", driving, COLOURED, _as_white, *END),
)


class Results:
    """Runs that were made, one line each in a file: an interruption loses nothing."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._runs: dict[tuple[str, int], Scored] = {}
        if file.exists():
            for line in file.read_text().splitlines():
                x = json.loads(line)
                key = x.pop("case"), x.pop("seed")
                self._runs[key] = Scored(**x)

    def of(self, case: Case) -> dict[int, Scored]:
        """Return the runs of a case by seed."""
        return {seed: s for (name, seed), s in sorted(self._runs.items()) if name == case.name}

    def add(self, case: Case, runs: int) -> None:
        """Run what is missing of the first ``runs``."""
        true: Truth | None = None
        for seed in sorted(set(range(runs)) - set(self.of(case))):
            true = true or truth(case.motion(0.7), 120.0, 100.0)
            sensed = sense(true, case.errors, np.random.default_rng(seed))
            noise = case.noise(case.errors, seed)
            _, rows = fuse(sensed, noise, case.parameters(seed), case.outage_s)
            scored = score(true, sensed, rows, case.at_s)
            self._runs[case.name, seed] = scored
            self._file.parent.mkdir(parents=True, exist_ok=True)
            with self._file.open("a") as out:
                out.write(json.dumps({"case": case.name, "seed": seed, **asdict(scored)}) + "\n")


def nees_row(case: Case, scored: list[Scored]) -> str:
    """One row of the table of NEES: mean, standard error over runs, band."""
    nees = np.array([s.nees for s in scored])
    if case.rest:
        nees = nees[:, -1:]
    cells = []
    for q, dof in enumerate((3, 3, 3 if case.heading else 2)):
        low, high = mean_band(dof, nees.shape[0] * nees.shape[1])
        mean = float(nees[..., q].mean())
        error = float(nees[..., q].mean(axis=1).std(ddof=1)) / math.sqrt(len(nees))
        inside = "" if low <= mean <= high else " (outside)"
        cells.append(f"{mean:.2f} ({error:.2f}) [{low:.2f}, {high:.2f}]{inside}")
    rmse = math.sqrt(np.mean([s.rmse_m**2 for s in scored]))
    raw = math.sqrt(np.mean([s.raw_m**2 for s in scored]))
    return f"| {case.name} | {' | '.join(cells)} | {rmse:.3f} | {raw:.3f} | {len(scored)} |"


def nees_rows(runs: int, results: Results) -> list[str]:
    """Table of NEES of all cases that have runs."""
    rows = []
    for case in CASES:
        results.add(case, runs)
        scored = list(results.of(case).values())
        rows.append(nees_row(case, scored) if len(scored) > 1 else f"| {case.name} | not run |")
        print(rows[-1], flush=True)
    return rows


def rate_rows() -> list[str]:
    """Covariance of the same noise-free drive at three rates."""
    found = {}
    for rate_hz in (1000.0, 200.0, 100.0):
        true = truth(driving(0.7), 60.0, rate_hz)
        sensed = sense(
            true,
            replace(
                COLOURED,
                gyro_density=0.0,
                accel_density=0.0,
                fix_white=0.0,
                gyro_turn_on=0.0,
                accel_turn_on=0.0,
                gyro_markov=(0.0, 1.0),
                accel_markov=(0.0, 1.0),
                fix_markov=(0.0, 1.0),
            ),
            np.random.default_rng(0),
        )
        parameters = replace(PARAMETERS, initial_heading_rad=0.7)
        engine, _ = fuse(sensed, true_noise(COLOURED), parameters, (40.0, 60.0))
        found[rate_hz] = np.sqrt(
            np.diag(covariance_of(engine.state(), engine.layout.slow.target.size))
        )
    rows = []
    for rate_hz in (200.0, 100.0):
        apart = np.max(np.abs((found[rate_hz] / found[1000.0]) ** 2 - 1))
        rows.append(f"| {rate_hz:g} Hz against 1 kHz | {apart:.1e} |")
    return rows


LOST = 40.0
"""NEES of three degrees of freedom that a true covariance exceeds once in 10^8."""


@dataclass(frozen=True)
class Length:
    """A long run at rest: what was looked at, and NEES of the position at its end and over it."""

    seed: int
    steps: int
    looked_at: int
    unsound: int
    used: int
    gated: int
    recovered: int
    nis_mean: float | None
    nees_end: float
    nees_mean: float
    nees_largest: float


def long_run(steps: int, seed: int = 11) -> Length:
    """Very many steps at rest with outages, late and bad fixes: is P sound and true throughout."""
    rng = np.random.default_rng(seed)
    e = COLOURED
    engine = Engine(
        true_noise(e), replace(PARAMETERS, initial_heading_rad=0.0, zero_velocity_updates=True)
    )
    block, dt_ns = 1000, 10_000_000
    slow = [Wander(*gm, 0.01, rng) for gm in (e.gyro_markov, e.accel_markov) for _ in range(3)]
    constant = rng.normal(0, [e.gyro_turn_on] * 3 + [e.accel_turn_on] * 3)
    colour = [Wander(*e.fix_markov, 0.01, rng) for _ in range(3)]
    place = ecef_from_geodetic(math.radians(47.0), math.radians(8.0), 450.0)
    checks, bad, now, outage_until = 0, 0, 0, 0
    nees = []
    for k in range(steps // block):
        stamp_ns = now + dt_ns * np.arange(block, dtype=np.int64)
        bias = np.stack([w.next(block) for w in slow], axis=1) + constant
        noise = np.stack([w.next(block) for w in colour], axis=1)
        rate = rng.normal(0, 10 * e.gyro_density, (block, 3)) + bias[:, :3] + EARTH_RATE_47
        force = rng.normal((0, 0, GRAVITY_47), 10 * e.accel_density, (block, 3)) + bias[:, 3:]
        engine.add_imu(stamp_ns, rate, force)
        now += block * dt_ns
        if rng.random() < 0.01:
            outage_until = k + int(rng.integers(2, 30))
        if k >= outage_until:
            off = 0.1 if rng.random() < 0.02 else 0.0
            late = int(rng.integers(0, 40))
            metres = noise[-1 - late] + rng.normal(0, e.fix_white, 3)
            engine.add_fix(
                now - (1 + late) * dt_ns,
                47.0 + off + metres[1] / NORTH_M,
                8.0 + metres[0] / EAST_M,
                450.0 + metres[2],
            )
        if k % 20 == 19:
            checks += 1
            s = engine.state()
            P = covariance_of(s, engine.layout.slow.target.size)
            bad += not is_symmetric_positive(P)
            nees.append(float(normalised_squares(place - s[:3], P[:3, :3])))
    s = engine.status()
    late_nees = np.array(nees[len(nees) // 10 :])
    return Length(
        seed,
        steps,
        checks,
        bad,
        s.used,
        s.gated,
        s.recovered,
        s.nis_mean,
        nees[-1],
        float(late_nees.mean()),
        float(late_nees.max()),
    )


class Wander:
    """A Gauss-Markov process in blocks that join."""

    def __init__(self, sigma: float, time_s: float, dt: float, rng: np.random.Generator) -> None:
        self._a, self._sigma, self._rng = math.exp(-dt / time_s), sigma, rng
        self._last = rng.normal(0, sigma)

    def next(self, n: int) -> Floats:
        """Return the next n samples."""
        drive = self._rng.normal(0, self._sigma * math.sqrt(1 - self._a**2), n)
        values, _ = lfilter([1.0], [1.0, -self._a], drive, zi=[self._a * self._last])
        self._last = float(values[-1])
        return values


@dataclass(frozen=True)
class Flagged:
    """A run with a model: first times, s, at which a test of any kind, or of the fixes, failed."""

    scene: str
    model: str
    seed: int
    any_s: float | None
    fixes_s: float | None


SCENES = {
    "standing": (standing, True),
    "driving": (driving, False),
}
"""Motion, and whether rest is used."""


def models_of(e: SensorErrors) -> dict[str, NavigationNoise]:
    """Return the true model and wrong ones."""
    quiet = replace(e, gyro_density=0.1 * e.gyro_density, accel_density=0.1 * e.accel_density)
    return {
        "true model": true_noise(e),
        "white noise of the fixes 10 times too small": true_noise(
            replace(e, fix_white=0.1 * e.fix_white)
        ),
        "noise of the IMU 10 times too small": true_noise(quiet),
        "noise and biases of the IMU 10 times too small": quiet_imu(e),
        "correlation time 3 s for 30 s": true_noise(replace(e, fix_markov=(0.8, 3.0))),
        "correlation time 300 s for 30 s": true_noise(replace(e, fix_markov=(0.8, 300.0))),
        "colour taken for white": colour_as_white(e),
    }


def flagged(file: Path, true_runs: int, wrong_runs: int) -> list[Flagged]:
    """Runs of 120 s in the file, after those that are missing."""
    lines = file.read_text().splitlines() if file.exists() else []
    runs = [Flagged(**json.loads(line)) for line in lines]
    done = {(r.scene, r.model, r.seed) for r in runs}
    file.parent.mkdir(parents=True, exist_ok=True)
    for scene, (motion, rest) in SCENES.items():
        true: Truth | None = None
        for model, noise in models_of(COLOURED).items():
            for seed in range(true_runs if model == "true model" else wrong_runs):
                if (scene, model, seed) in done:
                    continue
                true = true or truth(motion(0.7), 120.0, 100.0)
                sensed = sense(true, COLOURED, np.random.default_rng(seed))
                runs.append(Flagged(scene, model, seed, *flagged_after(sensed, noise, rest)))
                with file.open("a") as out:
                    out.write(json.dumps(asdict(runs[-1])) + "\n")
    return runs


def flagged_after(
    sensed: Sensed, noise: NavigationNoise, rest: bool
) -> tuple[float | None, float | None]:
    """Seconds until any test, and until one of the fixes, first fails; looked at every second."""
    settings = replace(PARAMETERS, initial_heading_rad=0.7, zero_velocity_updates=rest)
    engine = Engine(noise, settings)
    begin, any_s, fixes_s = 0, None, None
    for k, end in enumerate(np.searchsorted(sensed.stamp_ns, sensed.fix_ns)):
        part = slice(begin, end)
        engine.add_imu(sensed.stamp_ns[part], sensed.rate[part], sensed.force[part])
        begin = end
        engine.add_fix(int(sensed.fix_ns[k]), *sensed.fix[k])
        if k % round(COLOURED.fix_rate_hz) == 0:
            t = float((sensed.fix_ns[k] - sensed.stamp_ns[0]) * 1e-9)
            held = [d.kind for d in doubts_of(engine) if d.holds]
            any_s = any_s or (t if held else None)
            fixes_s = fixes_s or (t if set(held) - {"gyro", "accel"} else None)
    return any_s, fixes_s


def flagged_rows(runs: list[Flagged]) -> list[str]:
    """How soon each model was flagged, by any test and by those of the fixes alone."""
    rows = []
    for scene in SCENES:
        for model in models_of(COLOURED):
            some = [r for r in runs if (r.scene, r.model) == (scene, model)]
            cells = [_times([r.any_s for r in some]), _times([r.fixes_s for r in some])]
            rows.append(f"| {scene} | {model} | {' | '.join(cells)} | {len(some)} |")
    return rows


def _times(found: list[float | None]) -> str:
    """How many, median and last of those that are."""
    known = sorted(t for t in found if t is not None)
    if not known:
        return "0 | - | -"
    return f"{len(known)} | {known[(len(known) - 1) // 2]:.0f} | {known[-1]:.0f}"


def quiet_imu(e: SensorErrors) -> NavigationNoise:
    """Return the model whose IMU has a tenth of the noise and of what wanders."""
    return true_noise(
        replace(
            e,
            gyro_density=0.1 * e.gyro_density,
            accel_density=0.1 * e.accel_density,
            gyro_markov=(0.1 * e.gyro_markov[0], e.gyro_markov[1]),
            accel_markov=(0.1 * e.accel_markov[0], e.accel_markov[1]),
        )
    )


def rmse_rows(results: Results) -> list[str]:
    """Root mean square errors beside the filter that has the true model, on the same runs."""
    true = results.of(KNOWN)
    rows = []
    for case in (IDENTIFIED, AS_WHITE):
        other = results.of(case)
        pairs = np.array([(true[k].rmse_m ** 2, other[k].rmse_m ** 2) for k in other if k in true])
        if len(pairs) < 2:
            continue
        ratio = math.sqrt(pairs[:, 1].mean() / pairs[:, 0].mean())
        each = pairs[:, 1] - ratio**2 * pairs[:, 0]
        error = float(each.std(ddof=1)) / math.sqrt(len(pairs)) / (2 * ratio * pairs[:, 0].mean())
        rows.append(f"| {case.name} | {ratio:.4f} | {error:.4f} | {len(pairs)} |")
    return rows


def length_rows(file: Path) -> list[str]:
    """Runs by ``study_fusion_length.py``: the longest each, the shorter ones together."""
    lines = file.read_text().splitlines() if file.exists() else []
    runs = [Length(**json.loads(line)) for line in lines]
    rows = []
    for steps in sorted({r.steps for r in runs}):
        some = [r for r in runs if r.steps == steps]
        ends = [r.nees_end for r in some if r.nees_largest <= LOST]
        low, high = mean_band(3, max(len(ends), 1))
        mean = f"{np.mean(ends):.2f} [{low:.2f}, {high:.2f}]" if ends else "-"
        told = [(r.nis_mean, r.used) for r in some if r.nis_mean is not None]
        nis = sum(mean * used for mean, used in told) / sum(used for _, used in told)
        band = mean_band(3, sum(used for _, used in told))
        lost = sum(r.nees_largest > LOST for r in some)
        rows.append(
            f"| {steps:.0e} | {len(some)} | {sum(r.looked_at for r in some)} / "
            f"{sum(r.unsound for r in some)} | {sum(r.used for r in some)} / "
            f"{sum(r.gated for r in some)} / {sum(r.recovered for r in some)} | {nis:.3f} "
            f"[{band[0]:.3f}, {band[1]:.3f}] | {mean} | "
            f"{lost} |"
        )
    return rows


def nees_section(results: Results, runs: int) -> list[str]:
    """Return the table of NEES."""
    return [
        "NEES at 60 s and 120 s of runs of 120 s at 100 Hz and 10 Hz (standing: at 120 s alone), "
        "mean, standard error over the runs, and the 95 % band that a true covariance's mean stays "
        "in.  Start heading unknown unless said.  Standing without a magnetometer the heading is "
        "not observable: tilt alone is scored there (2 degrees of freedom), and rest is used.  "
        "Elsewhere updates by rest are off.",
        "",
        "The band counts both epochs of a run as independent, which slow errors are not: one entry "
        "in twenty and somewhat more lies outside by chance.  All scenarios draw the same sensor "
        "errors in the same run.",
        "",
        "| scenario | position | velocity | attitude | RMSE m after 60 s | fixes' RMSE m | runs |",
        "|---|---|---|---|---|---|---|",
        *nees_rows(runs, results),
    ]


def rmse_section(results: Results) -> list[str]:
    """Return the table of root mean square errors."""
    return [
        "## Root mean square error beside the filter that has the true model, same runs",
        "",
        "| model | ratio | standard error | runs |",
        "|---|---|---|---|",
        *rmse_rows(results),
    ]


def flagged_section(runs: list[Flagged]) -> list[str]:
    """Return the table of wrong models."""
    return [
        "## How soon a wrong model is flagged",
        "",
        "Runs of 120 s at 100 Hz, coloured fixes at 10 Hz, heading given, looked at every second; "
        "the drive begins with some seconds of rest.  Eight tests as one family, which a true "
        "model fails in 1 % of the runs at most, however often and long one looks "
        "(`nav_fusion.doubt`).  Count of runs flagged, median and last time in s: by any "
        "test, and by those of the fixes alone.",
        "",
        "| scene | model | flagged | median | last | by the fixes | median | last | runs |",
        "|---|---|---|---|---|---|---|---|---|",
        *flagged_rows(runs),
    ]


def rate_section() -> list[str]:
    """Return the table of rates."""
    return [
        "## The same drive at three rates",
        "",
        "Largest relative difference of a variance after 40 s of fixes and 20 s without.",
        "",
        "| rates | difference |",
        "|---|---|",
        *rate_rows(),
    ]


def length_section(lengths: Path) -> list[str]:
    """Return the table of long runs."""
    return [
        "## Length",
        "",
        "At rest, steps of 10 ms, one fix every 10 s up to 0.4 s late, outages of 20 s to 300 s, "
        "one fix in 50 off by 11 km (`study_fusion_length.py`).  *Lost*: runs in which the NEES of "
        f"the position exceeded {LOST:.0f} at any time that was looked at.  NEES at the end of the "
        "others, mean with its band.",
        "",
        "| steps | runs | covariances looked at / unsound | fixes used / gated / restarts | NIS "
        "| NEES at the end | lost |",
        "|---|---|---|---|---|---|---|",
        *length_rows(lengths),
    ]


def main() -> None:
    """Run the study and write its page."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=100)
    arguments.add_argument("--results", type=Path, default=Path("build/study_fusion.jsonl"))
    arguments.add_argument("--lengths", type=Path, default=Path("build/study_fusion_length.jsonl"))
    arguments.add_argument("--flags", type=Path, default=Path("build/study_fusion_flags.jsonl"))
    arguments.add_argument("--true-runs", type=int, default=200)
    arguments.add_argument("--wrong-runs", type=int, default=20)
    arguments.add_argument("--output", type=Path, default=Path("docs/study_fusion.md"))
    options = arguments.parse_args()
    results = Results(options.results)
    sections = (
        ["# Is the fused covariance true?"],
        nees_section(results, options.runs),
        rmse_section(results),
        flagged_section(flagged(options.flags, options.true_runs, options.wrong_runs)),
        rate_section(),
        length_section(options.lengths),
    )
    options.output.parent.mkdir(parents=True, exist_ok=True)
    options.output.write_text("\n".join(line for part in sections for line in (*part, "")))


if __name__ == "__main__":
    main()
