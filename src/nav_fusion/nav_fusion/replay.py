"""A bag's messages as bytes, in the order of the recording, read ahead of their time."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from heapq import merge
from itertools import chain, islice
from pathlib import Path
from typing import BinaryIO

from imu_noise_id.bag_files import SQLITE_MAGIC, BagFiles, open_bag_files
from imu_noise_id.bags import list_topics
from imu_noise_id.errors import InputError
from imu_noise_id.mcap_file import DamagedError, Span
from imu_noise_id.threads import ordered_map
from imu_noise_id.topics import TopicInfo, listing

from imu_noise_id import mcap_file, sqlite_file

_BATCH = 512
_READ_AHEAD = 2
_MESSAGE_LIMIT = 256 << 20

Message = tuple[int, str, bytes]
"""Time of reception in nanoseconds, topic, serialised message."""


@dataclass(frozen=True)
class Timetable:
    """When each message of a replay is due.

    Attributes
    ----------
    first_ns : int
        Time of reception of the first message.
    begin_ns : int
        When the replay began, on the clock that `due` answers in.
    rate : float
        How many times as fast as recorded.
    """

    first_ns: int
    begin_ns: int
    rate: float

    def due(self, log_ns: int) -> int:
        """When a message is due, in nanoseconds."""
        return self.begin_ns + round((log_ns - self.first_ns) / self.rate)


def choose(bag: str | Path, asked: Sequence[str]) -> dict[str, str]:
    """Return the topics to play with their types: those asked for, or all.

    Raises
    ------
    InputError
        When the bag cannot be read, or holds no such topic.
    """
    found = {info.name: info for info in list_topics(bag)}
    for topic in asked:
        if topic not in found:
            raise InputError(f"{bag}: no topic {topic}; it holds {listing(list(found.values()))}")
    chosen: list[TopicInfo] = [found[topic] for topic in asked or found]
    return {info.name: info.type for info in chosen}


def read_messages(bag: str | Path, topics: Sequence[str]) -> Iterator[list[Message]]:
    """Yield the messages of some topics in the order of the recording, in batches."""
    with open_bag_files(bag) as files, ExitStack() as stack:
        for path in files.paths:
            with path.open("rb") as file:
                if file.read(len(SQLITE_MAGIC)) == SQLITE_MAGIC:
                    database = stack.enter_context(sqlite_file.open_sqlite(path))
                    batches = _sqlite_batches(database, topics)
                else:
                    batches = _mcap_batches(file, path, topics)
                for batch in batches:
                    yield _unpacked(batch, files)


def _mcap_batches(file: BinaryIO, path: Path, topics: Sequence[str]) -> Iterator[list[Message]]:
    try:
        found = mcap_file.scan(file, str(path))
    except DamagedError as damage:
        raise InputError(f"{path}: {damage}; give a rosbag2 folder or an .mcap file") from damage
    names = {k: c.topic for k, c in found.channels.items() if c.topic in topics}
    yield from ordered_map(_chunk_reader(file, names), found.spans, _READ_AHEAD)


def _chunk_reader(file: BinaryIO, names: dict[int, str]) -> Callable[[Span], list[Message]]:
    def read(span: Span) -> list[Message]:
        try:
            chunk = mcap_file.unpack(file, span)
            by_channel = mcap_file.messages_of(file, span, chunk)
        except DamagedError:
            return []
        rows: list[tuple[int, Message]] = []
        for k, messages in by_channel.items():
            if k not in names:
                continue
            ends = (messages.start + messages.size).tolist()
            starts = messages.start.tolist()
            rows += [
                (start, (log_ns, names[k], chunk[start:end].tobytes()))
                for start, end, log_ns in zip(starts, ends, messages.log_ns.tolist(), strict=True)
            ]
        rows.sort(key=lambda row: row[0])
        return [message for _, message in rows]

    return read


def _sqlite_batches(database: sqlite3.Connection, topics: Sequence[str]) -> Iterator[list[Message]]:
    def one(topic_id: int, name: str) -> Iterator[Message]:
        for times, data in sqlite_file.messages(database, topic_id, None):
            for time, message in zip(times, data, strict=True):
                yield time, name, message

    streams = [one(t.id, t.name) for t in sqlite_file.topics(database) if t.name in topics]
    merged = merge(*streams, key=lambda message: message[0])
    for first in merged:
        yield list(chain([first], islice(merged, _BATCH - 1)))


def _unpacked(batch: list[Message], files: BagFiles) -> list[Message]:
    if not files.message_compression:
        return batch
    unpack = mcap_file.decompress
    kind = files.message_compression
    return [(time, name, unpack(data, kind, _MESSAGE_LIMIT)) for time, name, data in batch]
