"""nav_fusion.kalman against brute-force joint Gaussians and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from nav_fusion.kalman import (
    Gaussian,
    correct,
    correct_after_noise,
    correct_and_predict,
    predict,
    steady_covariance,
)

N, K = 3, 2


def random_model(rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    F = 0.6 * rng.normal(size=(N, N))
    H = rng.normal(size=(K, N))
    joint = rng.normal(size=(N + K, N + K))
    joint = joint @ joint.T
    return F, H, joint[:N, :N], joint[N:, N:], joint[:N, N:]


def conditioned(
    mean: np.ndarray, covariance: np.ndarray, seen: slice, value: np.ndarray, wanted: slice
) -> tuple[np.ndarray, np.ndarray]:
    """Condition a joint Gaussian: the oracle."""
    gain = covariance[wanted, seen] @ np.linalg.inv(covariance[seen, seen])
    return (
        mean[wanted] + gain @ (value - mean[seen]),
        covariance[wanted, wanted] - gain @ covariance[seen, wanted],
    )


def test_correct_is_conditioning_of_the_joint_gaussian() -> None:
    rng = np.random.default_rng(1)
    _, H, P, R, _ = random_model(rng)
    x, y = rng.normal(size=N), rng.normal(size=K)
    G = np.vstack([np.eye(N), H])
    joint = G @ P @ G.T
    joint[N:, N:] += R
    mean, covariance = conditioned(G @ x, joint, slice(N, None), y, slice(0, N))
    found = correct(Gaussian(x, P), y, H, R)
    np.testing.assert_allclose(found.state.mean, mean, rtol=1e-10)
    np.testing.assert_allclose(found.state.covariance, covariance, atol=1e-10)
    assert found.nis == pytest.approx((y - H @ x) @ np.linalg.inv(H @ P @ H.T + R) @ (y - H @ x))


@pytest.mark.parametrize("seed", range(5))
def test_noise_shared_with_the_step_before_is_exact_over_several_steps(seed: int) -> None:
    """The thesis's timing: v_k is correlated with w_{k-1}."""
    rng = np.random.default_rng(seed)
    F, H, Q, R, M = random_model(rng)
    steps = 3
    # stack everything that is random: x0, (w_0, v_1), (w_1, v_2), ...
    size = N + steps * (N + K)
    covariance = np.eye(size)
    for k in range(steps):
        a = N + k * (N + K)
        covariance[a : a + N + K, a : a + N + K] = np.block([[Q, M], [M.T, R]])
    x = np.eye(N, size)
    rows = []
    for k in range(steps):
        a = N + k * (N + K)
        x = F @ x
        x[:, a : a + N] += np.eye(N)
        y = H @ x
        y[:, a + N : a + N + K] += np.eye(K)
        rows.append(y)
    G = np.vstack([x, *rows])
    values = rng.normal(size=steps * K)
    mean, P = conditioned(
        np.zeros(len(G)), G @ covariance @ G.T, slice(N, None), values, slice(0, N)
    )
    state = Gaussian(np.zeros(N), np.eye(N))
    for k in range(steps):
        state = correct_after_noise(
            predict(state, F, Q), values[K * k : K * (k + 1)], H, R, M
        ).state
    np.testing.assert_allclose(state.mean, mean, atol=1e-9)
    np.testing.assert_allclose(state.covariance, P, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_noise_shared_with_the_step_that_follows_is_exact_over_several_steps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    F, H, Q, R, M = random_model(rng)
    steps = 3
    size = N + steps * (N + K)
    covariance = np.eye(size)
    x = np.eye(N, size)
    rows = []
    for k in range(steps):
        a = N + k * (N + K)
        covariance[a : a + N + K, a : a + N + K] = np.block([[Q, M], [M.T, R]])
        y = H @ x
        y[:, a + N : a + N + K] += np.eye(K)
        rows.append(y)
        x = F @ x
        x[:, a : a + N] += np.eye(N)
    G = np.vstack([x, *rows])
    values = rng.normal(size=steps * K)
    mean, P = conditioned(
        np.zeros(len(G)), G @ covariance @ G.T, slice(N, None), values, slice(0, N)
    )
    state = Gaussian(np.zeros(N), np.eye(N))
    for k in range(steps):
        state = correct_and_predict(state, values[K * k : K * (k + 1)], H, R, F, Q, M).state
    np.testing.assert_allclose(state.mean, mean, atol=1e-9)
    np.testing.assert_allclose(state.covariance, P, atol=1e-9)


def test_claimed_covariance_is_that_of_the_error_in_a_monte_carlo() -> None:
    rng = np.random.default_rng(7)
    F, H, Q, R, M = random_model(rng)
    root = np.linalg.cholesky(np.block([[Q, M], [M.T, R]]))
    runs = 4000
    errors = np.zeros((runs, N))
    for run in range(runs):
        truth, state = rng.normal(size=N), Gaussian(np.zeros(N), np.eye(N))
        for _ in range(6):
            noise = root @ rng.normal(size=N + K)
            state = correct_and_predict(state, H @ truth + noise[N:], H, R, F, Q, M).state
            truth = F @ truth + noise[:N]
        errors[run] = truth - state.mean
    sample = np.einsum("ri,rj->ij", errors, errors) / runs
    sigma = np.sqrt(np.diag(state.covariance))
    # a sample covariance's entries have a standard error below sigma_i sigma_j sqrt(2/runs)
    assert np.all(
        np.abs(sample - state.covariance) < 5 * np.outer(sigma, sigma) * np.sqrt(2 / runs)
    )


def test_steady_covariance_is_where_the_filter_settles() -> None:
    F, H, Q, R, M = random_model(np.random.default_rng(3))
    F = F / np.max(np.abs(np.linalg.eigvals(F))) * 0.99
    state = Gaussian(np.zeros(N), 10 * np.eye(N))
    for _ in range(3000):
        state = correct_and_predict(state, np.zeros(K), H, R, F, Q, M).state
    np.testing.assert_allclose(steady_covariance(F, Q, H, R, M), state.covariance, rtol=1e-9)


def test_what_no_measurement_holds_has_no_steady_state() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        steady_covariance(np.eye(1) * 1.5, np.eye(1), np.zeros((1, 1)), np.eye(1))
