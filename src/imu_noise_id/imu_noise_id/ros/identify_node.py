"""``identify`` live: buffers the still sensors' topics and publishes their noise model."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from imu_noise_id.cdr import Decoded
from imu_noise_id.checkpoint import load_checkpoint
from imu_noise_id.live import Findings
from imu_noise_id.longrun import LongRun
from imu_noise_id.model_file import load_model
from imu_noise_id.recording import Stamps
from imu_noise_id.rolling import BLOCK, RollingColumns
from imu_noise_id.ros.deferred import DeferredService, Reply
from imu_noise_id.ros.diagnostics import array, status
from imu_noise_id.ros.identifying import DIED, Answer, Job, work
from imu_noise_id.ros.messages import allan_messages, discrepancy_message, model_message
from imu_noise_id.ros.parameters import Setting, declare, refuse_non_finite, value
from imu_noise_id.ros.runtime import run_node as spin_node
from imu_noise_id.ros.stream import Stream
from imu_noise_id.ros.worker import Worker
from imu_noise_id.topics import DEFAULTS
from noise_msgs.msg import AllanCurve, DiscrepancyReport, NoiseModel
from noise_msgs.srv import Identify, Reset

SETTINGS = (
    *(
        Setting(f"{kind}_topic", topic, f"topic of the {kind} messages; empty: not used")
        for kind, topic in DEFAULTS.items()
    ),
    Setting("buffer_s", 1800.0, "samples kept, in seconds", 30.0, 86400.0),
    Setting(
        "buffer_samples", 2_000_000, "most samples kept a topic (64 bytes each)", 10_000, 50_000_000
    ),
    Setting("queue_depth", 5000, "messages that may wait for this node, a topic", 200, 100_000),
    Setting("first_after_s", 30.0, "buffered time of the first model, s", 1.0, 3600.0, fixed=False),
    Setting("publish_period_s", 10.0, "time between models, s", 0.5, 86400.0, fixed=False),
    Setting(
        "max_load", 0.5, "share of the time that may be spent identifying", 0.01, 1.0, fixed=False
    ),
    Setting("reference_model", "", "model.yaml to compare with on ~/discrepancy; empty: none"),
    Setting("checkpoint", "", "file that a restarted node resumes from; empty: none"),
    Setting("checkpoint_period_s", 60.0, "time between checkpoints, s", 1.0, 86400.0, fixed=False),
)

_DRAIN_S = 0.05
_LATCHED = DurabilityPolicy.TRANSIENT_LOCAL
_CHANNELS = 16


class IdentifyNode(Node):
    """Receives, buffers, has a worker identify, publishes."""

    def __init__(self, **options: Any) -> None:
        super().__init__("identify", **options)
        declare(self, SETTINGS)
        self.add_on_set_parameters_callback(refuse_non_finite)
        self._checkpoint = str(value(self, "checkpoint"))
        reference = str(value(self, "reference_model"))
        self._reference = load_model(reference) if reference else None
        self._streams = self._open_streams()
        self._buffers = {k: self._buffer(s) for k, s in self._streams.items()}
        self._before = {k: self._long_run(s) for k, s in self._streams.items()}
        self._resume()
        self._worker = Worker(work, DIED)
        self._waiting: deque[tuple[Identify.Request, Identify.Response, Reply]] = deque()
        self._answering: tuple[Identify.Response, Reply] | None = None
        self._found: Findings | None = None
        self._problem = ""
        self._checkpoint_problem = ""
        self._submitted_s = self._next_s = 0.0
        self._next_checkpoint_s = time.monotonic() + value(self, "checkpoint_period_s")
        self._allan = self.create_publisher(
            AllanCurve, "~/allan", QoSProfile(depth=_CHANNELS, durability=_LATCHED)
        )
        self._model = self.create_publisher(
            NoiseModel, "~/model", QoSProfile(depth=1, durability=_LATCHED)
        )
        self._discrepancy = self.create_publisher(
            DiscrepancyReport, "~/discrepancy", QoSProfile(depth=1, durability=_LATCHED)
        )
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._service = DeferredService(self, Identify, "~/identify", self._on_identify)
        self.create_service(Reset, "~/reset", self._on_reset)
        self.create_timer(_DRAIN_S, self._drain)
        self.create_timer(1.0, self._tell)

    def close(self) -> None:
        """Keep what was buffered since the last checkpoint, then end the worker."""
        self._receive()
        self._worker.close()
        if self._checkpoint and any(b.size for b in self._buffers.values()):
            answer = work(self._job(None, self._checkpoint, False))
            if answer.checkpoint_problem:
                self.get_logger().error(answer.checkpoint_problem)

    def _open_streams(self) -> dict[str, Stream]:
        depth = value(self, "queue_depth")
        topics = {kind: str(value(self, f"{kind}_topic")) for kind in DEFAULTS}
        return {k: Stream(self, k, topic, depth) for k, topic in topics.items() if topic}

    def _buffer(self, stream: Stream) -> RollingColumns:
        receiver = stream.receiver
        return RollingColumns(
            receiver.topic, receiver.type, value(self, "buffer_s"), value(self, "buffer_samples")
        )

    def _long_run(self, stream: Stream) -> LongRun:
        return LongRun(stream.receiver.topic, stream.receiver.type)

    def _forget(self, kind: str) -> int:
        """Begin anew with a sensor; return how many samples were buffered."""
        stream, size = self._streams[kind], self._buffers[kind].size
        self._buffers[kind] = self._buffer(stream)
        self._before[kind] = self._long_run(stream)
        stream.reset()
        return size

    def _resume(self) -> None:
        """Fill the buffers from the checkpoint, where there is one."""
        if not self._checkpoint or not Path(self._checkpoint).exists():
            return
        checkpoint = load_checkpoint(self._checkpoint)
        kept = {c.topic: c for c in checkpoint.columns}
        before = {(run.topic, run.type): run for run in checkpoint.before}
        for kind, buffer in self._buffers.items():
            self._before[kind] = before.get((buffer.topic, buffer.type), self._before[kind])
            columns = kept.get(buffer.topic)
            if columns is None or columns.type != buffer.type:
                continue
            for begin in range(0, columns.stamp_ns.size, BLOCK):
                part = slice(begin, begin + BLOCK)
                size = columns.stamp_ns[part].size
                decoded = Decoded(
                    columns.stamp_ns[part],
                    columns.values[:, part],
                    np.ones(size, dtype=bool),
                    columns.frame_ids,
                )
                self._keep(kind, decoded, columns.log_ns[part])
            self.get_logger().info(
                f"{buffer.topic}: {buffer.size} samples resumed from {self._checkpoint}"
            )

    def _drain(self) -> None:
        self._receive()
        answer = self._worker.poll()
        if answer is not None:
            self._finish(answer)
        if not self._worker.busy:
            self._start()

    def _receive(self) -> None:
        for kind, stream in self._streams.items():
            batch = stream.take()
            if batch is not None:
                self._keep(kind, *batch)

    def _keep(self, kind: str, decoded: Decoded, log_ns: Stamps) -> None:
        """Buffer samples; what no longer fits goes into the block averages."""
        buffer = self._buffers[kind]
        buffer.append(decoded, log_ns)
        while buffer.full:
            self._before[kind].feed(buffer.forget())

    def _job(self, last_s: float | None, checkpoint: str, identify: bool) -> Job:
        columns = tuple(buffer.columns() for buffer in self._buffers.values())
        return Job(
            columns, last_s, checkpoint, identify, tuple(self._before.values()), self._reference
        )

    def _start(self) -> None:
        """Give the worker what is due: a request, a model, a checkpoint."""
        now = time.monotonic()
        asked = self._waiting.popleft() if self._waiting else None
        buffered = max(b.buffered_s for b in self._buffers.values())
        due = now >= self._next_s and buffered >= value(self, "first_after_s")
        keep = bool(self._checkpoint) and now >= self._next_checkpoint_s and buffered > 0
        if not (asked or due or keep):
            return
        last_s = asked[0].last_s if asked and asked[0].last_s > 0.0 else None
        self._answering = asked[1:] if asked else None
        self._submitted_s = now
        if keep:
            self._next_checkpoint_s = now + value(self, "checkpoint_period_s")
        checkpoint = self._checkpoint if keep else ""
        self._worker.submit(self._job(last_s, checkpoint, bool(asked or due)))

    def _finish(self, answer: Answer) -> None:
        """Publish what the worker found; answer who asked for it."""
        now = time.monotonic()
        pause = (now - self._submitted_s) / value(self, "max_load")
        self._next_s = self._submitted_s + max(value(self, "publish_period_s"), pause)
        self._checkpoint_problem = answer.checkpoint_problem
        self._problem = answer.problem
        message = None
        if answer.findings is not None:
            self._found = answer.findings
            message = model_message(answer.findings)
            self._model.publish(message)
            for curve in allan_messages(answer.findings):
                self._allan.publish(curve)
            if self._reference is not None:
                self._discrepancy.publish(discrepancy_message(answer.findings))
        if self._answering is not None:
            response, reply = self._answering
            self._answering = None
            response.success = message is not None
            response.message = answer.problem or _span_text(answer.findings)
            if message is not None:
                response.model = message
            reply(response)

    def _on_identify(
        self, request: Identify.Request, response: Identify.Response, reply: Reply
    ) -> None:
        if not any(buffer.size for buffer in self._buffers.values()):
            response.message = f"no message has come on {', '.join(self._topics())}: start a driver"
            reply(response)
        elif not 0.0 <= request.last_s < float("inf"):
            response.message = f"last_s is {request.last_s}: give 0 (everything) or a time in s"
            reply(response)
        else:
            self._waiting.append((request, response, reply))

    def _on_reset(self, request: Reset.Request, response: Reset.Response) -> Reset.Response:
        self._receive()
        topics = self._topics()
        unknown = sorted(set(request.topics) - set(topics))
        if unknown:
            response.message = f"not a topic of this node: {', '.join(unknown)}"
            return response
        forgotten = 0
        for kind, stream in self._streams.items():
            if request.topics and stream.receiver.topic not in request.topics:
                continue
            forgotten += self._forget(kind)
        if not any(buffer.size for buffer in self._buffers.values()):
            self._found = None
        response.success = True
        response.message = f"{forgotten} samples of {', '.join(request.topics or topics)} forgotten"
        return response

    def _topics(self) -> list[str]:
        return [stream.receiver.topic for stream in self._streams.values()]

    def _tell(self) -> None:
        """Look at the publishers, then publish diagnostics."""
        now_ns = time.time_ns()
        statuses = []
        for kind, stream in self._streams.items():
            if stream.receiver.look():
                self._forget(kind)
            if kind != "imu" and not stream.known:
                continue
            found = stream.status(self.get_name(), now_ns)
            buffered = f"{self._buffers[kind].buffered_s:.1f}"
            found.values.append(KeyValue(key="buffered_s", value=buffered))
            statuses.append(found)
        statuses.append(self._model_status())
        self._diagnostics.publish(array(statuses, self.get_clock().now().nanoseconds))

    def _model_status(self) -> DiagnosticStatus:
        found = self._found
        problems = [p for p in (self._problem, self._checkpoint_problem) if p]
        numbers: dict[str, object] = {"identifying": self._worker.busy}
        said: list[str] = []
        if found is None:
            said.append(f"no model yet: {value(self, 'first_after_s'):g} s of samples make one")
        else:
            moved = [c.name for c in found.channels if not c.quality.static]
            said.append("the platform moved" if moved else "the platform stands still")
            numbers |= {"static": not moved, "described": found.span.what}
            numbers |= {"channels": len(found.channels), "span_s": f"{found.span.to_s:.1f}"}
        level = DiagnosticStatus.WARN if problems else DiagnosticStatus.OK
        text = "; ".join([*problems, *said])
        return status(level, f"{self.get_name()}: model", text, numbers)


def _span_text(found: Findings | None) -> str:
    if found is None:
        return ""
    return f"{found.span.what}, {found.span.to_s - found.span.from_s:.1f} s"


def run_node(argv: Sequence[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit status."""
    return spin_node(IdentifyNode, argv, "identify", SETTINGS)
