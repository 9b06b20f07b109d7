"""One MCAP file: where its chunks are, and the messages of a chunk as arrays.

The file is walked from its first byte, record by record (MCAP specification, version 0), so that a
file without footer is read as well as a whole one.  Nothing that the file says of itself is
believed: a chunk's message indexes are a hint that is checked against the chunk, sizes are limited,
checksums are compared where they are given.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO

import lz4.frame
import numpy as np
import zstandard

from imu_noise_id.cdr import Bytes, Positions, gather
from imu_noise_id.errors import one_line
from imu_noise_id.recording import Stamps

MAGIC = b"\x89MCAP0\r\n"
CHUNK_LIMIT = 128 << 20
"""Bytes; a chunk that is or claims to be larger is left out."""
LATEST_NS = 1 << 62
"""Later log times are nonsense and are cut to this one, so that differences can be taken."""
DEFINITION_LIMIT = 1 << 20

_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _STATISTICS, _DATA_END, _FOOTER = (
    *(0x03, 0x04, 0x05, 0x06, 0x07),
    *(0x0B, 0x0F, 0x02),
)
_RECORD_HEAD = 9
_MESSAGE_HEAD = 22
_LOOSE_SPAN = 4 << 20


class DamagedError(Exception):
    """Bytes that are not what the format asks for; the message says what is wrong with them."""


@dataclass(frozen=True)
class SchemaRecord:
    """A message definition."""

    name: str
    encoding: str
    text: str


@dataclass(frozen=True)
class ChannelRecord:
    """A topic as one publisher wrote it."""

    topic: str
    schema_id: int
    encoding: str


@dataclass(frozen=True)
class Span:
    """A chunk, or a stretch of messages outside any chunk.

    Attributes
    ----------
    at, packed_size : int
        Where its bytes lie in the file.
    size, crc, compression
        What they unpack to; a crc of 0 is none.
    end_ns : int
        Log time of its last message, as it says itself.
    index : dict of int to (int, int)
        For each channel, position and number of its index entries.
    """

    at: int
    packed_size: int
    size: int
    compression: str = ""
    crc: int = 0
    end_ns: int = 0
    index: dict[int, tuple[int, int]] = field(default_factory=dict)


@dataclass
class McapFile:
    """The contents of a file, as far as it is whole."""

    path: str
    spans: list[Span] = field(default_factory=list)
    schemas: dict[int, SchemaRecord] = field(default_factory=dict)
    channels: dict[int, ChannelRecord] = field(default_factory=dict)
    stated_counts: dict[int, int] | None = None
    complete: bool = False
    notes: list[str] = field(default_factory=list)

    def add_definition(self, opcode: int, body: bytes) -> None:
        """Take a Schema or Channel record; the first of an id holds."""
        reader = _Fields(body)
        if opcode == _SCHEMA:
            schema_id, name, encoding = reader.u16(), reader.name(), reader.name()
            self.schemas.setdefault(schema_id, SchemaRecord(name, encoding, reader.text()))
        else:
            channel_id, schema_id = reader.u16(), reader.u16()
            record = ChannelRecord(reader.name(), schema_id, reader.name())
            if self.channels.setdefault(channel_id, record) != record:
                raise DamagedError(f"channel {channel_id} is defined twice")


@dataclass(frozen=True)
class ChannelMessages:
    """Messages of one channel in an unpacked chunk: log times, first bytes, lengths."""

    log_ns: Stamps
    start: Positions
    size: Positions


class _Fields:
    """Reads the members of a small record."""

    def __init__(self, body: bytes) -> None:
        self._body = body
        self._at = 0

    def _take(self, size: int) -> bytes:
        if size > len(self._body) - self._at:
            raise DamagedError("a record is shorter than its members")
        self._at += size
        return self._body[self._at - size : self._at]

    def u16(self) -> int:
        return int.from_bytes(self._take(2), "little")

    def u32(self) -> int:
        return int.from_bytes(self._take(4), "little")

    def u64(self) -> int:
        return int.from_bytes(self._take(8), "little")

    def text(self) -> str:
        return self._take(self.u32()).decode(errors="replace")

    def name(self) -> str:
        return one_line(self.text())

    @property
    def at(self) -> int:
        return self._at


class _Window:
    """Positioned reads of few bytes, most of them from memory."""

    _SIZE = 16 << 10

    def __init__(self, file: BinaryIO) -> None:
        self._fd = file.fileno()
        self._at = 0
        self._data = b""

    def read(self, at: int, size: int) -> bytes:
        begin = at - self._at
        if begin < 0 or begin + size > len(self._data):
            self._at, begin = at, 0
            self._data = os.pread(self._fd, max(size, self._SIZE), at)
        return self._data[begin : begin + size]


def scan(file: BinaryIO, path: str) -> McapFile:
    """Find a file's chunks and topics without unpacking more than it must.

    Raises
    ------
    DamagedError
        When the file is no MCAP file at all.
    """
    window = _Window(file)
    if window.read(0, len(MAGIC)) != MAGIC:
        raise DamagedError("not an MCAP file")
    found = McapFile(path)
    end = os.fstat(file.fileno()).st_size
    at = len(MAGIC)
    try:
        while not found.complete:
            if at + _RECORD_HEAD > end:
                raise DamagedError("ends without a footer")
            head = window.read(at, _RECORD_HEAD)
            size = int.from_bytes(head[1:], "little")
            if size > end - at - _RECORD_HEAD:
                raise DamagedError("ends in the middle of a record")
            if head[0] == 0:
                raise DamagedError("has a record of no kind")
            _scan_record(found, window, head[0], at, size)
            at += _RECORD_HEAD + size
    except DamagedError as damage:
        found.notes.append(f"{path}: {damage} (byte {at} of {end}); what is whole before is read")
    _learn_channels(found, file)
    return found


def _scan_record(found: McapFile, window: _Window, opcode: int, at: int, size: int) -> None:
    body = at + _RECORD_HEAD
    if opcode in (_SCHEMA, _CHANNEL):
        if size > DEFINITION_LIMIT:
            raise DamagedError("has a definition too long to be one")
        found.add_definition(opcode, window.read(body, size))
    elif opcode == _CHUNK:
        found.spans.append(_chunk_span(window, body, size))
    elif opcode == _MESSAGE_INDEX and found.spans:
        head = _Fields(window.read(body, min(size, 6)))
        channel_id, length = head.u16(), head.u32()
        if length + 6 > size:
            raise DamagedError("has an index longer than its record")
        found.spans[-1].index[channel_id] = (body + 6, length // 16)
    elif opcode == _MESSAGE:
        _scan_loose(found, at, _RECORD_HEAD + size)
    elif opcode == _STATISTICS:
        found.stated_counts = _stated_counts(window.read(body, min(size, DEFINITION_LIMIT)))
    elif opcode == _FOOTER:
        found.complete = True


def _chunk_span(window: _Window, body: int, size: int) -> Span:
    head = _Fields(window.read(body, min(size, 64)))
    head.u64()
    end_ns, unpacked, crc = head.u64(), head.u64(), head.u32()
    compression, packed = head.name(), head.u64()
    if packed > size - head.at:
        raise DamagedError("has a chunk longer than its record")
    return Span(body + head.at, packed, unpacked, compression, crc, end_ns)


def _scan_loose(found: McapFile, at: int, size: int) -> None:
    """Join messages outside chunks that follow each other to spans of a few MB."""
    last = found.spans[-1] if found.spans else None
    if last and not last.index and last.at + last.size == at and last.size < _LOOSE_SPAN:
        size += last.size
        at = last.at
        found.spans.pop()
    found.spans.append(Span(at, size, size, end_ns=2**63))


def _stated_counts(body: bytes) -> dict[int, int]:
    reader = _Fields(body)
    for skip in (reader.u64, reader.u16, *(reader.u32,) * 4, reader.u64, reader.u64):
        skip()
    return {reader.u16(): reader.u64() for _ in range(min(reader.u32(), len(body)) // 10)}


def _learn_channels(found: McapFile, file: BinaryIO) -> None:
    """Unpack the chunks whose indexes name channels that no record outside has defined."""
    summarised = bool(found.channels)
    for span in found.spans:
        unknown = set(span.index) - set(found.channels)
        if unknown or not (span.index or summarised):
            try:
                _learn_from(found, unpack(file, span))
            except DamagedError:
                continue  # said when its messages are read


def _learn_from(found: McapFile, chunk: Bytes) -> None:
    for opcode, at, size in walk(chunk, 0, chunk.size):
        if opcode in (_SCHEMA, _CHANNEL) and size <= DEFINITION_LIMIT:
            found.add_definition(opcode, chunk[at : at + size].tobytes())


def unpack(file: BinaryIO, span: Span) -> Bytes:
    """The bytes of a chunk, unpacked and checked.

    Raises
    ------
    DamagedError
    """
    if max(span.size, span.packed_size) > CHUNK_LIMIT:
        raise DamagedError(f"a chunk claims {span.size} bytes, more than the {CHUNK_LIMIT} allowed")
    packed = os.pread(file.fileno(), span.packed_size, span.at)
    data = decompress(packed, span.compression, span.size)
    if len(data) != span.size:
        raise DamagedError("a chunk unpacks to another size than it says")
    if span.crc and zlib.crc32(data) != span.crc:
        raise DamagedError("a chunk's checksum is wrong")
    return np.frombuffer(data, np.uint8)


def decompress(packed: bytes, compression: str, limit: int) -> bytes:
    """Unpack to at most ``limit + 1`` bytes.

    Raises
    ------
    DamagedError
    """
    if compression == "":
        return packed
    try:
        if compression == "zstd":
            if zstandard.frame_content_size(packed) > limit:
                raise DamagedError("a chunk unpacks to another size than it says")
            return zstandard.ZstdDecompressor().decompress(packed, max_output_size=limit + 1)
        if compression == "lz4":
            unpacker = lz4.frame.LZ4FrameDecompressor()
            return bytes(unpacker.decompress(packed, max_length=limit + 1))
    except (zstandard.ZstdError, RuntimeError, EOFError, MemoryError) as error:
        raise DamagedError(f"a chunk cannot be unpacked ({error})") from error
    raise DamagedError(f"a chunk has the unknown compression {compression!r}")


def walk(chunk: Bytes, begin: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Opcode, first byte and size of each record between two positions of a chunk.

    Raises
    ------
    DamagedError
        At the first record that does not fit.
    """
    head = struct.Struct("<BQ")
    data = chunk.data
    while begin < end:
        if begin + _RECORD_HEAD > end:
            raise DamagedError("a chunk ends in the middle of a record")
        opcode, size = head.unpack_from(data, begin)
        begin += _RECORD_HEAD
        if size > end - begin:
            raise DamagedError("a chunk ends in the middle of a record")
        yield opcode, begin, size
        begin += size


