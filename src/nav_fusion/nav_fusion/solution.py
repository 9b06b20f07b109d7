"""What is published: rows of the engine as east-north-up positions, velocities and covariances."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from imu_noise_id.compiled import njit
from imu_noise_id.threads import cores, ordered_map
from numpy.typing import NDArray

from nav_fusion import arrays
from nav_fusion.earth import ecef_at, fill_axes, geodetic_at
from nav_fusion.state import NAV
from nav_fusion.strapdown import rotation_matrix

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]

ROWS_A_THREAD = 8192
LARGEST_HEADING_VARIANCE = np.pi**2 / 3
"""Of a heading that is not known at all; a Gaussian's cannot be larger on a circle."""

# Columns of the means; rows of J, by which an error (r, v, psi) becomes what is published.
POSITION, VELOCITY, ORIENTATION, BODY_VELOCITY, ANTENNA, MEANS = 0, 3, 6, 10, 13, 16
POSE, LEVEL_VELOCITY, TWIST, PLACE, ERRORS = 0, 6, 9, 12, 15


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


class Covariances(NamedTuple):
    """Of k rows: pose (k, 6, 6), velocity (k, 3, 3), twist (k, 6, 6), antenna (k, 3, 3)."""

    pose: Floats
    velocity: Floats
    twist: Floats
    antenna: Floats


def room_for(k: int) -> Covariances:
    """Zeros."""
    return Covariances(*(np.zeros((k, size, size)) for size in (6, 3, 6, 3)))


@njit(cache=True)
def cross_row(a: Floats, b: Floats, out: Floats) -> None:
    """``out`` = a x b (3,)."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def turned(T: Floats, a: Floats, out: Floats) -> None:
    """``out`` = T a (3,)."""
    for i in range(3):
        out[i] = T[i, 0] * a[0] + T[i, 1] * a[1] + T[i, 2] * a[2]


@njit(cache=True)
def product(p: Floats, q: Floats, out: Floats) -> None:
    """``out`` = p q as unit quaternions (4,), its first element not negative."""
    out[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    out[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    out[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    out[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]
    size = math.sqrt(out[0] ** 2 + out[1] ** 2 + out[2] ** 2 + out[3] ** 2)
    out /= -size if out[0] < 0.0 else size


@njit(cache=True)
def level_quaternion(latitude: float, longitude: float, out: Floats) -> None:
    """Quaternion of C_ne: back by longitude + 90 deg about z, then 90 deg - latitude about x."""
    z, x = 0.5 * longitude + math.pi / 4, math.pi / 4 - 0.5 * latitude
    out[0] = math.cos(x) * math.cos(z)
    out[1] = -math.sin(x) * math.cos(z)
    out[2] = -math.sin(x) * math.sin(z)
    out[3] = -math.cos(x) * math.sin(z)


@njit(cache=True)
def fill_jacobian(
    T: Floats, C: Floats, v: Floats, axes: Floats, arm: Floats, rests: bool, J: Floats
) -> None:
    """J (ERRORS, NAV) of pose, velocity, body velocity C'v and antenna r + arm, in its axes.

    At rest a velocity is noise along the body's axes, whatever the attitude.
    """
    for i in range(3):
        J[POSE + i, 0:3] = J[POSE + 3 + i, 6:9] = J[LEVEL_VELOCITY + i, 3:6] = T[i]
        J[TWIST + i, 3:6] = C[:, i]
        cross_row(C[:, i], v, J[TWIST + i, 6:9])
        if rests:
            J[TWIST + i, 6:9] = 0.0
        J[PLACE + i, 0:3] = axes[i]
        cross_row(arm, axes[i], J[PLACE + i, 6:9])


@njit(cache=True)
def spread(J: Floats, P: Floats, JP: Floats, out: Floats) -> None:
    """``out`` (ERRORS, ERRORS) = J P J', in one order of summing however many rows there are."""
    for i in range(ERRORS):
        for j in range(NAV):
            total = 0.0
            for k in range(NAV):
                total += J[i, k] * P[NAV * k + j]
            JP[i, j] = total
        for j in range(i + 1):
            total = 0.0
            for k in range(NAV):
                total += JP[i, k] * J[j, k]
            out[i, j] = out[j, i] = total


