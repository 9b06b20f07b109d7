"""Bags to recordings and back.

A bag is a rosbag2 folder (MCAP or sqlite3, split or not, compressed in any of rosbag2's ways) or
one ``.mcap`` file.  Chunks are unpacked and decoded as arrays, on several threads because unpacking
leaves the interpreter lock alone, and appended in their order: the result does not depend on the
number of threads, and memory grows with the samples kept.

What a file says of itself claims no memory: a chunk may unpack to `mcap_file.CHUNK_LIMIT` (128 MiB,
up to two of them a thread at a time), an MCAP file may hold as many messages as it has bytes, a
message compressed by itself may unpack to 64 KiB, one in a database may have 1 MiB, a file
compressed whole may unpack to `bag_files.UNPACKED_LIMIT` times its size (on disk), metadata.yaml
may have 1 MiB.  No file outside the bag's folder is opened.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from imu_noise_id import mcap_file, sqlite_file
from imu_noise_id.assemble import to_recording
from imu_noise_id.bag_files import SQLITE_MAGIC, BagFiles, open_bag_files
from imu_noise_id.bag_writer import write_recording
from imu_noise_id.cdr import LAYOUTS, Bytes, Decoded, decode, decode_batch
from imu_noise_id.columns import ColumnBuffer, TopicColumns
from imu_noise_id.definitions import is_standard
from imu_noise_id.errors import InputError, one_line
from imu_noise_id.mcap_file import (
    LATEST_NS,
    ChannelMessages,
    DamagedError,
    McapFile,
    Span,
)
from imu_noise_id.recording import Recording, Stamps
from imu_noise_id.threads import cores, ordered_map
from imu_noise_id.topics import TopicInfo, TopicNames, choose_topics, listing

_MESSAGE_LIMIT = 64 << 10
_MARGIN_S = 5.0


def read_recording(
    path: str | Path,
    topics: TopicNames | None = None,
    last_s: float | None = None,
    threads: int | None = None,
) -> Recording:
    """Read a bag's sensors.

    Parameters
    ----------
    path : str or Path
    topics : TopicNames, optional
    last_s : float, optional
        Only the recording's last seconds.
    threads : int, optional
        Default: one for each core, four at the most.

    Raises
    ------
    InputError
    """
    columns, notes = read_topics(path, topics, last_s, threads)
    return to_recording(columns, str(path), notes)


def read_topics(
    path: str | Path,
    topics: TopicNames | None = None,
    last_s: float | None = None,
    threads: int | None = None,
) -> tuple[list[TopicColumns], tuple[str, ...]]:
    """Read a bag's topics as they were received, and what there is to say about the bag.

    Parameters and errors as for `read_recording`.
    """
    if last_s is not None and not last_s > 0:
        raise InputError(f"{path}: the last {last_s:g} s were asked for; give a positive number")
    names = topics or TopicNames()
    with open_bag_files(path) as files, ExitStack() as stack:
        try:
            sources = _open_sources(files, stack)
        except OSError as error:
            raise InputError(f"{path}: cannot be read ({error.strerror})") from error
        found = _merged(sources)
        if not found and (damage := [note for source in sources for note in source.notes]):
            raise InputError("; ".join(damage))
        chosen = choose_topics(found, names, str(path))
        wanted = {info.name: info for info in chosen.values()}
        columns, notes = _read_wanted(sources, wanted, last_s, threads or cores())
    for column in columns:
        if not column.stamp_ns.size:
            notes = (*notes, _nothing_read(column))
    if not any(c.stamp_ns.size for c in columns):
        raise InputError(f"{path}: {'; '.join((*files.notes, *notes))}")
    return columns, (*files.notes, *notes)


def list_topics(path: str | Path) -> list[TopicInfo]:
    """All topics of a bag."""
    with open_bag_files(path) as files, ExitStack() as stack:
        return _merged(_open_sources(files, stack))


def _nothing_read(column: TopicColumns) -> str:
    kind = column.type.replace("/msg/", "/")
    if column.invalid:
        return f"none of the {column.invalid} messages of topic {column.topic} is a {kind}"
    return f"topic {column.topic} holds no message that can be read; record it again"


def _read_wanted(
    sources: Sequence[Source], wanted: Mapping[str, TopicInfo], last_s: float | None, threads: int
) -> tuple[list[TopicColumns], tuple[str, ...]]:
    first_ns = None
    if last_s is not None:
        ends = [end for source in sources if (end := source.last_ns()) is not None]
        first_ns = max(ends) - round((last_s + _MARGIN_S) * 1e9) if ends else None
    buffers = {
        name: ColumnBuffer(name, info.type, info.count if first_ns is None else 1024)
        for name, info in wanted.items()
    }
    notes: list[str] = []
    for source in sources:
        notes += source.notes
        notes += source.read(buffers, first_ns, threads)
    columns = [buffer.columns() for buffer in buffers.values()]
    if last_s is None:
        return columns, tuple(notes)
    newest = max((int(c.stamp_ns[-1]) for c in columns if c.stamp_ns.size), default=0)
    return [c.last(newest - round(last_s * 1e9)) for c in columns], tuple(notes)


@dataclass
class McapSource:
    """An open MCAP file."""

    file: BinaryIO
    found: McapFile
    message_compression: str = ""
    notes: list[str] = field(default_factory=list)

    def topics(self) -> list[TopicInfo]:
        """Its topics, with the message counts that its indexes or its summary give."""
        counts = self._counts()
        return [
            TopicInfo(
                channel.topic,
                self._type(channel_id),
                counts.get(channel_id, 0),
                self._problem(channel_id),
            )
            for channel_id, channel in self.found.channels.items()
        ]

    def last_ns(self) -> int | None:
        """Log time of the last message in a chunk, as the chunks say."""
        return max((s.end_ns for s in self.found.spans if s.end_ns < 2**62), default=None)

    def read(
        self, buffers: Mapping[str, ColumnBuffer], first_ns: int | None, threads: int
    ) -> list[str]:
        """Append the messages of the topics in `buffers`; return what is to be noted."""
        mine = {
            channel_id: buffers[channel.topic]
            for channel_id, channel in self.found.channels.items()
            if channel.topic in buffers
        }
        spans = [
            span
            for span in self.found.spans
            if (not span.index or mine.keys() & span.index.keys())
            and (first_ns is None or span.end_ns >= first_ns or span.end_ns == 0)
        ]
        notes = []
        read = dict.fromkeys(mine, 0)
        work = self._decoder({k: buffer.type for k, buffer in mine.items()})
        for parts in ordered_map(work, spans, threads):
            if isinstance(parts, str):
                notes.append(parts)
                continue
            for channel_id, decoded, log_ns in parts:
                mine[channel_id].append(decoded, log_ns)
                read[channel_id] += decoded.valid.size
            if sum(read.values()) > self._most():
                notes.append(f"{self.found.path}: holds more messages than bytes; no more are read")
                return notes
        if first_ns is None and self.found.stated_counts is not None:
            notes += self._shortfalls(read, self.found.stated_counts)
        return notes

    def _shortfalls(self, read: Mapping[int, int], stated: Mapping[int, int]) -> list[str]:
        return [
            f"{self.found.path}: {count} of the {stated[k]} messages of topic "
            f"{self.found.channels[k].topic} are there"
            for k, count in read.items()
            if k in stated and stated[k] != count
        ]

    def _decoder(
        self, types: Mapping[int, str]
    ) -> Callable[[Span], list[tuple[int, Decoded, Stamps]] | str]:
        def work(span: Span) -> list[tuple[int, Decoded, Stamps]] | str:
            try:
                chunk = mcap_file.unpack(self.file, span)
                by_channel = mcap_file.messages_of(self.file, span, chunk)
            except DamagedError as damage:
                held = sum(span.index[k][1] for k in types if k in span.index)
                count = f"its {held} messages are" if held else "it is"
                return f"{self.found.path}: {damage} (byte {span.at}); {count} left out"
            return [
                (k, self._decode(types[k], chunk, m), m.log_ns)
                for k, m in by_channel.items()
                if k in types
            ]

        return work

    def _decode(self, msgtype: str, chunk: Bytes, messages: ChannelMessages) -> Decoded:
        if self.message_compression == "":
            return decode(msgtype, chunk, messages.start, messages.size)
        ends = messages.start + messages.size
        packed = [
            chunk[begin:end].tobytes()
            for begin, end in zip(messages.start.tolist(), ends.tolist(), strict=True)
        ]
        return decode_batch(msgtype, [_unpacked(m, self.message_compression) for m in packed])

    def _type(self, channel_id: int) -> str:
        schema = self.found.schemas.get(self.found.channels[channel_id].schema_id)
        return _ros2_name(schema.name) if schema else "(no type)"

    def _problem(self, channel_id: int) -> str:
        channel = self.found.channels[channel_id]
        schema = self.found.schemas.get(channel.schema_id)
        if schema is None or self._type(channel_id) not in LAYOUTS:
            return ""
        if channel.encoding != "cdr":
            return f"is encoded as {channel.encoding!r}, not cdr; convert the bag to ROS 2"
        if schema.encoding not in ("ros2msg", ""):
            return f"is defined in {schema.encoding!r}, not ros2msg; convert the bag"
        return _definition_problem(self._type(channel_id), schema.text)

    def _most(self) -> int:
        """Most messages believed: one takes a byte of the file at least, however it is packed."""
        return os.fstat(self.file.fileno()).st_size

    def _counts(self) -> dict[int, int]:
        counts: dict[int, int] = {}
        for span in self.found.spans:
            for channel_id, (_, count) in span.index.items():
                counts[channel_id] = counts.get(channel_id, 0) + count
        limit = self._most()
        for channel_id, count in (self.found.stated_counts or {}).items():
            counts.setdefault(channel_id, min(count, limit))
        return counts


@dataclass
class SqliteSource:
    """An open sqlite3 file."""

    label: str
    database: sqlite3.Connection
    message_compression: str = ""
    notes: list[str] = field(default_factory=list)

    def topics(self) -> list[TopicInfo]:
        """Its topics with their message counts."""
        return [
            TopicInfo(
                t.name,
                t.type,
                t.count,
                _definition_problem(t.type, t.definition)
                if t.serialization == "cdr"
                else f"is encoded as {t.serialization!r}, not cdr; convert the bag",
            )
            for t in sqlite_file.topics(self.database)
        ]

    def last_ns(self) -> int | None:
        """Time of reception of the last message."""
        return sqlite_file.last_ns(self.database)

    def read(
        self, buffers: Mapping[str, ColumnBuffer], first_ns: int | None, threads: int
    ) -> list[str]:
        """Append the messages of the topics in `buffers`; return what is to be noted."""
        del threads  # sqlite keeps one cursor on one thread
        try:
            for topic in sqlite_file.topics(self.database):
                if topic.name not in buffers:
                    continue
                for times, data in sqlite_file.messages(self.database, topic.id, first_ns):
                    whole = [_unpacked(m, self.message_compression) for m in data]
                    decoded = decode_batch(topic.type, whole)
                    buffers[topic.name].append(
                        decoded, np.clip(np.array(times, np.int64), 0, LATEST_NS)
                    )
        except sqlite_file.ERRORS as error:
            return [
                f"{self.label}: damaged ({one_line(str(error))}); what is whole before it is read"
            ]
        return []


Source = McapSource | SqliteSource


def _open_sources(files: BagFiles, stack: ExitStack) -> list[Source]:
    pairs = zip(files.paths, files.labels, strict=True)
    return [_open_source(path, label, files.message_compression, stack) for path, label in pairs]


def _open_source(path: Path, label: str, compression: str, stack: ExitStack) -> Source:
    file = stack.enter_context(path.open("rb"))
    if os.pread(file.fileno(), len(SQLITE_MAGIC), 0) == SQLITE_MAGIC:
        try:
            database = stack.enter_context(sqlite_file.open_sqlite(path))
            source = SqliteSource(label, database, compression)
            source.topics()
        except sqlite_file.ERRORS as error:
            raise InputError(f"{label}: not readable as a rosbag2 database ({error})") from error
        return source
    try:
        found = mcap_file.scan(file, label)
    except DamagedError as damage:
        raise InputError(f"{label}: {damage}; give a rosbag2 folder or an .mcap file") from damage
    return McapSource(file, found, compression, list(found.notes))


def _ros2_name(msgtype: str) -> str:
    """``sensor_msgs/Imu`` of ROS 1, and of some writers of ROS 2, as ``sensor_msgs/msg/Imu``."""
    package, slash, name = msgtype.partition("/")
    return f"{package}/msg/{name}" if slash and "/" not in name else msgtype


def _definition_problem(msgtype: str, text: str) -> str:
    if msgtype in LAYOUTS and text.strip() and not is_standard(msgtype, text):
        name = msgtype.replace("/msg/", "/")
        return f"has a {name} whose members differ from the standard's; convert the bag"
    return ""


def _merged(sources: Sequence[Source]) -> list[TopicInfo]:
    """The topics of all files of a bag, each once."""
    merged: dict[str, TopicInfo] = {}
    for info in (info for source in sources for info in source.topics()):
        seen = merged.get(info.name)
        if seen is None:
            merged[info.name] = info
            continue
        problem = seen.problem or info.problem
        if seen.type != info.type:
            problem = f"carries both {seen.type} and {info.type}; give a bag with one of them"
        merged[info.name] = TopicInfo(info.name, seen.type, seen.count + info.count, problem)
    return list(merged.values())


def _unpacked(message: bytes, compression: str) -> bytes:
    """A message unpacked; nothing, and so no message, where it cannot be."""
    try:
        return mcap_file.decompress(message, compression, _MESSAGE_LIMIT)
    except DamagedError:
        return b""


__all__ = ["list_topics", "listing", "read_recording", "read_topics", "write_recording"]
