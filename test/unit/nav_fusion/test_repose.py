"""nav_fusion.repose: until rest is known, what the gyro's bias turns teaches nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nav_fusion.alignment import matrix_of
from nav_fusion.arrays import REPOSE
from nav_fusion.consistency import covariance_of
from nav_fusion.earth import level_axes
from nav_fusion.engine import Engine
from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.parameters import Parameters
from nav_fusion.solution import solve
from nav_fusion.state import Q

from helpers.drive import ALTITUDE, LATITUDE, LONGITUDE, Drive, drive, play

COLOUR = AidNoise(0.3, (SlowTerm.gauss_markov(0.8, 30.0, "gauss_markov"),))
HEADED = Parameters(initial_heading_rad=0.0, use_magnetometer=False, use_velocity=False)


def axis(white: float, turn_on: float) -> AxisNoise:
    return AxisNoise(white, (SlowTerm(turn_on, float("inf"), 0.0, "turn_on_bias"),))


def noise(vertical: float, level: float, fixes: AidNoise) -> NavigationNoise:
    """Return a model whose gyros' biases are ``level`` but for the vertical one's."""
    gyro = (axis(1e-4, level), axis(1e-4, level), axis(1e-4, vertical))
    return NavigationNoise(
        gyro, (axis(2e-3, 0.05),) * 3, (fixes,) * 3, (AidNoise(0.1),) * 3, AidNoise(0.02)
    )


def turned(d: Drive, bias: float) -> Drive:
    """Return a drive whose vertical gyro has a bias."""
    return replace(d, rate=d.rate + np.array([0.0, 0.0, bias]))


def part(d: Drive, begin_s: float, end_s: float) -> Drive:
    t, k = ((x - d.stamp_ns[0]) * 1e-9 for x in (d.stamp_ns, d.fix_ns))
    a, b = (t >= begin_s) & (t < end_s), (k >= begin_s) & (k < end_s)
    return Drive(d.stamp_ns[a], d.rate[a], d.force[a], d.fix_ns[b], d.fix[b])


def reposes(engine: Engine) -> bool:
    assert engine._core is not None
    return bool(engine._core.shared[REPOSE] == 1.0)


def test_tilt_and_accelerometer_bias_stay_one_by_the_axes_of_the_body() -> None:
    """Fixes of 300 m tell nothing of rest: in 10 s the bias turns the estimate by 0.2 rad."""
    engine = Engine(noise(0.02, 1e-7, AidNoise(300.0)), HEADED)
    play(engine, turned(drive(seconds=12.0, rest_s=100.0), 0.02))
    assert reposes(engine)
    s, m = engine.state(), engine.layout.slow.target.size
    C = matrix_of(s[Q : Q + 4])
    up = level_axes(np.radians(LATITUDE), np.radians(LONGITUDE))[2]
    cross = np.array([[0, -up[2], up[1]], [up[2], 0, -up[0]], [-up[1], up[0], 0]])
    level = np.eye(3) - np.outer(up, up)
    apart = np.zeros((3, 9 + m))  # psi - u x C b_a / g, its level part
    apart[:, 6:9] = level
    apart[:, 12:15] = -cross @ C / 9.81
    together = apart @ covariance_of(s, m) @ apart.T
    levelled = 2e-3 / 9.81 + 1e-4
    assert np.sqrt(np.trace(together)) < 3.0 * levelled
    # had the covariance's tilt stayed behind: 0.2 rad times 0.05 m/s^2 over g, 1.4 mrad
    assert 3.0 * levelled < 0.8 * 0.2 * 0.05 / 9.81 * np.sqrt(2)


@pytest.mark.parametrize("sigma", [0.1, 0.01])
def test_rest_that_is_known_late_gives_the_heading_back_as_it_was_given(sigma: float) -> None:
    rng = np.random.default_rng(2)
    d = turned(drive(seconds=80.0, rest_s=100.0, seed=3), 0.003)
    metres = rng.normal(0, 0.8, 3) + np.cumsum(rng.normal(0, 0.8 * (2 / 150) ** 0.5, (400, 3)), 0)
    scale = np.array([1 / 111_000.0, 1 / 76_000.0, 1.0])
    d = replace(d, fix=d.fix + scale * metres)
    settings = replace(HEADED, initial_heading_sigma_rad=sigma)
    engine = Engine(noise(0.003, 0.003, COLOUR), settings)
    rows = play(engine, d)
    s = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    t = (s.stamp_ns - d.stamp_ns[0]) * 1e-9
    widest = np.sqrt(np.linalg.eigvalsh(s.velocity_covariance)[:, -1])
    known = np.argmax(widest < 0.01)  # rest is
    assert t[known] > 10.0
    assert not reposes(engine)
    assert abs(s.heading[known - 1]) > 0.02
    assert abs(s.heading[-1]) < 0.005
    assert sigma * 0.995 < s.heading_sigma[-1] < np.hypot(sigma, 0.006)


def test_motion_ends_it_for_good() -> None:
    settings = replace(HEADED, zero_velocity_updates=False)
    engine = Engine(noise(0.003, 0.003, AidNoise(0.3)), settings)
    d = drive(seconds=12.0, rest_s=6.0)
    play(engine, part(d, 0.0, 6.0))
    assert reposes(engine)
    play(engine, part(d, 6.0, 12.0))
    assert not reposes(engine)


def test_an_even_run_that_the_fixes_show_ends_it() -> None:
    """Sensors at rest, fixes that move away at 2 m/s from the first on."""
    engine = Engine(noise(0.003, 0.003, AidNoise(3.0)), HEADED)
    d = drive(seconds=20.0, rest_s=100.0, noise_m=3.0)
    metres = 2.0 * (d.fix_ns - d.stamp_ns[0]) * 1e-9
    d = replace(d, fix=d.fix + np.outer(metres, [0.0, 1 / 76_000.0, 0.0]))
    play(engine, part(d, 0.0, 2.0))
    assert reposes(engine)
    play(engine, part(d, 2.0, 20.0))
    assert not reposes(engine)
