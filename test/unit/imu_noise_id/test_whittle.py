"""The likelihood's maximum is where it should be, as sharp as the bound, and in any unit."""

import numpy as np
from imu_noise_id.effects.rate_random_walk import RateRandomWalk
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.ordinates import bin_edges, cosine_coefficients, fast_length, ordinates
from imu_noise_id.whittle import fit, log_covariance, log_likelihood, parameter_vector
from numpy.testing import assert_allclose

from helpers.noise_records import DT, walk, white

N = 20000
START = (WhiteNoise(2.0), RateRandomWalk(0.01))


def grid_of(values):
    return ordinates(cosine_coefficients(values), DT)


def test_ordinates_of_white_noise_and_walk_have_their_spectra():
    rng = np.random.default_rng(1)
    ratio = []
    for _ in range(100):
        grid = grid_of(white(4000, rng) + walk(4000, rng, 0.3))
        exact = sum(e.psd(grid.frequency_hz, DT) for e in (WhiteNoise(1.0), RateRandomWalk(0.3)))
        ratio.append(grid.power / exact)
    mean, dof = np.mean(ratio, axis=0), grid.dof
    assert np.abs((mean - 1.0) / np.sqrt(2.0 / dof / 100)).max() < 4.5


def test_bins_hold_every_ordinate_once():
    for n in (40, 1000, 123456):
        edges = bin_edges(n, DT, (12.3,))
        assert (edges[0], edges[-1]) == (1, n)
        assert np.all(np.diff(edges) > 0)


def test_fast_length_is_smooth_and_close():
    for n in (97, 44930, 1234577):
        size = fast_length(n)
        assert 0.999 * n <= size <= n or size == n


def test_fit_finds_the_truth_within_its_errors():
    rng = np.random.default_rng(2)
    z = []
    for _ in range(60):
        found = fit(START, grid_of(white(N, rng) + walk(N, rng, 0.2)))
        error = np.sqrt(np.diag(log_covariance(found)))
        z.append((parameter_vector(found.effects) - np.log([1.0, 0.2])) / error)
    z = np.array(z)
    assert np.all(np.abs(z.mean(axis=0)) < 4.0 / np.sqrt(60))
    assert np.all((z.std(axis=0) > 0.7) & (z.std(axis=0) < 1.35))


def test_fit_ends_at_the_top():
    found = fit(START, grid_of(white(N, np.random.default_rng(3)) + 3.0))
    slope = found.spectrum.tangent @ (
        0.5 * found.ordinates.dof * (found.ordinates.power / found.spectrum.psd - 1.0)
    )
    assert abs(slope[0]) < 0.1
    assert_allclose(found.log_likelihood, log_likelihood(found.spectrum.psd, found.ordinates))


def test_unit_does_not_matter():
    rng = np.random.default_rng(4)
    values = white(N, rng) + walk(N, rng, 0.2)
    scale = np.pi / 180.0 * 1e-3
    one = fit(START, grid_of(values))
    start = (WhiteNoise(2.0 * scale), RateRandomWalk(0.01 * scale))
    other = fit(start, grid_of(scale * values))
    assert_allclose(
        parameter_vector(other.effects) - np.log(scale), parameter_vector(one.effects), atol=1e-6
    )


def test_a_shape_that_the_fit_has_already_is_given_no_amount_of_its_own():
    values = white(N, np.random.default_rng(5)) + walk(N, np.random.default_rng(6), 0.2)
    found = fit(START, grid_of(values))
    frequency = found.ordinates.frequency_hz
    shapes = np.stack([e.psd(frequency, DT) for e in found.effects])
    amount, chi2 = found.residual.score(shapes * np.linspace(1.0, 1.0 + 1e-6, frequency.size))
    assert np.all(amount < 0.1)
    assert np.all(chi2 < 1e-3)
