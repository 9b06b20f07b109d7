"""nav_fusion.starting: a smooth turn is not a start from rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nav_fusion.solution import solve

from helpers.drive import (
    ALTITUDE,
    EAST_M,
    GRAVITY,
    LATITUDE,
    LONGITUDE,
    START_NS,
    Drive,
)
from helpers.headed import HEADED, fused


def circle(speed: float, radius: float, seconds: float = 60.0, seed: int = 3) -> Drive:
    """A level car on a circle from the first sample on: as smooth as rest to an IMU."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * 100)) / 100.0
    turn = speed / radius
    rate = np.stack([0 * t, 0 * t, 0 * t + turn], 1) + rng.normal(0, 1e-3, (t.size, 3))
    force = np.stack([0 * t, 0 * t + speed * turn, 0 * t + GRAVITY], 1)
    force += rng.normal(0, 0.02, force.shape)
    k = np.arange(0, t.size, 20)
    east, north = radius * np.sin(turn * t[k]), radius * (1.0 - np.cos(turn * t[k]))
    noise = rng.normal(0, 0.3, (k.size, 3))
    cosine = np.cos(np.radians(LATITUDE))
    fix = np.stack(
        [
            LATITUDE + np.degrees((north + noise[:, 1]) / 6.37e6),
            LONGITUDE + np.degrees((east + noise[:, 0]) / (EAST_M * cosine)),
            ALTITUDE + noise[:, 2],
        ],
        axis=1,
    )
    stamp_ns = START_NS + np.rint(t * 1e9).astype(np.int64)
    return Drive(stamp_ns, rate, force, stamp_ns[k], fix)


@pytest.mark.parametrize(("speed", "radius"), [(8.0, 40.0), (5.0, 50.0), (5.0, 18.0)])
def test_a_smooth_turn_from_the_first_sample_is_not_taken_for_rest(
    speed: float, radius: float
) -> None:
    """Levelled on the turn's force and sure of it, the filter was lost for good."""
    d = circle(speed, radius)
    engine, rows = fused(d, replace(HEADED, initial_heading_rad=float("nan")))
    solution = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    status = engine.status()
    assert status.fault is None
    assert status.gated == 0
    turn = speed / radius * ((rows.stamp_ns[-1] - START_NS) * 1e-9)
    apart = (solution.heading[-1] - turn + np.pi) % (2.0 * np.pi) - np.pi
    assert abs(apart) < 4.0 * solution.heading_sigma[-1] + 0.02
    expected = [radius * np.sin(turn), radius * (1.0 - np.cos(turn)), 0.0]
    sigma = np.sqrt(np.diag(solution.pose_covariance[-1])[:3])
    assert np.all(np.abs(solution.position[-1] - expected) < 4.0 * sigma + 0.05)


def test_whether_the_start_moves_does_not_depend_on_when_fixes_arrive() -> None:
    d = circle(2.8, 70.0, 20.0)  # so slow that half a second of fixes more would tell
    late_s = np.full(d.fix_ns.size, 0.45)
    late_s[-1] = 0.0
    in_order, _ = fused(d)
    late, _ = fused(d, late_s=late_s)
    assert np.array_equal(in_order.state(), late.state())
