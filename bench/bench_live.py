"""Live nodes under load: samples lost, CPU, latency, by rate and reliability.

A sender publishes sensor_msgs/Imu and, for ``fuse``, ten fixes a second; the node runs as
``ros2 run`` starts it.  The stamp is the time at which a sample was due, as an IMU's own clock
gives it, however late this process sent it.  Lost is what was sent less what the node says it
received.  Latency (``fuse``, publishing at its 50 Hz) is told twice: from the stamp to the
reception in this process of the odometry that holds the sample, two hops of DDS and the sender's
delay included; and from the sample's reception by the node to the publishing, as the node's
diagnostics say it of all its outputs.

    python bench/bench_live.py                        the table
    python bench/bench_live.py --node identify --rate 1000 --seconds 600 --reliability reliable
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import signal
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from results import RESULTS, write_results
from sensor_msgs.msg import Imu, NavSatFix

from imu_noise_id import cdr

PACKAGES = {"identify": "imu_noise_id", "fuse": "nav_fusion"}
RELIABILITY = {
    "reliable": ReliabilityPolicy.RELIABLE,
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
}
OUTPUT_HZ = 50.0
RATES_HZ = (100, 1000, 2000, 4000, 6000, 8000)
TABLE = [(node, rate, "reliable") for node in PACKAGES for rate in RATES_HZ]
HEADING = """\
| node | IMU Hz | reliability | sent | lost | CPU of a core | stamp to reception of the odometry, \
p50 / p99 / max ms | reception to publishing, p50 / p99 / max ms | load |
|---|---|---|---|---|---|---|---|---|"""


@dataclass(frozen=True)
class Measured:
    """One run; latencies in milliseconds, empty for ``identify``."""

    sent: int
    received: int
    cpu: float
    latency_ms: np.ndarray
    inside_ms: tuple[float, ...]
    load: float


def messages(n: int, rng: np.random.Generator) -> np.ndarray:
    """Samples of a still IMU, stamps to be filled in."""
    members = {f"angular_velocity.{a}": rng.normal(0.0, 1e-3, n) for a in "xyz"}
    members |= {f"linear_acceleration.{a}": rng.normal(0.0, 1e-2, n) for a in "xyz"}
    members["linear_acceleration.z"] = members["linear_acceleration.z"] + 9.81
    return cdr.encode(cdr.IMU, np.zeros(n, np.int64), members, "imu_link")


def send(
    rate_hz: float, seconds: float, reliability: str, fixes: bool, sent: Any, heard: Any
) -> None:
    """Publish in time from when the node has taken note; count what was sent."""
    rclpy.init()
    node = Node("sender")
    qos = QoSProfile(depth=1000, reliability=RELIABILITY[reliability])
    samples = node.create_publisher(Imu, "/imu/data", qos)
    places = node.create_publisher(NavSatFix, "/gps/fix", qos)
    heard.wait()
    while not samples.get_subscription_count():  # each side matches the other on its own
        time.sleep(0.01)
    rng = np.random.default_rng(1)
    pool = [bytearray(row) for row in messages(1000, rng)]
    count = round(rate_hz * seconds)
    order = rng.integers(0, len(pool), count)  # in turn they would make lines, one each hertz
    begin_ns = time.time_ns()
    for k in range(count):
        due_ns = begin_ns + round(k * 1e9 / rate_hz)
        left_s = (due_ns - time.time_ns()) * 1e-9
        if left_s > 0.0:
            time.sleep(left_s)
        data, stamp_ns = pool[order[k]], due_ns
        data[4:8] = (stamp_ns // 10**9).to_bytes(4, "little")
        data[8:12] = (stamp_ns % 10**9).to_bytes(4, "little")
        samples.publish(bytes(data))
        sent.value = k + 1
        if fixes and k % max(round(rate_hz / 10), 1) == 0:
            places.publish(_fix(stamp_ns, k))
    node.destroy_node()
    rclpy.shutdown()


def _fix(stamp_ns: int, k: int) -> NavSatFix:
    fix = NavSatFix(latitude=48.0 + 1e-7 * np.sin(k), longitude=11.0, altitude=500.0)
    fix.status.status = 0
    fix.header.stamp.sec, fix.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    fix.position_covariance_type = NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN
    fix.position_covariance = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 4.0]
    return fix


def cpu_s(pid: int) -> float:
    """CPU time of a process so far, all threads, its children not."""
    after_name = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(after_name[11]) + int(after_name[12])) / os.sysconf("SC_CLK_TCK")


class Ear:
    """Listens to what the node says and publishes."""

    def __init__(self, name: str) -> None:
        rclpy.init()
        self.node = Node("ear")
        self.name = name
        self.received = -1
        self.publishers = 0
        self.latency_ms: list[float] = []
        self.inside_ms: tuple[float, ...] = ()
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._hear, 10)
        self.node.create_subscription(Odometry, "/odometry/filtered", self._take, 1000)

    def _hear(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == f"{self.name}: /imu/data":
                numbers = {v.key: v.value for v in status.values}
                self.received = int(numbers["received"])
                self.publishers = int(numbers["publishers"])
            if status.name == f"{self.name}: filter":
                told = {v.key: v.value for v in status.values}
                keys = [f"latency_{what}_ms" for what in ("median", "p99", "max")]
                self.inside_ms = tuple(float(told[key]) for key in keys if key in told)

    def _take(self, message: Odometry) -> None:
        stamp = message.header.stamp
        age_ns = time.time_ns() - stamp.sec * 10**9 - stamp.nanosec
        self.latency_ms.append(age_ns * 1e-6)

    def close(self) -> None:
        """Leave the domain."""
        self.node.destroy_node()
        rclpy.shutdown()


def measure(name: str, rate_hz: float, seconds: float, reliability: str) -> Measured:
    """Run a node under a sender."""
    settings = ["-p", f"publish_rate_hz:={OUTPUT_HZ}"] * (name == "fuse")
    settings += ["-p", "model_wait_s:=0.0"] * (name == "fuse")
    program = subprocess.Popen(["ros2", "run", PACKAGES[name], name, "--ros-args", *settings])
    ear = Ear(name)
    context = multiprocessing.get_context("spawn")
    sent, heard = context.Value("q", 0), context.Event()
    sender = context.Process(
        target=send, args=(rate_hz, seconds, reliability, name == "fuse", sent, heard)
    )
    try:
        while ear.received < 0:
            rclpy.spin_once(ear.node, timeout_sec=0.1)
        sender.start()
        while not ear.publishers:
            rclpy.spin_once(ear.node, timeout_sec=0.1)
        heard.set()
        while not sent.value:
            rclpy.spin_once(ear.node, timeout_sec=0.1)
        begin_s, begin_cpu = time.monotonic(), cpu_s(program.pid)
        while sender.is_alive():
            rclpy.spin_once(ear.node, timeout_sec=0.1)
        cpu = (cpu_s(program.pid) - begin_cpu) / (time.monotonic() - begin_s)
        settled = time.monotonic() + 4.0  # diagnostics come once a second
        while time.monotonic() < settled and ear.received < sent.value:
            rclpy.spin_once(ear.node, timeout_sec=0.1)
        latency_ms, load = np.array(ear.latency_ms), os.getloadavg()[0]
        return Measured(sent.value, ear.received, cpu, latency_ms, ear.inside_ms, load)
    finally:
        program.send_signal(signal.SIGINT)
        program.wait()
        ear.close()


def row(name: str, rate_hz: float, reliability: str, found: Measured) -> str:
    """A line of the table."""
    latency = inside = "–"
    if found.latency_ms.size:
        p50, p99 = np.percentile(found.latency_ms, [50, 99])
        latency = f"{p50:.2f} / {p99:.2f} / {found.latency_ms.max():.2f}"
        inside = " / ".join(f"{ms:.2f}" for ms in found.inside_ms)
    return (
        f"| {name} | {rate_hz:g} | {reliability} | {found.sent} | {found.sent - found.received} | "
        f"{100 * found.cpu:.1f} % | {latency} | {inside} | {found.load:.1f} |"
    )


def figures(name: str, rate_hz: float, found: Measured) -> dict[str, float | str]:
    """A run's figures for the page."""
    return {
        "node": name,
        "rate_hz": rate_hz,
        "lost": found.sent - found.received,
        "cpu_of_a_core": found.cpu,
    }


def main() -> None:
    """Measure and print the table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--node", choices=PACKAGES)
    arguments.add_argument("--rate", type=float, default=1000.0, help="Hz")
    arguments.add_argument("--seconds", type=float, default=10.0)
    arguments.add_argument("--reliability", choices=RELIABILITY, default="reliable")
    arguments.add_argument("--output", type=Path, default=RESULTS)
    options = arguments.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_LOG_DIR", tempfile.mkdtemp())
    runs = TABLE
    if options.node:
        runs = [(options.node, options.rate, options.reliability)]
    print(HEADING, flush=True)
    rows, results = [HEADING], []
    for name, rate_hz, reliability in runs:
        found = measure(name, rate_hz, options.seconds, reliability)
        rows.append(row(name, rate_hz, reliability, found))
        results.append(figures(name, rate_hz, found))
        print(rows[-1], flush=True)
    if not options.node:
        text = f"{options.seconds:g} s each, ten fixes a second for `fuse`.\n\n" + "\n".join(rows)
        write_results("live", results, text + "\n", options.output)


if __name__ == "__main__":
    main()