@njit(cache=True, nogil=True)
def solve_rows(
    values: Floats,
    origin: Floats,
    lever: Floats,
    means: Floats,
    covariances: Covariances,
) -> None:
    """Means (k, MEANS) and covariances of rows (k, OUT_SIZE) of the engine.

    ``origin`` (3,): latitude and longitude, rad, and altitude, m.
    """
    T, C, axes = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    J, JP, S = np.zeros((ERRORS, NAV)), np.empty((ERRORS, NAV)), np.empty((ERRORS, ERRORS))
    start, arm, level = np.empty(3), np.empty(3), np.empty(4)
    latitude, longitude = origin[0], origin[1]
    ecef_at(latitude, longitude, origin[2], start)
    fill_axes(math.sin(latitude), math.cos(latitude), math.sin(longitude), math.cos(longitude), T)
    level_quaternion(latitude, longitude, level)
    for k in range(values.shape[0]):
        row, mean = values[k], means[k]
        r, v = row[0:3], row[3:6]
        rotation_matrix(row[6:10], C)
        turned(T, r - start, mean[POSITION : POSITION + 3])
        turned(T, v, mean[VELOCITY : VELOCITY + 3])
        product(level, row[6:10], mean[ORIENTATION : ORIENTATION + 4])
        turned(C.T, v, mean[BODY_VELOCITY : BODY_VELOCITY + 3])
        turned(C, lever, arm)
        la, lo, altitude = geodetic_at(r[0] + arm[0], r[1] + arm[1], r[2] + arm[2])
        mean[ANTENNA], mean[ANTENNA + 1], mean[ANTENNA + 2] = la, lo, altitude
        fill_axes(math.sin(la), math.cos(la), math.sin(lo), math.cos(lo), axes)
        fill_jacobian(T, C, v, axes, arm, row[arrays.OUT_RESTING] == 1.0, J)
        spread(J, row[arrays.OUT_P : arrays.OUT_P + NAV * NAV], JP, S)
        covariances.pose[k] = S[POSE:LEVEL_VELOCITY, POSE:LEVEL_VELOCITY]
        covariances.pose[k, 5, 5] = min(S[POSE + 5, POSE + 5], LARGEST_HEADING_VARIANCE)
        covariances.velocity[k] = S[LEVEL_VELOCITY:TWIST, LEVEL_VELOCITY:TWIST]
        covariances.twist[k, :3, :3] = S[TWIST:PLACE, TWIST:PLACE]
        covariances.antenna[k] = S[PLACE:ERRORS, PLACE:ERRORS]
        for i in range(3):
            covariances.twist[k, 3 + i, 3 + i] = row[arrays.OUT_BIAS_VARIANCE + i]


def solve(
    stamp_ns: Stamps,
    values: Floats,
    origin: tuple[float, float, float],
    lever_arm_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Solution:
    """Turn rows (k, OUT_SIZE) into a :class:`Solution` about an origin (deg, deg, m)."""
    place = np.array([math.radians(origin[0]), math.radians(origin[1]), origin[2]])
    means = np.empty((len(values), MEANS))
    covariances = room_for(len(values))
    lever = np.array(lever_arm_m, dtype=float)

    def work(part: slice) -> None:
        rows = Covariances(*(c[part] for c in covariances))
        solve_rows(values[part], place, lever, means[part], rows)

    parts = [slice(a, a + ROWS_A_THREAD) for a in range(0, len(values), ROWS_A_THREAD)]
    for _ in ordered_map(work, parts, cores()):
        pass  # each fills its own rows
    means[:, ANTENNA : ANTENNA + 2] *= 180.0 / math.pi
    bias = values[:, arrays.OUT_BIAS : arrays.OUT_BIAS + 6]
    variance = values[:, arrays.OUT_BIAS_VARIANCE : arrays.OUT_BIAS_VARIANCE + 6]
    bias_sigma = np.sqrt(np.maximum(variance, 0.0))
    return Solution(
        stamp_ns,
        means[:, POSITION : POSITION + 3],
        means[:, VELOCITY : VELOCITY + 3],
        means[:, ORIENTATION : ORIENTATION + 4],
        covariances.pose,
        covariances.velocity,
        means[:, BODY_VELOCITY : BODY_VELOCITY + 3],
        values[:, arrays.OUT_RATE : arrays.OUT_RATE + 3],
        covariances.twist,
        means[:, ANTENNA : ANTENNA + 3],
        covariances.antenna,
        values[:, arrays.OUT_HYPOTHESES].astype(np.int64),
        values[:, arrays.OUT_STILL] > 0,
        bias[:, :3],
        bias_sigma[:, :3],
        bias[:, 3:],
        bias_sigma[:, 3:],
    )
