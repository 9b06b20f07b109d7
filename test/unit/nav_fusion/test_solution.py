"""nav_fusion.solution: what is published against samples of the same errors."""

from __future__ import annotations

import numpy as np
import pytest
from nav_fusion.earth import ecef_from_geodetic, level_axes
from nav_fusion.solution import LARGEST_HEADING_VARIANCE, Solution, solve
from scipy.spatial.transform import Rotation

from nav_fusion import arrays

ORIGIN = (47.0, 8.0, 400.0)
LEVER = (0.8, -0.3, 1.5)
SAMPLES = 20_000


def scene() -> tuple[np.ndarray, np.ndarray, Rotation, np.ndarray]:
    """Position and velocity in e, body to e, covariance of (r, v, psi)."""
    rng = np.random.default_rng(1)
    T = level_axes(*np.radians(ORIGIN[:2]))
    r = ecef_from_geodetic(*np.radians(ORIGIN[:2]), ORIGIN[2]) + T.T @ (30.0, -20.0, 5.0)
    v = T.T @ np.array((3.0, 8.0, -0.5))
    attitude = Rotation.from_matrix(T.T) * Rotation.from_euler("ZYX", (1.1, 0.2, -0.1))
    root = rng.normal(size=(9, 9)) * np.repeat((0.3, 0.1, 0.004), 3)[:, None]
    return r, v, attitude, root @ root.T


def row_of(r: np.ndarray, v: np.ndarray, attitude: Rotation, P: np.ndarray) -> np.ndarray:
    row = np.zeros(arrays.OUT_SIZE)
    x, y, z, w = attitude.as_quat()
    row[:10] = (*r, *v, w, x, y, z)
    row[arrays.OUT_P : arrays.OUT_P + 81] = P.ravel()
    row[arrays.OUT_HYPOTHESES] = 1
    return row


def solved(*rows: np.ndarray) -> Solution:
    return solve(np.arange(len(rows)), np.array(rows), ORIGIN, LEVER)


def test_every_covariance_is_that_of_samples() -> None:
    r, v, attitude, P = scene()
    rng = np.random.default_rng(2)
    x = rng.multivariate_normal(np.zeros(9), P, SAMPLES)
    T = level_axes(*np.radians(ORIGIN[:2]))
    s = solved(row_of(r, v, attitude, P))
    turned = Rotation.from_rotvec(x[:, 6:]) * attitude
    body_velocity = turned.inv().apply(v + x[:, 3:6])
    antenna = (r + x[:, :3] + turned.apply(LEVER)) @ T.T
    for samples, claimed in (
        (x[:, :3] @ T.T, s.pose_covariance[0, :3, :3]),
        (x[:, 6:] @ T.T, s.pose_covariance[0, 3:, 3:]),
        (x[:, 3:6] @ T.T, s.velocity_covariance[0]),
        (body_velocity, s.twist_covariance[0, :3, :3]),
        (antenna, s.antenna_covariance[0]),
    ):
        sigma = np.sqrt(np.diag(claimed))
        apart = (np.cov(samples.T) - claimed) / np.outer(sigma, sigma)
        assert np.abs(apart).max() < 6 * np.sqrt(2 / SAMPLES)


def test_means_are_east_north_up_and_forward_left_up() -> None:
    r, v, attitude, P = scene()
    s = solved(row_of(r, v, attitude, P))
    T = level_axes(*np.radians(ORIGIN[:2]))
    np.testing.assert_allclose(s.position[0], (30.0, -20.0, 5.0), atol=1e-6)
    np.testing.assert_allclose(s.velocity[0], (3.0, 8.0, -0.5), atol=1e-9)
    np.testing.assert_allclose(s.body_velocity[0], attitude.inv().apply(v), atol=1e-9)
    assert s.heading[0] == pytest.approx(1.1, abs=1e-9)
    antenna = ecef_from_geodetic(*np.radians(s.antenna[0, :2]), s.antenna[0, 2])
    np.testing.assert_allclose(T @ (antenna - r), T @ attitude.apply(LEVER), atol=1e-6)


def test_a_row_has_the_same_bits_alone_and_among_others() -> None:
    r, v, attitude, P = scene()
    rows = [row_of(r + k, v - k, attitude, P * (1 + k)) for k in range(7)]
    together, alone = solved(*rows), solved(rows[3])
    for name in ("position", "velocity", "orientation", "pose_covariance", "twist_covariance"):
        assert np.array_equal(getattr(together, name)[3], getattr(alone, name)[0]), name


def test_a_heading_that_is_not_known_has_no_more_than_a_circles_variance() -> None:
    r, v, attitude, P = scene()
    s = solved(row_of(r, v, attitude, 1e6 * P))
    assert s.heading_sigma[0] == pytest.approx(np.sqrt(LARGEST_HEADING_VARIANCE))
