"""Read a long Imu bag: messages a second, peak memory, and peers on the same file.

Each run is a process of its own, so that peak memory is the run's.  Rates are by the clock and, as
other work on the machine slows that, by processor time.  The bag (zstd chunks; white noise, a
random walk and a vibration, rounded to a sensor's LSB) is written once and kept in ``--folder``.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from imu_noise_id.bag_writer import TopicBytes, write_bag
from results import RESULTS, write_results

from imu_noise_id import cdr

RATE_HZ = 1000.0
DEDRUNK = Path(sys.executable).with_name("dedrunk")
FOLDER = Path(tempfile.gettempdir()) / "bench_bags"


def make_bag(path: Path, count: int) -> None:
    """Write `count` messages of a still 1 kHz MEMS IMU."""
    if path.exists():
        return
    rng = np.random.default_rng(1)
    stamp_ns = 1_700_000_000_000_000_000 + np.arange(count, dtype=np.int64) * 1_000_000
    members: dict[str, np.ndarray | float] = {"orientation_covariance.0": -1.0}
    for sensor, sigma, lsb in (
        ("angular_velocity", 0.005, np.deg2rad(1 / 131)),
        ("linear_acceleration", 0.05, 9.80665 / 16384),
    ):
        for axis, mean in zip("xyz", (0.0, 0.0, 9.80665 if lsb > 5e-4 else 0.0), strict=True):
            noise = rng.normal(mean, sigma, count)
            noise += np.cumsum(rng.normal(0.0, 1e-5 * sigma, count))
            members[f"{sensor}.{axis}"] = np.rint(noise / lsb) * lsb
    seconds = np.arange(count) / RATE_HZ
    members["angular_velocity.x"] += 0.002 * np.sin(2.0 * np.pi * 43.0 * seconds)
    rows = cdr.encode(cdr.IMU, stamp_ns, members, "imu_link")
    write_bag(path, [TopicBytes("/imu/data", cdr.IMU, stamp_ns, rows)])


def run_ours(path: str, threads: int) -> int:
    """Read with this package; return the number of messages."""
    from imu_noise_id.bags import read_recording

    return read_recording(path, threads=threads).channels[0].values.size


def run_columns(path: str, threads: int) -> int:
    """Read to columns only, without judging stamps and motion."""
    from imu_noise_id.bags import read_topics

    return read_topics(path, threads=threads)[0][0].stamp_ns.size


def run_mcap_ros2(path: str, threads: int) -> int:
    """Read with mcap-ros2-support, message by message."""
    from mcap_ros2.reader import read_ros2_messages

    del threads
    values = []
    for message in read_ros2_messages(str(next(Path(path).glob("*.mcap")))):
        imu = message.ros_msg
        values.append((imu.angular_velocity.x, imu.linear_acceleration.x))
    return len(values)


def run_rosbags(path: str, threads: int) -> int:
    """Read with rosbags, message by message."""
    from rosbags.highlevel import AnyReader

    del threads
    values = []
    with AnyReader([Path(path)]) as reader:
        for link, _, data in reader.messages():
            imu = reader.deserialize(data, link.msgtype)
            values.append((imu.angular_velocity.x, imu.linear_acceleration.x))
    return len(values)


def run_whole(path: str, threads: int) -> int:
    """Reading, Allan deviations and their intervals of six channels: dedrunk's job."""
    from imu_noise_id.allan import allan
    from imu_noise_id.bags import read_recording
    from imu_noise_id.series import to_series

    recording = read_recording(path, threads=threads)
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda c: allan(to_series(c, recording.start_ns)), recording.channels))
    return recording.channels[0].values.size


def run_dedrunk(path: str, threads: int) -> int:
    """Run dedrunk's noise command, on all cores; what it says of the slopes is of no interest."""
    del threads
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [DEDRUNK, "-y", "noise", str(next(Path(path).glob("*.mcap")))],
            check=False,
            cwd=folder,
            capture_output=True,
            text=True,
        )
    found = re.search(r"(\d+) samples", done.stdout + done.stderr)
    if found is None:
        raise SystemExit(f"dedrunk: {done.stderr}")
    return int(found.group(1))


RUNS = {
    "ours": run_ours,
    "columns": run_columns,
    "whole": run_whole,
    "dedrunk": run_dedrunk,
    "mcap_ros2": run_mcap_ros2,
    "rosbags": run_rosbags,
}


