"""nav_fusion.resting: what rest lets a filter know, and what not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from nav_fusion.solution import solve

from helpers.drive import (
    ALTITUDE,
    LATITUDE,
    LONGITUDE,
    drive,
)
from helpers.headed import HEADED, fused


def test_at_rest_the_velocity_is_known_to_what_the_accelerometer_walks_in_a_block() -> None:
    engine, rows = fused(drive(60.0, rest_s=100.0))
    solution = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    sigma = np.sqrt(solution.velocity_covariance[-500:, 0, 0])
    assert engine.status().still_updates > 100
    assert sigma.max() < 2 * 2e-3 * np.sqrt(0.25)
    nees = np.sum((solution.velocity[-500:] / sigma[:, None]) ** 2, axis=1)
    assert nees.mean() < 5.0


def test_at_rest_neither_heading_nor_tilt_become_known_from_nothing() -> None:
    """Tilt is known to the accelerometer's bias over gravity, heading as well as at the start."""
    parameters = replace(HEADED, initial_heading_sigma_rad=0.1)
    engine, rows = fused(drive(90.0, rest_s=200.0, seed=5), parameters)
    solution = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    east, north, heading = np.sqrt(np.diag(solution.pose_covariance[-1]))[3:]
    assert engine.status().still_updates > 200
    assert min(east, north) > 0.98 * 0.05 / 9.81
    # what the gyro's bias had turned it by until rest was known (0.110 rad were left) is taken back
    assert 0.0999 < heading < 0.105
