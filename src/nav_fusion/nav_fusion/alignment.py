"""Where the filter starts: levelled by gravity, at the first fix, with one or many headings."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from nav_fusion.earth import geodetic_from_ecef, level_axes, normal_gravity
from nav_fusion.state import ACCEL, ALIVE, NAV, SLOW, STRIDE, TILT_AT, Layout, Q, R

Floats = NDArray[np.float64]

POSITION_SIGMA_M = 1000.0
"""Before the first fix is taken: wide, so that it and its colour decide."""

MOVING_TILT_RAD = 0.07
"""Of levelling while the platform moves (0.7 m/s^2 of mean acceleration)."""


def quaternion_of(C: Floats) -> Floats:
    """Unit quaternions (..., 4) (w, x, y, z) of rotation matrices (..., 3, 3) (Shepperd 1978)."""
    diagonal = np.stack([C[..., 0, 0], C[..., 1, 1], C[..., 2, 2]], axis=-1)
    trace = diagonal.sum(axis=-1)
    squares = np.concatenate([1 + trace[..., None], 1 - trace[..., None] + 2 * diagonal], axis=-1)
    largest = np.argmax(squares, axis=-1)
    a = C[..., 2, 1] - C[..., 1, 2]
    b = C[..., 0, 2] - C[..., 2, 0]
    c = C[..., 1, 0] - C[..., 0, 1]
    d = C[..., 0, 1] + C[..., 1, 0]
    e = C[..., 0, 2] + C[..., 2, 0]
    f = C[..., 1, 2] + C[..., 2, 1]
    rows = np.stack(
        [
            np.stack([squares[..., 0], a, b, c], -1),
            np.stack([a, squares[..., 1], d, e], -1),
            np.stack([b, d, squares[..., 2], f], -1),
            np.stack([c, e, f, squares[..., 3]], -1),
        ],
        axis=-2,
    )
    q = np.take_along_axis(rows, largest[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0, -q, q)


def matrix_of(q: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = (q[..., i] for i in range(4))
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        axis=-2,
    )


def rotation_of(roll: float, pitch: float, yaw: float) -> Floats:
    """R_z(yaw) R_y(pitch) R_x(roll), (3, 3)."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def levelled(force: Floats, heading_rad: float) -> Floats:
    """C_nb (3, 3) whose up axis is the mean specific force (3,), at a heading (yaw from east)."""
    up = force / np.linalg.norm(force)
    forward = np.array([1.0, 0.0, 0.0]) if abs(up[0]) < 0.98 else np.array([0.0, 1.0, 0.0])
    a = forward - up * (up @ forward)
    a /= np.linalg.norm(a)
    b = np.cross(up, a)
    c, s = math.cos(heading_rad), math.sin(heading_rad)
    return np.array([c * a - s * b, s * a + c * b, up])


def heading_by_field(force: Floats, field: Floats, declination_rad: float) -> float:
    """Heading at which the levelled field (3,) points to magnetic north."""
    east, north, _ = levelled(force, 0.0) @ field
    return math.atan2(east, north) - declination_rad


def start_covariance(
    layout: Layout,
    C: Floats,
    axes: Floats,
    gravity: float,
    tilt_rad: float,
    heading_rad: float,
    speed_m_s: float,
) -> Floats:
    """P (n, n) at the start.

    Levelling with a biased accelerometer tilts by psi = (1/g) u x (C b_a), so tilt and bias are
    correlated, wholly where nothing else disturbs; ``tilt_rad`` is that rest, ``heading_rad`` the
    spread about the vertical u = ``axes[2]``.
    """
    n = layout.states
    P = np.zeros((n, n))
    P[0:3, 0:3] = POSITION_SIGMA_M**2 * np.eye(3)
    P[3:6, 3:6] = speed_m_s**2 * np.eye(3)
    up = axes[2]
    P[6:9, 6:9] = tilt_rad**2 * (np.eye(3) - np.outer(up, up)) + heading_rad**2 * np.outer(up, up)
    cross = np.array([[0, -up[2], up[1]], [up[2], 0, -up[0]], [-up[1], up[0], 0]])
    J = cross @ C / gravity
    for s, (target, variance) in enumerate(
        zip(layout.slow.target, layout.slow.variance, strict=True)
    ):
        P[NAV + s, NAV + s] = variance
        if ACCEL <= target < ACCEL + 3:
            column = J[:, target - ACCEL]
            P[6:9, NAV + s] = P[NAV + s, 6:9] = column * variance
            P[6:9, 6:9] += variance * np.outer(column, column)
    return P


def hypotheses(
    layout: Layout,
    position: Floats,
    force: Floats,
    headings: Floats,
    spread_rad: float,
    tilt_rad: float,
    speed_m_s: float,
) -> Floats:
    """Hypotheses (K, size) at an ECEF point, one for each heading (K,)."""
    latitude, longitude, _ = geodetic_from_ecef(position)
    axes = level_axes(latitude, longitude)
    g = np.zeros(3)
    normal_gravity(position, g)
    bank = np.zeros((headings.size, layout.size))
    m = layout.slow.target.size
    n = layout.states
    for row, heading in zip(bank, headings, strict=True):
        C = axes.T @ levelled(force, float(heading))
        row[R : R + 3] = position
        row[Q : Q + 4] = row[TILT_AT : TILT_AT + 4] = quaternion_of(C)
        row[ALIVE] = 1.0
        P = row[SLOW + m :].reshape(n, STRIDE)
        P[:, :n] = start_covariance(
            layout, C, axes, float(np.linalg.norm(g)), tilt_rad, spread_rad, speed_m_s
        )
    return bank
