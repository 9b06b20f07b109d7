"""What ``fuse`` puts out, live and into a bag: the same bytes from the same function."""

from __future__ import annotations

import numpy as np
from imu_noise_id.cdr import Bytes

from imu_noise_id import cdr
from nav_fusion.solution import Solution

ODOMETRY_TOPIC = "/odometry/filtered"
FIX_TOPIC = "/gps/filtered"
WORLD_FRAME = "map"
BODY_FRAME = "base_link"
_COVARIANCE_KNOWN = 3.0


def odometry_messages(
    solution: Solution, world_frame: str = WORLD_FRAME, body_frame: str = BODY_FRAME
) -> Bytes:
    """nav_msgs/Odometry, one a row: pose in the world's east, north, up, twist in body axes."""
    numbers = np.concatenate(
        (
            solution.position,
            solution.orientation[:, [1, 2, 3, 0]],
            _flat(solution.pose_covariance),
            solution.body_velocity,
            solution.body_rate,
            _flat(solution.twist_covariance),
        ),
        axis=1,
    )
    rows = cdr.encode(cdr.ODOMETRY, solution.stamp_ns, {}, world_frame, body_frame)
    return _filled(rows, numbers, rows.shape[1])


def fix_messages(solution: Solution, body_frame: str = BODY_FRAME) -> Bytes:
    """sensor_msgs/NavSatFix of the antenna with its east-north-up covariance, one a row."""
    numbers = np.concatenate((solution.antenna, _flat(solution.antenna_covariance)), axis=1)
    members = {"covariance_type": _COVARIANCE_KNOWN}
    rows = cdr.encode(cdr.NAV_SAT_FIX, solution.stamp_ns, members, body_frame)
    return _filled(rows, numbers, rows.shape[1] - 1)


def _flat(matrices: np.ndarray) -> np.ndarray:
    return matrices.reshape(matrices.shape[0], matrices.shape[1] * matrices.shape[2])


def _filled(rows: Bytes, numbers: np.ndarray, end: int) -> Bytes:
    """Messages with all their float64 members, which lie side by side and end at a byte."""
    size = 8 * numbers.shape[1]
    raw = np.ascontiguousarray(numbers, dtype="<f8").view(np.uint8)
    rows[:, end - size : end] = raw.reshape(rows.shape[0], size)
    return rows
