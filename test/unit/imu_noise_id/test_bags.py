"""Reading bags: all of rosbag2's storages, bad input, and a decoder of others beside ours."""

import shutil

import numpy as np
import pytest
import yaml
from imu_noise_id.bag_writer import write_bag
from imu_noise_id.bags import list_topics, read_recording, read_topics
from imu_noise_id.errors import InputError
from imu_noise_id.topics import TopicNames
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from helpers import bag_making as make
from imu_noise_id import cdr

STORE = get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture
def rng():
    return np.random.default_rng(42)


@pytest.fixture
def topics(rng):
    count = 9000  # several chunks
    slow = make.uniform(count // 20, 10.0)
    llh = rng.normal((45.0, 7.0, 200.0), (1e-6, 1e-6, 0.3), (slow.size, 3))
    covariance = {f"position_covariance.{k}": 1.0 + k for k in (0, 4, 8)}
    field = rng.normal((2e-5, 0.0, -4e-5), 1e-7, (count // 4, 3))
    return [
        make.still_imu(rng, count),
        make.field(make.uniform(count // 4, 50.0), field),
        make.temperatures(make.uniform(45, 1.0), rng.normal(25.0, 0.1, 45)),
        make.fixes(slow, llh, covariance_type=2.0, **covariance),
        make.velocities(slow, rng.normal(0, 0.05, llh.shape), msgtype=cdr.TWIST_WITH_COVARIANCE),
    ]


def write(path, topics, plugin, mode=CompressionMode.NONE):
    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        links = [writer.add_connection(t.topic, t.type, typestore=STORE) for t in topics]
        messages = [
            (time, link, row.tobytes())
            for link, t in zip(links, topics, strict=True)
            for time, row in zip(t.log_ns.tolist(), t.messages, strict=True)
        ]
        for time, link, row in sorted(messages, key=lambda m: m[0]):
            writer.write(link, time, row)


def assert_same(one, other):
    assert [c.name for c in one.channels] == [c.name for c in other.channels]
    for a, b in zip(one.channels, other.channels, strict=True):
        np.testing.assert_array_equal(a.values, b.values)
        np.testing.assert_array_equal(a.stamp_ns, b.stamp_ns)
        assert a.quality == b.quality


def test_values_are_those_that_rosbags_decodes(tmp_path, topics):
    write_bag(tmp_path / "bag", topics)
    recording = read_recording(tmp_path / "bag")
    with AnyReader([tmp_path / "bag"]) as reader:
        link = next(c for c in reader.connections if c.topic == "/imu/data")
        messages = [reader.deserialize(d, c.msgtype) for c, _, d in reader.messages([link])]
    expected = np.array([(m.angular_velocity.x, m.linear_acceleration.z) for m in messages])
    np.testing.assert_array_equal(recording.channel("angular_velocity.x").values, expected[:, 0])
    np.testing.assert_array_equal(recording.channel("linear_acceleration.z").values, expected[:, 1])
    assert recording.channel("heading").values.std() == pytest.approx(0.005, rel=0.1)
    assert recording.channel("position.up").rate_hz == pytest.approx(10.0)
    np.testing.assert_array_equal(recording.claim.covariance[7], np.diag((1.0, 5.0, 9.0)))
    assert recording.temperature.unit == "degC"
    assert recording.notes == ()


@pytest.mark.parametrize(
    ("plugin", "mode"),
    [
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    ],
)
def test_every_storage_holds_the_same_recording(tmp_path, topics, plugin, mode):
    write(tmp_path / "plain", topics, StoragePlugin.MCAP)
    write(tmp_path / "other", topics, plugin, mode)
    assert_same(read_recording(tmp_path / "other"), read_recording(tmp_path / "plain"))


def test_one_thread_or_several_read_the_same(tmp_path, topics):
    write_bag(tmp_path / "bag", topics)
    alone = read_recording(tmp_path / "bag", threads=1)
    assert_same(read_recording(tmp_path / "bag", threads=3), alone)


def test_split_files_are_one_recording(tmp_path, rng):
    whole = make.still_imu(rng, 6000)
    write_bag(tmp_path / "whole", [whole])
    folder = tmp_path / "split"
    folder.mkdir()
    for k in range(3):
        part = slice(2000 * k, 2000 * (k + 1))
        stamp_ns = whole.log_ns[part]
        gyro_and_force = cdr.decode_batch(cdr.IMU, [r.tobytes() for r in whole.messages[part]])
        values = gyro_and_force.values.T
        write_bag(tmp_path / f"part{k}", [make.imu(stamp_ns, values[:, :3], values[:, 3:])])
        shutil.move(tmp_path / f"part{k}" / f"part{k}.mcap", folder / f"split_{k}.mcap")
    information = yaml.safe_load((tmp_path / "part0" / "metadata.yaml").read_text())
    information["rosbag2_bagfile_information"]["relative_file_paths"] = [
        f"split_{k}.mcap" for k in range(3)
    ]
    (folder / "metadata.yaml").write_text(yaml.safe_dump(information))
    assert_same(read_recording(folder), read_recording(tmp_path / "whole"))


def test_a_bare_mcap_is_read(tmp_path, topics):
    write_bag(tmp_path / "bag", topics)
    assert_same(read_recording(tmp_path / "bag" / "bag.mcap"), read_recording(tmp_path / "bag"))


def test_only_the_last_seconds(tmp_path, topics):
    write_bag(tmp_path / "bag", topics)
    whole, last = read_recording(tmp_path / "bag"), read_recording(tmp_path / "bag", last_s=10.0)
    ends = whole.channels[0].stamp_ns[-1] - 10 * 10**9
    for channel in last.channels:
        if channel.name == "heading" or channel.name.startswith("position"):
            continue  # depend on their surroundings
        of_whole = whole.channel(channel.name)
        kept = of_whole.stamp_ns >= ends
        np.testing.assert_array_equal(channel.values, of_whole.values[kept])


def test_the_topics_of_a_bag(tmp_path, topics):
    write_bag(tmp_path / "bag", topics)
    assert {(t.name, t.count) for t in list_topics(tmp_path / "bag")} == {
        (t.topic, t.log_ns.size) for t in topics
    }


def test_stamps_all_zero_give_way_to_the_time_of_reception(tmp_path, rng):
    zero = make.still_imu(rng, stamp_ns=np.zeros(1000, np.int64))
    bag = make.imu(
        np.zeros(1000, np.int64),
        np.ones((1000, 3)),
        np.ones((1000, 3)),
        log_ns=make.uniform(1000, 50.0),
    )
    assert zero.log_ns.max() == 0
    write_bag(tmp_path / "bag", [bag])
    recording = read_recording(tmp_path / "bag")
    assert recording.channels[0].rate_hz == pytest.approx(50.0)
    assert "all header stamps of topic /imu/data are zero" in recording.notes[0]


def test_stamps_that_jump_back_an_hour(tmp_path, rng):
    stamp_ns = make.uniform(2000, 100.0)
    stamp_ns[1000:] -= 3600 * 10**9
    topic = make.still_imu(rng, stamp_ns=stamp_ns)
    write_bag(
        tmp_path / "bag",
        [make.TopicBytes(topic.topic, topic.type, make.uniform(2000, 100.0), topic.messages)],
    )
    channel = read_recording(tmp_path / "bag").channels[0]
    assert channel.values.size == 2000
    assert channel.duration_s == pytest.approx(20.0, abs=0.02)
    assert any("clock was set once" in note for note in channel.quality.notes)


def test_a_frame_that_changes_is_noted_and_read(tmp_path, rng):
    parts = [
        make.imu(
            make.uniform(100, 100.0, make.START_NS + k * 10**9),
            rng.normal(size=(100, 3)),
            rng.normal(size=(100, 3)),
            frame_id=frame,
        )
        for k, frame in enumerate(("left", "right_imu"))
    ]
    rows = [row.tobytes() for part in parts for row in part.messages]
    times = np.concatenate([part.log_ns for part in parts])
    write_bag(tmp_path / "bag", [make.TopicBytes("/imu/data", cdr.IMU, times, rows)])
    recording = read_recording(tmp_path / "bag")
    assert recording.channels[0].values.size == 200
    assert "several frames ('left', 'right_imu')" in recording.notes[0]


def test_nan_in_some_samples_is_left_out(tmp_path, rng):
    gyro, accel = rng.normal(size=(500, 3)), rng.normal(size=(500, 3))
    gyro[10:15, 1] = np.nan
    gyro[20, 1] = np.inf
    write_bag(tmp_path / "bag", [make.imu(make.uniform(500, 100.0), gyro, accel)])
    recording = read_recording(tmp_path / "bag")
    assert recording.channel("angular_velocity.y").quality.non_finite == 6
    assert recording.channel("angular_velocity.y").values.size == 494
    assert recording.channel("angular_velocity.x").quality.non_finite == 0


def test_an_all_nan_channel_is_left_out_with_a_note(tmp_path, rng):
    gyro, accel = rng.normal(size=(500, 3)), rng.normal(size=(500, 3))
    gyro[:, 1] = np.nan
    write_bag(tmp_path / "bag", [make.imu(make.uniform(500, 100.0), gyro, accel)])
    recording = read_recording(tmp_path / "bag")
    assert len(recording.channels) == 5
    assert "angular_velocity.y: no finite sample" in recording.notes[0]


def test_an_all_constant_channel_is_noted(tmp_path, rng):
    gyro, accel = rng.normal(size=(500, 3)), rng.normal(size=(500, 3))
    gyro[:, 1] = 0.0
    write_bag(tmp_path / "bag", [make.imu(make.uniform(500, 100.0), gyro, accel)])
    quality = read_recording(tmp_path / "bag").channel("angular_velocity.y").quality
    assert quality.held == 499
    assert "same value" in quality.notes[0]


def test_three_seconds_are_read(tmp_path, rng):
    write_bag(tmp_path / "bag", [make.still_imu(rng, 600)])
    assert read_recording(tmp_path / "bag").channels[0].duration_s == pytest.approx(2.995)


def test_messages_that_are_none_are_left_out_and_counted(tmp_path, rng):
    topic = make.still_imu(rng, 100)
    rows = [row.tobytes() for row in topic.messages]
    rows[3], rows[50] = rows[3][:-9], b""
    write_bag(tmp_path / "bag", [make.TopicBytes(topic.topic, topic.type, topic.log_ns, rows)])
    recording = read_recording(tmp_path / "bag")
    assert recording.channels[0].values.size == 98
    assert "2 messages of topic /imu/data are no sensor_msgs/Imu" in recording.notes[0]


@pytest.mark.parametrize(("count", "told"), [(0, "holds no message"), (1, "has one message")])
def test_zero_or_one_message(tmp_path, rng, count, told):
    write_bag(tmp_path / "bag", [make.still_imu(rng, count)])
    with pytest.raises(InputError, match=rf"/imu/data {told}"):
        read_recording(tmp_path / "bag")


def test_no_matching_topic(tmp_path):
    write_bag(tmp_path / "bag", [make.temperatures(make.uniform(9, 1.0), np.ones(9))])
    with pytest.raises(InputError, match=r"no topic of .*it holds /imu/temperature"):
        read_recording(tmp_path / "bag")


def test_a_topic_of_the_wrong_type(tmp_path, topics):
    write_bag(tmp_path / "bag", topics)
    with pytest.raises(InputError, match="/imu/mag is sensor_msgs/MagneticField, not"):
        read_recording(tmp_path / "bag", TopicNames(imu="/imu/mag"))


def test_another_definition_is_told(tmp_path, rng):
    topic = make.still_imu(rng, 10)
    text, digest = STORE.generate_msgdef(cdr.IMU, ros_version=2)[0], STORE.hash_rihs01(cdr.IMU)
    text = "uint8 mode\n" + text
    with Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        link = writer.add_connection("/imu", cdr.IMU, msgdef=text, rihs01=digest)
        writer.write(link, 5, topic.messages[0].tobytes())
    with pytest.raises(InputError, match="members differ from the standard's"):
        read_recording(tmp_path / "bag")


def test_the_last_zero_seconds_are_a_mistake(tmp_path, rng):
    write_bag(tmp_path / "bag", [make.still_imu(rng, 10)])
    with pytest.raises(InputError, match="positive number"):
        read_topics(tmp_path / "bag", last_s=0.0)
