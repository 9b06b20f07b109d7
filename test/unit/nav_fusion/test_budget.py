"""nav_fusion.budget against closed forms and a Monte Carlo of the same physics."""

from __future__ import annotations

import math

import numpy as np
import pytest
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.effects.rate_random_walk import RateRandomWalk
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.errors import InputError
from imu_noise_id.model import ChannelModel, FittedEffect, NoiseModel
from nav_fusion.budget import Environment, budget_of, budget_tree
from nav_fusion.noise import TurnOn

QUIET = Environment(
    TurnOn(0.0, 0.0),
    0.0,
    tilt_rad=0.0,
    heading_rad=0.0,
    speed_m_s=0.0,
    position_m=0.0,
    weave_m_s2=0.0,
)


def model(gyro: tuple, accel: tuple, position: tuple = ()) -> NoiseModel:
    def channel(name: str, unit: str, effects: tuple, rate: float) -> ChannelModel:
        return ChannelModel(
            name, "/x", unit, rate, 0.0, tuple(FittedEffect(e, ()) for e in effects)
        )

    channels = [channel(f"angular_velocity.{a}", "rad/s", gyro, 100.0) for a in "xyz"]
    channels += [channel(f"linear_acceleration.{a}", "m/s^2", accel, 100.0) for a in "xyz"]
    if position:
        channels += [channel(f"position.{a}", "m", position, 10.0) for a in ("east", "north", "up")]
    return NoiseModel(tuple(channels))


def test_white_noise_alone_gives_the_closed_forms() -> None:
    N, A, t = 1e-5, 1e-2, 60.0
    free = budget_of(model((WhiteNoise(N),), (WhiteNoise(A),)), QUIET, t).scenarios[0]
    assert free.heading_sigma_rad[-1] == pytest.approx(N * math.sqrt(t), rel=1e-6)
    velocity = A**2 * t + (9.80665 * N) ** 2 * t**3 / 3
    assert free.velocity_sigma_m_s[-1] ** 2 == pytest.approx(velocity, rel=1e-2)
    position = A**2 * t**3 / 3 + (9.80665 * N) ** 2 * t**5 / 20
    assert free.position_sigma_m[-1] ** 2 == pytest.approx(position, rel=1e-2)


def test_shares_sum_to_one_free_and_aided() -> None:
    both = model(
        (WhiteNoise(1e-4), GaussMarkov(1e-4, 300.0)),
        (WhiteNoise(2e-3),),
        (WhiteNoise(0.1), GaussMarkov(0.8, 30.0)),
    )
    for scenario in budget_of(both, duration_s=60.0).scenarios:
        for quantity in ("position", "velocity", "heading"):
            total = sum(getattr(s, quantity) for s in scenario.shares)
            np.testing.assert_allclose(total[1:], 1.0, rtol=1e-9)


def test_aided_covariance_is_that_of_a_monte_carlo() -> None:
    """200 runs of a one-axis filter written here, against the budget's vertical-free horizontal."""
    A, white, sigma, time_s, duration = 0.05, 0.3, 0.8, 30.0, 20.0
    scenario = budget_of(
        model(
            (WhiteNoise(1e-9),),
            (WhiteNoise(A),),
            (WhiteNoise(white / math.sqrt(10.0)), GaussMarkov(sigma, time_s)),
        ),
        QUIET,
        duration,
    ).scenarios[2]
    rng = np.random.default_rng(5)
    dt, runs = 0.1, 400
    F = np.array([[1, dt, 0], [0, 1, 0], [0, 0, math.exp(-dt / time_s)]])
    Q = np.diag([0, 0, sigma**2 * (1 - math.exp(-2 * dt / time_s))])
    Q[:2, :2] = A**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    root = np.linalg.cholesky(Q + 1e-18 * np.eye(3))
    truth = np.zeros((runs, 3))
    truth[:, 2] = rng.normal(0, sigma, runs)
    estimate, P, H = np.zeros((runs, 3)), np.diag([0, 0, sigma**2]), np.array([1.0, 0, 1.0])
    for _ in range(round(duration / dt)):
        truth = truth @ F.T + rng.normal(size=(runs, 3)) @ root.T
        estimate, P = estimate @ F.T, F @ P @ F.T + Q
        y = truth @ H + rng.normal(0, white, runs)
        K = P @ H / (H @ P @ H + white**2)
        estimate = estimate + (y - estimate @ H)[:, None] * K
        P = P - np.outer(K, H @ P)
    error = np.std((truth - estimate)[:, 0])
    assert scenario.position_sigma_m[-1] == pytest.approx(error, rel=4 / math.sqrt(2 * runs))
    assert scenario.position_sigma_m[-1] == pytest.approx(math.sqrt(P[0, 0]), rel=5e-3)


@pytest.mark.parametrize("walk", [(), (RateRandomWalk(1e-6),)])
def test_turn_on_bias_stands_beside_what_a_static_record_shows(walk: tuple) -> None:
    imu = model((WhiteNoise(1e-4), *walk), (WhiteNoise(2e-3),))
    free, stationary, _ = budget_of(imu, duration_s=60.0).scenarios
    assert free.position_sigma_m[-1] > 10 * stationary.position_sigma_m[-1]
    top = max(free.shares, key=lambda s: s.position[-1])
    assert top.effect == "turn_on_bias"


def test_a_model_without_a_gyro_is_refused() -> None:
    accel_only = NoiseModel(model((), (WhiteNoise(1e-3),)).channels[3:])
    with pytest.raises(InputError, match=r"angular_velocity\.x"):
        budget_of(accel_only)


def test_the_tree_has_the_contract_keys() -> None:
    tree = budget_tree([budget_of(model((WhiteNoise(1e-4),), (WhiteNoise(1e-3),)), duration_s=5.0)])
    assert tree["format"] == "budget/1"
    keys = {"time_s", "position_sigma_m", "velocity_sigma_m_s", "heading_sigma_rad", "shares"}
    assert keys <= set(tree["models"][0]["scenarios"][0])
