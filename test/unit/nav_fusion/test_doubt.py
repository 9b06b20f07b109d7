"""nav_fusion.doubt: a wrong noise model is said to be wrong, by the tests that can see it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nav_fusion.doubt import doubts_of
from nav_fusion.engine import Engine
from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.parameters import Parameters

from helpers.drive import drive, play

HEADED = Parameters(initial_heading_rad=0.0, use_magnetometer=False, use_velocity=False)
GYRO = AxisNoise(1e-4, (SlowTerm(0.005, float("inf"), 1e-6, "rate_random_walk"),))
ACCEL = AxisNoise(2e-3, (SlowTerm(0.05, float("inf"), 1e-5, "rate_random_walk"),))
NOISE = NavigationNoise(
    (GYRO,) * 3, (ACCEL,) * 3, (AidNoise(0.3),) * 3, (AidNoise(0.1),) * 3, AidNoise(0.05)
)


def scaled(factor: float) -> NavigationNoise:
    """Return the model with the IMU's white noise times a factor."""
    gyro = replace(GYRO, white_density=factor * GYRO.white_density)
    accel = replace(ACCEL, white_density=factor * ACCEL.white_density)
    return replace(NOISE, gyro=(gyro,) * 3, accel=(accel,) * 3)


def rested(noise: NavigationNoise, seconds: float, seed: int = 1) -> Engine:
    engine = Engine(noise, HEADED)
    play(engine, drive(seconds, seed=seed, rest_s=seconds))
    return engine


@pytest.mark.parametrize("seed", range(5))
def test_the_true_model_is_not_doubted(seed: int) -> None:
    assert rested(NOISE, 20.0, seed).status().doubts == ()


@pytest.mark.parametrize(("factor", "word"), [(0.1, "louder"), (0.5, "louder"), (2.0, "quieter")])
def test_an_imu_that_its_model_does_not_know_shows_within_seconds_of_rest(
    factor: float, word: str
) -> None:
    said = rested(scaled(factor), 10.0).status().doubts
    assert len([s for s in said if word in s]) == 2  # gyroscope and accelerometer
    sizes = {d.kind: d.size for d in doubts_of(rested(scaled(factor), 10.0))}
    assert sizes["gyro"] == pytest.approx(1 / factor, rel=0.05)
    assert sizes["accel"] == pytest.approx(1 / factor, rel=0.05)


def test_an_imu_too_loud_ever_to_be_quiet_is_seen_where_the_fixes_show_rest() -> None:
    noisy = drive(30.0, rest_s=30.0)
    rng = np.random.default_rng(6)
    noisy = replace(
        noisy,
        force=noisy.force + rng.normal(0, 0.2, noisy.force.shape),
        rate=noisy.rate + rng.normal(0, 0.01, noisy.rate.shape),
    )
    engine = Engine(NOISE, HEADED)
    play(engine, noisy)
    assert not engine.status().still
    assert any("accelerometer is louder" in s for s in engine.status().doubts)


def test_biases_that_wander_more_than_their_model_show_in_sums_of_innovations() -> None:
    d = drive(120.0, rest_s=0.0)
    wander = np.cumsum(np.random.default_rng(7).normal(0, 0.02 * 0.1, d.force.shape), axis=0)
    engine = Engine(NOISE, HEADED)
    play(engine, replace(d, force=d.force + wander))
    assert any("summed over" in s or "fixes differ" in s for s in engine.status().doubts)


def test_the_tests_do_not_depend_on_the_order_of_arrival() -> None:
    d = drive(20.0, rest_s=20.0)
    late = np.random.default_rng(8).choice([0.0, 0.2, 0.45], d.fix_ns.size)
    ordered, delayed = Engine(scaled(0.1), HEADED), Engine(scaled(0.1), HEADED)
    play(ordered, d)
    play(delayed, d, late, block=7)
    assert doubts_of(ordered) == doubts_of(delayed)
