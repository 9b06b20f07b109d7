"""Arrays to a rosbag2 folder: ``metadata.yaml``, MCAP, message definitions embedded."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import yaml
from rosbags.typesys import Stores, get_typestore

from imu_noise_id import cdr
from imu_noise_id.errors import OutputError
from imu_noise_id.files import scratch_folder
from imu_noise_id.geodesy import curvature_radii
from imu_noise_id.mcap_writer import TopicBytes, write_mcap
from imu_noise_id.recording import Channel, Floats, Recording, Stamps

ORIGIN_DEG = (45.0, 7.0)
"""Latitude and longitude at which positions about a mean are written."""
HORIZONTAL_FIELD_T = 2e-5
"""Strength of the field that a heading without a field is written as."""
_TYPES = {
    "angular_velocity": cdr.IMU,
    "linear_acceleration": cdr.IMU,
    "magnetic_field": cdr.MAGNETIC_FIELD,
    "heading": cdr.MAGNETIC_FIELD,
    "temperature": cdr.TEMPERATURE,
    "position": cdr.NAV_SAT_FIX,
    "velocity": cdr.TWIST,
}
_FRAMES = {cdr.NAV_SAT_FIX: "gps", cdr.TWIST: "enu"}


class _Dumper(yaml.SafeDumper):
    """Writes a mapping out each time that it comes: rosbag2 need not know YAML's anchors."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def write_bag(path: str | Path, topics: Sequence[TopicBytes], compressed: bool = True) -> None:
    """Write a bag, all topics sorted by time.

    The bag is written beside its place and moved there when it is whole; in a folder that is there
    already its files replace those of the same name.

    Raises
    ------
    OutputError
        When the place cannot be written.
    """
    target = Path(path)
    try:
        with scratch_folder(target) as folder:
            draft = folder / target.name
            _write(draft, topics, compressed)
            _move(draft, target)
    except OSError as error:
        raise OutputError(
            f"{path}: cannot be written ({error.strerror or error}); choose another --output"
        ) from error


def write_recording(recording: Recording, path: str | Path) -> None:
    """Write every channel of a recording on its topic.

    Axes of one topic that are stamped differently are written at all their stamps, NaN where one
    has no sample; an Imu's sensor without channels is 0 with its covariance's first element -1, as
    sensor_msgs has it.  Positions are written about `ORIGIN_DEG`.  A heading beside its field is
    not written: it follows from the field.

    Raises
    ------
    OutputError
        When the place cannot be written.
    """
    channels = [*recording.channels, *([recording.temperature] if recording.temperature else [])]
    by_topic: dict[str, list[Channel]] = {}
    for channel in channels:
        by_topic.setdefault(channel.topic, []).append(channel)
    write_bag(path, [_topic_bytes(topic, group) for topic, group in by_topic.items()])


def _topic_bytes(topic: str, channels: Sequence[Channel]) -> TopicBytes:
    stamp_ns = channels[0].stamp_ns
    if any(not np.array_equal(c.stamp_ns, stamp_ns) for c in channels[1:]):
        stamp_ns = np.unique(np.concatenate([c.stamp_ns for c in channels]))
    columns = {c.name: _at(stamp_ns, c) for c in channels}
    msgtype = _TYPES[channels[0].name.split(".")[0]]
    rows = cdr.encode(msgtype, stamp_ns, _members(msgtype, columns), _FRAMES.get(msgtype, "imu"))
    return TopicBytes(topic, msgtype, stamp_ns, rows)


def _at(stamp_ns: Stamps, channel: Channel) -> Floats:
    if channel.stamp_ns.size == stamp_ns.size:
        return channel.values
    values = np.full(stamp_ns.size, np.nan)
    values[np.searchsorted(stamp_ns, channel.stamp_ns)] = channel.values
    return values


