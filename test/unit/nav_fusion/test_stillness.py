"""nav_fusion.stillness: what is taken for rest, and what is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nav_fusion.engine import Engine
from nav_fusion.noise import AidNoise
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.solution import solve

from helpers.drive import (
    ALTITUDE,
    EAST_M,
    LATITUDE,
    LONGITUDE,
    START_NS,
    Drive,
    drive,
    play,
    until,
)
from helpers.headed import HEADED, NOISE, fused


def test_an_even_drive_with_quiet_sensors_is_not_taken_for_rest() -> None:
    d = drive(60.0, rest_s=100.0)
    t = (d.fix_ns - START_NS) * 1e-9
    metres = EAST_M * np.cos(np.radians(LATITUDE))
    east = np.stack([0 * t, np.degrees(0.5 * t / metres), 0 * t], axis=1)
    engine, rows = fused(replace(d, fix=d.fix + east))
    solution = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    late = slice(solution.stamp_ns.size // 2, None)
    error = solution.position[late, 0] - 0.5 * (solution.stamp_ns[late] - START_NS) * 1e-9
    assert np.max(np.abs(error) / np.sqrt(solution.pose_covariance[late, 0, 0])) < 4.5
    assert engine.status().still_updates == 0


def moved(d: Drive, metres: np.ndarray) -> Drive:
    """Shift the fixes east."""
    fix = d.fix.copy()
    fix[:, 1] += np.degrees(metres / (EAST_M * np.cos(np.radians(LATITUDE))))
    return replace(d, fix=fix)


def test_rest_that_fixes_contradicted_by_mistake_is_believed_again() -> None:
    d = drive(300.0, rest_s=300.0)
    t = (d.fix_ns - START_NS) * 1e-9
    d = moved(d, np.where((t > 60) & (t < 75), 0.8, 0.0))
    counts = []
    for seconds in (80.0, 160.0, 300.0):
        engine = Engine(NOISE, HEADED)
        play(engine, until(d, seconds))
        counts.append(engine.status().still_updates)
    assert counts[0] < 4 * 65  # denied from about the first fix that was off
    assert counts[1] == counts[0]
    assert counts[2] > counts[1] + 4 * 50


@pytest.mark.parametrize("aided", [True, False])
def test_a_slow_even_motion_is_not_rest_where_fixes_or_velocities_show_it(aided: bool) -> None:
    d = drive(150.0, rest_s=150.0)
    t = (d.fix_ns - START_NS) * 1e-9
    d = moved(d, 0.1 * np.maximum(t - 60.0, 0.0))
    colour = AidNoise(0.3, (SlowTerm.gauss_markov(0.8, 30.0, "gauss_markov"),))
    parameters = replace(HEADED, use_velocity=True)
    engine = Engine(replace(NOISE, position=(colour if aided else AidNoise(0.3),) * 3), parameters)
    rng = np.random.default_rng(9)
    begin = 0
    for k, ns in enumerate(d.fix_ns):
        end = int(np.searchsorted(d.stamp_ns, ns))
        engine.add_imu(d.stamp_ns[begin:end], d.rate[begin:end], d.force[begin:end])
        begin = end
        engine.add_fix(int(ns), *d.fix[k])
        if aided:
            speed = 0.1 if t[k] > 60 else 0.0
            engine.add_velocity(int(ns), np.array((speed, 0.0, 0.0)) + rng.normal(0, 0.1, 3))
    assert 4 * 40 < engine.status().still_updates < 4 * 90
