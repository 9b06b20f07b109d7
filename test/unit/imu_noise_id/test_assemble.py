"""Topics to channels, without files."""

from dataclasses import replace

import numpy as np
import pytest
from imu_noise_id.assemble import to_recording
from imu_noise_id.columns import ColumnBuffer, TopicColumns
from imu_noise_id.errors import InputError

from helpers import bag_making as make
from imu_noise_id import cdr


def received(topic):
    """Return a topic as a live node has it: batches of bytes, decoded as they come."""
    buffer = ColumnBuffer(topic.topic, topic.type, capacity=1)
    for first in range(0, topic.log_ns.size, 37):
        part = slice(first, first + 37)
        decoded = cdr.decode_batch(topic.type, [row.tobytes() for row in topic.messages[part]])
        buffer.append(decoded, topic.log_ns[part])
    return buffer.columns()


@pytest.fixture
def rng():
    return np.random.default_rng(9)


def test_channels_come_in_the_order_of_the_conventions(rng):
    slow = make.uniform(100, 10.0)
    topics = [
        received(make.still_imu(rng, 1000)),
        received(make.field(slow, rng.normal(2e-5, 1e-7, (100, 3)))),
        received(make.fixes(slow, rng.normal((45.0, 7.0, 1.0), 1e-6, (100, 3)))),
        received(make.velocities(slow, rng.normal(0, 0.1, (100, 3)))),
    ]
    recording = to_recording(topics, "live")
    assert [c.name for c in recording.channels] == [
        *(f"angular_velocity.{a}" for a in "xyz"),
        *(f"linear_acceleration.{a}" for a in "xyz"),
        *(f"magnetic_field.{a}" for a in "xyz"),
        *(f"position.{a}" for a in ("east", "north", "up")),
        *(f"velocity.{a}" for a in ("east", "north", "up")),
        "heading",
    ]
    assert recording.start_ns == make.START_NS
    assert recording.claim is None
    channels = recording.channels
    assert channels[0].stamp_ns is channels[5].stamp_ns


def test_messages_without_a_fix_are_left_out_and_noted(rng):
    status = np.zeros(100)
    status[:7] = -1.0
    llh = rng.normal((45.0, 7.0, 1.0), 1e-6, (100, 3))
    llh[:7] = 0.0
    recording = to_recording(
        [received(make.fixes(make.uniform(100, 5.0), llh, status=status))], "x"
    )
    channel = recording.channel("position.north")
    assert channel.values.size == 93
    assert abs(channel.values).max() < 1.0
    assert "7 messages say that there is no fix" in channel.quality.notes[0]


def test_fixes_without_an_altitude_still_have_east_and_north(rng):
    llh = rng.normal((45.0, 7.0, 200.0), (1e-6, 1e-6, 0.3), (100, 3))
    whole = to_recording([received(make.fixes(make.uniform(100, 5.0), llh))], "x")
    some, none = llh.copy(), llh.copy()
    some[3, 2], none[:, 2] = np.nan, np.nan
    of_some = to_recording([received(make.fixes(make.uniform(100, 5.0), some))], "x")
    of_none = to_recording([received(make.fixes(make.uniform(100, 5.0), none))], "x")
    for name in ("position.east", "position.north"):
        expected = whole.channel(name).values
        np.testing.assert_allclose(of_some.channel(name).values, expected, rtol=1e-6)
        np.testing.assert_allclose(of_none.channel(name).values, expected, rtol=1e-4)
    assert of_some.channel("position.up").quality.non_finite == 1
    assert [c.name for c in of_none.channels] == ["position.east", "position.north"]
    assert "position.up: no finite sample" in of_none.notes[0]


def test_a_simulation_may_begin_at_zero(rng):
    topic = make.still_imu(rng, stamp_ns=make.uniform(1000, 100.0, 0))
    columns = replace(received(topic), log_ns=make.uniform(1000, 100.0, make.START_NS))
    recording = to_recording([columns], "x")
    assert recording.start_ns == 0
    assert recording.notes == recording.channels[0].quality.notes == ()
    assert recording.channels[0].values.size == 1000


def test_a_receiver_that_never_has_a_fix_is_said_to_have_none(rng):
    llh = rng.normal((45.0, 7.0, 1.0), 1e-6, (100, 3))
    lost = received(make.fixes(make.uniform(100, 5.0), llh, status=np.full(100, -1.0)))
    with pytest.raises(InputError, match="100 messages say that there is no fix"):
        to_recording([lost], "x")


def test_absurd_numbers_are_not_finite(rng):
    topic = make.imu(make.uniform(50, 50.0), rng.normal(size=(50, 3)), rng.normal(size=(50, 3)))
    columns = received(topic)
    columns.values[2, 7] = 1e300
    assert to_recording([columns], "x").channel("angular_velocity.z").quality.non_finite == 1


def test_repeated_values_are_counted_as_held(rng):
    gyro = np.repeat(rng.normal(size=(50, 3)), 4, axis=0)
    recording = to_recording([received(make.imu(make.uniform(200, 50.0), gyro, gyro))], "x")
    assert recording.channels[0].quality.held == 150


def test_clocks_a_day_apart_are_noted(rng):
    late = make.still_imu(rng, stamp_ns=make.uniform(100, 50.0, make.START_NS + 10**14))
    early = make.velocities(make.uniform(100, 10.0), rng.normal(0, 0.1, (100, 3)))
    recording = to_recording([received(late), received(early)], "x")
    assert "clocks differ" in recording.notes[0]


def test_nothing_in_order_is_an_error():
    empty = np.empty(0, np.int64)
    with pytest.raises(InputError, match="live: no message"):
        to_recording([TopicColumns("/imu", cdr.IMU, empty, empty, np.empty((6, 0)))], "live")
    frozen = received(make.still_imu(np.random.default_rng(0), stamp_ns=np.full(9, 77)))
    with pytest.raises(InputError, match="all bear the stamp 77 ns"):
        to_recording([frozen], "live")


def test_a_buffer_grows_and_keeps_the_last(rng):
    topic = make.still_imu(rng, 1000)
    columns = received(topic)
    decoded = cdr.decode_batch(topic.type, [row.tobytes() for row in topic.messages])
    np.testing.assert_array_equal(columns.values, decoded.values)
    last = columns.last(int(columns.stamp_ns[900]))
    np.testing.assert_array_equal(last.values, decoded.values[:, 900:])
