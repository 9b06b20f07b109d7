"""One sensor's topic in a live node: received, decoded, watched."""

from __future__ import annotations

from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from imu_noise_id.cdr import Decoded, decode_batch
from imu_noise_id.recording import Stamps
from imu_noise_id.ros.diagnostics import StreamDiagnosis
from imu_noise_id.ros.receiver import Receiver
from imu_noise_id.topics import TYPES
from imu_noise_id.watch import StreamWatch


@dataclass
class Stream:
    """A receiver with the watch over what it receives."""

    receiver: Receiver
    watch: StreamWatch = field(default_factory=StreamWatch)
    diagnosis: StreamDiagnosis = field(default_factory=StreamDiagnosis)

    def take(self) -> tuple[Decoded, Stamps] | None:
        """What has come since the last call, decoded, and when; None where nothing has."""
        data, log_ns = self.receiver.take()
        if not data:
            return None
        decoded = decode_batch(self.receiver.type, data)
        self.watch.feed(decoded, log_ns)
        return decoded, log_ns

    def status(self, owner: str, now_ns: int) -> DiagnosticStatus:
        """Diagnostics of this topic."""
        receiver = self.receiver
        name = f"{owner}: {receiver.topic}"
        return self.diagnosis.status(name, self.watch, receiver.complaints, now_ns)

    def reset(self) -> None:
        """Count from zero."""
        self.watch = StreamWatch()
        self.diagnosis = StreamDiagnosis()


def open_stream(node: Node, kind: str, topic: str, depth: int) -> Stream:
    """Subscribe to the topic of a kind of sensor."""
    return Stream(Receiver(node, topic, TYPES[kind], depth))
