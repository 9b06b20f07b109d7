"""The bias of maximum likelihood is known to second order, and the estimates are free of it."""

import numpy as np
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.intervals import estimates
from imu_noise_id.likelihood_bias import second_order_bias
from imu_noise_id.ordinates import Ordinates, cosine_coefficients, ordinates
from imu_noise_id.whittle import fit, parameter_vector
from numpy.testing import assert_allclose
from scipy.special import digamma

from helpers.noise_records import DT, markov, white


def drawn(effects, n, rng):
    """Ordinates drawn from the law itself, so that nothing but the likelihood can be wrong."""
    f = np.arange(1, n) / (2.0 * n * DT)
    psd = sum(e.psd(f, DT) for e in effects)
    return Ordinates(f, psd * rng.chisquare(1.0, f.size), np.ones(f.size), DT, n * DT)


def test_a_level_alone_has_the_bias_of_a_log_chi_square():
    n = 60
    found = fit((WhiteNoise(1.0),), drawn((WhiteNoise(1.0),), n, np.random.default_rng(1)))
    exact = 0.5 * (digamma(0.5 * (n - 1)) - np.log(0.5 * (n - 1)))
    assert_allclose(second_order_bias(found), exact, rtol=0.02)


def test_the_mean_of_many_estimates_shows_the_bias_that_is_said():
    rng = np.random.default_rng(2)
    truth = (GaussMarkov(1.0, 4.0),)
    fits = [fit(truth, drawn(truth, 6000, rng)) for _ in range(400)]
    errors = np.array([parameter_vector(f.effects) for f in fits]) - parameter_vector(truth)
    said = np.mean([second_order_bias(f) for f in fits], axis=0)
    noise = errors.std(axis=0) / np.sqrt(len(fits))
    assert np.all(np.abs(errors.mean(axis=0)) > 4.0 * noise)
    assert_allclose(errors.mean(axis=0), said, atol=3.0 * noise.max())


def test_estimates_and_their_intervals_are_moved_by_it():
    rng = np.random.default_rng(3)
    grid = ordinates(cosine_coefficients(white(60_000, rng) + markov(60_000, rng, 2.0, 20.0)), DT)
    found = fit((WhiteNoise(1.0), GaussMarkov(2.0, 20.0)), grid)
    bias = second_order_bias(found)
    effects, _ = estimates(found, "u")
    value = parameter_vector(tuple(e.effect for e in effects))
    assert_allclose(value, parameter_vector(found.effects) - bias)
    assert np.abs(bias[1:]).max() > 0.02
    assert all(x.lower < x.value < x.upper for e in effects for x in e.estimates)


def test_what_is_hardly_known_stays_where_the_likelihood_has_it():
    rng = np.random.default_rng(4)
    grid = ordinates(cosine_coefficients(white(4000, rng) + markov(4000, rng, 1.0, 100.0)), DT)
    found = fit((WhiteNoise(1.0), GaussMarkov(1.0, 100.0)), grid)
    assert np.all(second_order_bias(found) == 0.0)
