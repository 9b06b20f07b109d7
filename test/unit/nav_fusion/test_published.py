"""What ``fuse`` puts out, read back by an implementation that is not ours."""

import numpy as np
from nav_fusion.published import fix_messages, odometry_messages
from nav_fusion.solution import Solution
from rosbags.typesys import Stores, get_typestore

from imu_noise_id import cdr

STORE = get_typestore(Stores.ROS2_JAZZY)


def some(k: int, rng: np.random.Generator) -> Solution:
    def normal(*shape: int) -> np.ndarray:
        return rng.normal(size=(k, *shape))

    return Solution(
        10**18 + np.arange(k) * 20_000_001,
        normal(3),
        normal(3),
        normal(4),
        normal(6, 6),
        normal(3, 3),
        normal(3),
        normal(3),
        normal(6, 6),
        normal(3),
        normal(3, 3),
        np.ones(k, np.int64),
        np.zeros(k, bool),
        normal(3),
        abs(normal(3)),
        normal(3),
        abs(normal(3)),
    )


def vector(message: object) -> list[float]:
    return [message.x, message.y, message.z]  # type: ignore[attr-defined]


def test_odometry_has_every_number_in_its_place() -> None:
    solution = some(3, np.random.default_rng(1))
    rows = odometry_messages(solution, "earth", "robot")
    for k, row in enumerate(rows):
        found = STORE.deserialize_cdr(row.tobytes(), cdr.ODOMETRY)
        stamp = found.header.stamp.sec * 10**9 + found.header.stamp.nanosec
        assert stamp == solution.stamp_ns[k]
        assert (found.header.frame_id, found.child_frame_id) == ("earth", "robot")
        assert vector(found.pose.pose.position) == solution.position[k].tolist()
        turn = found.pose.pose.orientation
        assert [turn.w, turn.x, turn.y, turn.z] == solution.orientation[k].tolist()
        assert np.array_equal(found.pose.covariance, solution.pose_covariance[k].ravel())
        assert vector(found.twist.twist.linear) == solution.body_velocity[k].tolist()
        assert vector(found.twist.twist.angular) == solution.body_rate[k].tolist()
        assert np.array_equal(found.twist.covariance, solution.twist_covariance[k].ravel())


def test_a_fix_has_place_and_covariance() -> None:
    solution = some(2, np.random.default_rng(2))
    for k, row in enumerate(fix_messages(solution, "antenna")):
        found = STORE.deserialize_cdr(row.tobytes(), cdr.NAV_SAT_FIX)
        assert found.header.frame_id == "antenna"
        place = [found.latitude, found.longitude, found.altitude]
        assert place == solution.antenna[k].tolist()
        covariance = solution.antenna_covariance[k].ravel()
        assert np.array_equal(found.position_covariance, covariance)
        assert (found.status.status, found.position_covariance_type) == (0, 3)
