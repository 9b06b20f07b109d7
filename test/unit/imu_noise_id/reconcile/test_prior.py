"""What a given model leaves open: intervals, typed values, drift that was too short to show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.model import ChannelModel, Estimate, FittedEffect
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile.prior import (
    PASSED_OVER,
    TYPED_STD_ERROR,
    DriftPrior,
    prior_of,
    unseen_drift,
)

NAME = "angular_velocity.x"
F = np.arange(1, 129) / 1200.0
PRIOR = DriftPrior(F, np.full(F.size, 1.0), 0.005)


def model_of(fitted: FittedEffect, covariance: np.ndarray | None = None) -> ChannelModel:
    return ChannelModel(NAME, "", "rad/s", 200.0, 0.0, (fitted,), covariance, 600.0)


def test_typed_values_are_taken_at_their_word_and_errors_hold_without_a_covariance() -> None:
    typed = typed_effect("white_noise", NAME, {"density": 1e-4})
    assert prior_of(model_of(typed)).std_error == pytest.approx(TYPED_STD_ERROR)
    estimate = Estimate(1e-4, 3e-6, 0.94e-4, 1.06e-4, "rad/s/sqrt(Hz)")
    fitted = replace(typed, estimates=(estimate,))
    assert prior_of(model_of(fitted)).std_error == pytest.approx(0.03)
    assert prior_of(model_of(fitted, np.array([[1e-4]]))).std_error == pytest.approx(0.01)


def test_only_an_identified_model_leaves_room_for_drift() -> None:
    typed = typed_effect("white_noise", NAME, {"density": 1e-4})
    effects = (WhiteNoise(1e-4),)
    assert unseen_drift(model_of(typed), effects, 0.005, 0.0) is None
    assert unseen_drift(model_of(typed, np.array([[1e-6]])), effects, 0.005, 0.0) is not None


def test_drift_costs_nothing_until_identification_would_have_seen_it() -> None:
    log_sigma, log_time = PRIOR.start
    costs = [PRIOR.cost(np.array([log_sigma + step, log_time])) for step in range(6)]
    assert costs[0] == 0.0
    assert np.all(np.diff(costs) >= 0.0)
    assert costs[-1] > 10.0


def test_the_cost_bounds_the_chance_of_being_passed_over() -> None:
    rng = np.random.default_rng(0)
    theta = np.array(PRIOR.start) + np.array([2.8, -1.5])
    law = PRIOR._drift(theta).psd(F, 0.005)
    gains = 0.5 * (rng.standard_normal((20000, F.size)) ** 2 @ law - np.log1p(law).sum())
    chance = float(np.mean(gains < PASSED_OVER))
    assert 0.003 < chance < 0.3
    assert np.log(chance) < -PRIOR.cost(theta) < np.log(chance) + 2.5


def test_the_slope_of_the_drift_cost_is_its_derivative() -> None:
    theta = np.array(PRIOR.start) + np.array([2.0, -1.0])
    step = 0.05
    for row in range(2):
        move = np.eye(2)[row] * step
        numeric = (PRIOR.cost(theta + move) - PRIOR.cost(theta - move)) / (2.0 * step)
        assert PRIOR.slope(theta)[row] == pytest.approx(numeric, rel=0.1, abs=0.05)
