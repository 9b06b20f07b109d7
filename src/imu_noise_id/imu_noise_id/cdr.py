"""ROS messages as bytes: many of them to columns of numbers, columns of numbers to many of them.

The reader of bags and the live nodes decode with the same function, so that the same bytes give
the same numbers.  A message is a 4-byte encapsulation header followed by its members in order,
each aligned to its own size relative to the end of that header (OMG DDSI-RTPS 2.5, section 10,
"plain CDR", little endian).  All types here begin with a ``std_msgs/Header`` and are, but for a few
bytes, a row of float64 behind it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from imu_noise_id.recording import Floats, Mask, Stamps

Bytes = NDArray[np.uint8]
Positions = NDArray[np.int64]

IMU = "sensor_msgs/msg/Imu"
MAGNETIC_FIELD = "sensor_msgs/msg/MagneticField"
TEMPERATURE = "sensor_msgs/msg/Temperature"
NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"
TWIST = "geometry_msgs/msg/TwistStamped"
TWIST_WITH_COVARIANCE = "geometry_msgs/msg/TwistWithCovarianceStamped"
ODOMETRY = "nav_msgs/msg/Odometry"

_ENCAPSULATION = 4
_LITTLE_ENDIAN_PLAIN_CDR = 0x0100  # bytes 00 01, read as a little-endian number
_PADDING = 8  # a serialiser may round a message up to a multiple of 4 or 8
_LONGEST_STRING = 4096


@dataclass(frozen=True)
class Layout:
    """Where the numbers of a message type lie.

    Attributes
    ----------
    type : str
    members : tuple of str
        The float64 members in order, arrays written out (``position_covariance.0``, ...).
    kept : tuple of int
        The members that `decode` returns.
    child_frame, fix_status : bool
        Whether ``child_frame_id`` precedes the numbers (Odometry), and whether a NavSatStatus
        precedes and a covariance type follows them (NavSatFix).
    """

    type: str
    members: tuple[str, ...]
    kept: tuple[int, ...]
    child_frame: bool = False
    fix_status: bool = False

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the rows of `Decoded.values`."""
        names = tuple(self.members[k] for k in self.kept)
        return (*names, "status", "covariance_type") if self.fix_status else names


def _numbered(name: str, count: int) -> tuple[str, ...]:
    return tuple(f"{name}.{k}" for k in range(count))


def _axes(name: str, axes: str = "xyz") -> tuple[str, ...]:
    return tuple(f"{name}.{axis}" for axis in axes)


def _layout(
    msgtype: str, *members: tuple[str, ...], keep: Sequence[str] | None = None, **flags: bool
) -> Layout:
    names = tuple(name for group in members for name in group)
    kept = tuple(k for k, name in enumerate(names) if keep is None or name.split(".")[0] in keep)
    return Layout(msgtype, names, kept, **flags)


_TWIST_MEMBERS = (_axes("linear"), _axes("angular"))

LAYOUTS: Mapping[str, Layout] = {
    layout.type: layout
    for layout in (
        _layout(
            IMU,
            _axes("orientation", "xyzw"),
            _numbered("orientation_covariance", 9),
            _axes("angular_velocity"),
            _numbered("angular_velocity_covariance", 9),
            _axes("linear_acceleration"),
            _numbered("linear_acceleration_covariance", 9),
            keep=("angular_velocity", "linear_acceleration"),
        ),
        _layout(
            MAGNETIC_FIELD,
            _axes("magnetic_field"),
            _numbered("magnetic_field_covariance", 9),
            keep=("magnetic_field",),
        ),
        _layout(TEMPERATURE, ("temperature", "variance"), keep=("temperature",)),
        _layout(
            NAV_SAT_FIX,
            ("latitude", "longitude", "altitude"),
            _numbered("position_covariance", 9),
            fix_status=True,
        ),
        _layout(TWIST, *_TWIST_MEMBERS, keep=("linear",)),
        _layout(TWIST_WITH_COVARIANCE, *_TWIST_MEMBERS, _numbered("covariance", 36)),
        _layout(
            ODOMETRY,
            _axes("position"),
            _axes("orientation", "xyzw"),
            _numbered("pose_covariance", 36),
            *_TWIST_MEMBERS,
            _numbered("twist_covariance", 36),
            child_frame=True,
        ),
    )
}


