"""Small bags, ways to damage them, and what reading a damaged one may do.

Shared by the seeded subset in ``test/faults`` and the campaign in ``study``.
"""

from __future__ import annotations

import contextlib
import io
import os
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from imu_noise_id.bag_writer import write_bag
from imu_noise_id.bags import read_recording, read_topics
from imu_noise_id.errors import InputError
from imu_noise_id.recording import Recording
from imu_noise_id.series import to_series
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

from helpers import bag_making as make

COUNT = 40
EXTREMES = (0, 1, 8, 2**16, 2**31 - 1, 2**32 - 1, 2**40, 2**63 - 1, 2**63, 2**64 - 1)

Bytes = bytearray
Damage = Callable[[Bytes, list[int], np.random.Generator], Bytes]


def some_topics(rng: np.random.Generator, every: bool = True) -> list[make.TopicBytes]:
    """Return a few messages of every kind, or of an Imu and of fixes only."""
    slow = make.uniform(COUNT // 4, 25.0)
    llh = rng.normal((45.0, 7.0, 200.0), (1e-6, 1e-6, 0.3), (slow.size, 3))
    if not every:
        return [make.still_imu(rng, COUNT, 100.0), make.fixes(slow, llh)]
    return [
        make.still_imu(rng, COUNT, 100.0),
        make.field(slow, rng.normal((2e-5, 0.0, -4e-5), 1e-7, (slow.size, 3))),
        make.fixes(slow, llh),
        make.velocities(slow, rng.normal(0, 0.05, llh.shape)),
        make.temperatures(slow, rng.normal(25, 0.1, slow.size)),
    ]


def mcap_bytes(
    compression: CompressionType, crcs: bool, chunked: bool = True, every: bool = False
) -> bytes:
    """Return an MCAP file of `some_topics`, definitions embedded."""
    topics = some_topics(np.random.default_rng(1), every)
    store = get_typestore(Stores.ROS2_JAZZY)
    file = io.BytesIO()
    writer = Writer(
        file,
        chunk_size=4000,
        compression=compression,
        enable_crcs=crcs,
        use_chunking=chunked,
    )
    writer.start(profile="ros2")
    messages = []
    for topic in topics:
        text = store.generate_msgdef(topic.type, ros_version=2)[0].encode()
        schema = writer.register_schema(topic.type, "ros2msg", text)
        channel = writer.register_channel(topic.topic, "cdr", schema)
        rows = zip(topic.log_ns.tolist(), topic.messages, strict=True)
        messages += [(time, channel, row.tobytes()) for time, row in rows]
    for time, channel, row in sorted(messages):
        writer.add_message(channel, time, row, time)
    writer.finish()
    return file.getvalue()


def sqlite_bytes(folder: Path) -> bytes:
    """Return a rosbag2 database of `some_topics`."""
    store = get_typestore(Stores.ROS2_JAZZY)
    path = folder / "database"
    with BagWriter(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        for topic in some_topics(np.random.default_rng(1), every=False):
            link = writer.add_connection(topic.topic, topic.type, typestore=store)
            for time, row in zip(topic.log_ns.tolist(), topic.messages, strict=True):
                writer.write(link, time, row.tobytes())
    return (path / "database.db3").read_bytes()


def folder_bag(folder: Path) -> Path:
    """Write a rosbag2 folder of `some_topics`."""
    write_bag(folder / "bag", some_topics(np.random.default_rng(1)))
    return folder / "bag"


def record_heads(data: bytes) -> list[int]:
    """Return the position of every record, those inside uncompressed chunks included."""

    def walk(at: int, end: int) -> Iterator[int]:
        while at + 9 <= end:
            opcode, size = struct.unpack_from("<BQ", data, at)
            yield at
            if opcode == 0x06:
                name = struct.unpack_from("<I", data, at + 9 + 28)[0]
                if name == 0:
                    yield from walk(at + 9 + 28 + 4 + 8, at + 9 + size)
            at += 9 + size

    return list(walk(8, len(data) - 8))


def flip_head(data: Bytes, heads: list[int], rng: np.random.Generator) -> Bytes:
    """Change one byte of a record's opcode, length or first members."""
    data[int(rng.choice(heads)) + int(rng.integers(40)) % (len(data) - heads[-1])] ^= int(
        rng.integers(1, 256)
    )
    return data


def flip_anywhere(data: Bytes, heads: list[int], rng: np.random.Generator) -> Bytes:
    """Change up to eight bytes."""
    for at in rng.integers(0, len(data), int(rng.integers(1, 9))).tolist():
        data[at] ^= int(rng.integers(1, 256))
    return data


def put_extreme(data: Bytes, heads: list[int], rng: np.random.Generator) -> Bytes:
    """Overwrite a number behind a record's head by one that a careless reader believes."""
    size = int(rng.choice([2, 4, 8]))
    at = int(rng.choice(heads)) + int(rng.integers(1, 60))
    at = min(at, len(data) - size)
    value = int(rng.choice(np.array(EXTREMES, dtype=np.uint64))) % 256**size
    data[at : at + size] = value.to_bytes(size, "little")
    return data


def cut(data: Bytes, heads: list[int], rng: np.random.Generator) -> Bytes:
    """Cut the file short."""
    return data[: int(rng.integers(len(data)))]


def splice(data: Bytes, heads: list[int], rng: np.random.Generator) -> Bytes:
    """Copy, move or drop a piece, often from record to record."""
    source, target = sorted(int(x) for x in rng.choice(heads, 2))
    length = int(rng.integers(1, 2000))
    piece = data[source : source + length]
    kind = int(rng.integers(3))
    if kind == 0:
        return data[:target] + piece + data[target:]
    if kind == 1:
        data[target : target + len(piece)] = piece
        return data
    return data[:source] + data[target:]


DAMAGES: tuple[Damage, ...] = (flip_head, flip_anywhere, put_extreme, cut, splice)


NAMES = (
    *(b"../../etc/passwd", b"/etc/passwd", b"../outside.mcap", b"/dev/zero", b"/proc/self/mem"),
    *(
        b"link.mcap",
        b"link/outside.mcap",
        b"..",
        b".",
        b"''",
        b"[]",
        b"~",
        b"a\\x00b",
        b"pipe.mcap",
    ),
)
"""What metadata may name, of which none may be opened; link and pipe lie in the folder."""


def name_another(data: Bytes, heads: list[int], rng: np.random.Generator) -> Bytes:
    """Name something that is no file of the bag."""
    lines = bytes(data).split(b"\n")
    named = [k for k, line in enumerate(lines) if b".mcap" in line or b".db3" in line]
    k = int(rng.choice(named))
    head = lines[k][: len(lines[k]) - len(lines[k].lstrip(b" -"))]
    lines[k] = head + NAMES[int(rng.integers(len(NAMES)))]
    return bytearray(b"\n".join(lines))


def shuffle_lines(data: Bytes, heads: list[int], rng: np.random.Generator) -> Bytes:
    """Repeat, drop, indent or swap lines."""
    lines = bytes(data).split(b"\n")
    for _ in range(int(rng.integers(1, 4))):
        a, b = (int(k) for k in rng.integers(len(lines), size=2))
        kind = int(rng.integers(4))
        if kind == 0:
            lines.insert(a, lines[b])
        elif kind == 1 and len(lines) > 2:
            del lines[a]
        elif kind == 2:
            lines[a] = b" " * int(rng.integers(1, 5)) + lines[a]
        else:
            lines[a], lines[b] = lines[b], lines[a]
    return bytearray(b"\n".join(lines))


def put_yaml(data: Bytes, heads: list[int], rng: np.random.Generator) -> Bytes:
    """Put a tag, an alias, a nest or a number into the place of a value."""
    evil = (
        *(b"!!python/object/apply:os.system [echo]", b"&a [*a, *a]", b"[" * 5000, b"{" * 5000),
        *(b"1e999", b".nan", b"0x" + b"f" * 400, b"9" * 5000, b"2001-99-99", b"!!binary x", b"*a"),
    )
    lines = bytes(data).split(b"\n")
    valued = [k for k, line in enumerate(lines) if b":" in line]
    k = int(rng.choice(valued))
    lines[k] = lines[k].split(b":")[0] + b": " + evil[int(rng.integers(len(evil)))]
    return bytearray(b"\n".join(lines))


METADATA_DAMAGES: tuple[Damage, ...] = (
    *(flip_anywhere, cut, name_another, shuffle_lines, put_yaml),
)


def folders_with_traps(folder: Path) -> list[Path]:
    """Write an MCAP and a sqlite3 folder, links and a pipe in them, a whole bag outside them."""
    mcap = folder_bag(folder).rename(folder / "mcap")
    sqlite_bytes(folder)
    bags = [mcap, (folder / "database").rename(folder / "sqlite3")]
    (folder / "outside.mcap").write_bytes(tiny_mcap())
    for bag in bags:
        (bag / "link.mcap").symlink_to(folder / "outside.mcap")
        (bag / "link").symlink_to(folder)
        os.mkfifo(bag / "pipe.mcap")
    return bags


class OpenedOutside:
    """Watches which files this process opens, by Python's own audit events.

    sqlite3 opens its journals itself, beside the file that it was told to open.
    """

    def __init__(self, root: Path) -> None:
        self.root = str(root)
        self.allowed: str | None = None
        self.seen: list[str] = []
        self.system = (sys.prefix, sys.base_prefix, tempfile.gettempdir() + "/tmp")
        sys.addaudithook(self._see)

    def _see(self, event: str, arguments: tuple[object, ...]) -> None:
        if self.allowed is None or event not in ("open", "sqlite3.connect"):
            return
        path = str(arguments[0]).removeprefix("file:").split("?")[0]
        system = path.startswith(self.system)
        inside = path.startswith(self.allowed + "/") and not Path(path).is_symlink()
        if not (inside or system or arguments[0].__class__ is int):
            self.seen.append(path)

    @contextlib.contextmanager
    def only(self, bag: Path) -> Iterator[None]:
        """Raise AssertionError where a file outside of a folder is opened meanwhile."""
        self.seen, self.allowed = [], str(bag)
        try:
            yield
        finally:
            self.allowed = None
        assert not self.seen, f"opened {self.seen[0]}"


def tiny_mcap(
    compression: CompressionType = CompressionType.NONE, crcs: bool = False, chunked: bool = True
) -> bytes:
    """Return an MCAP file small enough to be damaged in every place."""
    imu = make.still_imu(np.random.default_rng(1), 6, 100.0)
    file = io.BytesIO()
    writer = Writer(
        file, chunk_size=1000, compression=compression, enable_crcs=crcs, use_chunking=chunked
    )
    writer.start(profile="ros2")
    schema = writer.register_schema(imu.type, "ros2msg", b"")
    channel = writer.register_channel(imu.topic, "cdr", schema)
    for time, row in zip(imu.log_ns.tolist(), imu.messages, strict=True):
        writer.add_message(channel, time, row.tobytes(), time)
    writer.finish()
    return file.getvalue()


def every_prefix(data: bytes, step: int = 1) -> Iterator[bytes]:
    """Yield a file cut at every byte."""
    return (data[:end] for end in range(0, len(data), step))


def every_head_flip(data: bytes, flips: range) -> Iterator[bytes]:
    """Yield a file with each byte of each record head changed in each of the ways."""
    for at in (head + k for head in record_heads(data) for k in range(9)):
        for flip in flips:
            yield data[:at] + bytes([data[at] ^ flip]) + data[at + 1 :]


def read_or_refuse(path: Path, judged: bool = True) -> str:
    """Read a bag; return ``read`` or ``refused``, raise AssertionError for anything else.

    Without `judged` the messages are decoded, but stamps and motion are not looked into.
    """
    try:
        if judged:
            check(read_recording(path, threads=1))
        else:
            columns, _ = read_topics(path, threads=1)
            assert all(c.values.shape[1] == c.stamp_ns.size == c.log_ns.size for c in columns)
    except InputError as error:
        line = str(error)
    else:
        return "read"
    assert "\n" not in line, line
    assert str(path) in line, line
    return "refused"


def check(recording: Recording) -> None:
    """Assert that a recording is sound, whatever it was read from."""
    assert recording.channels
    for k, channel in enumerate(recording.channels):
        count = channel.values.size
        assert count >= 2
        assert channel.stamp_ns.shape == channel.still.shape == (count,)
        assert (np.diff(channel.stamp_ns) > 0).all()
        assert np.isfinite(channel.values).all()
        assert np.isfinite(channel.rate_hz)
        assert channel.rate_hz > 0
        if channel.still.any() and k % 3 == 0:
            assert to_series(channel, recording.start_ns).values.size < 5_000_000
    assert all("\n" not in note for note in recording.notes)
