"""Arrays to a rosbag2 folder: ``metadata.yaml``, MCAP, message definitions embedded."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from imu_noise_id.cdr import Bytes
from imu_noise_id.errors import InputError
from imu_noise_id.recording import Stamps


@dataclass(frozen=True)
class TopicBytes:
    """The messages of a topic, serialised.

    Attributes
    ----------
    topic, type : str
    log_ns : (n,) int64
        Times of reception.
    messages : (n, size) uint8, or sequence of n bytes
    """

    topic: str
    type: str
    log_ns: Stamps
    messages: Bytes | Sequence[bytes]


def write_bag(path: str | Path, topics: Sequence[TopicBytes], compressed: bool = True) -> None:
    """Write a bag, all topics sorted by time.

    The bag is written beside its place and moved there when it is whole; in a folder that is there
    already its files replace those of the same name.

    Raises
    ------
    InputError
        When the place cannot be written.
    """
    target = Path(path)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=target.parent, prefix=".writing-") as folder:
            draft = Path(folder) / target.name
            _write(draft, topics, compressed)
            _move(draft, target)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}); choose another --output"
        ) from error


def _write(path: Path, topics: Sequence[TopicBytes], compressed: bool) -> None:
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    if compressed:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    store = _typestore()
    with writer:
        connections = [writer.add_connection(t.topic, t.type, typestore=store) for t in topics]
        times = np.concatenate([t.log_ns for t in topics] or [np.empty(0, np.int64)])
        origin = np.repeat(np.arange(len(topics)), [t.log_ns.size for t in topics])
        within = np.concatenate([np.arange(t.log_ns.size) for t in topics] or [times])
        order = np.argsort(times, kind="stable")
        rows = [t.messages for t in topics]
        for time, k, row in zip(
            times[order].tolist(), origin[order].tolist(), within[order].tolist(), strict=True
        ):
            writer.write(connections[k], time, bytes(rows[k][row]))


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
