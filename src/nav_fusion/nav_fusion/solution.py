"""What is published: rows of the engine as east-north-up positions, velocities and covariances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_fusion import core
from nav_fusion.alignment import matrix_of, quaternion_of
from nav_fusion.earth import ecef_from_geodetic, geodetic_from_ecef, level_axes
from nav_fusion.state import NAV

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]

LARGEST_HEADING_VARIANCE = np.pi**2 / 3
"""Of a heading that is not known at all; a Gaussian's cannot be larger on a circle."""


@dataclass(frozen=True)
class Solution:
    """k states, ready for messages.

    Attributes
    ----------
    stamp_ns : (k,) int64
    position, velocity : (k, 3) float64
        East, north, up about the origin, m and m/s (velocity of the IMU to the Earth).
    orientation : (k, 4) float64
        Quaternion (w, x, y, z) of body to east-north-up.
    pose_covariance : (k, 6, 6) float64
        Position and turn about the fixed east, north, up axes (nav_msgs/Odometry.pose).
    velocity_covariance : (k, 3, 3) float64
        East-north-up.
    body_velocity, body_rate : (k, 3) float64
        In body axes (nav_msgs/Odometry.twist is in its child frame), m/s and rad/s.
    twist_covariance : (k, 6, 6) float64
    antenna : (k, 3) float64
        Latitude deg, longitude deg, altitude m.
    antenna_covariance : (k, 3, 3) float64
        East-north-up, m^2.
    hypotheses : (k,) int64
        Headings still followed; 1 once it is known.
    still : (k,) bool
    gyro_bias, gyro_bias_sigma, accel_bias, accel_bias_sigma : (k, 3) float64
        Body axes, rad/s and m/s^2.
    """

    stamp_ns: Stamps
    position: Floats
    velocity: Floats
    orientation: Floats
    pose_covariance: Floats
    velocity_covariance: Floats
    body_velocity: Floats
    body_rate: Floats
    twist_covariance: Floats
    antenna: Floats
    antenna_covariance: Floats
    hypotheses: NDArray[np.int64]
    still: NDArray[np.bool_]
    gyro_bias: Floats
    gyro_bias_sigma: Floats
    accel_bias: Floats
    accel_bias_sigma: Floats

    @property
    def heading(self) -> Floats:
        """Yaw (k,): of the body's x axis from east, counter-clockwise, rad."""
        w, x, y, z = self.orientation.T
        return np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))

    @property
    def heading_sigma(self) -> Floats:
        """Standard deviation of the heading (k,), rad."""
        return np.sqrt(self.pose_covariance[:, 5, 5])


def cross_matrix(a: Floats) -> Floats:
    """[a x] (..., 3, 3) of vectors (..., 3)."""
    out = np.zeros((*a.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2] = -a[..., 2], a[..., 1]
    out[..., 1, 0], out[..., 1, 2] = a[..., 2], -a[..., 0]
    out[..., 2, 0], out[..., 2, 1] = -a[..., 1], a[..., 0]
    return out


def turned(a: Floats, T: Floats) -> Floats:
    """T a of vectors (k, 3), to the same bits whatever k is: BLAS sums one row in another order."""
    return a[:, 0:1] * T[:, 0] + a[:, 1:2] * T[:, 1] + a[:, 2:3] * T[:, 2]


def solve(
    stamp_ns: Stamps,
    values: Floats,
    origin: tuple[float, float, float],
    lever_arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
    gyro_sample_variance: Floats | None = None,
) -> Solution:
    """Turn rows (k, OUT_SIZE) into a :class:`Solution` about an origin (deg, deg, m).

    ``gyro_sample_variance`` (3,): of white noise in one sample, for the twist's angular part.
    """
    latitude, longitude = np.radians(origin[0]), np.radians(origin[1])
    T = level_axes(latitude, longitude)
    r, v = values[:, 0:3], values[:, 3:6]
    C_eb = matrix_of(values[:, 6:10])
    P = values[:, core.OUT_P : core.OUT_P + NAV * NAV].reshape(-1, NAV, NAV)
    position = turned(r - ecef_from_geodetic(latitude, longitude, origin[2]), T)
    pose = _rotated(P[:, [0, 1, 2, 6, 7, 8]][:, :, [0, 1, 2, 6, 7, 8]], T)
    pose[:, 5, 5] = np.minimum(pose[:, 5, 5], LARGEST_HEADING_VARIANCE)
    J = np.concatenate((np.swapaxes(C_eb, 1, 2), np.swapaxes(C_eb, 1, 2) @ cross_matrix(v)), axis=2)
    twist = np.zeros((len(v), 6, 6))
    twist[:, :3, :3] = J @ P[:, 3:9, 3:9] @ np.swapaxes(J, 1, 2)
    noise = np.zeros(3) if gyro_sample_variance is None else gyro_sample_variance
    for i in range(3):
        twist[:, 3 + i, 3 + i] = values[:, core.OUT_BIAS_VARIANCE + i] + noise[i]
    bias = values[:, core.OUT_BIAS : core.OUT_BIAS + 6]
    bias_sigma = np.sqrt(
        np.maximum(values[:, core.OUT_BIAS_VARIANCE : core.OUT_BIAS_VARIANCE + 6], 0.0)
    )
    antenna, antenna_covariance = _antenna(r, C_eb, P, np.array(lever_arm_m))
    return Solution(
        stamp_ns,
        position,
        turned(v, T),
        quaternion_of(T @ C_eb),
        pose,
        T @ P[:, 3:6, 3:6] @ T.T,
        np.einsum("kji,kj->ki", C_eb, v),
        values[:, core.OUT_RATE : core.OUT_RATE + 3],
        twist,
        antenna,
        antenna_covariance,
        values[:, core.OUT_HYPOTHESES].astype(np.int64),
        values[:, core.OUT_STILL] > 0,
        bias[:, :3],
        bias_sigma[:, :3],
        bias[:, 3:],
        bias_sigma[:, 3:],
    )


def _rotated(P: Floats, T: Floats) -> Floats:
    """Both 3-vectors of P (k, 6, 6) turned by T (3, 3)."""
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = T
    return both @ P @ both.T


def _antenna(r: Floats, C_eb: Floats, P: Floats, lever: Floats) -> tuple[Floats, Floats]:
    """Geodetic antenna (k, 3) and its covariance: dr + psi x (C l), in its own level axes."""
    arm = C_eb @ lever
    latitude, longitude, altitude = geodetic_from_ecef(r + arm)
    axes = level_axes(latitude, longitude)
    J = np.zeros((len(r), 3, NAV))
    J[:, :, 0:3] = axes
    J[:, :, 6:9] = -axes @ cross_matrix(arm)
    covariance = J @ P @ np.swapaxes(J, 1, 2)
    return np.stack([np.degrees(latitude), np.degrees(longitude), altitude], axis=1), covariance
