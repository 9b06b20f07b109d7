"""Whole commands, from the shell's prompt back to it: identify, fuse, and a fleet.

Every run is ``ros2 run`` as a user types it, Python's start, reading and writing included, with a
warm cache as the build leaves it.  Wall clock and processor time; medians of ``--runs``, the bag of
three hours once.  A fleet is timed on one core and on all.
"""

from __future__ import annotations

import argparse
import os
import shlex
import statistics
import subprocess
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from bench_reading import FOLDER, make_bag
from imu_noise_id.bag_writer import TopicBytes, write_bag
from imu_noise_id.bags import write_recording
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import save_model, typed_effect
from imu_noise_id.recording import unit_of
from imu_noise_id.simulate import simulate_recording
from results import RESULTS, write_results

from imu_noise_id import cdr

START_NS = 1_700_000_000_000_000_000
SIGMAS = {"angular_velocity": 2e-4, "linear_acceleration": 2e-3}
FLEET = 4
LONG = 10_800_000
HEADING_GIVEN = "--set initial_heading_rad=0.0"
"""At rest and without a magnetometer nothing tells the heading: 32 are followed to the end."""


@dataclass(frozen=True)
class Timed:
    """One command: seconds by the clock, of processor, and of data."""

    what: str
    runs: int
    wall_s: float
    most_s: float
    processor_s: float
    data_s: float


def model() -> NoiseModel:
    """Six channels with white noise, a slow term, and a vibration on the first."""
    channels = []
    for kind, density in SIGMAS.items():
        for axis in "xyz":
            name = f"{kind}.{axis}"
            slow: dict[str, float | str] = {"sigma": 0.3 * density, "correlation_time_s": 40.0}
            effects = [
                typed_effect("white_noise", name, {"density": density}),
                typed_effect("gauss_markov", name, slow),
            ]
            if name == "angular_velocity.x":
                line: dict[str, float | str] = {"frequency_hz": 43.0, "amplitude": 2.0 * density}
                effects.append(typed_effect("periodic", name, line))
            channels.append(
                ChannelModel(name, "/imu/data", unit_of(name), 200.0, 0.0, tuple(effects))
            )
    return NoiseModel(tuple(channels))


def still_bag(path: Path, seconds: float, seed: int) -> Path:
    """Write the model played at 200 Hz."""
    if not path.exists():
        rng = np.random.default_rng(seed)
        write_recording(simulate_recording(model(), seconds, rng, START_NS), path)
    return path


def navigation_bag(path: Path, seconds: float) -> Path:
    """Write a platform at rest: IMU at 1 kHz, fixes at 10 Hz."""
    if path.exists():
        return path
    rng = np.random.default_rng(3)
    n, m = round(1000 * seconds), round(10 * seconds)
    imu_ns = START_NS + np.arange(n, dtype=np.int64) * 1_000_000
    fix_ns = START_NS + np.arange(m, dtype=np.int64) * 100_000_000
    imu = {
        f"{kind}.{axis}": rng.normal(0.0, density * np.sqrt(1000.0), n)
        for kind, density in SIGMAS.items()
        for axis in "xyz"
    }
    imu["linear_acceleration.z"] += 9.80665
    fix = {
        "latitude": 47.0 + rng.normal(0.0, 0.5 / 1.11e5, m),
        "longitude": 8.0 + rng.normal(0.0, 0.5 / 7.6e4, m),
        "altitude": 400.0 + rng.normal(0.0, 0.5, m),
        "covariance_type": 2.0,
    } | {f"position_covariance.{k}": 0.25 for k in (0, 4, 8)}
    write_bag(
        path,
        [
            TopicBytes("/imu/data", cdr.IMU, imu_ns, cdr.encode(cdr.IMU, imu_ns, imu, "imu")),
            TopicBytes(
                "/gps/fix",
                cdr.NAV_SAT_FIX,
                fix_ns,
                cdr.encode(cdr.NAV_SAT_FIX, fix_ns, fix, "gps"),
            ),
        ],
    )
    return path


def timed(what: str, line: str, data_s: float, runs: int) -> Timed:
    """Run a command some times."""
    walls, processor = [], []
    for _ in range(runs):
        before, begun = os.times(), time.monotonic()
        done = subprocess.run(shlex.split(line), check=False, capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(f"{line}: {done.stderr[-2000:]}")
        after = os.times()
        walls.append(time.monotonic() - begun)
        spent = (after.children_user - before.children_user) + (
            after.children_system - before.children_system
        )
        processor.append(spent)
    found = Timed(
        what, runs, statistics.median(walls), max(walls), statistics.median(processor), data_s
    )
    print(row(found), flush=True)
    return found


def row(found: Timed) -> str:
    """Return a line of the table."""
    return (
        f"| {found.what} | {found.runs} | {found.wall_s:.1f} (at most {found.most_s:.1f}) | "
        f"{found.processor_s:.1f} | {found.data_s / found.wall_s:.0f} |"
    )


HEADING = """\
| command | runs | seconds by the clock, median | of processor | times real time |
|---|---|---|---|---|"""


def main() -> None:
    """Run the benchmark."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=3)
    arguments.add_argument("--folder", type=Path, default=FOLDER)
    arguments.add_argument("--output", type=Path, default=RESULTS)
    options = arguments.parse_args()
    folder, runs = options.folder, options.runs
    folder.mkdir(parents=True, exist_ok=True)
    os.environ.pop("OMP_NUM_THREADS", None)  # as a user's shell has it
    os.environ.pop("OPENBLAS_NUM_THREADS", None)
    short = still_bag(folder / "still_200hz_600s", 600.0, 1)
    fleet = folder / "fleet"
    fleet.mkdir(exist_ok=True)
    for k in range(FLEET):
        still_bag(fleet / f"unit_{k}", 600.0, 10 + k)
    make_bag(folder / f"imu_{LONG}", LONG)
    drives = {s: navigation_bag(folder / f"rest_1khz_{s}s", s) for s in (240, 3600)}
    typed = folder / "typed.yaml"
    save_model(model(), typed)
    print(HEADING, flush=True)
    with tempfile.TemporaryDirectory() as out:
        identify = f"ros2 run imu_noise_id identify --output {out} --bag"
        fuse = f"ros2 run nav_fusion fuse --model {typed} --output {out} --bag"
        given = f"ros2 run nav_fusion fuse {HEADING_GIVEN} --model {typed} --output {out} --bag"
        many = 600.0 * FLEET
        jobs = (
            # what, line, seconds of data, runs
            ("identify, 10 min at 200 Hz, 6 channels", f"{identify} {short}", 600.0, runs),
            ("identify, 3 h at 1 kHz, 6 channels", f"{identify} {folder}/imu_{LONG}", 10_800.0, 1),
            (f"identify {FLEET} bags, one core", f"taskset -c 0 {identify} {fleet}", many, 1),
            (f"identify {FLEET} bags, all cores", f"{identify} {fleet}", many, 1),
            ("fuse, 4 min at 1 kHz, heading given", f"{given} {drives[240]}", 240.0, runs),
            ("fuse, an hour at 1 kHz, heading given", f"{given} {drives[3600]}", 3600.0, 1),
            ("fuse, 4 min at 1 kHz, heading unknown", f"{fuse} {drives[240]}", 240.0, runs),
            ("fuse, an hour at 1 kHz, heading unknown", f"{fuse} {drives[3600]}", 3600.0, 1),
        )
        found = [timed(*job) for job in jobs]
    text = "\n".join((HEADING, *(row(f) for f in found))) + "\n"
    write_results("commands", [asdict(f) for f in found], text, options.output)


if __name__ == "__main__":
    main()
