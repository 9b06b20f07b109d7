"""Which topic is read: defaults, the only one of its type, or a question."""

import pytest
from imu_noise_id.errors import InputError
from imu_noise_id.topics import TopicInfo, TopicNames, choose_topics

from imu_noise_id import cdr

CAMERA = TopicInfo("/camera", "sensor_msgs/msg/Image", 9)


def imu(name, count=5, problem=""):
    return TopicInfo(name, cdr.IMU, count, problem)


def chosen(found, **names):
    return {k: t.name for k, t in choose_topics(found, TopicNames(**names), "bag").items()}


def test_the_default_comes_first():
    assert chosen([imu("/other"), imu("/imu/data"), CAMERA]) == {"imu": "/imu/data"}


def test_the_only_topic_of_a_type_is_taken():
    assert chosen([CAMERA, imu("/livox/imu")]) == {"imu": "/livox/imu"}


def test_an_empty_topic_is_not_in_question():
    assert chosen([imu("/a"), imu("/b", 0)]) == {"imu": "/a"}


def test_several_are_a_question_with_the_list():
    with pytest.raises(InputError, match=r"which one is the imu topic\? /a .*/b .*--topic imu="):
        chosen([imu("/a"), imu("/b")])


def test_the_one_asked_for_is_taken_and_the_others_left():
    found = [imu("/a"), imu("/b"), TopicInfo("/t", cdr.TEMPERATURE, 3)]
    assert chosen(found, imu="/b", temperature="") == {"imu": "/b"}


def test_a_topic_asked_for_that_is_not_there():
    with pytest.raises(InputError, match=r"no topic /c; it holds /a \(sensor_msgs/Imu, 5\)"):
        chosen([imu("/a")], imu="/c")


def test_a_topic_asked_for_of_another_type():
    with pytest.raises(InputError, match="/camera is sensor_msgs/Image, not sensor_msgs/Imu"):
        chosen([imu("/a"), CAMERA], imu="/camera")


def test_both_velocity_types_are_velocities():
    for msgtype in (cdr.TWIST, cdr.TWIST_WITH_COVARIANCE):
        assert chosen([TopicInfo("/v", msgtype, 3)], vel="/v") == {"vel": "/v"}


@pytest.mark.parametrize("found", [[CAMERA], [], [TopicInfo("/t", cdr.TEMPERATURE, 3)]])
def test_no_matching_topic_lists_what_there_is(found):
    with pytest.raises(InputError, match=r"no topic of sensor_msgs/Imu.*; it holds"):
        chosen(found)


def test_a_topic_that_cannot_be_decoded_says_why():
    with pytest.raises(InputError, match="topic /a is encoded as 'ros1'"):
        chosen([imu("/a", problem="is encoded as 'ros1'")])
