"""Missing samples are drawn as the model says they are, given the others."""

import numpy as np
from imu_noise_id.effects.rate_random_walk import RateRandomWalk
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.gaps import draw_missing, interpolate, windows
from numpy.testing import assert_allclose
from scipy import fft

from helpers.noise_records import DT


def psd(frequency_hz):
    return 1.0 + RateRandomWalk(5.0).psd(frequency_hz, DT) + 0.0 * WhiteNoise(1.0).density


def test_draws_have_the_conditional_mean_and_covariance_of_a_dense_solution():
    rng = np.random.default_rng(31)
    n = 200
    observed = rng.random(n) > 0.1
    observed[80:110] = False
    values = np.cumsum(rng.standard_normal(n)) * 5.0
    cosine = fft.dct(np.eye(n), axis=0, norm="ortho")
    precision = np.concatenate(([0.0], DT / psd(np.arange(1, n) / (2 * n * DT))))
    Q = cosine.T @ np.diag(precision) @ cosine
    m = ~observed
    mean = -np.linalg.solve(Q[np.ix_(m, m)], Q[np.ix_(m, observed)] @ values[observed])
    sigma = np.sqrt(np.diag(np.linalg.inv(Q[np.ix_(m, m)])))
    start = interpolate(values, observed)
    draws = np.array([draw_missing(start, observed, DT, psd, rng)[m] for _ in range(200)])
    assert np.all(np.abs(draws.mean(axis=0) - mean) < 5 * sigma / np.sqrt(200))
    assert_allclose(draws.std(axis=0), sigma, rtol=0.27)


def test_seen_samples_are_kept():
    rng = np.random.default_rng(32)
    values = rng.standard_normal(500)
    observed = rng.random(500) > 0.2
    drawn = draw_missing(interpolate(values, observed), observed, DT, psd, rng)
    assert np.array_equal(drawn[observed], values[observed])


def test_windows_hold_every_missing_sample():
    rng = np.random.default_rng(33)
    for share in (1e-5, 0.05):
        observed = rng.random(2**20) > share
        held = np.zeros(observed.size, dtype=bool)
        for first, last in windows(observed):
            held[first:last] = True
        assert np.all(held[~observed])
