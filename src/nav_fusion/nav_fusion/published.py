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
    w, x, y, z = solution.orientation.T
    members = _named("position", "xyz", solution.position)
    members |= {"orientation.x": x, "orientation.y": y, "orientation.z": z, "orientation.w": w}
    members |= _named("linear", "xyz", solution.body_velocity)
    members |= _named("angular", "xyz", solution.body_rate)
    members |= _numbered("pose_covariance", solution.pose_covariance)
    members |= _numbered("twist_covariance", solution.twist_covariance)
    return cdr.encode(cdr.ODOMETRY, solution.stamp_ns, members, world_frame, body_frame)


def fix_messages(solution: Solution, body_frame: str = BODY_FRAME) -> Bytes:
    """sensor_msgs/NavSatFix of the antenna with its east-north-up covariance, one a row."""
    names = ("latitude", "longitude", "altitude")
    members = dict(zip(names, solution.antenna.T, strict=True))
    members |= _numbered("position_covariance", solution.antenna_covariance)
    members["covariance_type"] = np.full(solution.stamp_ns.size, _COVARIANCE_KNOWN)
    return cdr.encode(cdr.NAV_SAT_FIX, solution.stamp_ns, members, body_frame)


def _named(name: str, axes: str, rows: np.ndarray) -> dict[str, np.ndarray]:
    return {f"{name}.{axis}": column for axis, column in zip(axes, rows.T, strict=True)}


def _numbered(name: str, matrices: np.ndarray) -> dict[str, np.ndarray]:
    flat = matrices.reshape(matrices.shape[0], -1)
    return {f"{name}.{k}": column for k, column in enumerate(flat.T)}
