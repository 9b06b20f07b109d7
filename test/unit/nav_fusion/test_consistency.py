"""nav_fusion.consistency: the bands against the distributions that they claim."""

from __future__ import annotations

import numpy as np
import pytest
from nav_fusion.consistency import (
    is_symmetric_positive,
    mean_band,
    normalised_squares,
    portmanteau,
    whiteness_limit,
)

LAGS = 5


def lag_sums(e: np.ndarray) -> np.ndarray:
    return np.array([np.sum(e[lag:] * e[:-lag]) for lag in range(1, LAGS + 1)])


def statistic(e: np.ndarray) -> float:
    return portmanteau(lag_sums(e), len(e), e.shape[1], float(np.sum(e**2)))


def test_normalised_squares_of_gaussian_errors_have_the_mean_and_variance_of_chi_square() -> None:
    rng = np.random.default_rng(1)
    root = np.array([[2.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.1, -0.3, 0.2]])
    errors = rng.normal(size=(20_000, 3)) @ root.T
    nees = normalised_squares(errors, np.broadcast_to(root @ root.T, (20_000, 3, 3)))
    assert nees.mean() == pytest.approx(3.0, abs=5 * np.sqrt(6 / 20_000))
    assert nees.var() == pytest.approx(6.0, rel=0.1)


def test_the_band_of_the_mean_holds_as_often_as_it_says() -> None:
    rng = np.random.default_rng(2)
    low, high = mean_band(3, 50)
    means = rng.chisquare(3, (4000, 50)).mean(axis=1)
    inside = np.mean((low <= means) & (means <= high))
    assert inside == pytest.approx(0.95, abs=5 * np.sqrt(0.95 * 0.05 / 4000))


@pytest.mark.parametrize("scale", [1.0, 0.05, 7.0])
def test_white_innovations_pass_in_99_of_100_runs_whatever_their_scale(scale: float) -> None:
    rng = np.random.default_rng(3)
    limit = whiteness_limit(LAGS)
    passed = np.mean([statistic(scale * rng.normal(size=(400, 3))) < limit for _ in range(1000)])
    assert passed == pytest.approx(0.99, abs=5 * np.sqrt(0.99 * 0.01 / 1000))


def test_coloured_innovations_fail_though_they_are_small() -> None:
    rng = np.random.default_rng(4)
    white = rng.normal(size=(400, 3))
    coloured = np.copy(white)
    for k in range(1, 400):
        coloured[k] = 0.5 * coloured[k - 1] + white[k]
    assert statistic(0.01 * coloured) > 10 * whiteness_limit(LAGS)


def test_a_covariance_is_symmetric_to_the_last_bit_and_positive() -> None:
    P = np.diag([1e6, 1.0, 1e-9])
    assert is_symmetric_positive(P)
    skewed = P.copy()
    skewed[0, 1] = 1e-12
    assert not is_symmetric_positive(skewed)
    assert not is_symmetric_positive(np.array([[1.0, 1.1], [1.1, 1.0]]))
