"""What a recording says of itself costs no memory, no endless walk and no open file."""

import os
import resource
import struct
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.bags import read_recording
from imu_noise_id.errors import InputError
from mcap.writer import CompressionType

from helpers import damaged_bags as damaged
from imu_noise_id import mcap_file

ROOM = 384 << 20
CLAIM = 100 << 30
CHUNK, FOOTER = 0x06, 0x02


@pytest.fixture
def little_memory():
    """Let this process claim no more than a chunk's limit and some beyond what it has."""
    read_recording_of(damaged.tiny_mcap(), Path("/dev/shm") / f"warm_{os.getpid()}.mcap")
    before = resource.getrlimit(resource.RLIMIT_AS)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + ROOM, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


def read_recording_of(data, path):
    path.write_bytes(data)
    try:
        return read_recording(path, threads=1)
    finally:
        path.unlink()


def chunk_places(data):
    """Return where the bodies of the chunks begin."""
    return [at + 9 for at in damaged.record_heads(data) if data[at] == CHUNK]


@pytest.mark.parametrize("kind", [CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4])
def test_a_chunk_that_claims_100_gigabytes_costs_no_memory(tmp_path, little_memory, kind):
    data = bytearray(damaged.mcap_bytes(kind, crcs=False))
    struct.pack_into("<Q", data, chunk_places(data)[1] + 16, CLAIM)
    recording = read_recording_of(data, tmp_path / "bag.mcap")
    assert "claims 107374182400 bytes" in recording.notes[0]
    assert recording.channels[0].values.size > 0


def test_a_chunk_that_is_packed_to_100_gigabytes_costs_no_memory(tmp_path, little_memory):
    data = bytearray(damaged.mcap_bytes(CompressionType.NONE, crcs=False))
    struct.pack_into("<Q", data, chunk_places(data)[1] + 32, CLAIM)
    recording = read_recording_of(data, tmp_path / "bag.mcap")
    assert "longer than its record" in recording.notes[0]
    assert recording.channels[0].values.size > 0


def test_a_summary_and_indexes_that_point_at_themselves_are_not_followed(tmp_path):
    data = bytearray(damaged.mcap_bytes(CompressionType.NONE, crcs=False))
    whole = read_recording_of(data, tmp_path / "bag.mcap").channels[0].values.size
    footer = damaged.record_heads(data)[-1]
    assert data[footer] == FOOTER
    struct.pack_into("<QQ", data, footer + 9, footer, footer)
    assert read_recording_of(data, tmp_path / "bag.mcap").channels[0].values.size == whole


def test_a_chunk_in_a_chunk_is_passed_over(tmp_path):
    data = damaged.mcap_bytes(CompressionType.NONE, crcs=False)
    begin = chunk_places(data)[0] - 9
    size = 9 + int.from_bytes(data[begin + 1 : begin + 9], "little")
    inner = data[begin : begin + size]
    head = struct.pack("<QQQII", 0, 2**62, size, 0, 0) + struct.pack("<Q", size)
    outer = bytes([CHUNK]) + struct.pack("<Q", len(head) + size) + head + inner
    nested = data[:begin] + outer + data[begin:]
    plain, found = (read_recording_of(d, tmp_path / "bag.mcap") for d in (data, nested))
    np.testing.assert_array_equal(found.channels[0].values, plain.channels[0].values)


def test_a_record_of_no_length_ends_the_walk():
    chunk = np.frombuffer(bytes([5]) + bytes(8), np.uint8)
    assert len(list(mcap_file.walk(chunk, 0, chunk.size))) == 1


@pytest.mark.parametrize("target", ["loop.mcap", "."])
def test_a_link_to_itself_is_a_clear_line(tmp_path, target):
    (tmp_path / "loop.mcap").symlink_to(target)
    with pytest.raises(InputError, match=r"loop\.mcap"):
        read_recording(tmp_path / "loop.mcap" / ("x" if target == "." else ""))


def test_reading_leaves_no_file_open_and_memory_flat(tmp_path):
    whole = damaged.mcap_bytes(CompressionType.ZSTD, crcs=True, every=True)
    path = tmp_path / "bag.mcap"

    def read_many(count):
        for k in range(count):
            rng = np.random.default_rng(k)
            path.write_bytes(damaged.flip_anywhere(bytearray(whole), [], rng))
            damaged.read_or_refuse(path)
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return len(os.listdir("/proc/self/fd")), pages * resource.getpagesize()

    files, memory = read_many(100)
    after = read_many(300)
    assert after[0] == files
    assert after[1] - memory < 4 << 20
