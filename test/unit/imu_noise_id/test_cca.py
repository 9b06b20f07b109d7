"""Canonical correlation finds H(z) where an input drives it, and the dynamics where none does."""

import numpy as np
import pytest
from imu_noise_id.allan import allan
from imu_noise_id.cca import driven, past_future
from imu_noise_id.innovations import Innovations, maximise
from imu_noise_id.series import Series
from imu_noise_id.shaping_allan import allan_deviation, allan_distance
from imu_noise_id.transfer_function import output_sigma, random_walk
from scipy import linalg
from scipy.signal import lfilter

TRUTH_A = (np.array([1.0, -0.2]), np.array([1.0, -0.55]), 1e-3)


def series_of(values, observed=None, sample_time_s=1e-3):
    observed = np.ones(values.size, dtype=bool) if observed is None else observed
    return Series(np.where(observed, values, 0.0), observed, sample_time_s)


def truth_b(size, rng):
    """Gauss-Markov with T_c = 10 s and sigma 0.1 under white noise of sigma 1, 100 Hz."""
    pole = np.exp(-0.01 / 10.0)
    drive = rng.standard_normal(size + 10_000) * 0.1 * np.sqrt(1.0 - pole**2)
    return lfilter([1.0], [1.0, -pole], drive)[-size:] + rng.standard_normal(size)


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [
        ([-0.3059, 0.9285], [186.7, -101.9]),
        ([1.0, -0.9954], [1.0, -0.999]),
        ([1.0, 0.4, -0.2], [2.0, -1.1, 0.5]),
        ([0.7], [1.0, -0.9]),
    ],
)
def test_the_true_input_gives_h_z_to_1e_9(numerator, denominator):
    rng = np.random.default_rng(1)
    x = rng.standard_normal(5000) + 3.0
    y = lfilter(numerator, denominator, x)
    found = driven(x, y, 0.01, (len(numerator) - 1, len(denominator) - 1))
    scale = denominator[0] / found.H_z.denominator[0]
    np.testing.assert_allclose(found.H_z.numerator * scale, numerator, rtol=1e-9)
    np.testing.assert_allclose(found.H_z.denominator * scale, denominator, rtol=1e-9)
    assert found.canonical_correlations[0] == pytest.approx(1.0, abs=1e-12)
    assert found.significant
    assert found.method == "driven"


def test_qr_and_svd_solve_the_generalised_eigenproblem():
    rng = np.random.default_rng(2)
    x = rng.standard_normal(3000)
    y = lfilter([1.0, -0.2], [1.0, -0.55], x) + rng.standard_normal(3000)
    found = driven(x, y, 0.01)
    X, Y = (np.stack((side[1:], side[:-1]), axis=1) for side in (x, y))
    X, Y = X - X.mean(axis=0), Y - Y.mean(axis=0)
    Cxx, Cyy, Cxy = (M / (X.shape[0] - 1) for M in (X.T @ X, Y.T @ Y, X.T @ Y))
    zero = np.zeros((2, 2))
    left = np.block([[zero, Cxy], [Cxy.T, zero]])
    right = linalg.block_diag(Cxx, Cyy)
    L = np.linalg.cholesky(right)
    rho, vectors = np.linalg.eigh(np.linalg.solve(L, np.linalg.solve(L, left).T))
    np.testing.assert_allclose(found.canonical_correlations, rho[:-3:-1], rtol=1e-10)
    a, b = np.split(np.linalg.solve(L.T, vectors[:, -1]), 2)
    np.testing.assert_allclose(a[1] / a[0], found.H_z.numerator[1] / found.H_z.numerator[0])
    np.testing.assert_allclose(b[1] / b[0], found.H_z.denominator[1] / found.H_z.denominator[0])
    assert found.H_z.numerator @ Cxx @ found.H_z.numerator == pytest.approx(1.0)


def test_an_independent_input_is_said_to_be_insignificant_and_half_its_fits_are_unstable():
    rng = np.random.default_rng(3)
    significant, stable = [], []
    for _ in range(300):
        y = lfilter(*TRUTH_A[:2], rng.standard_normal(2000))
        found = driven(rng.standard_normal(2000), y, 1e-3)
        significant.append(found.significant)
        stable.append(found.H_z.stable)
    assert np.mean(significant) < 0.01 + 3 * np.sqrt(0.01 / 300)
    assert 0.35 < np.mean(stable) < 0.65
    assert found.notes


def test_rows_across_a_gap_are_skipped_when_driven():
    rng = np.random.default_rng(4)
    x = rng.standard_normal(4000)
    y = lfilter(*TRUTH_A[:2], x)
    observed = rng.random(4000) > 0.1
    found = driven(
        np.where(observed, x, 99.0), np.where(observed, y, -99.0), 1e-3, (1, 1), observed
    )
    ratio = found.H_z.denominator / found.H_z.denominator[0]
    np.testing.assert_allclose(ratio, TRUTH_A[1], rtol=1e-9)


