"""What a recording is."""

import numpy as np
import pytest
from imu_noise_id.recording import UNITS, Channel, Recording, unit_of


def test_every_channel_has_its_unit():
    assert unit_of("angular_velocity.x") == "rad/s"
    assert unit_of("heading") == "rad"
    assert set(UNITS) == {
        "angular_velocity",
        "linear_acceleration",
        "position",
        "velocity",
        "magnetic_field",
        "heading",
        "temperature",
    }


def test_channels_are_found_by_name():
    one = Channel(
        "/t",
        "heading",
        "rad",
        np.array([0, 2_000_000_000]),
        np.zeros(2),
        np.ones(2, dtype=bool),
        0.5,
    )
    recording = Recording("bag", 0, (one,))
    assert recording.channel("heading") is one
    assert one.duration_s == 2.0
    with pytest.raises(KeyError):
        recording.channel("position.up")
