"""What a given model leaves open: intervals, typed values, drift that was too short to show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.intervals import ONE_SIDED_DROP
from imu_noise_id.model import ChannelModel, Estimate, FittedEffect
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile.prior import (
    FREE_STD_ERROR,
    TYPED_STD_ERROR,
    DriftPrior,
    Prior,
    UnseenDrift,
    power_seen,
    prior_of,
    unseen_drift,
    within_intervals,
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
    assert unseen_drift(model_of(typed), effects, 0.005, 0.0, 600.0) is None
    assert unseen_drift(model_of(typed, np.array([[1e-6]])), effects, 0.005, 0.0, 600.0) is not None


def test_a_drift_costs_nothing_that_does_not_show_and_more_the_more_it_would_have() -> None:
    log_sigma, log_time = PRIOR.start
    costs = [PRIOR.cost(np.array([log_sigma + step, log_time])) for step in range(6)]
    assert costs[0] < 0.01
    assert np.all(np.diff(costs) >= 0.0)
    assert costs[-1] > 10.0


def test_the_cost_is_the_mean_likelihood_of_a_term_in_a_recording_that_has_none() -> None:
    rng = np.random.default_rng(0)
    theta = np.array(PRIOR.start) + np.array([2.8, -1.5])
    law = PRIOR._drift(theta).psd(F, 0.005)
    power = rng.standard_normal((4000, F.size)) ** 2
    loss = 0.5 * np.sum(np.log1p(law) + power / (1.0 + law) - power, axis=1)
    assert PRIOR.cost(theta) == pytest.approx(loss.mean(), abs=4.0 * loss.std() / 4000**0.5)


def test_the_bound_of_a_walk_says_how_loud_the_low_ordinates_were() -> None:
    def bound_of(power: float) -> np.ndarray:
        """Walk whose likelihood has dropped by 1.35 nats from its largest, by brute force."""
        laws = np.geomspace(1e-4, 1e4, 4000)[:, None] / (F * 1200.0) ** 2
        gain = 0.5 * np.sum(power * laws / (1.0 + laws) - np.log1p(laws), axis=1)
        best = int(np.argmax(gain))
        beyond = np.flatnonzero(gain[best:] < max(gain[best], 0.0) - 1.3528)[0]
        return laws[best + beyond]

    for power in (0.3, 1.0, 2.0):
        assert power_seen(bound_of(power)) == pytest.approx(power, abs=0.02)


def test_a_drift_counts_as_agreement_only_within_the_models_interval() -> None:
    prior = replace(Prior.none(), drift=PRIOR)
    time_s = 600.0
    loud, quiet = UnseenDrift(50.0, time_s), UnseenDrift(1e-3, time_s)
    assert within_intervals((quiet,), prior) == (quiet,)
    (cut,) = within_intervals((loud,), prior)
    assert isinstance(cut, UnseenDrift)
    assert cut.correlation_time_s == pytest.approx(time_s)
    assert PRIOR.cost(np.log([cut.sigma, time_s])) == pytest.approx(ONE_SIDED_DROP, abs=1e-6)


def test_the_slope_of_the_drift_cost_is_its_derivative() -> None:
    theta = np.array(PRIOR.start) + np.array([2.0, -1.0])
    step = 0.05
    for row in range(2):
        move = np.eye(2)[row] * step
        numeric = (PRIOR.cost(theta + move) - PRIOR.cost(theta - move)) / (2.0 * step)
        assert PRIOR.slope(theta)[row] == pytest.approx(numeric, rel=0.1, abs=0.05)


def test_a_slow_term_leaves_room_in_a_record_distinctly_longer_than_its_own() -> None:
    typed = typed_effect("gauss_markov", NAME, {"sigma": 1e-5, "correlation_time_s": 20.0})
    model = model_of(typed, np.diag([0.01, 0.04]))
    effects = (GaussMarkov(1e-5, 20.0),)
    assert unseen_drift(model, effects, 0.005, 0.0, 600.0) is None
    assert unseen_drift(model, effects, 0.005, 0.0, 3000.0) is not None


def test_what_lies_beyond_the_model_is_drawn_back_and_what_is_free_stays() -> None:
    prior = Prior(np.zeros(2), np.eye(2), np.array([0.01, FREE_STD_ERROR]))
    inside, beyond = prior.drawn_back(np.array([0.02, 3.0])), prior.drawn_back(np.array([0.5, 3.0]))
    assert inside == pytest.approx([0.02, 3.0])
    assert beyond[1] == 3.0
    assert 0.025 < beyond[0] < 0.04  # 3.3 standard errors, one in a thousand