def test_past_and_future_find_the_arma_model_of_truth_a():
    rng = np.random.default_rng(5)
    poles = []
    for _ in range(20):
        found = past_future(series_of(5.0 + lfilter(*TRUTH_A[:2], rng.standard_normal(20_000))))
        assert found.significant
        poles.append(-found.H_z.denominator[1] / found.H_z.denominator[0])
        assert found.order == 1
    # asymptotic standard error of the pole of this ARMA(1,1) (Box and Jenkins)
    bound = (1 - 0.55 * 0.2) / (0.55 - 0.2) * np.sqrt((1 - 0.55**2) / 20_000)
    assert np.mean(poles) == pytest.approx(0.55, abs=4 * bound / np.sqrt(20))
    assert np.std(poles) < 1.5 * bound
    assert found.minimum_phase
    assert found.innovation_variance == pytest.approx(1.0, rel=0.05)


def test_a_slow_state_under_white_noise_is_where_full_maximum_likelihood_puts_it():
    rng = np.random.default_rng(6)
    truth = Innovations(np.array([1.0, -0.999]), np.array([1.0, -0.9954]), 1.0, 0.0, 1)
    for _ in range(5):
        values = truth_b(50_000, rng)
        found = past_future(series_of(values, sample_time_s=0.01), order=1)
        best = maximise(values - values.mean(), np.ones(values.size, dtype=bool), truth)
        pole = -found.H_z.denominator[1] / found.H_z.denominator[0]
        assert pole == pytest.approx(-best.phi[1], abs=2e-5)
        assert random_walk(found.H_z) == pytest.approx(
            abs(best.theta.sum() / best.phi.sum()) * np.sqrt(best.variance * 0.01), rel=0.02
        )


def test_white_noise_has_no_state_and_correlations_at_chance_level():
    rng = np.random.default_rng(7)
    found = [past_future(series_of(rng.standard_normal(2000))) for _ in range(300)]
    by_chance = 0.01 + 3 * np.sqrt(0.01 / 300)
    assert np.mean([one.significant for one in found]) < by_chance
    assert np.mean([one.order > 0 for one in found]) < by_chance
    quiet = next(one for one in found if not one.significant and not one.order)
    assert quiet.canonical_correlations[0] < quiet.chance_level
    assert quiet.settling_time_s == 0.0
    assert quiet.bandwidth_3db_hz is None
    assert "white" in quiet.notes[0]


def test_a_weak_slow_state_is_found_where_the_correlations_do_not_show_it():
    rng = np.random.default_rng(16)
    found = [past_future(series_of(truth_b(5000, rng), sample_time_s=0.01)) for _ in range(40)]
    orders, significant = (
        np.array([getattr(f, k) for f in found]) for k in ("order", "significant")
    )
    assert np.mean(orders > 0) > np.mean(significant) + 0.15
    hidden = next(f for f in found if f.order and not f.significant)
    assert "likelihood" in hidden.notes[0]


def test_two_effects_take_two_states_or_more():
    rng = np.random.default_rng(8)
    values = truth_b(100_000, rng) + 2.0 * lfilter(
        [1.0], [1.0, -1.2, 0.9], rng.standard_normal(100_000)
    )
    found = past_future(series_of(values, sample_time_s=0.01))
    assert found.order >= 3
    frequency_hz = np.abs(np.angle(np.roots(found.H_z.denominator))) / (2 * np.pi * 0.01)
    assert np.min(np.abs(frequency_hz - 14.1)) < 0.5
    assert np.max(np.abs(np.roots(found.H_z.denominator))) > 0.99


def test_lost_samples_and_a_gap_leave_the_model():
    rng = np.random.default_rng(9)
    values = lfilter(*TRUTH_A[:2], rng.standard_normal(60_000))
    observed = rng.random(60_000) > 0.05
    observed[20_000:26_000] = False
    found = past_future(series_of(values, observed), order=1)
    assert -found.H_z.denominator[1] / found.H_z.denominator[0] == pytest.approx(0.55, abs=0.04)
    assert found.innovation_variance == pytest.approx(1.0, rel=0.03)


def test_normalisation_is_the_thesiss():
    values = lfilter(*TRUTH_A[:2], np.random.default_rng(10).standard_normal(20_000)) * 3e-4
    found = past_future(series_of(values))
    assert np.linalg.norm(found.H_z.numerator) == pytest.approx(1.0)
    assert found.H_z.denominator[0] > 0.0
    assert output_sigma(found.H_z) == pytest.approx(values.std(), rel=0.02)


def test_cca_and_allan_tell_the_same_story():
    values = truth_b(200_000, np.random.default_rng(11))
    series = series_of(values, sample_time_s=0.01)
    measured = allan(series)
    modelled = allan_deviation(past_future(series).H_z, measured.averaging_factor)
    distance = allan_distance(measured.deviation, modelled, measured.degrees_of_freedom)
    assert distance < 0.1
    far = allan_distance(measured.deviation, 2.0 * modelled, measured.degrees_of_freedom)
    assert far == pytest.approx(np.log(2.0), rel=0.2)


@pytest.mark.parametrize("values", [np.zeros(1000), np.full(1000, 9.81), np.arange(5.0)])
def test_what_cannot_be_had_is_refused_with_a_reason(values):
    with pytest.raises(ValueError, match=r"equal|too few"):
        past_future(series_of(values))


def test_a_constant_input_is_refused():
    with pytest.raises(ValueError, match="constant"):
        driven(np.ones(1000), np.random.default_rng(14).standard_normal(1000), 0.01)