def measure(reader: str, path: Path, threads: int) -> dict[str, float]:
    """One run in a process of its own."""
    command = [sys.executable, __file__, "--child", reader, "--bag", str(path)]
    output = subprocess.run(
        [*command, "--threads", str(threads)], check=True, capture_output=True, text=True
    ).stdout
    return json.loads(output)


def child(reader: str, path: str, threads: int) -> None:
    """Time one read; print seconds, messages and memory above what the imports take."""
    import imu_noise_id.bags  # noqa: F401  # its imports are not the reader's memory

    before = peak_mb()
    begin, processor = time.perf_counter(), processor_s()
    count = RUNS[reader](path, threads)
    figures = {
        "count": count,
        "seconds": time.perf_counter() - begin,
        "processor_s": processor_s() - processor,
        "peak_mb": peak_mb() - before,
    }
    print(json.dumps(figures))


def processor_s() -> float:
    """Processor time of this process and of those that it has waited for."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


def peak_mb() -> float:
    """Peak resident memory of this process image (``ru_maxrss`` would count the parent's too)."""
    status = Path("/proc/self/status").read_text().splitlines()
    return next(int(row.split()[1]) for row in status if row.startswith("VmHWM")) / 1024


def row(name: str, runs: list[dict[str, float]], kept_bytes: float) -> str:
    """Return one line of the table."""
    rates = sorted(run["count"] / run["seconds"] / 1e3 for run in runs)
    own = statistics.median(run["count"] / run["processor_s"] / 1e3 for run in runs)
    peak = statistics.median(run["peak_mb"] for run in runs)
    ratio = peak * 2**20 / (kept_bytes * runs[0]["count"])
    memory = "" if name.startswith("dedrunk") else f"{peak:.0f} MB, {ratio:.2f}"
    return (
        f"| {name} | {runs[0]['count']:,} | {statistics.median(rates):.0f} "
        f"({rates[0]:.0f} to {rates[-1]:.0f}) | {own:.0f} | {memory} |"
    )


HEADING = """\
| what | messages | thousand messages a second, median (least to most) | a processor-second | peak \
memory, in kept arrays |
|---|---|---|---|---|"""
JOBS = (
    # label, reader, which bag, threads
    ("to columns, 1 thread", "columns", "long", 1),
    ("to columns, 2 threads", "columns", "long", 2),
    ("to a recording (stamps, quality, motion), 1 thread", "ours", "long", 1),
    ("to a recording, 2 threads", "ours", "long", 2),
    ("recording, Allan deviations and intervals, 2 threads", "whole", "long", 2),
    ("dedrunk noise, all cores", "dedrunk", "long", 2),
    ("to columns, 1 thread", "columns", "short", 1),
    ("rosbags, message by message", "rosbags", "short", 1),
    ("mcap-ros2-support, message by message", "mcap_ros2", "short", 1),
)


def main() -> None:
    """Run the benchmark."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--count", type=int, default=10_800_000)
    arguments.add_argument("--peer-count", type=int, default=300_000)
    arguments.add_argument("--runs", type=int, default=2)
    arguments.add_argument("--folder", type=Path, default=FOLDER)
    arguments.add_argument("--output", type=Path, default=RESULTS)
    arguments.add_argument("--child", choices=sorted(RUNS))
    arguments.add_argument("--bag")
    arguments.add_argument("--threads", type=int, default=1)
    options = arguments.parse_args()
    if options.child:
        child(options.child, options.bag, options.threads)
        return
    counts = {"long": options.count, "short": options.peer_count}
    bags = {which: options.folder / f"imu_{n}" for which, n in counts.items()}
    for which, path in bags.items():
        make_bag(path, counts[which])
    kept = 8.0 + 6 * 8.0 + 1.0  # stamps, six channels, the still mask
    size = sum(f.stat().st_size for f in bags["long"].iterdir()) / 2**20
    rows, results = [HEADING], {}
    print(HEADING, flush=True)
    for label, reader, which, threads in JOBS:
        if reader == "dedrunk" and not DEDRUNK.is_file():
            print("dedrunk is not installed: left out")
            continue
        runs = [measure(reader, bags[which], threads) for _ in range(options.runs)]
        results[f"{reader} {which} {threads}"] = runs
        rows.append(row(label, runs, kept))
        print(rows[-1], flush=True)
    text = (
        f"sensor_msgs/Imu, the long bag {size:.0f} MB of zstd chunks; every run a process of its "
        f"own, {options.runs} runs; {os.cpu_count()} cores.\n\n" + "\n".join(rows) + "\n"
    )
    write_results("reading", results, text, options.output)


if __name__ == "__main__":
    main()
