"""Sentences say what a reader would measure."""

import numpy as np
import pytest
from imu_noise_id.effects.bandwidth_limit import BandwidthLimit
from imu_noise_id.model import FittedEffect
from imu_noise_id.reconcile.evidence import sentence


def test_a_bandwidth_is_where_the_power_is_half_and_not_the_natural_frequency() -> None:
    overdamped = BandwidthLimit(200.0, 2.0, 2.9)
    said = sentence("angular_velocity.y", "rad/s", "add", FittedEffect(overdamped, ()), (9.0, 1.0))
    assert "a bandwidth of 35.5 Hz (-3 dB) was missing" in said


@pytest.mark.parametrize(("order", "damping"), [(1, 0.7), (2, 0.2), (2, 0.7071), (2, 1.0), (2, 3)])
def test_half_power_is_where_a_driven_spring_has_half_its_power(
    order: float, damping: float
) -> None:
    limit = BandwidthLimit(40.0, order, damping)
    s = 1j * limit.half_power_hz / 40.0
    response = 1.0 / (1.0 + s) if order == 1 else 1.0 / (s * s + 2.0 * damping * s + 1.0)
    assert np.abs(response) ** 2 == pytest.approx(0.5)
