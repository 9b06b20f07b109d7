"""Read a long Imu bag: messages a second, peak memory, and peers on the same file.

Each run is a process of its own, so that peak memory is the run's.  Rates are by the clock and, as
other work on the machine slows that, by processor time.  The bag (zstd chunks; white noise, a random walk and a vibration, rounded to a sensor's LSB) is written once and kept in ``--folder``.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from imu_noise_id.bag_writer import TopicBytes, write_bag

from imu_noise_id import cdr

RATE_HZ = 1000.0


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


RUNS = {
    "ours": run_ours,
    "columns": run_columns,
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
    begin, processor = time.perf_counter(), time.process_time()
    count = RUNS[reader](path, threads)
    figures = {
        "count": count,
        "seconds": time.perf_counter() - begin,
        "processor_s": time.process_time() - processor,
        "peak_mb": peak_mb() - before,
    }
    print(json.dumps(figures))


def peak_mb() -> float:
    """Peak resident memory of this process image (``ru_maxrss`` would count the parent's too)."""
    status = Path("/proc/self/status").read_text().splitlines()
    return next(int(row.split()[1]) for row in status if row.startswith("VmHWM")) / 1024


def report(name: str, runs: list[dict[str, float]], kept_bytes: float) -> None:
    """Print one line of the table."""
    rates = sorted(run["count"] / run["seconds"] / 1e3 for run in runs)
    own = statistics.median(run["count"] / run["processor_s"] / 1e3 for run in runs)
    peak = statistics.median(run["peak_mb"] for run in runs)
    ratio = peak * 2**20 / (kept_bytes * runs[0]["count"])
    print(
        f"{name:26s} {statistics.median(rates):8.0f} k msg/s ({rates[0]:.0f} to {rates[-1]:.0f}), "
        f"{own:6.0f} k/processor-s, "
        f"peak {peak:6.0f} MB = {ratio:.2f} of the kept arrays"
    )


def main() -> None:
    """Run the benchmark."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--count", type=int, default=10_800_000)
    arguments.add_argument("--peer-count", type=int, default=300_000)
    arguments.add_argument("--runs", type=int, default=3)
    arguments.add_argument(
        "--folder", type=Path, default=Path(tempfile.gettempdir()) / "bench_bags"
    )
    arguments.add_argument("--child", choices=sorted(RUNS))
    arguments.add_argument("--bag")
    arguments.add_argument("--threads", type=int, default=1)
    options = arguments.parse_args()
    if options.child:
        child(options.child, options.bag, options.threads)
        return
    options.folder.mkdir(parents=True, exist_ok=True)
    bags = {n: options.folder / f"imu_{n}" for n in (options.count, options.peer_count)}
    for count, path in bags.items():
        make_bag(path, count)
    kept = 8.0 + 6 * 8.0 + 1.0  # stamps, six channels, the still mask
    long, short = bags[options.count], bags[options.peer_count]
    size = sum(f.stat().st_size for f in long.iterdir()) / 2**20
    print(f"{options.count} messages, {size:.0f} MB zstd, {os.cpu_count()} cores")
    for threads in (1, 2):
        for name in ("columns", "ours"):
            runs = [measure(name, long, threads) for _ in range(options.runs)]
            report(f"{name}, {threads} thread{'s' * (threads > 1)}", runs, kept)
    for name in ("ours", "rosbags", "mcap_ros2"):
        runs = [measure(name, short, 1) for _ in range(options.runs)]
        report(f"{name}, {options.peer_count} messages", runs, kept)


if __name__ == "__main__":
    main()
