"""nav_fusion.circle: five headings of a platform that rests tell where all the others are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nav_fusion.arrays import CIRCLE, RESTING, Core, circle_shares
from nav_fusion.engine import Engine
from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.parameters import Parameters
from nav_fusion.state import ALIVE, ASLEEP, LOG_WEIGHT, NAV, SLOW, STRIDE, Q

from helpers.drive import Drive, drive, play
from nav_fusion import circle

GYRO = AxisNoise(1e-4, (SlowTerm(0.005, float("inf"), 1e-6, "rate_random_walk"),))
ACCEL = AxisNoise(2e-3, (SlowTerm(0.05, float("inf"), 1e-5, "rate_random_walk"),))
COLOUR = AidNoise(0.3, (SlowTerm(0.8, 30.0, 0.8 * (2 / 30) ** 0.5, "gauss_markov"),))
NOISE = NavigationNoise(
    (GYRO,) * 3,
    (ACCEL,) * 3,
    (COLOUR, replace(COLOUR, white_sigma=0.6), COLOUR),
    (AidNoise(0.1),) * 3,
    AidNoise(0.05),
)
UNKNOWN = Parameters(use_magnetometer=False, use_velocity=False, publish_rate_hz=20.0)
RESTED = drive(seconds=80.0, rest_s=200.0, seed=5)
GONE = drive(seconds=92.0, rest_s=80.0, seed=5)


def part(d: Drive, begin_s: float, end_s: float) -> Drive:
    t, k = ((x - d.stamp_ns[0]) * 1e-9 for x in (d.stamp_ns, d.fix_ns))
    a, b = (t >= begin_s) & (t < end_s), (k >= begin_s) & (k < end_s)
    return Drive(d.stamp_ns[a], d.rate[a], d.force[a], d.fix_ns[b], d.fix[b])


def played(d: Drive, parameters: Parameters, all_followed: bool = False) -> Core:
    """Play the first second, then the rest, by five of the headings or by all."""
    engine = Engine(NOISE, parameters)
    play(engine, part(d, 0.0, 2.0))
    assert engine._core is not None
    if all_followed:
        engine._core = engine._core._replace(constants=engine._core.constants[:CIRCLE].copy())
    play(engine, part(d, 2.0, 1e9))
    return engine._core


def assert_alike(found: Core, expected: Core, most: float) -> None:
    """Each living hypothesis of both: states in sigmas, covariance in shares of them, weights."""
    n = NAV + found.target.size
    living = expected.bank[:, ALIVE] > 0.0
    assert np.array_equal(found.bank[:, ALIVE] > 0.0, living)
    states = [*range(6), *range(SLOW, SLOW + n - NAV)]
    for s, t in zip(found.bank[living], expected.bank[living], strict=True):
        P, its = (x[x.size - n * STRIDE :].reshape(n, STRIDE)[:, :n] for x in (s, t))
        sigma = np.sqrt(np.diag(its))
        assert np.all(np.abs(s - t)[states] < most * sigma[[*range(6), *range(NAV, n)]])
        assert np.all(np.abs(P - its) < most * np.outer(sigma, sigma))
        turned = np.abs(np.abs(s[Q : Q + 4] @ t[Q : Q + 4]) - 1.0)
        assert 2.0 * np.sqrt(2.0 * turned) < most * sigma[6:9].min()
    apart = found.bank[living, LOG_WEIGHT] - expected.bank[living, LOG_WEIGHT]
    assert np.ptp(apart) < 0.05


@pytest.mark.parametrize("lever_m", [0.0, 1.0])
def test_headings_that_sleep_wake_where_they_would_have_been(lever_m: float) -> None:
    parameters = replace(UNKNOWN, lever_arm_m=(lever_m, 0.2 * lever_m, 0.0))
    found = played(RESTED, parameters)
    assert (found.bank[:, ALIVE] == ASLEEP).sum() == 27
    circle.wake(found)
    assert_alike(found, played(RESTED, parameters, all_followed=True), 0.01)


def test_a_platform_that_departs_finds_its_heading_as_if_all_had_been_followed() -> None:
    found, expected = played(GONE, UNKNOWN), played(GONE, UNKNOWN, all_followed=True)
    assert found.shared[RESTING] == 0.0
    assert (found.bank[:, ALIVE] == ASLEEP).sum() == 0
    assert_alike(found, expected, 0.01)


@pytest.mark.parametrize("how", [{"block": 1}, {"block": 7}, {"late_s": 0.23}])
def test_neither_blocks_nor_late_fixes_change_a_bit_of_what_wakes(how: dict) -> None:
    ends = []
    for way in ({}, how):
        engine = Engine(NOISE, UNKNOWN)
        play(engine, GONE, **way)
        assert engine._core is not None
        ends.append(engine._core.bank[engine._core.bank[:, ALIVE] > 0.0])
    assert np.array_equal(ends[0], ends[1])


def test_headings_that_the_gyro_tells_apart_do_not_sleep() -> None:
    fine = AxisNoise(1e-7, (SlowTerm(2e-6, float("inf"), 1e-10, "rate_random_walk"),))
    engine = Engine(replace(NOISE, gyro=(fine,) * 3), UNKNOWN)
    d = part(RESTED, 0.0, 20.0)
    play(engine, replace(d, rate=d.rate * 1e-3))
    assert engine._core is not None
    assert engine._core.shared[RESTING] == 1.0
    assert not (engine._core.bank[:, ALIVE] == ASLEEP).any()


def test_shares_give_two_harmonics_exactly() -> None:
    shares = circle_shares(32).reshape(32, 5)
    angle = 2 * np.pi * np.arange(32) / 32
    wave = 1.3 - 0.4 * np.cos(angle) + 2.0 * np.sin(angle) - 0.7 * np.cos(2 * angle + 0.4)
    assert np.allclose(shares @ wave[[0, 6, 13, 19, 26]], wave, atol=1e-13)
    assert circle_shares(6).size == 0
