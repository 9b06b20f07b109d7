"""Damaged MCAP files: what is whole is read, what is not is named."""

import struct

import lz4.frame
import numpy as np
import pytest
import zstandard
from imu_noise_id.bag_writer import write_bag
from imu_noise_id.bags import read_recording, read_topics
from imu_noise_id.errors import InputError
from mcap.writer import CompressionType, IndexType, Writer

from helpers import bag_making as make
from imu_noise_id import mcap_file

COUNT = 12_000


@pytest.fixture(scope="module")
def imu():
    return make.still_imu(np.random.default_rng(5), COUNT)


@pytest.fixture
def bag(tmp_path, imu):
    write_bag(tmp_path / "bag", [imu])
    return tmp_path / "bag" / "bag.mcap"


def write_with_mcap(path, imu, rows=None, **settings):
    """Write with the mcap library, whose indexes, checksums and chunking can be chosen."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=100_000, **settings)
        writer.start(profile="ros2")
        schema = writer.register_schema(imu.type, "ros2msg", b"")
        channel = writer.register_channel(imu.topic, "cdr", schema)
        for time, row in zip(
            imu.log_ns.tolist(), imu.messages if rows is None else rows, strict=True
        ):
            writer.add_message(channel, time, row.tobytes(), time)
        writer.finish()


def spans_of(path):
    with path.open("rb") as file:
        return mcap_file.scan(file, str(path)).spans


def gyro(path):
    return read_recording(path).channel("angular_velocity.x")


@pytest.mark.parametrize("compression", CompressionType)
@pytest.mark.parametrize("crcs", [True, False])
@pytest.mark.parametrize("index", [IndexType.ALL, IndexType.NONE, IndexType.CHUNK])
def test_every_way_of_the_mcap_library_reads_the_same(tmp_path, imu, compression, crcs, index):
    write_with_mcap(
        tmp_path / "a.mcap", imu, compression=compression, enable_crcs=crcs, index_types=index
    )
    write_bag(tmp_path / "bag", [imu])
    np.testing.assert_array_equal(gyro(tmp_path / "a.mcap").values, gyro(tmp_path / "bag").values)


def test_messages_outside_chunks_are_read(tmp_path, imu):
    write_with_mcap(tmp_path / "a.mcap", imu, use_chunking=False)
    assert gyro(tmp_path / "a.mcap").values.size == COUNT


def test_a_file_without_footer_is_read_as_far_as_it_is_whole(bag):
    third = spans_of(bag)[2]
    data = bag.read_bytes()
    bag.write_bytes(data[: third.at + 1000])
    recording = read_recording(bag)
    assert 0 < recording.channels[0].values.size < COUNT
    assert "ends in the middle of a record" in recording.notes[0]


def test_a_file_cut_in_its_first_chunk_is_a_clear_line(bag):
    bag.write_bytes(bag.read_bytes()[:2000])
    with pytest.raises(InputError, match="ends in the middle of a record"):
        read_recording(bag)


def test_a_chunk_with_a_wrong_checksum_is_left_out_and_named(tmp_path, imu):
    path = tmp_path / "a.mcap"
    write_with_mcap(path, imu, compression=CompressionType.NONE)
    span = spans_of(path)[3]
    data = bytearray(path.read_bytes())
    data[span.at + 5000] ^= 1
    path.write_bytes(data)
    recording = read_recording(path)
    lost = span.index[1][1]
    assert recording.channels[0].values.size == COUNT - lost
    assert recording.channels[0].quality.missing == lost
    assert "checksum is wrong" in recording.notes[0]
    assert f"its {lost} messages are left out" in recording.notes[0]
    assert f"{COUNT - lost} of the {COUNT} messages" in recording.notes[1]


def test_a_chunk_that_does_not_unpack_is_left_out_and_named(bag):
    span = spans_of(bag)[1]
    data = bytearray(bag.read_bytes())
    data[span.at : span.at + 4] = b"\0\0\0\0"
    bag.write_bytes(data)
    recording = read_recording(bag)
    assert "cannot be unpacked" in recording.notes[0]
    assert recording.channels[0].quality.gaps == 1


@pytest.mark.parametrize("claim", [100 << 30, 2**64 - 1, 1])
def test_a_chunk_that_claims_another_size_is_left_out(bag, claim):
    span = spans_of(bag)[1]
    data = bytearray(bag.read_bytes())
    at = span.at - 8 - 4 - len(span.compression) - 4 - 8
    assert struct.unpack_from("<Q", data, at)[0] == span.size
    struct.pack_into("<Q", data, at, claim)
    bag.write_bytes(data)
    recording = read_recording(bag)
    assert "claims" in recording.notes[0] or "another size" in recording.notes[0]
    assert recording.channels[0].quality.gaps == 1


@pytest.mark.parametrize("offset", [0, 7, 2**63, 2**64 - 1])
def test_indexes_that_point_elsewhere_are_not_followed(bag, imu, offset):
    data = bytearray(bag.read_bytes())
    for span in spans_of(bag):
        at, count = span.index[1]
        for k in range(count):
            struct.pack_into("<Q", data, at + 16 * k + 8, offset)
    bag.write_bytes(data)
    channel = gyro(bag)
    assert channel.values.size == COUNT
    assert channel.quality.missing == 0


def test_an_index_that_leaves_messages_out_does_not_lose_them(bag):
    data = bytearray(bag.read_bytes())
    for span in spans_of(bag):
        at, count = span.index[1]
        data[at + 16 * 3 : at + 16 * 4] = data[at : at + 16]
        assert count > 4
    bag.write_bytes(data)
    assert gyro(bag).values.size == COUNT


def test_unpacking_stops_at_its_limit():
    packed = lz4.frame.compress(bytes(50 << 20))
    assert len(mcap_file.decompress(packed, "lz4", 1000)) == 1001
    with pytest.raises(mcap_file.DamagedError, match="another size"):
        mcap_file.decompress(zstandard.compress(bytes(50 << 20)), "zstd", 1000)


@pytest.mark.parametrize(
    ("encoding", "says"), [("cdr", None), ("ros1", "convert the bag to ROS 2")]
)
def test_a_type_may_be_named_as_in_ros_1(tmp_path, imu, encoding, says):
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile=encoding)
        schema = writer.register_schema("sensor_msgs/Imu", "ros2msg", b"")
        channel = writer.register_channel(imu.topic, encoding, schema)
        for time, row in zip(imu.log_ns.tolist(), imu.messages, strict=True):
            writer.add_message(channel, time, row.tobytes(), time)
        writer.finish()
    if says is None:
        assert gyro(path).values.size == COUNT
        return
    with pytest.raises(InputError, match=says):
        read_recording(path)


def test_an_unknown_compression_is_named():
    with pytest.raises(mcap_file.DamagedError, match="unknown compression 'gzip'"):
        mcap_file.decompress(b"", "gzip", 10)


def test_walking_stops_at_a_record_that_does_not_fit():
    chunk = np.frombuffer(
        struct.pack("<BQ", 5, 30) + bytes(30) + struct.pack("<BQ", 5, 99), np.uint8
    )
    records = mcap_file.walk(chunk, 0, chunk.size)
    assert next(records) == (5, 9, 30)
    with pytest.raises(mcap_file.DamagedError, match="middle of a record"):
        next(records)


def test_a_small_file_that_unpacks_to_endless_messages_is_left_in_time(tmp_path, imu):
    path, count = tmp_path / "bomb.mcap", 60_000
    same = make.messages(imu.topic, imu.type, np.zeros(count, np.int64), {})
    write_with_mcap(path, same, compression=CompressionType.ZSTD, index_types=IndexType.NONE)
    assert path.stat().st_size < 0.9 * count
    (columns,), notes = read_topics(path)
    assert columns.stamp_ns.size < count
    assert "more messages than bytes" in notes[0]