def _members(msgtype: str, columns: dict[str, Floats]) -> dict[str, Floats | float]:
    """Members of a message type by channels."""
    members: dict[str, Floats | float] = {}
    if msgtype == cdr.IMU:
        members = {**columns, "orientation.w": 1.0, "orientation_covariance.0": -1.0}
        for sensor in ("angular_velocity", "linear_acceleration"):
            if not any(name.startswith(sensor) for name in columns):
                members[f"{sensor}_covariance.0"] = -1.0
    elif msgtype == cdr.MAGNETIC_FIELD:
        angle = columns.pop("heading", None)
        members = {**columns}
        if angle is not None and not columns:
            members["magnetic_field.x"] = HORIZONTAL_FIELD_T * np.cos(angle)
            members["magnetic_field.y"] = -HORIZONTAL_FIELD_T * np.sin(angle)
    elif msgtype == cdr.NAV_SAT_FIX:
        latitude_rad = np.deg2rad(ORIGIN_DEG[0])
        meridian, prime_vertical = curvature_radii(latitude_rad)
        scales = {"latitude": meridian, "longitude": prime_vertical * np.cos(latitude_rad)}
        for name, axis, origin in zip(scales, ("north", "east"), ORIGIN_DEG, strict=True):
            metres = columns.get(f"position.{axis}", np.zeros(1))
            members[name] = origin + np.rad2deg(metres / scales[name])
        members["altitude"] = columns.get("position.up", 0.0)
    elif msgtype == cdr.TWIST:
        for axis, name in zip("xyz", ("east", "north", "up"), strict=True):
            members[f"linear.{axis}"] = columns.get(f"velocity.{name}", 0.0)
    else:
        members = {**columns}
    return members


def _write(path: Path, topics: Sequence[TopicBytes], compressed: bool) -> None:
    path.mkdir()
    store = _typestore()
    definitions = {t.type: store.generate_msgdef(t.type, ros_version=2)[0] for t in topics}
    information = _information(path, topics)
    with (path / f"{path.name}.mcap").open("wb") as file:
        write_mcap(file, topics, definitions, _yaml(information).strip(), compressed)
    (path / "metadata.yaml").write_text(_yaml({"rosbag2_bagfile_information": information}))


def _information(path: Path, topics: Sequence[TopicBytes]) -> dict[str, object]:
    """What rosbag2 (its version 9) says of a bag."""
    store, counts = _typestore(), [t.log_ns.size for t in topics]
    filled = [t.log_ns for t in topics if t.log_ns.size]
    first = min((int(t.min()) for t in filled), default=2**63 - 1)
    last = max((int(t.max()) for t in filled), default=first)
    extent = {
        "starting_time": {"nanoseconds_since_epoch": first},
        "duration": {"nanoseconds": last - first},
        "message_count": sum(counts),
    }
    described = [
        {
            "topic_metadata": {
                "name": t.topic,
                "type": t.type,
                "serialization_format": "cdr",
                "offered_qos_profiles": [],
                "type_description_hash": store.hash_rihs01(t.type),
            },
            "message_count": count,
        }
        for t, count in zip(topics, counts, strict=True)
    ]
    name = f"{path.name}.mcap"
    return {
        "version": 9,
        "storage_identifier": "mcap",
        "relative_file_paths": [name],
        **extent,
        "topics_with_message_count": described,
        "compression_format": "",
        "compression_mode": "",
        "files": [{"path": name, **extent}],
        "custom_data": None,
        "ros_distro": "jazzy",
    }


def _yaml(tree: dict[str, object]) -> str:
    return yaml.dump(tree, Dumper=_Dumper, sort_keys=False, width=1000)


def _move(draft: Path, target: Path) -> None:
    """Put the files of a finished bag in place, the metadata last."""
    if not target.exists():
        os.replace(draft, target)
        return
    for file in sorted(draft.iterdir(), key=lambda f: f.name == "metadata.yaml"):
        os.replace(file, target / file.name)


@cache
def _typestore():  # type: ignore[no-untyped-def]  # rosbags' Typestore is not exported
    return get_typestore(Stores.ROS2_JAZZY)


__all__ = ["TopicBytes", "write_bag", "write_recording"]
