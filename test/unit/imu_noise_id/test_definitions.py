"""Definitions embedded in bags, against those of rosbags for several ROS distributions."""

import pytest
from imu_noise_id.definitions import full_name, is_standard
from rosbags.typesys import Stores, get_typestore

from imu_noise_id import cdr


def embedded(msgtype, store=Stores.ROS2_JAZZY):
    return get_typestore(store).generate_msgdef(msgtype, ros_version=2)[0]


@pytest.mark.parametrize("msgtype", cdr.LAYOUTS)
@pytest.mark.parametrize("store", [Stores.ROS2_FOXY, Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY])
def test_every_distribution_has_the_standard_types(msgtype, store):
    assert is_standard(msgtype, embedded(msgtype, store))


def test_comments_defaults_and_constants_make_no_difference():
    text = "# an imu\nuint8 UNKNOWN=0\n" + embedded(cdr.IMU).replace("float64 x", "float64 x 0  #?")
    assert is_standard(cdr.IMU, text)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("float64", "float32"),
        ("float64 x\nfloat64 y", "float64 y\nfloat64 x"),
        ("std_msgs/Header header\n", "std_msgs/Header header\nuint8 mode\n"),
        ("float64[9] orientation_covariance\n", ""),
        ("float64[9]", "float64[]"),
        ("MSG: geometry_msgs/Vector3", "MSG: other_msgs/Vector3"),
        ("geometry_msgs/Vector3 angular", "geometry_msgs/Vector3[2] angular"),
    ],
)
def test_another_layout_is_told(old, new):
    assert old in embedded(cdr.IMU)
    assert not is_standard(cdr.IMU, embedded(cdr.IMU).replace(old, new))


def test_a_definition_that_contains_itself_ends():
    assert not is_standard(cdr.IMU, "sensor_msgs/Imu imu\nsensor_msgs/Imu other\n")


def test_full_names():
    assert full_name("std_msgs/Header") == "std_msgs/msg/Header"
    assert full_name("Header", "std_msgs") == "std_msgs/msg/Header"
    assert full_name("std_msgs/msg/Header") == "std_msgs/msg/Header"
