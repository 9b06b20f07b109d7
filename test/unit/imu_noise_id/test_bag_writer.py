"""Bags that we write, read by rosbags and by ourselves."""

import os

import numpy as np
import pytest
from imu_noise_id.bag_writer import TopicBytes, write_bag, write_recording
from imu_noise_id.bags import read_recording
from imu_noise_id.errors import InputError
from imu_noise_id.recording import Channel, Recording, unit_of
from rosbags.rosbag2 import Reader

from helpers import bag_making as make
from imu_noise_id import cdr

STAMPS = make.uniform(500, 100.0)


def channel(topic, name, values, stamp_ns=STAMPS):
    still = np.ones(stamp_ns.size, dtype=bool)
    return Channel(topic, name, unit_of(name), stamp_ns, values, still, 100.0)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize("compressed", [True, False])
def test_rosbags_reads_every_message_in_the_order_of_time(tmp_path, rng, compressed):
    imu = make.still_imu(rng, 300, 100.0)
    slow = make.temperatures(make.uniform(3, 1.0), np.array([20.0, 21.0, 22.0]))
    write_bag(tmp_path / "bag", [slow, imu], compressed)
    with Reader(tmp_path / "bag") as reader:
        read = list(reader.messages())
        assert {c.topic: c.msgcount for c in reader.connections} == {
            "/imu/data": 300,
            "/imu/temperature": 3,
        }
        assert all(c.msgdef.data for c in reader.connections)
    times = [time for _, time, _ in read]
    assert times == sorted(times)
    assert [bytes(d) for c, _, d in read if c.topic == "/imu/data"] == [
        row.tobytes() for row in imu.messages
    ]


def test_messages_may_be_given_as_bytes_of_any_length(tmp_path):
    rows = [
        cdr.encode(cdr.IMU, STAMPS[k : k + 1], {"angular_velocity.x": k}, "f" * k)[0].tobytes()
        for k in range(20)
    ]
    write_bag(tmp_path / "bag", [TopicBytes("/imu", cdr.IMU, STAMPS[:20], rows)])
    values = read_recording(tmp_path / "bag").channel("angular_velocity.x").values
    assert values.tolist() == list(range(20))


def test_a_recording_comes_back_to_the_last_bit(tmp_path, rng):
    names = [f"{s}.{a}" for s in ("angular_velocity", "linear_acceleration") for a in "xyz"]
    channels = [channel("/imu/data", n, rng.normal(size=500)) for n in names]
    channels += [channel("/imu/mag", f"magnetic_field.{a}", rng.normal(size=500)) for a in "xyz"]
    axes = ("east", "north", "up")
    channels += [channel("/gps/vel", f"velocity.{a}", 0.1 * rng.normal(size=500)) for a in axes]
    temperature = channel("/imu/temperature", "temperature", rng.normal(25, 1, 500))
    write_recording(Recording("", 0, tuple(channels), temperature), tmp_path / "bag")
    back = read_recording(tmp_path / "bag")
    for one in channels:
        np.testing.assert_array_equal(back.channel(one.name).values, one.values)
        np.testing.assert_array_equal(back.channel(one.name).stamp_ns, one.stamp_ns)
    np.testing.assert_array_equal(back.temperature.values, temperature.values)


def test_positions_come_back_to_a_micrometre(tmp_path, rng):
    channels = [
        channel("/gps/fix", f"position.{a}", rng.normal(size=500)) for a in ("east", "north", "up")
    ]
    write_recording(Recording("", 0, tuple(channels)), tmp_path / "bag")
    back = read_recording(tmp_path / "bag")
    for one in channels:
        expected = one.values - one.values.mean()
        np.testing.assert_allclose(back.channel(one.name).values, expected, atol=2e-6)


def test_axes_with_stamps_of_their_own_are_merged(tmp_path):
    one = channel("/imu/data", "angular_velocity.x", np.arange(500.0))
    other = channel("/imu/data", "angular_velocity.y", np.arange(250.0), STAMPS[::2])
    write_recording(Recording("", 0, (one, other)), tmp_path / "bag")
    back = read_recording(tmp_path / "bag").channel("angular_velocity.y")
    assert back.quality.non_finite == 250
    np.testing.assert_array_equal(back.values, other.values)
    np.testing.assert_array_equal(back.stamp_ns, other.stamp_ns)


def test_a_heading_alone_is_written_as_a_level_field(tmp_path, rng):
    heading = channel("/imu/mag", "heading", 0.3 + 0.01 * rng.normal(size=500))
    level = channel("/imu/data", "linear_acceleration.z", 9.81 + 0.01 * rng.normal(size=500))
    write_recording(Recording("", 0, (heading, level)), tmp_path / "bag")
    back = read_recording(tmp_path / "bag").channel("heading")
    np.testing.assert_allclose(back.values, heading.values, atol=1e-12)


def test_an_existing_bag_is_replaced_and_its_neighbours_stay(tmp_path, rng):
    write_bag(tmp_path / "bag", [make.still_imu(rng, 100)])
    (tmp_path / "bag" / "notes.txt").write_text("mine")
    write_bag(tmp_path / "bag", [make.still_imu(rng, 200)])
    assert read_recording(tmp_path / "bag").channels[0].values.size == 200
    assert (tmp_path / "bag" / "notes.txt").read_text() == "mine"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bag"]


def test_a_place_that_cannot_be_written_is_a_clear_line(tmp_path, rng):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write_bag(tmp_path / "file" / "bag", [make.still_imu(rng, 10)])


@pytest.mark.skipif(os.getuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_a_clear_line(tmp_path, rng):
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="cannot be written"):
        write_bag(tmp_path / "bag", [make.still_imu(rng, 10)])
