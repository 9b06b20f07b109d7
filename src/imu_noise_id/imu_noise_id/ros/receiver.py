"""A raw subscription that hears every publisher of its topic."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from imu_noise_id.ros.runtime import message_class

_RELIABLE, _BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT


class Receiver:
    """Hands on the serialised messages of one topic as they come.

    It asks for reliable delivery, and for best effort while a publisher offers no more.  Where
    several types will do it takes the one that is published.

    No event of the middleware is asked for: taking one while its listener counts another (a lost
    sample, a mismatch) takes two locks in the other order, and both threads wait for ever
    (rmw_fastrtps 8.4).  `look` asks the graph instead, and a lost message shows as a gap of stamps.

    Attributes
    ----------
    topic, type : str
    complaints : tuple of str
        What is wrong with the topic's publishers, one sentence each, as of the last `look`.
    publishers : int
        Matched by the subscription, so that nothing that they send from now on is missed.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        types: Sequence[str],
        depth: int,
        deliver: Callable[[bytes], None],
    ) -> None:
        self._node = node
        self._deliver = deliver
        self._types = tuple(types)
        self._depth = depth
        self._reliability = _RELIABLE
        self.type = types[0]
        self.complaints: tuple[str, ...] = ()
        self.publishers = 0
        self._subscription = self._subscribe(topic)
        self.topic = self._subscription.topic_name

    def look(self) -> bool:
        """Look at the publishers, subscribe anew where they ask for it; say if the type changed."""
        found = self._node.get_publishers_info_by_topic(self.topic)
        fitting = [p for p in found if p.topic_type in self._types]
        self.publishers = self._subscription.get_publisher_count()
        types = {p.topic_type for p in fitting}
        weak = any(p.qos_profile.reliability == _BEST_EFFORT for p in fitting)
        reliability = _BEST_EFFORT if weak else _RELIABLE
        wrong = sorted({f"{_node_of(p)} ({p.topic_type})" for p in found if p not in fitting})
        said = []
        if wrong:
            said.append(f"not {' or '.join(self._types)}, unheard: {', '.join(wrong)}")
        if len(fitting) > 1:
            said.append(f"{len(fitting)} publishers: {', '.join(sorted(map(_node_of, fitting)))}")
        if weak:
            said.append("a publisher offers best effort only: what it loses stays lost")
        self.complaints = tuple(said)
        changed = bool(types) and self.type not in types
        if changed:
            self.type = min(types)
        if changed or (fitting and reliability != self._reliability):
            self._reliability = reliability
            self._node.destroy_subscription(self._subscription)
            self._subscription = self._subscribe(self.topic)
        return changed

    def _subscribe(self, topic: str) -> Subscription:
        qos = QoSProfile(depth=self._depth, reliability=self._reliability)
        events = SubscriptionEventCallbacks(use_default_callbacks=False)
        kind = message_class(self.type)
        return self._node.create_subscription(
            kind, topic, self._deliver, qos, event_callbacks=events, raw=True
        )


def _node_of(endpoint: object) -> str:
    namespace: str = endpoint.node_namespace  # type: ignore[attr-defined]
    return f"{namespace.rstrip('/')}/{endpoint.node_name}"  # type: ignore[attr-defined]
