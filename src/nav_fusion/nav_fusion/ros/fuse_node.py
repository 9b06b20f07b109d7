"""``fuse`` live: IMU and receiver in, odometry with a covariance out."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from imu_noise_id.cdr import Decoded
from imu_noise_id.errors import InputError
from imu_noise_id.model_file import load_model
from imu_noise_id.ros.diagnostics import array, status
from imu_noise_id.ros.messages import to_model, to_time
from imu_noise_id.ros.parameters import declare, refuse_non_finite
from imu_noise_id.ros.runtime import run_node as spin_node
from imu_noise_id.ros.stream import Stream
from imu_noise_id.ros.worker import Worker
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import NavSatFix

from nav_fusion.beginning import Beginning
from nav_fusion.engine import Engine, Rows
from nav_fusion.feeding import feed
from nav_fusion.fuse import warm_up
from nav_fusion.noise import NavigationNoise, TurnOn, from_model, mems_defaults
from nav_fusion.published import (
    FIX_TOPIC,
    ODOMETRY_TOPIC,
    fix_messages,
    odometry_messages,
)
from nav_fusion.ros.latency import Latency
from nav_fusion.ros.leading import DIED, Found, Leading, find_noise
from nav_fusion.ros.settings import AIDS, SETTINGS, filter_parameters
from nav_fusion.ros.status import filter_status
from nav_fusion.ros.transform import transform_sender
from nav_fusion.solution import solve
from noise_msgs.msg import FilterStatus, NoiseModel
from noise_msgs.srv import Reset

_DRAIN_S = 0.02
_STAMP = struct.Struct("<iI")
_ENCAPSULATION = 4


@dataclass(frozen=True)
class Successor:
    """A filter with another model that is being fed what the running one was.

    Attributes
    ----------
    engine : Engine
    beginning : Beginning
        What it is fed.
    replay : future of int
        How many batches it has been fed, when it has caught up.
    """

    engine: Engine
    beginning: Beginning
    replay: Future[int]


class FuseNode(Node):
    """Receives in order of arrival, feeds the engine, publishes what became due."""

    def __init__(self, **options: Any) -> None:
        super().__init__("fuse", **options)
        declare(self, SETTINGS)
        self.add_on_set_parameters_callback(refuse_non_finite)
        self._values = {s.name: self.get_parameter(s.name).value for s in SETTINGS}
        self._filter_parameters = filter_parameters(self._values)
        self._period_ns = round(1e9 / self._filter_parameters.publish_rate_hz)
        self._turn_on = TurnOn(
            self._filter_parameters.gyro_turn_on_rad_s, self._filter_parameters.accel_turn_on_m_s2
        )
        self._noise = self._noise_of_file()
        self._engine: Engine | None = None
        self._modelled = False
        self._leading = ""
        self._beginning = Beginning()
        self._worker = Worker(find_noise, DIED)
        self._looked_at = self._beginning
        self._pool = ThreadPoolExecutor(max_workers=1)
        self._successor: Successor | None = None
        self._inbox: list[tuple[str, bytes, int]] = []
        self._slot = -1
        self._newest_ns = 0
        self._begun_s = time.monotonic()
        self._latency = Latency()
        self._updates = ""
        self._to_tell = False
        self._odometry = self.create_publisher(Odometry, ODOMETRY_TOPIC, 100)
        self._fixes = self.create_publisher(NavSatFix, FIX_TOPIC, 100)
        self._status = self.create_publisher(FilterStatus, "~/status", 10)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._send_transforms = transform_sender(
            self,
            self._values["publish_tf"],
            self._values["world_frame"],
            self._values["body_frame"],
        )
        self._streams = self._open_streams()
        self._listen_for_model()
        self.create_service(Reset, "~/reset", self._on_reset)
        self.create_timer(_DRAIN_S, self._drain)
        self.create_timer(1.0, self._tell_soon)

    # ------------------------------------------------------------------ what comes in

    def _open_streams(self) -> dict[str, Stream]:
        depth = self._values["queue_depth"]
        topics = {kind: str(self._values[f"{kind}_topic"]) for kind in ("imu", *AIDS)}
        return {
            kind: Stream(self, kind, topic, depth, self._sink(kind))
            for kind, topic in topics.items()
            if topic
        }

    def _sink(self, kind: str) -> Callable[[bytes], None]:
        return self._on_imu if kind == "imu" else lambda data: self._on_aid(kind, data)

    def _keep(self, kind: str, data: bytes) -> None:
        self._inbox.append((kind, data, time.time_ns()))

    def _on_imu(self, data: bytes) -> None:
        """Keep a sample; the first in a new period of publishing is what a row waits for."""
        self._keep("imu", data)
        if len(data) < _ENCAPSULATION + _STAMP.size:
            return
        seconds, nanoseconds = _STAMP.unpack_from(data, _ENCAPSULATION)
        self._newest_ns = seconds * 1_000_000_000 + nanoseconds
        slot = self._newest_ns // self._period_ns
        if slot != self._slot:
            self._slot = slot
            self._drain()
            if self._to_tell:  # there is time for it until the next output
                self._tell()

    def _on_aid(self, kind: str, data: bytes) -> None:
        """Take a measurement at once: between two outputs there is time for it."""
        self._keep(kind, data)
        self._drain()

    def _noise_of_file(self) -> NavigationNoise | None:
        path = self._values["model_file"]
        return from_model(load_model(path), self._turn_on) if path else None

    def _listen_for_model(self) -> None:
        if self._noise is None and self._values["model_topic"]:
            latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            self.create_subscription(
                NoiseModel, self._values["model_topic"], self._on_model, latched
            )

    def _on_model(self, message: NoiseModel) -> None:
        """Take the newest model: at once from the beginning while that is kept, else later."""
        try:
            self._noise = from_model(to_model(message), self._turn_on)
        except (ValueError, InputError) as error:
            self.get_logger().warning(f"{self._values['model_topic']}: not used: {error}")
            return
        if self._engine is not None and not self._modelled:
            self._take_over(self._noise)
            self._modelled = True

    def _take_over(self, noise: NavigationNoise) -> None:
        """Begin anew with another model on all that has come, where that is kept.

        A thread feeds the new filter while this one goes on (the filter's loop holds no lock).
        """
        if not self._beginning.kept:
            self.get_logger().warning(f"{noise.source}: takes effect at the next start or ~/reset")
            return
        engine = Engine(noise, self._filter_parameters)
        replay = self._pool.submit(self._beginning.replay, engine)
        self._successor = Successor(engine, self._beginning, replay)

    def _hand_over(self) -> None:
        """Let the new filter take the old one's place once it has been fed what that one was."""
        if self._successor is None or not self._successor.replay.done():
            return
        new, self._successor = self._successor, None
        if new.beginning is not self._beginning or not self._beginning.kept:
            self.get_logger().warning(
                f"{new.engine.noise.source}: takes effect at the next start or ~/reset"
            )
            return
        self._beginning.replay(new.engine, new.replay.result())
        self._engine = new.engine
        self.get_logger().info(f"noise model from the beginning on: {new.engine.noise.source}")

    def _look_at_rest(self) -> None:
        """Without a model: identify the leading rest beside the filter, as it grows."""
        found, begun = self._worker.poll(), self._beginning
        if found is not None and self._looked_at is begun:
            self._take_leading_rest(found)
        if self._worker.busy or self._modelled or self._engine is None or not begun.kept:
            return
        if begun.span_s < begun.look_at_s:
            return
        begun.look_at_s *= 2.0
        self._looked_at = begun
        self._worker.submit(Leading(tuple(begun.columns()), self._filter_parameters))

    def _take_leading_rest(self, found: Found) -> None:
        if found.noise is None:
            self.get_logger().warning(f"the leading rest was not identified: {found.problem}")
        elif not self._modelled and found.noise.source != self._leading:
            self._leading = found.noise.source
            self._take_over(found.noise)

    def close(self) -> None:
        """End the thread and the process, whatever they are at."""
        self._beginning.forget()
        self._pool.shutdown(cancel_futures=True)
        self._worker.close()

    # ------------------------------------------------------------------ what goes out

    def _drain(self) -> None:
        """Feed everything that has come, in order of arrival, and publish what became due."""
        self._hand_over()
        if not self._inbox or not self._begin():
            return
        inbox, self._inbox = self._inbox, []
        aided = False
        for kind, group in groupby(inbox, key=lambda item: item[0]):
            items = list(group)
            stream, log_ns = self._streams[kind], np.array([item[2] for item in items], np.int64)
            decoded = stream.decode([item[1] for item in items])
            rows = self._feed(kind, decoded)
            if kind != "imu":
                aided = True
                self._updates = stream.receiver.topic
            if rows.stamp_ns.size:
                self._publish(rows, int(log_ns[-1]))
            stream.watch.feed(decoded, log_ns)
            self._beginning.add(stream.receiver.topic, stream.receiver.type, decoded, log_ns)
        if aided:
            self._publish_status()

    def _begin(self) -> bool:
        """Whether there is an engine; it begins once the model is there or waited for."""
        if self._engine is not None:
            return True
        waited = time.monotonic() - self._begun_s >= self._values["model_wait_s"]
        if self._noise is None and self._values["model_topic"] and not waited:
            return False
        self._modelled = self._noise is not None
        noise = self._noise or mems_defaults(self._turn_on)
        self._leading = noise.source
        self._engine = Engine(noise, self._filter_parameters)
        self.get_logger().info(f"noise model: {noise.source}")
        return True

    def _feed(self, kind: str, decoded: Decoded) -> Rows:
        assert self._engine is not None
        kind_of_message = self._streams[kind].receiver.type
        return feed(self._engine, kind_of_message, decoded.stamp_ns, decoded.values)

    def _publish(self, rows: Rows, received_ns: int) -> None:
        """Publish, the odometry first: it is what a controller waits for."""
        assert self._engine is not None
        origin = self._engine.origin
        if origin is None:
            return
        solution = solve(rows.stamp_ns, rows.values, origin, self._filter_parameters.lever_arm_m)
        world, body = self._values["world_frame"], self._values["body_frame"]
        for row in odometry_messages(solution, world, body):
            self._odometry.publish(row.tobytes())
        self._latency.count((time.time_ns() - received_ns) * 1e-9)
        for row in fix_messages(solution, body):
            self._fixes.publish(row.tobytes())
        self._send_transforms(solution)

    def _publish_status(self) -> None:
        assert self._engine is not None
        message = filter_status(self._engine)
        message.header.frame_id = self._values["world_frame"]
        message.header.stamp = to_time(self._newest_ns)
        message.last_update = self._updates
        message.latency_s, message.latency_max_s = self._latency.median_s(), self._latency.worst_s()
        message.imu_missing = self._streams["imu"].watch.missing
        self._status.publish(message)

    def _tell_soon(self) -> None:
        """Tell after the next output; now where none has come since the last second."""
        if self._to_tell:
            self._tell()
        self._to_tell = True

    def _tell(self) -> None:
        """Look at the publishers and at the leading rest, then publish diagnostics."""
        self._to_tell = False
        self._look_at_rest()
        now_ns = time.time_ns()
        statuses = []
        for kind, stream in self._streams.items():
            if stream.receiver.look():
                stream.reset()
            if kind == "imu" or stream.known:
                statuses.append(stream.status(self.get_name(), now_ns))
        statuses.append(self._filter_diagnosis())
        self._diagnostics.publish(array(statuses, self.get_clock().now().nanoseconds))
        if self._engine is not None:
            self._publish_status()

    def _filter_diagnosis(self) -> DiagnosticStatus:
        name = f"{self.get_name()}: filter"
        if self._engine is None:
            return status(DiagnosticStatus.STALE, name, "waiting for samples and a noise model", {})
        found = self._engine.status()
        said = [found.fault or "", *found.notes]
        numbers = {
            "model": self._engine.noise.source,
            "running": self._engine.running,
            "heading_known": found.aligned,
            "fixes_used": found.used,
            "fixes_gated": found.gated,
            "fixes_late": found.late,
            "fixes_rejected": found.rejected,
            "standing_still": found.still,
            **self._latency.numbers(),
        }
        bad = bool(found.fault or found.doubts)
        level = DiagnosticStatus.WARN if bad else DiagnosticStatus.OK
        return status(level, name, "; ".join(filter(None, said)) or "as it should be", numbers)

    def _on_reset(self, request: Reset.Request, response: Reset.Response) -> Reset.Response:
        topics = [stream.receiver.topic for stream in self._streams.values()]
        unknown = sorted(set(request.topics) - set(topics))
        if unknown:
            response.message = f"not a topic of this node: {', '.join(unknown)}"
            return response
        self._inbox = []
        self._engine = None
        self._beginning.forget()
        self._beginning = Beginning()
        self._successor = None
        for stream in self._streams.values():
            stream.reset()
        response.success = True
        response.message = "the filter starts anew with the next samples"
        return response


def run_node(argv: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit status."""
    warm_up()  # kernels are loaded before samples come, not while they wait
    return spin_node(FuseNode, argv, "fuse", SETTINGS)
