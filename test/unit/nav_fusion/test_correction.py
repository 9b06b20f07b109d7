"""nav_fusion.correction: gain, Joseph's form and the turn of tilt against plain matrices."""

from __future__ import annotations

import numpy as np
import pytest
from nav_fusion.alignment import hypotheses
from nav_fusion.consistency import covariance_of
from nav_fusion.correction import (
    UPDATE_SIZE,
    Update,
    gain,
    innovation_covariance,
    joseph,
    keep_heading,
    turn_tilt,
    update_views,
    whiten,
)
from nav_fusion.earth import ecef_from_geodetic, level_axes, plumb_at
from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.state import NAV, STRIDE, layout_of

GYRO = AxisNoise(1e-4, (SlowTerm(1e-3, float("inf"), 0.0, "turn_on_bias"),))
ACCEL = AxisNoise(2e-3, (SlowTerm(0.05, float("inf"), 0.0, "turn_on_bias"),))
NOISE = NavigationNoise(
    (GYRO,) * 3, (ACCEL,) * 3, (AidNoise(0.3),) * 3, (AidNoise(0.1),) * 3, AidNoise(0.02)
)
STATES = NAV + 6


def prepared(seed: int) -> tuple[np.ndarray, np.ndarray, Update]:
    """A covariance, flat and square, and an innovation of three components."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(STATES, STATES))
    square = root @ root.T / STATES
    P = np.zeros((STATES, STRIDE))
    P[:, :STATES] = square
    u = update_views(np.zeros(UPDATE_SIZE))
    u.H[:, :STATES] = rng.normal(size=(3, STATES)) * (rng.random((3, STATES)) < 0.4)
    noise = rng.normal(size=(3, 3))
    u.R[:] = noise @ noise.T + 0.1 * np.eye(3)
    u.y[:] = rng.normal(size=3)
    return P.ravel(), square, u


def test_the_innovation_is_weighed_as_the_textbook_has_it() -> None:
    P, square, u = prepared(1)
    H, R = u.H[:, :STATES].copy(), u.R.copy()
    S = H @ square @ H.T + R
    assert innovation_covariance(P, STATES, 3, u) == pytest.approx(np.linalg.slogdet(S)[1])
    assert whiten(3, u) == pytest.approx(u.y @ np.linalg.solve(S, u.y))
    gain(STATES, 3, u)
    assert pytest.approx(square @ H.T @ np.linalg.inv(S)) == u.K[:, :STATES].T


@pytest.mark.parametrize("best", [True, False])
def test_the_covariance_is_that_of_the_gain_that_was_used(best: bool) -> None:
    P, square, u = prepared(2)
    H, R = u.H[:, :STATES].copy(), u.R.copy()
    innovation_covariance(P, STATES, 3, u)
    gain(STATES, 3, u)
    s = np.concatenate([ecef_from_geodetic(0.7, 0.3, 200.0), np.zeros(7)])
    if not best:
        keep_heading(s, 3, u)
    K = u.K[:, :STATES].T.copy()
    joseph(P, STATES, 3, u)
    left = np.eye(STATES) - K @ H
    found = P.reshape(STATES, STRIDE)[:, :STATES]
    assert np.array_equal(found, found.T)
    assert found == pytest.approx(left @ square @ left.T + K @ R @ K.T, abs=1e-12)
    turn = np.array(plumb_at(*s[:3])) @ K[6:9]
    assert best or turn == pytest.approx(np.zeros(3), abs=1e-14)


def test_what_is_known_of_the_tilt_turns_with_the_heading() -> None:
    """Levelled at one heading and turned to another, P is that of levelling at the other."""
    layout = layout_of(NOISE, False, False)
    place = ecef_from_geodetic(0.7, 0.3, 200.0)
    start, other = hypotheses(
        layout, place, np.array([1.0, -2.0, 9.5]), np.array([0.4, 0.7]), 0.1, 1e-3, 5.0
    )
    m = layout.slow.target.size
    up = level_axes(0.7, 0.3)[2]
    turn_tilt(start, m, 0.3 * up)
    turned, expected = (covariance_of(s, m) for s in (start, other))
    assert np.array_equal(turned, turned.T)
    assert turned == pytest.approx(expected, abs=1e-9)