@dataclass(frozen=True)
class Decoded:
    """The messages of one topic as columns.

    Attributes
    ----------
    stamp_ns : (n,) int64
        Header stamps.
    values : (k, n) float64
        One row for each of the layout's `columns`.
    valid : (m,) bool
        Which of the m messages given were whole; the n are those.
    frame_ids : frozenset of bytes
        The distinct ``frame_id`` met.
    """

    stamp_ns: Stamps
    values: Floats
    valid: Mask
    frame_ids: frozenset[bytes]


def decode(msgtype: str, buffer: Bytes, start: Positions, size: Positions) -> Decoded:
    """Decode the messages that lie in ``buffer[start:start + size]``.

    Parameters
    ----------
    msgtype : str
        A key of `LAYOUTS`.
    buffer : (b,) uint8
    start, size : (m,) int64
        Each message's first byte and length; must lie inside the buffer.

    Returns
    -------
    Decoded
        A message that is shorter or longer than its type, or in another encoding, is not valid
        and contributes nothing.
    """
    layout = LAYOUTS[msgtype]
    valid = size >= _ENCAPSULATION + 12
    every = bool(valid.all())
    begin, length = (start, size) if every else (start[valid], size[valid])
    whole = gather(buffer, "<u2", begin) == _LITTLE_ENDIAN_PLAIN_CDR
    origin = begin + _ENCAPSULATION
    end = begin + length
    text_at, text_size, behind = _skip_string(buffer, origin + 8, end)
    if layout.child_frame:
        behind = _skip_string(buffer, origin + _align(behind - origin, 4), end)[2]
    if layout.fix_status:
        status_at = behind
        behind = origin + _align(behind - origin + 1, 2) + 2
    numbers = origin + _align(behind - origin, 8)
    last = numbers + 8 * len(layout.members) + layout.fix_status
    whole &= (last <= end) & (last + _PADDING > end)
    if not whole.all():
        if every:
            valid = whole
        else:
            valid[valid] = whole
        origin, numbers = origin[whole], numbers[whole]
        text_at, text_size = text_at[whole], text_size[whole]
        if layout.fix_status:
            status_at = status_at[whole]
    values = np.empty((len(layout.columns), origin.size))
    _gather_members(buffer, numbers, layout.kept, values)
    if layout.fix_status:
        values[-2] = gather(buffer, "i1", status_at)
        values[-1] = gather(buffer, "u1", numbers + 8 * len(layout.members))
    frames = _distinct_strings(buffer, text_at, text_size)
    return Decoded(_stamps(buffer, origin), values, valid, frames)


def decode_batch(msgtype: str, messages: Sequence[bytes]) -> Decoded:
    """Decode serialised messages of one type, for instance those of a raw subscription."""
    size = np.fromiter((len(m) for m in messages), np.int64, len(messages))
    start = np.cumsum(size) - size
    return decode(msgtype, np.frombuffer(b"".join(messages), np.uint8), start, size)


def gather(buffer: Bytes, dtype: str, at: Positions) -> NDArray[np.generic]:
    """Items of `dtype` that begin at the byte positions `at`, aligned or not."""
    kind = np.dtype(dtype)
    count = buffer.size - kind.itemsize + 1
    if at.size == 0 or count <= 0:
        return np.empty(0, kind)
    window: NDArray[np.generic] = np.ndarray((count,), kind, buffer=buffer, strides=(1,))
    return window[at]


def _gather_members(
    buffer: Bytes, numbers: Positions, kept: tuple[int, ...], values: Floats
) -> None:
    """Fill rows of `values`, neighbouring members in one go."""
    row = 0
    while row < len(kept):
        count = 1
        while row + count < len(kept) and kept[row + count] == kept[row] + count:
            count += 1
        items = gather(buffer, f"V{8 * count}", numbers + 8 * kept[row])
        values[row : row + count] = items.view("<f8").reshape(-1, count).T
        row += count


def _align(offset: Positions, size: int) -> Positions:
    return (offset + (size - 1)) & -size


