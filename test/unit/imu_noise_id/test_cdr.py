"""The bytes of messages, against rosbags' serialiser."""

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from imu_noise_id import cdr

STAMPS = np.array([0, 1, 2_000_000_001, 1_700_000_000_123_456_789, -1_500_000_000], np.int64)


@pytest.fixture(scope="module")
def typestore():
    return get_typestore(Stores.ROS2_JAZZY)


def some_members(msgtype, rng):
    layout = cdr.LAYOUTS[msgtype]
    members = {name: rng.standard_normal(STAMPS.size) for name in layout.members}
    if layout.fix_status:
        members["status"] = np.array([-1.0, 0.0, 1.0, 2.0, -1.0])
        members["covariance_type"] = np.array([0.0, 1.0, 2.0, 3.0, 2.0])
    return members


@pytest.mark.parametrize("msgtype", cdr.LAYOUTS)
@pytest.mark.parametrize("frame_id", ["", "imu", "imu_link", "a_frame_of_21_letters"])
def test_rosbags_reads_the_same_bytes(typestore, msgtype, frame_id):
    members = some_members(msgtype, np.random.default_rng(1))
    rows = cdr.encode(msgtype, STAMPS, members, frame_id, "base_link")
    for row, stamp_ns in zip(rows, STAMPS.tolist(), strict=True):
        message = typestore.deserialize_cdr(row.tobytes(), msgtype)
        stamp = message.header.stamp
        assert message.header.frame_id == frame_id
        assert stamp.sec * 10**9 + stamp.nanosec == stamp_ns
        assert bytes(typestore.serialize_cdr(message, msgtype)) == row.tobytes()


@pytest.mark.parametrize("msgtype", cdr.LAYOUTS)
def test_decode_returns_what_was_encoded_to_the_last_bit(msgtype):
    members = some_members(msgtype, np.random.default_rng(2))
    rows = [
        row.tobytes()
        for frame_id in ("a", "abcdefgh")
        for row in cdr.encode(msgtype, STAMPS, members, frame_id, "base_link")
    ]
    decoded = cdr.decode_batch(msgtype, rows)
    assert decoded.valid.all()
    assert decoded.frame_ids == {b"a", b"abcdefgh"}
    np.testing.assert_array_equal(decoded.stamp_ns, np.tile(STAMPS, 2))
    for name, column in zip(cdr.LAYOUTS[msgtype].columns, decoded.values, strict=True):
        np.testing.assert_array_equal(column, np.tile(members[name], 2))


@pytest.mark.parametrize("msgtype", cdr.LAYOUTS)
def test_a_message_cut_anywhere_is_not_valid_and_spoils_no_other(msgtype):
    members = some_members(msgtype, np.random.default_rng(3))
    rows = [row.tobytes() for row in cdr.encode(msgtype, STAMPS, members, "imu", "base")]
    for length in range(len(rows[0])):
        decoded = cdr.decode_batch(msgtype, [rows[3], rows[0][:length], rows[3]])
        assert decoded.valid.tolist() == [True, False, True]
        assert decoded.stamp_ns.tolist() == [STAMPS[3], STAMPS[3]]


def test_a_message_that_is_too_long_or_big_endian_is_not_valid():
    row = cdr.encode(cdr.IMU, STAMPS[:1], {}, "imu")[0].tobytes()
    longer = row + bytes(8)
    big_endian = b"\0\0" + row[2:]
    endless_frame = row[:12] + b"\xff\xff\xff\xff" + row[16:]
    decoded = cdr.decode_batch(cdr.IMU, [longer, big_endian, endless_frame, row])
    assert decoded.valid.tolist() == [False, False, False, True]


def test_a_serialiser_may_pad_a_message_to_a_multiple_of_four():
    row = cdr.encode(cdr.NAV_SAT_FIX, STAMPS[:1], {"latitude": 45.0}, "gps")[0].tobytes()
    decoded = cdr.decode_batch(cdr.NAV_SAT_FIX, [row + bytes(3)])
    assert decoded.values[0].tolist() == [45.0]


def test_one_message_alone_decodes_as_in_a_batch():
    members = some_members(cdr.IMU, np.random.default_rng(4))
    rows = [row.tobytes() for row in cdr.encode(cdr.IMU, STAMPS, members, "imu")]
    batch = cdr.decode_batch(cdr.IMU, rows).values
    alone = np.hstack([cdr.decode_batch(cdr.IMU, [row]).values for row in rows])
    np.testing.assert_array_equal(alone, batch)


def test_no_message_decodes_to_no_sample():
    decoded = cdr.decode_batch(cdr.IMU, [])
    assert decoded.values.shape == (6, 0)
    assert decoded.stamp_ns.size == 0


def test_a_member_that_the_type_lacks_is_an_error():
    with pytest.raises(KeyError, match="has no member yaw"):
        cdr.encode(cdr.IMU, STAMPS, {"yaw": 1.0}, "imu")
