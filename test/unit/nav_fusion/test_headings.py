"""nav_fusion.headings: which of the headings live on."""

from __future__ import annotations

import numpy as np
import pytest
from nav_fusion.engine import Engine
from nav_fusion.headings import circle_variance, prune
from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.parameters import Parameters
from nav_fusion.solution import Solution, solve
from nav_fusion.state import ALIVE, BIAS, LOG_WEIGHT, NAV, SLOW, STRIDE

from helpers.drive import ALTITUDE, LATITUDE, LONGITUDE, drive, play

BIAS_SIGMA = 0.01
GYRO = AxisNoise(1e-4, (SlowTerm(BIAS_SIGMA, float("inf"), 0.0, "turn_on_bias"),))
ACCEL = AxisNoise(2e-3, (SlowTerm(0.05, float("inf"), 0.0, "turn_on_bias"),))
NOISE = NavigationNoise(
    (GYRO,) * 3, (ACCEL,) * 3, (AidNoise(0.3),) * 3, (AidNoise(0.1),) * 3, AidNoise(0.02)
)


@pytest.mark.parametrize(("apart", "living"), [(0.0, 1), (0.3, 1), (1.0, 2)])
def test_headings_that_have_met_are_one_only_with_one_bias_of_the_gyro(
    apart: float, living: int
) -> None:
    """Two that began apart and met by their biases tell different turns from here on."""
    engine = Engine(NOISE, Parameters(use_magnetometer=False, use_velocity=False))
    play(engine, drive(seconds=2.0))
    core = engine._core
    assert core is not None
    core.bank[2:, ALIVE] = 0.0
    core.bank[1] = core.bank[0]
    core.bank[1, LOG_WEIGHT] -= 1.0
    core.bank[1, BIAS + 2] += apart * BIAS_SIGMA
    m = core.target.size
    for s in core.bank[:2]:  # both know their heading to 0.05 rad and their bias as at first
        P = s[SLOW + m :].reshape(NAV + m, STRIDE)
        P[6:9, : NAV + m] = P[: NAV + m, 6:9] = 0.0
        P[[6, 7, 8], [6, 7, 8]] = 0.05**2
        P[[9, 10, 11], [9, 10, 11]] = BIAS_SIGMA**2
    prune(core, 1.0)
    assert np.count_nonzero(core.bank[:, ALIVE]) == living


@pytest.mark.parametrize("count", [8, 9, 32])
def test_headings_on_the_circle_are_as_wide_as_their_turns(count: int) -> None:
    turns = 2 * np.pi * np.arange(count) / count
    turns = (turns + np.pi) % (2 * np.pi) - np.pi
    assert circle_variance(count) == pytest.approx(np.mean(turns**2))


def at_rest(seed: int, heading_rad: float) -> Solution:
    parameters = Parameters(
        use_magnetometer=False,
        use_velocity=False,
        initial_heading_rad=heading_rad,
        initial_heading_sigma_rad=0.02,
    )
    rows = play(Engine(NOISE, parameters), drive(seconds=40.0, rest_s=100.0, seed=seed))
    return solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))


def test_at_rest_velocity_is_told_alike_whether_the_heading_is_known_or_not() -> None:
    """It is the accelerometer's noise since the last velocity of 0, along the body's axes."""
    for seed in range(4):
        known, unknown = (at_rest(seed, heading) for heading in (0.0, np.nan))
        assert (known.hypotheses[-1], unknown.hypotheses[-1]) == (1, 32)
        sigma = np.sqrt(np.diagonal(known.twist_covariance[-50:, :3, :3], axis1=1, axis2=2))
        apart = unknown.body_velocity[-50:] - known.body_velocity[-50:]
        assert np.all(np.abs(apart) < 0.1 * sigma)
        assert np.std(known.body_velocity[-50:] / sigma) > 0.5
        its = np.sqrt(np.diagonal(unknown.twist_covariance[-50:, :3, :3], axis1=1, axis2=2))
        assert np.allclose(its, sigma, rtol=0.05)
