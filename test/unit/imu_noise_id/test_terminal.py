"""Numbers on the terminal have the digits that their intervals deserve."""

from __future__ import annotations

import pytest
from imu_noise_id.customary import customary
from imu_noise_id.model import Estimate
from imu_noise_id.terminal import interval, number
from imu_noise_id.wording import channel_label, powers


@pytest.mark.parametrize(
    ("value", "precision", "text"),
    [
        (1.06432e-4, 3e-6, "1.064e-04"),
        (1.06432e-4, 3e-8, "1.06432e-04"),
        (37.99999, 7e-6, "37.999990"),
        (0.0, None, "0"),
        (123.456, None, "123.5"),
        (None, None, "-"),
        ("angular_velocity.y", None, "angular_velocity.y"),
        (-2.5e-7, 1e-8, "-2.50e-07"),
    ],
)
def test_two_digits_of_the_uncertainty_are_shown(
    value: float | str | None, precision: float | None, text: str
) -> None:
    assert number(value, precision) == text


def test_both_ends_of_an_interval_are_written_alike() -> None:
    assert interval(Estimate(8e-4, 2e-4, 5e-4, 1.3e-3, "")) == "5.0e-04 .. 1.30e-03"
    assert interval(Estimate(1.0, None, None, None, "")) == "-"


def test_data_sheet_units_are_the_textbook_ones() -> None:
    value, unit = customary("angular_velocity.x", "white_noise", "density", 1.0e-4) or (0.0, "")
    assert value == pytest.approx(0.34377, rel=1e-4)  # deg/sqrt(h)
    assert unit == "deg/\u221ah"
    found = customary("linear_acceleration.x", "white_noise", "density", 9.80665e-4)
    assert found is not None
    assert found[0] == pytest.approx(100.0)  # micro-g/sqrt(Hz)
    assert customary("position.east", "white_noise", "density", 1.0) is None


def test_names_and_powers_read_as_people_write_them() -> None:
    assert channel_label("linear_acceleration.x") == "accelerometer x"
    assert channel_label("heading") == "heading"
    assert powers(1.23e-4) == "1.2\u00d710\u207b\u2074"
    assert powers(0.45) == "0.45"
