"""Live nodes over a long time on a bad stream: memory, file descriptors and what they still say.

A sender publishes Imu with bursts, jitter, 1 % duplicates, 1 % out of order, drops, clock
steps of a second and of an hour, frozen stamps, NaN, and is restarted again and again; ``identify``
and ``fuse`` must keep running with flat memory and as many open files as in the beginning.  Run by
hand (it is no part of `make study`):

    source env.sh && .venv/bin/python study/soak_live.py --minutes 30 --output soak.json
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Imu

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "bench"))
from bench_live import PACKAGES, messages

SESSION_S = 14.0
WARM_UP_S = 120.0


def stamps(n: int, rate_hz: int, start_ns: int, rng: np.random.Generator) -> np.ndarray:
    """Stamps of a session with everything that goes wrong with stamps."""
    stamp_ns = start_ns + np.arange(n) * (10**9 // rate_hz)
    stamp_ns += np.rint(rng.normal(0.0, 1e8 / rate_hz, n)).astype(np.int64)
    repeated = np.flatnonzero(rng.random(n) < 0.01)
    stamp_ns[repeated] = stamp_ns[np.maximum(repeated - 1, 0)]
    swapped = np.flatnonzero(rng.random(n - 1) < 0.01)
    stamp_ns[swapped], stamp_ns[swapped + 1] = stamp_ns[swapped + 1], stamp_ns[swapped]
    stamp_ns[n // 2 :] += int(rng.choice([-3600, -1, 0, 1, 3600])) * 10**9
    frozen = int(rng.integers(0, n - rate_hz))
    stamp_ns[frozen : frozen + rate_hz // 2] = stamp_ns[frozen]
    return stamp_ns


def send(session: int, rate_hz: int) -> None:
    """One life of the driver."""
    rng = np.random.default_rng([7, session])
    rclpy.init()
    node = Node("sender")
    samples = node.create_publisher(Imu, "/imu/data", QoSProfile(depth=1000))
    while samples.get_subscription_count() < len(PACKAGES):
        time.sleep(0.01)
    n = round(SESSION_S * rate_hz)
    rows = messages(1000, rng)
    bad = np.flatnonzero(rng.random(n) < 0.001)
    lost = set(np.flatnonzero(rng.random(n) < 0.005).tolist())
    nan = np.frombuffer(np.array([np.nan]).tobytes(), np.uint8)
    stamp_ns = stamps(n, rate_hz, time.time_ns(), rng)
    begin = time.monotonic()
    burst = rate_hz // 10
    for first in range(0, n, burst):
        time.sleep(max(begin + first / rate_hz - time.monotonic(), 0.0))
        for k in range(first, min(first + burst, n)):
            if k in lost:
                continue
            row = rows[k % len(rows)].copy()
            row[4:8] = np.frombuffer(np.int32(stamp_ns[k] // 10**9).tobytes(), np.uint8)
            row[8:12] = np.frombuffer(np.uint32(stamp_ns[k] % 10**9).tobytes(), np.uint8)
            if k in bad:
                row[-80:-72] = nan
            samples.publish(row.tobytes())
    node.destroy_node()
    rclpy.shutdown()


def footprint(pid: int) -> dict[str, float]:
    """Resident memory in MB and open files of a process and of those that it started."""
    pids, megabytes, files = [pid], 0.0, 0
    while pids:
        one = Path(f"/proc/{pids.pop()}")
        pids += [int(c) for f in one.glob("task/*/children") for c in f.read_text().split()]
        megabytes += (
            int((one / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
        )
        files += len(os.listdir(one / "fd"))
    return {"resident_mb": round(megabytes, 1), "files": files}


def growth(course: list[dict[str, object]], name: str, key: str) -> tuple[float, float]:
    """Medians of the first and of the last third after the warm-up."""
    after = [c for c in course if c["elapsed_s"] > WARM_UP_S and name in c]
    third = max(len(after) // 3, 1)
    parts = after[:third], after[-third:]
    return tuple(float(np.median([c[name][key] for c in part])) for part in parts)


def main() -> None:
    """Soak, print and write what was seen."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--minutes", type=float, default=30.0)
    arguments.add_argument("--rate", type=int, default=1000)
    arguments.add_argument("--output", default="soak.json")
    options = arguments.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_LOG_DIR", tempfile.mkdtemp())
    # full, and forgetting, from the second minute
    short = ["--ros-args", "-p", "buffer_s:=60.0", "-p", "max_load:=0.2"]
    programs = {
        name: subprocess.Popen(["ros2", "run", package, name, *(short * (name == "identify"))])
        for name, package in PACKAGES.items()
    }
    context = multiprocessing.get_context("spawn")
    begin, session = time.monotonic(), 0
    course: list[dict[str, object]] = []
    while (elapsed := time.monotonic() - begin) < WARM_UP_S + 60.0 * options.minutes:
        sender = context.Process(target=send, args=(session, options.rate))
        sender.start()
        sender.join()
        session += 1
        look = {name: footprint(p.pid) for name, p in programs.items() if p.poll() is None}
        course.append({"elapsed_s": elapsed, **look})
        print(course[-1], flush=True)
    status = {}
    for name, program in programs.items():
        program.send_signal(signal.SIGTERM)
        status[name] = program.wait()
    for name in PACKAGES:
        for key in ("resident_mb", "files"):
            first, last = growth(course, name, key)
            print(f"{name} {key}: median {first:g} in the first third, {last:g} in the last")
    result = {"sessions": session, "exit_status": status, "course": course}
    Path(options.output).write_text(json.dumps(result, indent=1))
    print(f"{session} restarts of the driver, exit status {status}")


if __name__ == "__main__":
    main()
