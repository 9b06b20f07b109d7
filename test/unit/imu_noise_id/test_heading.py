"""Heading of a tilted magnetometer, against rotations made independently."""

import numpy as np
import pytest
from imu_noise_id.heading import heading
from scipy.spatial.transform import Rotation

RATE = 100
STAMPS = np.arange(500, dtype=np.int64) * (1_000_000_000 // RATE)


@pytest.mark.parametrize(("roll_deg", "pitch_deg"), [(0, 0), (20, -10), (-35, 40)])
def test_tilt_is_taken_out(roll_deg, pitch_deg):
    yaw = np.linspace(0.0, 8.0, STAMPS.size)
    angles = np.column_stack(
        (yaw, np.full_like(yaw, np.deg2rad(pitch_deg)), np.full_like(yaw, np.deg2rad(roll_deg)))
    )
    body = Rotation.from_euler("ZYX", angles).inv()
    field = body.apply((2e-5, 0.0, -4e-5)).T
    accel = body.apply((0.0, 0.0, 9.8)).T
    angle = heading(STAMPS, field, STAMPS, accel)
    np.testing.assert_allclose(angle - angle[0], yaw, atol=1e-9)


def test_the_field_s_own_noise_is_the_heading_s():
    rng = np.random.default_rng(5)
    field = np.array((2e-5, 0.0, -4e-5))[:, np.newaxis] + rng.normal(0, 1e-7, (3, STAMPS.size))
    accel = np.array((0.0, 0.0, 9.8))[:, np.newaxis] + np.zeros((3, STAMPS.size))
    assert heading(STAMPS, field, STAMPS, accel).std() == pytest.approx(0.005, rel=0.15)


def test_unknown_tilt_or_field_is_no_heading():
    field = np.full((3, 4), np.nan)
    assert np.isnan(heading(STAMPS[:4], field, STAMPS[:0], np.empty((3, 0)))).all()
    far = STAMPS[:4] + 3600 * 10**9
    accel = np.ones((3, STAMPS.size))
    assert np.isnan(heading(far, np.ones((3, 4)), STAMPS, accel)).all()
