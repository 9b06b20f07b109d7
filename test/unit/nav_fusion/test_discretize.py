"""nav_fusion.discretize against closed forms."""

from __future__ import annotations

import numpy as np
from nav_fusion.discretize import exact, first_order, repeated


def test_a_gauss_markov_process_keeps_its_stationary_variance_at_any_step() -> None:
    rate, sigma = 1 / 30, 0.8
    for dt in (1e-3, 0.1, 10.0, 300.0):
        step = exact(np.array([[-rate]]), np.array([[2 * sigma**2 * rate]]), dt)
        np.testing.assert_allclose(step.F, np.exp(-rate * dt))
        np.testing.assert_allclose(step.F**2 * sigma**2 + step.Q, sigma**2, rtol=1e-12)


def test_white_acceleration_gives_the_textbook_covariance() -> None:
    A = np.array([[0.0, 1.0], [0.0, 0.0]])
    step = exact(A, np.diag([0.0, 2.0]), 0.5)
    expected = 2.0 * np.array([[0.5**3 / 3, 0.5**2 / 2], [0.5**2 / 2, 0.5]])
    np.testing.assert_allclose(step.Q, expected, rtol=1e-12)


def test_steps_of_any_length_agree_and_the_first_order_one_errs_by_the_step() -> None:
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -0.2]])
    spectrum = np.diag([0.0, 1e-2, 1e-3])
    whole = exact(A, spectrum, 1.0)
    for count in (10, 100):
        parts = repeated(exact(A, spectrum, 1.0 / count), count)
        np.testing.assert_allclose(parts.F, whole.F, atol=1e-12)
        np.testing.assert_allclose(parts.Q, whole.Q, rtol=1e-9, atol=1e-15)
    errors = [
        np.max(np.abs(repeated(first_order(A, spectrum, 1.0 / c), c).Q - whole.Q))
        for c in (100, 200)
    ]
    np.testing.assert_allclose(errors[0] / errors[1], 2.0, rtol=0.05)
