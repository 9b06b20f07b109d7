"""The likelihood of several outputs is climbed to its top; innovations are the truth's."""

import numpy as np
from imu_noise_id.joint_innovations import maximise, residuals, stable_both_ways
from numpy.linalg import eigvals, slogdet

A = np.array([[0.95, 0.1], [-0.1, 0.9]])
C = np.array([[1.0, 0.0], [0.3, 1.0], [-0.5, 0.2]])
K = np.array([[0.2, 0.0, -0.1], [0.05, 0.3, 0.0]])


def record(size, rng):
    """By the recursion, in numpy."""
    e, x, y = rng.standard_normal((size, 3)), np.zeros(2), np.empty((size, 3))
    for k in range(size):
        y[k] = C @ x + e[k]
        x = A @ x + K @ e[k]
    return y, e


def test_residuals_of_the_true_model_are_the_innovations():
    y, e = record(2000, np.random.default_rng(1))
    found = residuals(y, np.ones(2000, dtype=bool), A, C, K)
    np.testing.assert_allclose(found, e, atol=1e-10)


def test_where_nothing_was_observed_the_model_predicts_and_nothing_is_left():
    y, _ = record(500, np.random.default_rng(2))
    observed = np.ones(500, dtype=bool)
    observed[100:120] = False
    found = residuals(np.where(observed[:, None], y, 99.0), observed, A, C, K)
    assert not found[~observed].any()
    x = np.zeros(2)
    for k in range(130):
        v = y[k] - C @ x if observed[k] else np.zeros(3)
        np.testing.assert_allclose(found[k], v, atol=1e-10)
        x = A @ x + K @ v


def test_the_maximum_is_above_the_truth_and_near_it():
    y, e = record(20_000, np.random.default_rng(3))
    observed = np.ones(20_000, dtype=bool)
    *found, covariance = maximise(y, observed, 0.95 * A, C, 0.8 * K, 30)
    gain = 20_000 * (slogdet(e.T @ e / 20_000)[1] - slogdet(covariance)[1])
    # by Wilks, chi-square with the 2 * 2 * 3 free parameters of the model
    assert 0.0 < gain < 12.0 + 4.0 * np.sqrt(24.0)
    np.testing.assert_allclose(eigvals(found[0]), eigvals(A), atol=0.03)


def test_a_model_that_cannot_be_inverted_is_left_as_it_is():
    y, _ = record(500, np.random.default_rng(4))
    loud = np.array([[3.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    assert not stable_both_ways(A, C, loud)
    found = maximise(y, np.ones(500, dtype=bool), A, C, loud)
    np.testing.assert_array_equal(found[2], loud)