def messages_of(file: BinaryIO, span: Span, chunk: Bytes) -> dict[int, ChannelMessages]:
    """The messages of a chunk by channel, in the order in which they lie there.

    Raises
    ------
    DamagedError
    """
    body = _indexed_bodies(file, span, chunk)
    if body is None:
        found = [r[1:] for r in walk(chunk, 0, chunk.size) if r[0] == _MESSAGE]
        body, size = np.array(found, np.int64).reshape(-1, 2).T
    else:
        size = gather(chunk, "<u8", body - 8).astype(np.int64)
    if (size < _MESSAGE_HEAD).any():
        raise DamagedError("a chunk holds a message shorter than its head")
    channel = gather(chunk, "<u2", body)
    log_ns = np.minimum(gather(chunk, "<u8", body + 6), LATEST_NS).astype(np.int64)
    by_channel = {}
    for channel_id in np.unique(channel).tolist():
        mine = channel == channel_id
        by_channel[channel_id] = ChannelMessages(
            log_ns[mine], body[mine] + _MESSAGE_HEAD, size[mine] - _MESSAGE_HEAD
        )
    return by_channel


def _indexed_bodies(file: BinaryIO, span: Span, chunk: Bytes) -> Positions | None:
    """First byte of every message by the chunk's own indexes; None unless they are all true.

    They are true when each entry points at a message and what lies between the messages holds no
    other.
    """
    parts = [
        np.frombuffer(os.pread(file.fileno(), 16 * count, at), "<u8").reshape(-1, 2)[:, 1]
        for at, count in span.index.values()
        if count <= chunk.size // (_RECORD_HEAD + _MESSAGE_HEAD)
    ]
    if len(parts) < len(span.index) or not parts:
        return None
    stated = np.sort(np.concatenate(parts))
    if stated.size == 0 or int(stated[-1]) > chunk.size - _RECORD_HEAD - _MESSAGE_HEAD:
        return None
    entry = stated.astype(np.int64)
    size = gather(chunk, "<u8", entry + 1).astype(np.uint64)
    if (size > chunk.size).any() or (gather(chunk, "u1", entry) != _MESSAGE).any():
        return None
    begin = np.append(entry, chunk.size)
    end = np.insert(entry + _RECORD_HEAD + size.astype(np.int64), 0, 0)
    if (end > begin).any():
        return None
    for gap in np.flatnonzero(end < begin).tolist():
        if any(r[0] == _MESSAGE for r in walk(chunk, int(end[gap]), int(begin[gap]))):
            return None
    return entry + _RECORD_HEAD
