"""Message definitions: whether a bag means by a type's name what the standard does."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache

from imu_noise_id import cdr

Members = tuple[tuple[str, str], ...]

TEXTS: Mapping[str, str] = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/msg/Pose": "Point position\nQuaternion orientation\n",
    "geometry_msgs/msg/PoseWithCovariance": "Pose pose\nfloat64[36] covariance\n",
    "geometry_msgs/msg/Twist": "Vector3 linear\nVector3 angular\n",
    "geometry_msgs/msg/TwistWithCovariance": "Twist twist\nfloat64[36] covariance\n",
    "sensor_msgs/msg/NavSatStatus": "int8 status\nuint16 service\n",
    cdr.IMU: "std_msgs/Header header\n"
    "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
    "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
    "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n",
    cdr.MAGNETIC_FIELD: "std_msgs/Header header\n"
    "geometry_msgs/Vector3 magnetic_field\nfloat64[9] magnetic_field_covariance\n",
    cdr.TEMPERATURE: "std_msgs/Header header\nfloat64 temperature\nfloat64 variance\n",
    cdr.NAV_SAT_FIX: "std_msgs/Header header\nNavSatStatus status\n"
    "float64 latitude\nfloat64 longitude\nfloat64 altitude\n"
    "float64[9] position_covariance\nuint8 position_covariance_type\n",
    cdr.TWIST: "std_msgs/Header header\nTwist twist\n",
    cdr.TWIST_WITH_COVARIANCE: "std_msgs/Header header\nTwistWithCovariance twist\n",
    cdr.ODOMETRY: "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist\n",
}
"""Members of the standard types (common_interfaces, ROS 2 Jazzy), comments left out."""

_WHOLE = [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
_PRIMITIVES = frozenset(
    (*_WHOLE, "bool", "byte", "char", "float32", "float64", "string", "wstring")
)
_MEMBER = re.compile(r"([\w/]+)(\[[^\]]*\])?\s+([a-z]\w*)(\s.*)?")
_SEPARATOR = re.compile(r"^=+\s*$", re.MULTILINE)
_DEEPEST = 8
_MOST_MEMBERS = 256


def full_name(name: str, package: str = "") -> str:
    """``std_msgs/Header`` and ``Header`` of the same package to ``std_msgs/msg/Header``."""
    parts = name.split("/")
    if len(parts) == 1 and package:
        parts = [package, *parts]
    return "/".join((parts[0], "msg", parts[-1])) if len(parts) > 1 else name


@lru_cache(maxsize=64)
def is_standard(msgtype: str, text: str) -> bool:
    """Whether a ``ros2msg`` definition lays a message out as the standard one does.

    Comments, white space, constants and default values make no difference; names do.
    """
    parts = _SEPARATOR.split(text)
    texts = {msgtype: parts[0]}
    for part in parts[1:]:
        head, _, body = part.lstrip().partition("\n")
        if not head.startswith("MSG:"):
            return False
        texts[full_name(head[4:].strip())] = body
    return _flat(msgtype, texts, 0) == _flat(msgtype, TEXTS, 0)


def _members(text: str) -> list[tuple[str, str, str]]:
    """Type, array suffix and name of each member; a constant is none."""
    found = []
    for line in (row.split("#")[0].strip() for row in text.splitlines()):
        match = _MEMBER.fullmatch(line)
        if match and not (match[4] or "").lstrip().startswith("="):
            found.append((match[1], match[2] or "", match[3]))
        elif line and "=" not in line:
            found.append(("?", "", line))
    return found


def _flat(msgtype: str, texts: Mapping[str, str], depth: int) -> Members | None:
    """Members written out down to primitives; None where a type is not defined."""
    if msgtype not in texts or depth > _DEEPEST:
        return None
    package = msgtype.split("/")[0]
    flat: list[tuple[str, str]] = []
    for kind, suffix, name in _members(texts[msgtype]):
        if kind in _PRIMITIVES:
            flat.append((kind + suffix, name))
            continue
        below = _flat(full_name(kind, package), texts, depth + 1)
        if below is None or suffix:
            return None
        flat += [(inner, f"{name}.{path}") for inner, path in below]
        if len(flat) > _MOST_MEMBERS:
            return None
    return tuple(flat)
