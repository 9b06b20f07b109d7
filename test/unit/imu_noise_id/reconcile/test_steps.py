"""A step is found beside slow noise that could have grown to hold it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.model import ChannelModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile.prior import prior_of, unseen_drift
from imu_noise_id.reconcile.state import State, analyse
from imu_noise_id.reconcile.steps import best_step, scan_density

N, DT, DENSITY = 12000, 0.05, 1e-3
NAME = "angular_velocity.x"


def state_of(seed: int, height: float, at_s: float = 400.0) -> State:
    """White noise under a model that was identified from 600 s and leaves drift open."""
    values = np.random.default_rng(seed).normal(0.0, DENSITY / np.sqrt(DT), N)
    values[round(at_s / DT) :] += height
    white = typed_effect("white_noise", NAME, {"density": DENSITY})
    known = np.array([[1.0 / (2.0 * N)]])
    model = ChannelModel(NAME, "", "rad/s", 20.0, 0.0, (white,), known, 600.0)
    effects = (WhiteNoise(DENSITY),)
    drift = unseen_drift(model, effects, DT, 0.0, N * DT)
    assert drift is not None
    prior = replace(prior_of(model), drift=drift[1])
    return State(values, DT, 0.0, None, (*effects, drift[0]), prior)


def test_a_step_is_found_where_it_is_although_drift_may_float() -> None:
    # energy of a step of h at share u of T: h^2 u (1 - u) T/(2 S) nats
    height = DENSITY * np.sqrt(2.0 * 120.0 / (600.0 * 2.0 / 9.0))
    for seed in range(4):
        state = state_of(seed, height)
        best = best_step(state, analyse(state))
        assert best.time_s == pytest.approx(400.0, abs=20.0)
        assert best.height == pytest.approx(height, rel=0.4)
        assert best.gain > 10.0


def test_without_a_step_the_best_one_gains_little() -> None:
    for seed in range(4):
        state = state_of(seed, 0.0)
        found = analyse(state)
        assert best_step(state, found).gain < 9.0
        assert 1.0 < scan_density(state, found) < 20.0
