"""nav_fusion.observe through the engine: each setting of a sensor against a closed-form scene."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nav_fusion.engine import Engine, joined
from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.parameters import Parameters
from nav_fusion.solution import Solution, solve
from scipy.spatial.transform import Rotation

from helpers.drive import ALTITUDE, EAST_M, GRAVITY, LATITUDE, LONGITUDE, START_NS, drive, play

ORIGIN = (LATITUDE, LONGITUDE, ALTITUDE)
GYRO = AxisNoise(1e-4, (SlowTerm(1e-3, float("inf"), 0.0, "turn_on_bias"),))
ACCEL = AxisNoise(2e-3, (SlowTerm(0.05, float("inf"), 0.0, "turn_on_bias"),))
NOISE = NavigationNoise(
    (GYRO,) * 3, (ACCEL,) * 3, (AidNoise(0.3),) * 3, (AidNoise(0.1),) * 3, AidNoise(0.02)
)
HEADED = Parameters(initial_heading_rad=0.0, use_magnetometer=False, use_velocity=False)
FIELD_T = np.array((21e-6, -43e-6))
"""Horizontal and upward part."""


def end(engine: Engine, rows: object) -> Solution:
    return solve(rows.stamp_ns, rows.values, ORIGIN, engine.parameters.lever_arm_m)  # type: ignore[attr-defined]


def standing(
    attitude: Rotation,
    parameters: Parameters,
    declination: float,
    hard: np.ndarray,
    bent: np.ndarray,
) -> Solution:
    """Rest for 20 s with a magnetometer whose readings are ``bent`` B + ``hard``."""
    rng = np.random.default_rng(7)
    engine = Engine(NOISE, parameters)
    gravity = attitude.inv().apply((0.0, 0.0, GRAVITY))
    north = FIELD_T[0] * np.array((np.sin(declination), np.cos(declination), 0.0))
    field = attitude.inv().apply(north + np.array((0.0, 0.0, FIELD_T[1])))
    rows = []
    for k in range(200):
        ns = START_NS + 10_000_000 * np.arange(10 * k, 10 * k + 10, dtype=np.int64)
        rate = rng.normal(0, 1e-3, (10, 3))
        rows.append(engine.add_imu(ns, rate, gravity + rng.normal(0, 0.02, (10, 3))))
        engine.add_field(int(ns[-1]), bent @ (field + rng.normal(0, 2e-7, 3)) + hard)
        metres = rng.normal(0, 0.3, 3)
        east = np.degrees(metres[0] / EAST_M / np.cos(np.radians(LATITUDE)))
        north_deg = np.degrees(metres[1] / 6.37e6)
        place = LATITUDE + north_deg, LONGITUDE + east, ALTITUDE + metres[2]
        engine.add_fix(int(ns[-1]), *place)
    return end(engine, joined(rows))


@pytest.mark.parametrize("heading", [0.0, 1.2, -2.9])
@pytest.mark.parametrize("declination", [0.0, 0.3, -0.2])
def test_a_magnetometer_finds_the_heading_from_true_north(
    heading: float, declination: float
) -> None:
    attitude = Rotation.from_euler("ZYX", (heading, 0.1, -0.2))
    settings = Parameters(use_velocity=False, declination_rad=declination)
    s = standing(attitude, settings, declination, np.zeros(3), np.eye(3))
    error = (s.heading[-1] - heading + np.pi) % (2 * np.pi) - np.pi
    assert s.hypotheses[-1] == 1
    assert abs(error) < 4 * s.heading_sigma[-1] + 0.005
    assert s.heading_sigma[-1] < 0.02


def test_hard_and_soft_iron_are_taken_out_before_the_field_is_used() -> None:
    hard = np.array((12e-6, -7e-6, 4e-6))
    bent = np.array(((1.2, 0.1, 0.0), (-0.05, 0.9, 0.1), (0.02, 0.0, 1.1)))
    attitude = Rotation.from_euler("ZYX", (0.8, 0.05, 0.1))
    soft = tuple(map(tuple, np.linalg.inv(bent).tolist()))
    known = Parameters(use_velocity=False, hard_iron_t=tuple(hard.tolist()), soft_iron=soft)
    s = standing(attitude, known, 0.0, hard, bent)
    assert abs(s.heading[-1] - 0.8) < 4 * s.heading_sigma[-1] + 0.005
    unknown = standing(attitude, Parameters(use_velocity=False), 0.0, hard, bent)
    assert abs(unknown.heading[-1] - 0.8) > 0.1


def turntable(parameters: Parameters, arm: tuple[float, float]) -> Solution:
    """IMU on the axis of a table that turns at 0.5 rad/s, antenna on an arm: a circle."""
    rng = np.random.default_rng(8)
    engine = Engine(NOISE, parameters)
    t = np.arange(3000) / 100
    ns = START_NS + np.rint(t * 1e9).astype(np.int64)
    turning = np.clip(t - 2.0, 0, None)
    rate = rng.normal(0, 1e-3, (t.size, 3))
    rate[:, 2] += 0.5 * (t > 2.0)
    force = rng.normal((0, 0, GRAVITY), 0.02, (t.size, 3))
    turned = Rotation.from_euler("z", 0.5 * turning[:, None]).apply((*arm, 0.0))
    rows = []
    for k in range(0, t.size, 20):
        rows.append(engine.add_imu(ns[k : k + 20], rate[k : k + 20], force[k : k + 20]))
        i = min(k + 19, t.size - 1)
        metres = turned[i] + rng.normal(0, 0.3, 3)
        east = np.degrees(metres[0] / EAST_M / np.cos(np.radians(LATITUDE)))
        place = LATITUDE + np.degrees(metres[1] / 6.37e6), LONGITUDE + east, ALTITUDE + metres[2]
        engine.add_fix(int(ns[i]), *place)
    return end(engine, joined(rows))


def test_the_lever_arm_leaves_the_axis_of_a_turntable_where_it_is() -> None:
    arm = (3.0, 1.0)
    settings = replace(HEADED, lever_arm_m=(*arm, 0.0), zero_velocity_updates=False)
    s = turntable(settings, arm)
    sigma = np.sqrt(np.diag(s.pose_covariance[-1]))
    assert np.all(np.abs(s.position[-1, :2]) < 4 * sigma[:2])
    antenna = (s.antenna[-1, :2] - ORIGIN[:2]) * np.radians((6.37e6, EAST_M * np.cos(0.8203)))
    assert np.hypot(*antenna) == pytest.approx(np.hypot(*arm), abs=4 * sigma[:2].max() + 0.02)
    plain = turntable(replace(settings, lever_arm_m=(0.0, 0.0, 0.0)), arm)
    assert np.hypot(*plain.position[-1, :2]) > 4 * sigma[:2].max()


def test_a_known_delay_of_the_fixes_changes_nothing_and_an_unknown_one_drags() -> None:
    d = drive(20.0)
    late = replace(d, fix_ns=d.fix_ns + 200_000_000)
    ends = []
    for settings, data in (
        (HEADED, d),
        (replace(HEADED, gnss_delay_s=0.2), late),
        (HEADED, late),
    ):
        engine = Engine(NOISE, settings)
        ends.append(end(engine, play(engine, data, 0.0)))
    in_time, mended, dragged = (s.position[-1] for s in ends)
    np.testing.assert_allclose(mended, in_time, atol=0.3)
    speed = float(np.linalg.norm(ends[0].velocity[-1]))
    assert abs(dragged[0] - in_time[0]) > 0.5 * 0.2 * speed


def test_the_mounting_turns_sensor_axes_into_those_of_the_body() -> None:
    d = drive(15.0)
    roll, pitch, yaw = 0.3, -0.2, 2.0
    body = Rotation.from_euler("ZYX", (yaw, pitch, roll))
    turned = replace(d, rate=body.inv().apply(d.rate), force=body.inv().apply(d.force))
    straight = Engine(NOISE, HEADED)
    play(straight, d)
    mounted = Engine(NOISE, replace(HEADED, mounting_rpy_rad=(roll, pitch, yaw)))
    play(mounted, turned)
    np.testing.assert_allclose(mounted.state()[:10], straight.state()[:10], rtol=1e-9, atol=1e-7)
