"""``play``: a bag's messages on their topics, in time, with ``/clock``."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import rclpy
from imu_noise_id.errors import InputError
from imu_noise_id.ros.messages import to_time
from imu_noise_id.ros.runtime import Stop, message_class
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock

from nav_fusion.replay import Timetable, choose, read_messages

_DEPTH = 5000
_CLOCK_STEP_NS = 10_000_000
_LONGEST_SLEEP_S = 0.05
_ACKNOWLEDGED_S = 5.0
_LATE_NS = 1_000_000
_SETTLE_NS = 300_000_000
_SWITCH_S = 2e-4


@dataclass
class Played:
    """What a replay did.

    Attributes
    ----------
    messages, late : int
        Published, and those of them more than a millisecond after their time.
    latest_s : float
    """

    messages: int = 0
    late: int = 0
    latest_s: float = 0.0

    def count(self, behind_ns: int) -> None:
        """Count a message that was published so long after its time."""
        self.messages += 1
        if behind_ns > _LATE_NS:
            self.late += 1
            self.latest_s = max(self.latest_s, behind_ns * 1e-9)


class Player:
    """Publishers for a bag's topics; the bytes of the bag go out as they are."""

    def __init__(self, node: Node, types: Mapping[str, str], rate: float) -> None:
        self._rate = rate
        self._clock = node.create_publisher(Clock, "/clock", 10)
        self._publishers = _publishers(node, types)
        self.played = Played()

    @property
    def topics(self) -> list[str]:
        """Topics that can be played."""
        return list(self._publishers)

    def wait_for_subscribers(self, wait_s: float, stopped: Callable[[], bool]) -> None:
        """Wait until every topic has a subscriber, but no longer than so."""
        end = time.monotonic() + wait_s
        while time.monotonic() < end and not stopped():
            if all(p.get_subscription_count() for p in self._publishers.values()):
                # a subscriber takes note of us a moment after we do of it, and nothing says when
                _sleep_until(time.monotonic_ns() + _SETTLE_NS, stopped)
                return
            time.sleep(0.01)

    def play(self, bag: str | Path, stopped: Callable[[], bool]) -> None:
        """Publish a bag from its first to its last message."""
        table: Timetable | None = None
        clock_ns = 0
        step_ns = max(round(_CLOCK_STEP_NS * self._rate), 1)
        for batch in read_messages(bag, self.topics):
            for log_ns, topic, data in batch:
                if table is None:
                    table = Timetable(log_ns, time.monotonic_ns(), self._rate)
                    clock_ns = log_ns
                while clock_ns <= log_ns and not stopped():
                    _sleep_until(table.due(clock_ns), stopped)
                    self._clock.publish(Clock(clock=to_time(clock_ns)))
                    clock_ns += step_ns
                due_ns = table.due(log_ns)
                _sleep_until(due_ns, stopped)
                if stopped():
                    return
                self._publishers[topic].publish(data)
                self.played.count(time.monotonic_ns() - due_ns)

    def finish(self) -> bool:
        """Wait until all reliable subscribers have everything; say whether they do."""
        timeout = Duration(seconds=_ACKNOWLEDGED_S)
        acknowledged = [p.wait_for_all_acked(timeout) for p in self._publishers.values()]
        return all(acknowledged)


def _publishers(node: Node, types: Mapping[str, str]) -> dict[str, Publisher]:
    qos = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.RELIABLE)
    made = {}
    for topic, name in types.items():
        try:
            made[topic] = node.create_publisher(message_class(name), topic, qos)
        except (ImportError, ValueError):
            print(f"note: {topic} is left out: {name} is not installed", file=sys.stderr)
    return made


def _sleep_until(due_ns: int, stopped: Callable[[], bool]) -> None:
    while (left_s := (due_ns - time.monotonic_ns()) * 1e-9) > 0.0 and not stopped():
        time.sleep(min(left_s, _LONGEST_SLEEP_S))


def run_play(
    bag: str, rate: float, loop: bool, topics: Sequence[str], wait_s: float, argv: Sequence[str]
) -> Played:
    """Play a bag, once or until stopped.

    Raises
    ------
    InputError
        When the bag cannot be read or none of its topics can be played.
    """
    types = choose(bag, topics)
    # the thread that reads ahead must not keep a message waiting for the interpreter
    sys.setswitchinterval(_SWITCH_S)
    rclpy.init(args=list(argv), signal_handler_options=SignalHandlerOptions.NO)
    stop = Stop()
    node = Node("play", start_parameter_services=False)
    try:
        player = Player(node, types, rate)
        if not player.topics:
            raise InputError(f"{bag}: no topic with an installed type: install their packages")
        player.wait_for_subscribers(wait_s, lambda: stop.asked)
        player.play(bag, lambda: stop.asked)
        while loop and player.played.messages and not stop.asked:
            player.play(bag, lambda: stop.asked)
        if not stop.asked and not player.finish():
            print("note: a subscriber did not acknowledge everything", file=sys.stderr)
        return player.played
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
