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
from imu_noise_id.reconcile.steps import best_step, scan_density, step_scores, telling_edges
from scipy import fft

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


def test_edges_tell_nothing_in_white_noise_and_much_on_a_walk() -> None:
    half = np.sin(0.5 * np.pi * np.arange(N) / N)
    assert telling_edges(np.ones(N), 64) == [1]
    assert telling_edges(half**2, 64) == [1, 2, 4, 8, 16, 32, 64]


def test_the_score_of_an_edged_step_is_that_of_least_squares() -> None:
    edge, at = 6, 5000
    rng = np.random.default_rng(2)
    inverse = np.concatenate(([0.0], 1.0 / (0.01 + 1.0 / np.arange(1, N))))
    coefficients = rng.standard_normal(N)
    z, power, _ = step_scores(coefficients, inverse, DT, edge)
    twice = np.convolve(np.full(edge, 1.0 / edge), np.full(edge, 1.0 / edge))
    step = np.convolve(np.arange(N + 2 * (edge - 1)) > at + edge - 1, twice, mode="valid")
    shape = fft.dct(step, norm="ortho")
    weight = inverse * DT
    energy = float(np.sum(weight * shape**2))
    assert power[at] == pytest.approx(energy, rel=1e-6)
    assert z[at] == pytest.approx(float(np.sum(weight * shape * coefficients)) / energy**0.5)
