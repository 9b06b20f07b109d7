"""The body's pose on ``/tf``, on machines that have tf2."""

from __future__ import annotations

from collections.abc import Callable

from geometry_msgs.msg import TransformStamped
from imu_noise_id.ros.messages import to_time
from rclpy.node import Node

from nav_fusion.solution import Solution


def transform_sender(
    node: Node, wanted: bool, world_frame: str, body_frame: str
) -> Callable[[Solution], None]:
    """Return a function that sends the newest pose; it does nothing where tf2 is not installed."""
    try:
        from tf2_ros import TransformBroadcaster
    except ImportError:
        return _send_nothing
    if not wanted:
        return _send_nothing
    broadcaster = TransformBroadcaster(node)

    def send(solution: Solution) -> None:
        message = TransformStamped(child_frame_id=body_frame)
        message.header.frame_id = world_frame
        message.header.stamp = to_time(int(solution.stamp_ns[-1]))
        move, turn = message.transform.translation, message.transform.rotation
        move.x, move.y, move.z = solution.position[-1].tolist()
        turn.w, turn.x, turn.y, turn.z = solution.orientation[-1].tolist()
        broadcaster.sendTransform(message)

    return send


def _send_nothing(solution: Solution) -> None:
    del solution