def _skip_string(
    buffer: Bytes, at: Positions, end: Positions
) -> tuple[Positions, Positions, Positions]:
    """Position, length (with its zero byte) and end of strings; past the message if too long."""
    inside = at + 4 <= end
    size = gather(buffer, "<u4", np.where(inside, at, 0)).astype(np.int64)
    size = np.where(inside & (size <= _LONGEST_STRING), size, _LONGEST_STRING * 4)
    return at + 4, size, at + 4 + size


def _stamps(buffer: Bytes, origin: Positions) -> Stamps:
    seconds = gather(buffer, "<i4", origin).astype(np.int64)
    return seconds * 1_000_000_000 + gather(buffer, "<u4", origin + 4).astype(np.int64)


def _distinct_strings(buffer: Bytes, at: Positions, size: Positions) -> frozenset[bytes]:
    distinct: set[bytes] = set()
    for length in set(size.tolist()) if size.size and np.ptp(size) else set(size[:1].tolist()):
        if length == 0:
            distinct.add(b"")
            continue
        texts = gather(buffer, f"S{length}", at[size == length])
        distinct.update(texts[:1].tolist() if (texts == texts[0]).all() else set(texts.tolist()))
    return frozenset(distinct)


def encode(
    msgtype: str,
    stamp_ns: Stamps,
    members: Mapping[str, Floats | float],
    frame_id: str,
    child_frame_id: str = "",
) -> Bytes:
    """Serialise messages, one a row.

    Parameters
    ----------
    msgtype : str
        A key of `LAYOUTS`.
    stamp_ns : (n,) int64
    members : mapping of str to (n,) float64 or float
        By the names of the layout's members, ``status`` and ``covariance_type`` included; those
        not named are 0.
    frame_id, child_frame_id : str

    Returns
    -------
    (n, size) uint8

    Raises
    ------
    KeyError
        For a name that the type does not have.
    """
    layout = LAYOUTS[msgtype]
    known = {*layout.members, *layout.columns}
    if unknown := set(members) - known:
        raise KeyError(f"{msgtype} has no member {sorted(unknown)[0]}")
    head, status_at = _head(msgtype, frame_id, child_frame_id)
    numbers = head.size
    rows = np.zeros((stamp_ns.size, numbers + 8 * len(layout.members)), np.uint8)
    rows[:, :numbers] = head
    seconds, nanoseconds = np.divmod(stamp_ns, 1_000_000_000)
    _put(rows, _ENCAPSULATION, seconds.astype("<i4"))
    _put(rows, _ENCAPSULATION + 4, nanoseconds.astype("<u4"))
    for k, name in enumerate(layout.members):
        if name in members:
            column = np.broadcast_to(np.asarray(members[name], dtype="<f8"), stamp_ns.shape)
            _put(rows, numbers + 8 * k, column)
    if not layout.fix_status:
        return rows
    rows[:, status_at] = np.asarray(members.get("status", 0.0)).astype(np.int8).view(np.uint8)
    kind = np.asarray(members.get("covariance_type", 0.0)).astype(np.uint8)
    return np.column_stack((rows, np.broadcast_to(kind, stamp_ns.shape)))


@lru_cache(maxsize=64)
def _head(msgtype: str, frame_id: str, child_frame_id: str) -> tuple[Bytes, int]:
    """What every message of a topic begins with, its stamp 0; and where a fix's status lies."""
    layout = LAYOUTS[msgtype]
    head = _string_bytes(b"\0" * 8, frame_id)
    if layout.child_frame:
        head = _string_bytes(_pad(head, 4), child_frame_id)
    status_at = _ENCAPSULATION + len(head)
    if layout.fix_status:
        head = _pad(head + b"\0", 2) + b"\1\0"  # service: GPS
    return np.frombuffer(b"\0\1\0\0" + _pad(head, 8), np.uint8), status_at


def _put(rows: Bytes, at: int, column: NDArray[np.generic]) -> None:
    size = column.dtype.itemsize
    flat = np.ascontiguousarray(column).view(np.uint8).reshape(rows.shape[0], size)
    rows[:, at : at + size] = flat


def _pad(data: bytes, size: int) -> bytes:
    return data + b"\0" * (-len(data) % size)


def _string_bytes(head: bytes, text: str) -> bytes:
    encoded = text.encode() + b"\0"
    return head + len(encoded).to_bytes(4, "little") + encoded
