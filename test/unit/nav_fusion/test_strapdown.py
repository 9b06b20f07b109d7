"""nav_fusion.strapdown against dense exponentials and inertial-frame truth."""

from __future__ import annotations

import numpy as np
import pytest
from nav_fusion.discretize import exact
from nav_fusion.earth import EARTH_RATE_RAD_S
from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise
from nav_fusion.noise_terms import PairTerm, SlowTerm
from nav_fusion.state import NAV, STRIDE, layout_of
from scipy.spatial.transform import Rotation

from nav_fusion import earth, strapdown

GYRO = AxisNoise(
    2e-4,
    (SlowTerm(0.01, float("inf"), 1e-5, "walk"), SlowTerm.gauss_markov(1e-3, 20.0, "gauss_markov")),
)
ACCEL = AxisNoise(3e-3, (SlowTerm.gauss_markov(0.02, 40.0, "gauss_markov"),))
FIX = AidNoise(
    0.3,
    (
        SlowTerm.gauss_markov(0.8, 30.0, "gauss_markov"),
        PairTerm.narrow_band(0.4, 0.7, 0.2),
        PairTerm.low_pass(0.2, 2.0, 0.8, "low_pass"),
    ),
)
LAYOUT = layout_of(
    NavigationNoise((GYRO,) * 3, (ACCEL,) * 3, (FIX,) * 3, (FIX,) * 3, FIX), False, False
)
POSITION = earth.ecef_from_geodetic(0.8, 0.3, 500.0)


def cross_matrix(a: np.ndarray) -> np.ndarray:
    """[a x] (3, 3)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


def continuous(C: np.ndarray, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A and the spectrum, dense, as the module's page has them."""
    n, slow = LAYOUT.states, LAYOUT.slow
    A, spectrum = np.zeros((n, n)), np.zeros((n, n))
    g = np.zeros(3)
    earth.normal_gravity(POSITION, g)
    up = POSITION / np.linalg.norm(POSITION)
    k = np.linalg.norm(g) / np.linalg.norm(POSITION)
    W = cross_matrix(np.array([0.0, 0.0, EARTH_RATE_RAD_S]))
    A[0:3, 3:6] = np.eye(3)
    A[3:6, 0:3] = -k * (np.eye(3) - 3 * np.outer(up, up))
    A[3:6, 3:6], A[6:9, 6:9] = -2 * W, -W
    A[3:6, 6:9] = -cross_matrix(force)
    for s, target in enumerate(slow.target):
        A[NAV + s, NAV + s], spectrum[NAV + s, NAV + s] = -slow.rate[s], slow.psd[s]
        if slow.spin[s] != 0.0:
            A[NAV + s, NAV + s + 1], A[NAV + s + 1, NAV + s] = -slow.spin[s], slow.spin[s]
        if target < 3:
            A[6:9, NAV + s] = -C[:, target]
        elif target < 6:
            A[3:6, NAV + s] = -C[:, target - 3]
    spectrum[3:6, 3:6] = C @ np.diag(LAYOUT.accel_psd) @ C.T
    spectrum[6:9, 6:9] = C @ np.diag(LAYOUT.gyro_psd) @ C.T
    return A, spectrum


@pytest.mark.parametrize("dt", [1e-3, 5e-3, 1e-2])
def test_the_structured_covariance_is_the_dense_exponentials(dt: float) -> None:
    rng = np.random.default_rng(4)
    n, m = LAYOUT.states, LAYOUT.slow.target.size
    C = Rotation.random(random_state=3).as_matrix()
    force = C @ np.array([0.8, -0.4, 9.7])
    root = rng.normal(size=(n, n)) * 0.01
    dense = root @ root.T
    flat = np.zeros((n, STRIDE))
    flat[:, :n] = dense
    flat = flat.ravel()
    work = strapdown.scratch_views(np.zeros(strapdown.SCRATCH_SIZE), m)
    strapdown.slow_step(LAYOUT.slow, dt, work.decay, work.mean, work.half_noise)
    step = exact(*continuous(C, force), dt)
    for _ in range(round(1.0 / dt)):
        strapdown.propagate_covariance(
            flat,
            tuple(C.ravel()),
            tuple(force),
            tuple(POSITION),
            dt,
            LAYOUT.slow,
            tuple(LAYOUT.gyro_psd),
            tuple(LAYOUT.accel_psd),
            work,
        )
        dense = step.F @ dense @ step.F.T + step.Q
    P = flat.reshape(n, STRIDE)[:, :n]
    assert np.array_equal(P, P.T)
    scale = np.sqrt(np.outer(np.diag(dense), np.diag(dense)))
    assert np.max(np.abs(P - dense) / scale) < 5e-4 * (dt / 1e-2)


def test_free_fall_and_rest_follow_inertial_space() -> None:
    """Specific force and rate of a point that rests on the Earth keep it at rest."""
    latitude, longitude = 0.8, 0.3
    axes = earth.level_axes(latitude, longitude)
    g = np.zeros(3)
    earth.normal_gravity(POSITION, g)
    C = axes.T @ Rotation.from_euler("ZYX", [0.4, 0.1, -0.2]).as_matrix()
    q = np.roll(Rotation.from_matrix(C).as_quat(), 1)
    s = np.concatenate((POSITION, np.zeros(3), q))
    rate, force = tuple(C.T @ np.array([0, 0, EARTH_RATE_RAD_S])), tuple(-C.T @ g)
    for _ in range(6000):
        strapdown.mechanise(s, rate, rate, force, force, 0.01)
    assert np.linalg.norm(s[0:3] - POSITION) < 1e-6
    assert np.linalg.norm(s[3:6]) < 1e-7
    turned = np.zeros((3, 3))
    strapdown.rotation_matrix(s[6:10], turned)
    np.testing.assert_allclose(turned, C, atol=1e-11)


def test_a_turn_with_changing_force_is_integrated_to_second_order() -> None:
    """A circle in inertial axes, seen from a body that turns: the error falls with dt squared."""
    errors = []
    for dt in (0.02, 0.01):
        w, a = 1.2, 3.0
        s = np.concatenate((POSITION, np.zeros(3), [1.0, 0, 0, 0]))
        expected_v, body = np.zeros(3), (0.0, 0.0, w)

        def force(t: float, w: float = w, a: float = a) -> tuple[float, ...]:
            turned = Rotation.from_rotvec([0, 0, w * t]).as_matrix()
            return tuple(turned.T @ np.array([a * np.cos(2 * t), a * np.sin(3 * t), 0.0]))

        gravity_v = np.zeros(3)
        for k in range(round(2.0 / dt)):
            before = s[3:6].copy()
            f_e, _ = strapdown.mechanise(s, body, body, force(k * dt), force((k + 1) * dt), dt)
            gravity_v += s[3:6] - before - dt * np.array(f_e)
        expected_v[0] = 3.0 / 2 * np.sin(4.0)
        expected_v[1] = 3.0 / 3 * (1 - np.cos(6.0))
        errors.append(np.linalg.norm(s[3:6] - gravity_v - expected_v))
    assert errors[0] < 3e-3
    assert errors[0] / errors[1] > 1.5
