"""One sensor's topic in a live node: received, decoded, watched."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.node import Node

from imu_noise_id.cdr import Decoded, decode_batch
from imu_noise_id.recording import Stamps
from imu_noise_id.ros.diagnostics import StreamDiagnosis
from imu_noise_id.ros.receiver import Receiver
from imu_noise_id.topics import TYPES
from imu_noise_id.watch import StreamWatch


class Stream:
    """A receiver with the watch over what it receives.

    Parameters
    ----------
    node : Node
    kind : str
        Of sensor, a key of `topics.TYPES`.
    topic : str
    depth : int
        Messages that may wait.
    deliver : callable, optional
        Takes each message as it comes; without it they wait for `take`.
    """

    def __init__(
        self,
        node: Node,
        kind: str,
        topic: str,
        depth: int,
        deliver: Callable[[bytes], None] | None = None,
    ) -> None:
        self._data: list[bytes] = []
        self._log_ns: list[int] = []
        self.receiver = Receiver(node, topic, TYPES[kind], depth, deliver or self._keep)
        self.reset()

    def reset(self) -> None:
        """Count from zero."""
        self.watch = StreamWatch()
        self.diagnosis = StreamDiagnosis()

    @property
    def known(self) -> bool:
        """Whether anybody publishes the topic, has, or offers another type under its name."""
        receiver = self.receiver
        return bool(receiver.publishers or self.watch.received or receiver.complaints)

    def take(self) -> tuple[Decoded, Stamps] | None:
        """What has come since the last call, decoded, and when; None where nothing has."""
        data, log_ns = self._data, self._log_ns
        if not data:
            return None
        self._data, self._log_ns = [], []
        decoded, times = self.decode(data), np.array(log_ns, np.int64)
        self.watch.feed(decoded, times)
        return decoded, times

    def decode(self, data: Sequence[bytes]) -> Decoded:
        """Decode messages of the topic; the watch has not seen them yet."""
        return decode_batch(self.receiver.type, data)

    def status(self, owner: str, now_ns: int) -> DiagnosticStatus:
        """Diagnostics of this topic."""
        receiver = self.receiver
        name = f"{owner}: {receiver.topic}"
        found = self.diagnosis.status(name, self.watch, receiver.complaints, now_ns)
        found.values.append(KeyValue(key="publishers", value=str(receiver.publishers)))
        return found

    def _keep(self, data: bytes) -> None:
        self._data.append(data)
        self._log_ns.append(time.time_ns())
