"""Simulated truth that owes nothing to the filter: analytic motion, differentiated in space.

A trajectory is latitude, longitude, height and attitude as smooth functions of time.  The specific
force is the second difference of the *inertial* position (extended precision) minus gravitation,
gravitation being Somigliana's gravity plus the centrifugal part; the angular rate is the rotation
vector between attitudes to inertial space.  Neither uses the filter's frame, gravity or mechanics.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]

A, F, OMEGA, GM = 6378137.0, 1 / 298.257223563, 7.292115e-5, 3.986004418e14
E2 = F * (2 - F)
LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 47.0, 8.0, 450.0
STEP_S = 0.02


@dataclass(frozen=True)
class Motion:
    """East, north, up (m) about the start and roll, pitch, yaw (rad), functions of t (n,)."""

    name: str
    position: Callable[[Floats], tuple[Floats, Floats, Floats]]
    attitude: Callable[[Floats], tuple[Floats, Floats, Floats]]


@dataclass(frozen=True)
class Truth:
    """What the sensors would read without noise, and where the platform is.

    ``t`` (n,), ``rate`` and ``force`` (n, 3) in body axes; ``geodetic`` (n, 3) rad, rad, m;
    ``velocity`` (n, 3) ENU; ``C_nb`` (n, 3, 3).
    """

    t: Floats
    rate: Floats
    force: Floats
    geodetic: Floats
    velocity: Floats
    C_nb: Floats


def _geodetic(motion: Motion, t: Floats) -> tuple[NDArray, NDArray, NDArray]:
    east, north, up = motion.position(t)
    lat0 = np.radians(np.longdouble(LATITUDE_DEG))
    # a fixed metric at the start: the curve is what it is, only its name is in metres
    M = A * (1 - E2) / (1 - E2 * np.sin(lat0) ** 2) ** 1.5
    N = A / np.sqrt(1 - E2 * np.sin(lat0) ** 2)
    latitude = lat0 + north / M
    longitude = np.radians(np.longdouble(LONGITUDE_DEG)) + east / (N * np.cos(lat0))
    return latitude, longitude, ALTITUDE_M + up


def _ecef(latitude: NDArray, longitude: NDArray, h: NDArray) -> NDArray:
    N = A / np.sqrt(1 - E2 * np.sin(latitude) ** 2)
    return np.stack(
        [
            (N + h) * np.cos(latitude) * np.cos(longitude),
            (N + h) * np.cos(latitude) * np.sin(longitude),
            (N * (1 - E2) + h) * np.sin(latitude),
        ],
        axis=-1,
    )


def _inertial(motion: Motion, t: NDArray) -> NDArray:
    r = _ecef(*_geodetic(motion, t))
    c, s = np.cos(OMEGA * t), np.sin(OMEGA * t)
    return np.stack([c * r[:, 0] - s * r[:, 1], s * r[:, 0] + c * r[:, 1], r[:, 2]], axis=-1)


def _level(latitude: Floats, longitude: Floats) -> Floats:
    sl, cl, so, co = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    zero = np.zeros_like(sl)
    return np.stack(
        [
            np.stack([-so, co, zero], -1),
            np.stack([-sl * co, -sl * so, cl], -1),
            np.stack([cl * co, cl * so, sl], -1),
        ],
        axis=-2,
    )


def gravity(latitude: Floats, h: Floats) -> Floats:
    """Somigliana with second-order height (Groves 2013, (2.134), (2.139))."""
    s2 = np.sin(latitude) ** 2
    surface = 9.7803253359 * (1 + 0.001931853 * s2) / np.sqrt(1 - E2 * s2)
    m = OMEGA**2 * A**2 * A * (1 - F) / GM
    return surface * (1 - 2 / A * (1 + F + m - 2 * F * s2) * h + 3 * h**2 / A**2)


def _to_inertial(motion: Motion, t: Floats) -> tuple[Rotation, Floats, Floats]:
    """Body to inertial, body to level, ECEF to level."""
    latitude, longitude, _ = (np.asarray(x, float) for x in _geodetic(motion, t))
    roll, pitch, yaw = motion.attitude(t)
    level = Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], axis=-1)).as_matrix()
    T = _level(latitude, longitude)
    spin = Rotation.from_rotvec(np.stack([0 * t, 0 * t, OMEGA * t], axis=-1))
    return spin * Rotation.from_matrix(np.swapaxes(T, 1, 2) @ level), level, T


def truth(motion: Motion, duration_s: float, rate_hz: float) -> Truth:
    """Sample a motion at a rate from 0 to its end."""
    t = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    x = t.astype(np.longdouble)
    h = np.longdouble(STEP_S)
    # fourth-order second difference in extended precision: rounding 1e-12/h^2 stays below 1e-8
    weights = {-2: -1.0, -1: 16.0, 0: -30.0, 1: 16.0, 2: -1.0}
    acceleration = sum(w * _inertial(motion, x + k * h) for k, w in weights.items()) / (12 * h * h)
    latitude, longitude, altitude = (np.asarray(g, float) for g in _geodetic(motion, x))
    C_ib, C_nb, T = _to_inertial(motion, t)
    spin = np.stack([np.cos(OMEGA * t), np.sin(OMEGA * t)], axis=-1)
    ecef = np.asarray(_ecef(latitude, longitude, altitude), float)
    down = -T[:, 2] * gravity(latitude, altitude)[:, None]
    centrifugal = OMEGA**2 * ecef * np.array([1.0, 1.0, 0.0])
    g_e = down - centrifugal
    g_i = np.stack(
        [
            spin[:, 0] * g_e[:, 0] - spin[:, 1] * g_e[:, 1],
            spin[:, 1] * g_e[:, 0] + spin[:, 0] * g_e[:, 1],
            g_e[:, 2],
        ],
        axis=-1,
    )
    force = C_ib.inv().apply(np.asarray(acceleration, float) - g_i)
    d = 1e-4
    after, before = _to_inertial(motion, t + d)[0], _to_inertial(motion, t - d)[0]
    rate = (before.inv() * after).as_rotvec() / (2 * d)
    up = {k: np.asarray(_ecef(*_geodetic(motion, x + k * h)), float) for k in (-2, -1, 1, 2)}
    velocity_e = (8 * (up[1] - up[-1]) - (up[2] - up[-2])) / (12 * STEP_S)
    velocity = np.einsum("kij,kj->ki", T, velocity_e)
    return Truth(t, rate, force, np.stack([latitude, longitude, altitude], -1), velocity, C_nb)


def _smooth_start(t: NDArray, start_s: float, rise_s: float) -> NDArray:
    """0 before ``start_s``, then t - start less half the rise: a speed that grows smoothly to 1."""
    x = np.clip((t - start_s) / rise_s, 0, 1)
    inside = rise_s * (x**4 * (2.5 - 3 * x + x * x))  # integral of 10x^3 - 15x^4 + 6x^5
    return inside + np.clip(t - start_s - rise_s, 0, None)


def standing(yaw: float = 0.7) -> Motion:
    """Rest, slightly tilted."""
    return Motion(
        "standing",
        lambda t: (0 * t, 0 * t, 0 * t),
        lambda t: (0 * t + 0.02, 0 * t - 0.03, 0 * t + yaw),
    )


def driving(yaw: float = 0.7, rest_s: float = 10.0, speed: float = 12.0) -> Motion:
    """Rest, then a winding road with hills, heading along the track."""

    def along(t: NDArray) -> NDArray:
        return speed * _smooth_start(t, rest_s, 6.0) + 30 * (
            1 - np.cos(0.11 * _smooth_start(t, rest_s, 6.0))
        )

    def bend(s: NDArray) -> NDArray:
        return yaw + 0.9 * np.sin(s / 90) + 0.5 * (np.cos(s / 37) - 1)

    def position(t: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        s = along(t)
        grid = np.linspace(0, float(s.max()) + 1, 20001, dtype=np.longdouble)
        return (*_track(s, bend, grid), 4 * (1 - np.cos(s / 120)))

    def attitude(t: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        s = along(t)
        pitch = -np.arctan(4 / 120 * np.sin(s / 120))
        return 0.03 * np.sin(s / 55), pitch, bend(s)

    return Motion("driving", position, attitude)


def _track(s: NDArray, bend: Callable, grid: NDArray) -> tuple[NDArray, NDArray]:
    """East and north along a path of heading ``bend(s)``: Gauss-Legendre from the last knot."""
    knots = np.arange(0, float(s.max()) + 10, 5.0).astype(np.longdouble)
    x, w = np.polynomial.legendre.leggauss(12)

    def piece(a: NDArray, b: NDArray) -> tuple[NDArray, NDArray]:
        mid, half = (a + b) / 2, (b - a) / 2
        angle = bend(mid[:, None] + half[:, None] * x)
        return half * (np.cos(angle) @ w), half * (np.sin(angle) @ w)

    de, dn = piece(knots[:-1], knots[1:])
    east = np.concatenate(([0], np.cumsum(de)))
    north = np.concatenate(([0], np.cumsum(dn)))
    k = np.clip((s / 5).astype(int), 0, knots.size - 2)
    pe, pn = piece(knots[k], s)
    return east[k] + pe, north[k] + pn


def flying(yaw: float = 0.7, rest_s: float = 5.0) -> Motion:
    """Rest, climb, then banked figures of eight with a slow swing of all angles."""

    def position(t: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        u = _smooth_start(t, rest_s, 8.0)
        c, s = np.cos(yaw), np.sin(yaw)
        forward = 60 * np.sin(0.2 * u) + 40 * np.sin(0.07 * u)
        left = 35 * np.sin(0.4 * u) + 50 * (1 - np.cos(0.05 * u))
        return c * forward - s * left, s * forward + c * left, 20 * (1 - np.cos(0.09 * u))

    def attitude(t: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        u = _smooth_start(t, rest_s, 8.0)
        roll = 0.3 * np.sin(0.4 * u)
        return roll, 0.15 * np.sin(0.23 * u), yaw + 1.2 * np.sin(0.17 * u) + 0.05 * u

    return Motion("flying", position, attitude)
