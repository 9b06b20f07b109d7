"""nav_fusion.colour: a spectrum becomes few states whose law at the receiver's rate is the same."""

from __future__ import annotations

import numpy as np
import pytest
from nav_fusion.colour import ENOUGH_NATS, grid, lost_nats, reduced, sampled_psd
from nav_fusion.noise_terms import PairTerm, SlowTerm, pair_step
from scipy.linalg import expm

DT = 0.1
PAIRS = (
    PairTerm.narrow_band(0.4, 0.2, 0.1),
    PairTerm.low_pass(0.4, 0.5, 0.3, "x"),
    PairTerm.low_pass(0.4, 0.5, 1.0, "x"),
    PairTerm.low_pass(0.4, 0.5, 3.0, "x"),
)


def arma(pole: float, zero: float, deviation: float) -> np.ndarray:
    z = np.exp(-2j * np.pi * grid(DT) * DT)
    return DT * deviation**2 * np.abs((1 - zero * z) / (1 - pole * z)) ** 2


@pytest.mark.parametrize("pair", PAIRS)
@pytest.mark.parametrize("dt", [1e-7, 1e-3, 0.1, 10.0])
def test_a_pairs_step_is_the_matrix_exponential(pair: PairTerm, dt: float) -> None:
    (a, d), w = pair.rates, pair.spin_rad_s
    dense = expm(np.array([[-a, -w], [w, -d]]) * dt)
    np.testing.assert_allclose(np.reshape(pair_step(a, d, w, dt), (2, 2)), dense, atol=1e-12)


@pytest.mark.parametrize("pair", PAIRS)
def test_a_pairs_spectrum_is_the_sum_over_its_lags(pair: PairTerm) -> None:
    (a, d), w = pair.rates, pair.spin_rad_s
    lags = np.array([expm(np.array([[-a, -w], [w, -d]]) * DT * k)[0, 0] for k in range(3000)])
    f = np.array([0.01, 0.2, 1.0, 4.9])
    cosines = np.cos(2 * np.pi * np.outer(f, DT * np.arange(1, lags.size)))
    expected = DT * pair.sigma**2 * (1 + 2 * cosines @ lags[1:])
    np.testing.assert_allclose(sampled_psd(pair, f, DT), expected, rtol=1e-6)
    memory = DT * (0.5 + lags[1:].sum())
    assert pair.memory_s == pytest.approx(memory, rel=0.05)


def test_white_noise_stays_white() -> None:
    colour = reduced(np.full(grid(DT).size, 0.04 * DT), DT)
    assert colour.terms == ()
    assert colour.white_sigma == pytest.approx(0.2)


def test_a_gauss_markov_process_beside_white_noise_is_found_with_one_state() -> None:
    term = SlowTerm.gauss_markov(0.5, 0.8, "x")
    f = grid(DT)
    colour = reduced(sampled_psd(term, f, DT) + 0.09 * DT, DT)
    (found,) = colour.terms
    assert isinstance(found, SlowTerm)
    assert found.initial_sigma == pytest.approx(0.5, rel=0.02)
    assert found.correlation_time_s == pytest.approx(0.8, rel=0.05)


@pytest.mark.parametrize(("pole", "zero"), [(0.828, -0.709), (0.933, -0.847), (0.826, -0.97)])
def test_the_thesis_receivers_keep_their_innovations_scale(pole: float, zero: float) -> None:
    """ARMA(1,1) with a zero near half the rate, where no few states in continuous time follow."""
    psd = arma(pole, zero, 0.05)
    colour = reduced(psd, DT)
    model = sum((sampled_psd(t, grid(DT), DT) for t in colour.terms), np.zeros(psd.size))
    model = model + DT * colour.white_sigma**2
    assert 1 <= len(colour.terms) <= 2
    assert lost_nats(psd, model) < 0.2
    assert np.mean(psd / model) == pytest.approx(1.0, abs=0.01)


def test_what_one_state_cannot_follow_costs_more_than_is_allowed() -> None:
    psd = arma(0.828, -0.709, 0.05)
    assert lost_nats(psd, np.full(psd.size, psd.mean())) > ENOUGH_NATS
