"""Real nodes over DDS for tests: processes that are started, and a node that listens."""

from __future__ import annotations

import signal
import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from imu_noise_id.bag_writer import TopicBytes, write_bag
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from imu_noise_id import cdr

LATCHED = QoSProfile(depth=20, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PATIENCE_S = 60.0
ASK_AGAIN_S = 15.0


class Program:
    """``ros2 run PACKAGE EXECUTABLE ARGUMENTS`` as a process."""

    def __init__(self, env: dict[str, str], log: Path, command: Sequence[str]) -> None:
        self.log = log
        with log.open("wb") as stream:
            self.process = subprocess.Popen(
                ["ros2", "run", *command], env=env, stdout=stream, stderr=subprocess.STDOUT
            )

    @property
    def output(self) -> str:
        """Everything that it has printed."""
        return self.log.read_text(errors="replace")

    def wait(self) -> int:
        """Return the exit status once it has ended by itself."""
        return self.process.wait(PATIENCE_S)

    def end(self, number: int = signal.SIGTERM) -> int:
        """Send a signal and return the exit status."""
        self.process.send_signal(number)
        return self.wait()

    def kill(self) -> None:
        """End it for certain."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()


class Listener:
    """A node of the test's own, spun while a condition is waited for."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = Node("listener", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def close(self) -> None:
        """Leave the domain."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def hear(self, kind: Any, topic: str, qos: Any = LATCHED) -> list[Any]:
        """Subscribe; the list returned grows."""
        heard: list[Any] = []
        self.node.create_subscription(kind, topic, heard.append, qos)
        return heard

    def until(self, condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> Any:
        """Spin until a condition holds and return its value."""
        end = time.monotonic() + patience_s
        while not (found := condition()):
            assert time.monotonic() < end, f"waited {patience_s} s in vain for {what}"
            self.executor.spin_once(0.05)
        return found

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Call a service and return its answer."""
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready, name)
        asked = [client.call_async(request)]

        def answered() -> list[Any]:
            # a server that was killed is still listed for a while: what it was sent is lost
            if time.monotonic() > again_s[-1]:
                again_s.append(time.monotonic() + ASK_AGAIN_S)
                asked.append(client.call_async(request))
            return [future for future in asked if future.done()]

        again_s = [time.monotonic() + ASK_AGAIN_S]
        done = self.until(answered, f"an answer of {name}")
        self.node.destroy_client(client)
        return done[0].result()


def write_still_bag(path: Path, duration_s: float, rate_hz: int, rng: np.random.Generator) -> Path:
    """A still IMU with a magnetometer and a receiver: white noise and a walk, whole messages."""
    start_ns = 1_700_000_000_000_000_000
    n, m = round(duration_s * rate_hz), round(duration_s * 5)
    imu_ns = start_ns + np.arange(n) * (1_000_000_000 // rate_hz)
    fix_ns = start_ns + 7_000_000 + np.arange(m) * 200_000_000
    imu = {f"angular_velocity.{a}": _walk(rng, n, 1e-3, 1e-5) for a in "xyz"}
    imu |= {f"linear_acceleration.{a}": _walk(rng, n, 2e-2, 1e-4) for a in "xyz"}
    imu["linear_acceleration.z"] = imu["linear_acceleration.z"] + 9.81
    field = {f"magnetic_field.{a}": _walk(rng, m, 1e-7, 0.0) + 2e-5 for a in "xyz"}
    fix = {
        "latitude": 48.0 + _walk(rng, m, 1e-6, 0.0),
        "longitude": 11.0 + _walk(rng, m, 1e-6, 0.0),
        "altitude": 500.0 + _walk(rng, m, 0.5, 0.0),
        "covariance_type": 2.0,
    } | {f"position_covariance.{k}": 1.0 for k in (0, 4, 8)}
    topics = (
        ("/imu/data", cdr.IMU, imu_ns, imu, "imu_link"),
        ("/imu/mag", cdr.MAGNETIC_FIELD, fix_ns + 1_000_000, field, "imu_link"),
        ("/gps/fix", cdr.NAV_SAT_FIX, fix_ns, fix, "gps"),
    )
    write_bag(
        path,
        [
            TopicBytes(topic, kind, ns + 2_000_000, cdr.encode(kind, ns, members, frame))
            for topic, kind, ns, members, frame in topics
        ],
    )
    return path


def _walk(rng: np.random.Generator, n: int, white: float, step: float) -> np.ndarray:
    return rng.normal(0.0, white, n) + np.cumsum(rng.normal(0.0, step, n) if step else np.zeros(n))
