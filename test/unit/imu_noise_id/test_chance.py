"""What white noise reaches by chance is what simulations of it reach."""

import numpy as np
import pytest
from imu_noise_id.chance import correlation_by_chance, gain_by_chance


@pytest.mark.parametrize("outputs", [1, 2, 3])
def test_one_record_in_a_hundred_gains_more_than_the_level(outputs):
    """Gains of all poles at once: normals whose correlation is sech of their distance."""
    rng = np.random.default_rng(outputs)
    samples, runs = 5000, 1500
    edge = np.arctanh(1.0 - 1.0 / samples)
    u = np.arange(-edge, edge, 0.1)
    root = np.linalg.cholesky(1.0 / np.cosh(np.subtract.outer(u, u)) + 1e-9 * np.eye(u.size))
    fields = root @ rng.standard_normal((u.size, runs * outputs**2))
    matrices = fields.reshape(u.size, runs, outputs, outputs)
    gains = np.linalg.svd(matrices, compute_uv=False)[..., 0].max(axis=0) ** 2
    above = np.mean(gains > gain_by_chance(samples, 1, outputs))
    assert above == pytest.approx(0.01, abs=3.0 * np.sqrt(0.01 / runs))


def test_one_state_of_one_output_is_priced_as_davies_does():
    level = gain_by_chance(5000, 1)
    tail = np.log(1e4) / np.pi * np.exp(-level / 2.0)  # upcrossings; the rest is below 1e-3
    assert 0.009 < tail < 0.01


def test_a_pair_costs_more_than_two_states_and_a_longer_record_more_than_a_short_one():
    assert gain_by_chance(5000, 2) > 2.0 * gain_by_chance(5000, 1)
    assert gain_by_chance(10**7, 1) > gain_by_chance(5000, 1)


def test_the_level_of_correlations_is_the_quantile_of_random_hankel_matrices():
    rng = np.random.default_rng(3)
    lag = np.add.outer(np.arange(5), np.arange(5))
    largest = np.linalg.svd(rng.standard_normal((4000, 9))[:, lag], compute_uv=False)[:, 0]
    above = np.mean(largest / np.sqrt(700) > correlation_by_chance(5, 1, 700, 0.01))
    assert above == pytest.approx(0.01, abs=3.0 * np.sqrt(0.01 / 4000) + 0.002)
