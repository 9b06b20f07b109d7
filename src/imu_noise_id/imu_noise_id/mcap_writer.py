"""Messages in memory to one MCAP file (MCAP specification, version 0).

Laid out as rosbag2 lays it out: schemas and channels at the beginning of the first chunk, an index
of its messages behind every chunk, the bag's metadata, a summary.  The records of a chunk are
joined as whole arrays and packed on threads: a library that takes message by message needs some 5
microseconds for each.  Chunks carry no checksum: comparing it costs a sixth of reading.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from struct import pack
from typing import BinaryIO

import numpy as np
import zstandard
from numpy.typing import NDArray

from imu_noise_id.cdr import Bytes, Positions
from imu_noise_id.mcap_file import MAGIC
from imu_noise_id.recording import Stamps
from imu_noise_id.threads import cores, ordered_map

CHUNK_BYTES = 1 << 20
"""A chunk ends with the message that reaches this."""
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX = range(1, 9)
_STATISTICS, _METADATA, _METADATA_INDEX, _SUMMARY_OFFSET, _DATA_END = range(0x0B, 0x10)
_MESSAGE_HEAD = np.dtype(
    [
        *(("op", "u1"), ("size", "<u8"), ("channel", "<u2"), ("sequence", "<u4")),
        *(("log_ns", "<i8"), ("publish_ns", "<i8")),
    ]
)
_INDEX_ENTRY = np.dtype([("log_ns", "<i8"), ("at", "<u8")])
_PREFIX = 22
"""Bytes of a message record between its length and the message."""


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


@dataclass(frozen=True)
class _Chunk:
    """A chunk ready to be written: its records packed, and its index."""

    first_ns: int
    last_ns: int
    size: int
    packed: bytes
    index: dict[int, bytes]


@dataclass
class _Summary:
    """What the end of the file says of the whole."""

    groups: dict[int, list[bytes]] = field(default_factory=dict)

    def add(self, op: int, *records: bytes) -> None:
        self.groups.setdefault(op, []).extend(records)


def write_mcap(
    file: BinaryIO,
    topics: Sequence[TopicBytes],
    definitions: Mapping[str, str],
    metadata: str,
    compressed: bool = True,
) -> None:
    """Write all messages in the order of their times.

    Parameters
    ----------
    file : binary stream
    topics : sequence of TopicBytes
    definitions : mapping of str to str
        Text of each message type's definition.
    metadata : str
        What rosbag2 keeps in ``metadata.yaml``.
    """
    compression = "zstd" if compressed else ""
    summary = _Summary()
    kinds = list(dict.fromkeys(t.type for t in topics))
    for k, kind in enumerate(kinds):
        text = definitions[kind]
        summary.add(_SCHEMA, pack("<H", k + 1) + _text(kind) + _text("ros2msg") + _text(text))
    for k, t in enumerate(topics):
        ids = pack("<HH", k + 1, kinds.index(t.type) + 1)
        qos = _map({"offered_qos_profiles": "[]"})
        summary.add(_CHANNEL, ids + _text(t.topic) + _text("cdr") + qos)
    head = b"".join(_record(op, r) for op, rs in summary.groups.items() for r in rs)
    file.write(MAGIC + _record(_HEADER, _text("ros2") + _text("imu_noise_id")))
    for chunk in _chunks(topics, head, compressed):
        summary.add(_CHUNK_INDEX, _put_chunk(file, chunk, compression))
    at = file.tell()
    file.write(_record(_METADATA, _text("rosbag2") + _map({"serialized_metadata": metadata})))
    end = file.tell()
    file.write(_record(_DATA_END, pack("<I", 0)))
    summary.add(_METADATA_INDEX, pack("<QQ", at, end - at) + _text("rosbag2"))
    summary.add(_STATISTICS, _statistics(topics, len(kinds), len(summary.groups[_CHUNK_INDEX])))
    _put_summary(file, summary)


def _chunks(topics: Sequence[TopicBytes], head: bytes, compressed: bool) -> Iterable[_Chunk]:
    times = np.concatenate([t.log_ns for t in topics] or [np.empty(0, np.int64)])
    order = np.argsort(times, kind="stable")
    times = times[order]
    counts = np.array([t.log_ns.size for t in topics], dtype=np.int64)
    origin = np.repeat(np.arange(len(topics)), counts)[order]
    within = order - np.concatenate(([0], np.cumsum(counts)))[origin]
    sizes = np.concatenate([_sizes(t.messages) for t in topics] or [times])[order]
    ends = np.cumsum(sizes + _MESSAGE_HEAD.itemsize)

    def chunk(part: slice) -> _Chunk:
        prelude = head if part.start == 0 else b""
        heads = np.empty(part.stop - part.start, _MESSAGE_HEAD)
        heads["op"], heads["sequence"] = _MESSAGE, 0
        heads["size"], heads["channel"] = sizes[part] + _PREFIX, origin[part] + 1
        heads["log_ns"] = heads["publish_ns"] = times[part]
        joined = np.empty((heads.size, 2), dtype=object)
        joined[:, 0] = _rows(heads.view(np.uint8).reshape(-1, _MESSAGE_HEAD.itemsize))
        index: dict[int, bytes] = {}
        starts = ends[part] - sizes[part] - _MESSAGE_HEAD.itemsize
        starts += len(prelude) - starts[:1]
        for k in np.unique(origin[part]).tolist():
            own = np.flatnonzero(origin[part] == k)
            joined[own, 1] = _picked(topics[k].messages, within[part][own])
            entries = np.empty(own.size, _INDEX_ENTRY)
            entries["log_ns"], entries["at"] = times[part][own], starts[own]
            index[k + 1] = entries.tobytes()
        records = prelude + b"".join(joined.ravel().tolist())
        packed = zstandard.ZstdCompressor().compress(records) if compressed else records
        span = (int(times[part.start]), int(times[part.stop - 1])) if heads.size else (0, 0)
        return _Chunk(*span, len(records), packed, index)

    return ordered_map(chunk, _parts(ends), cores())


def _parts(ends: Positions) -> list[slice]:
    """Stretches of messages, one a chunk; an empty one where there are none."""
    parts: list[slice] = []
    begin, done = 0, 0
    while begin < ends.size or not parts:
        stop = min(int(np.searchsorted(ends, done + CHUNK_BYTES)) + 1, ends.size)
        parts.append(slice(begin, stop))
        begin, done = stop, int(ends[stop - 1]) if stop else 0
    return parts


def _sizes(messages: Bytes | Sequence[bytes]) -> Positions:
    if isinstance(messages, np.ndarray):
        return np.full(messages.shape[0], messages.shape[1], dtype=np.int64)
    return np.array([len(m) for m in messages], dtype=np.int64)


def _picked(messages: Bytes | Sequence[bytes], rows: Positions) -> NDArray[np.object_]:
    if isinstance(messages, np.ndarray):
        return _rows(messages[rows])
    picked = np.empty(rows.size, dtype=object)
    picked[:] = [messages[k] for k in rows.tolist()]
    return picked


def _rows(rows: Bytes) -> NDArray[np.object_]:
    """Rows of bytes as objects."""
    parts = np.empty(rows.shape[0], dtype=object)
    parts[:] = np.ascontiguousarray(rows).view(f"V{rows.shape[1]}").ravel().tolist()
    return parts


def _put_chunk(file: BinaryIO, chunk: _Chunk, compression: str) -> bytes:
    """Write a chunk and the index of its messages; return its entry in the summary."""
    at = file.tell()
    span = pack("<QQ", chunk.first_ns, chunk.last_ns)
    sizes = pack("<QI", chunk.size, 0) + _text(compression)
    file.write(_record(_CHUNK, span + sizes + pack("<Q", len(chunk.packed)) + chunk.packed))
    end = file.tell()
    places = b""
    for channel, entries in chunk.index.items():
        places += pack("<HQ", channel, file.tell())
        file.write(_record(_MESSAGE_INDEX, pack("<HI", channel, len(entries)) + entries))
    return b"".join(
        (
            span,
            pack("<QQ", at, end - at),
            pack("<I", len(places)) + places,
            pack("<Q", file.tell() - end),
            _text(compression),
            pack("<QQ", len(chunk.packed), chunk.size),
        )
    )


def _statistics(topics: Sequence[TopicBytes], kinds: int, chunks: int) -> bytes:
    times = np.concatenate([t.log_ns for t in topics] or [np.empty(0, np.int64)])
    counts = b"".join(pack("<HQ", k + 1, t.log_ns.size) for k, t in enumerate(topics))
    span = (int(times.min()), int(times.max())) if times.size else (0, 0)
    numbers = pack("<QHIIII", times.size, kinds, len(topics), 0, 1, chunks)
    return numbers + pack("<QQ", *span) + pack("<I", len(counts)) + counts


def _put_summary(file: BinaryIO, summary: _Summary) -> None:
    begin = file.tell()
    offsets = b""
    for op, records in summary.groups.items():
        at = file.tell()
        file.writelines(_record(op, r) for r in records)
        offsets += _record(_SUMMARY_OFFSET, pack("<BQQ", op, at, file.tell() - at))
    where = file.tell()
    file.write(offsets + _record(_FOOTER, pack("<QQI", begin, where, 0)) + MAGIC)


def _text(text: str) -> bytes:
    raw = text.encode()
    return pack("<I", len(raw)) + raw


def _map(pairs: Mapping[str, str]) -> bytes:
    raw = b"".join(_text(k) + _text(v) for k, v in pairs.items())
    return pack("<I", len(raw)) + raw


def _record(op: int, content: bytes) -> bytes:
    return pack("<BQ", op, len(content)) + content
