"""WGS-84: geodetic coordinates, the local level frame, gravity, and the Earth's rotation."""

from __future__ import annotations

import math

import numpy as np
from imu_noise_id.compiled import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

EQUATORIAL_RADIUS_M = 6378137.0
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)
POLAR_RADIUS_M = EQUATORIAL_RADIUS_M * (1.0 - FLATTENING)
EARTH_RATE_RAD_S = 7.292115e-5
GRAVITATIONAL_CONSTANT_M3_S2 = 3.986004418e14
EQUATORIAL_GRAVITY_M_S2 = 9.7803253359
POLAR_GRAVITY_M_S2 = 9.8321849378
# Even zonal harmonics of the normal field (Moritz, Geodetic Reference System 1980, recursion
# J_2n from J_2 and e^2, with WGS-84's J_2); J_6 and beyond stay below 1e-7 m/s^2.
J2 = 1.0826298213e-3
J4 = -2.3709112005e-6


@njit(cache=True)
def gravity_at(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Gravity at an ECEF point: zonal field plus centrifugal, m/s^2.

    Gradient of mu/r (1 - J2 (a/r)^2 P2(s) - J4 (a/r)^4 P4(s)), s = z/r (Hofmann-Wellenhof and
    Moritz, Physical Geodesy, ch. 2); agrees with Somigliana's closed form to 1e-6 m/s^2.
    """
    inverse2 = 1.0 / (x * x + y * y + z * z)
    k = GRAVITATIONAL_CONSTANT_M3_S2 * inverse2 * math.sqrt(inverse2)
    a2 = EQUATORIAL_RADIUS_M * EQUATORIAL_RADIUS_M * inverse2
    s2 = z * z * inverse2
    c2 = 1.5 * J2 * a2
    c4 = 0.625 * J4 * a2 * a2
    horizontal = 1.0 + c2 * (1.0 - 5.0 * s2) - c4 * (3.0 - 42.0 * s2 + 63.0 * s2 * s2)
    vertical = 1.0 + c2 * (3.0 - 5.0 * s2) - c4 * (15.0 - 70.0 * s2 + 63.0 * s2 * s2)
    level = EARTH_RATE_RAD_S * EARTH_RATE_RAD_S - k * horizontal
    return level * x, level * y, -k * vertical * z


@njit(cache=True)
def plumb_at(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Unit vector along gravity at an ECEF point: down."""
    a, b, c = gravity_at(x, y, z)
    scale = 1.0 / math.sqrt(a * a + b * b + c * c)
    return scale * a, scale * b, scale * c


@njit(cache=True)
def normal_gravity(r: Floats, g: Floats) -> None:
    """Gravity at the ECEF point ``r`` (3,) into ``g`` (3,)."""
    g[0], g[1], g[2] = gravity_at(r[0], r[1], r[2])


def somigliana_gravity(latitude_rad: float, altitude_m: float) -> float:
    """Magnitude of normal gravity near the ellipsoid, m/s^2: Somigliana, second order in height."""
    s2 = math.sin(latitude_rad) ** 2
    a, b, f = EQUATORIAL_RADIUS_M, POLAR_RADIUS_M, FLATTENING
    k = b * POLAR_GRAVITY_M_S2 / (a * EQUATORIAL_GRAVITY_M_S2) - 1.0
    surface = EQUATORIAL_GRAVITY_M_S2 * (1.0 + k * s2) / math.sqrt(1.0 - ECCENTRICITY_SQUARED * s2)
    m = EARTH_RATE_RAD_S**2 * a**2 * b / GRAVITATIONAL_CONSTANT_M3_S2
    h = altitude_m / a
    return float(surface * (1.0 - 2.0 * (1.0 + f + m - 2.0 * f * s2) * h + 3.0 * h * h))


def ecef_from_geodetic(
    latitude_rad: Floats | float, longitude_rad: Floats | float, altitude_m: Floats | float
) -> Floats:
    """ECEF points (..., 3) in metres of geodetic coordinates."""
    s, c = np.sin(latitude_rad), np.cos(latitude_rad)
    N = EQUATORIAL_RADIUS_M / np.sqrt(1.0 - ECCENTRICITY_SQUARED * s * s)
    x = (N + altitude_m) * c * np.cos(longitude_rad)
    y = (N + altitude_m) * c * np.sin(longitude_rad)
    z = (N * (1.0 - ECCENTRICITY_SQUARED) + altitude_m) * s
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1)


@njit(cache=True)
def ecef_at(latitude_rad: float, longitude_rad: float, altitude_m: float, r: Floats) -> None:
    """One ECEF point into the first three of ``r``, as :func:`ecef_from_geodetic`."""
    s, c = math.sin(latitude_rad), math.cos(latitude_rad)
    N = EQUATORIAL_RADIUS_M / math.sqrt(1.0 - ECCENTRICITY_SQUARED * s * s)
    r[0] = (N + altitude_m) * c * math.cos(longitude_rad)
    r[1] = (N + altitude_m) * c * math.sin(longitude_rad)
    r[2] = (N * (1.0 - ECCENTRICITY_SQUARED) + altitude_m) * s


@njit(cache=True)
def geodetic_at(x: float, y: float, z: float) -> tuple[float, float, float]:
    """Latitude, longitude (rad) and altitude (m) of one ECEF point.

    Bowring's formula (1976) with one more turn: below 1e-12 rad from -10 km to 50 km.
    """
    p = math.hypot(x, y)
    a, b, e2 = EQUATORIAL_RADIUS_M, POLAR_RADIUS_M, ECCENTRICITY_SQUARED
    second = (a * a - b * b) / (b * b)
    reduced, latitude = math.atan2(z * a, p * b), 0.0
    for _ in range(2):
        latitude = math.atan2(
            z + second * b * math.sin(reduced) ** 3, p - e2 * a * math.cos(reduced) ** 3
        )
        reduced = math.atan2((1.0 - FLATTENING) * math.sin(latitude), math.cos(latitude))
    s, c = math.sin(latitude), math.cos(latitude)
    altitude = p * c + z * s - a * math.sqrt(1.0 - e2 * s * s)
    return latitude, math.atan2(y, x), altitude


@njit(cache=True)
def _geodetic_rows(points: Floats, out: Floats) -> None:
    for k in range(points.shape[0]):
        out[k, 0], out[k, 1], out[k, 2] = geodetic_at(points[k, 0], points[k, 1], points[k, 2])


def geodetic_from_ecef(r: Floats) -> tuple[Floats, Floats, Floats]:
    """Latitude, longitude (rad) and altitude (m) of ECEF points (..., 3)."""
    points = np.ascontiguousarray(r, dtype=np.float64).reshape(-1, 3)
    out = np.empty_like(points)
    _geodetic_rows(points, out)
    places = out.reshape(r.shape)
    return places[..., 0], places[..., 1], places[..., 2]


def level_axes(latitude_rad: Floats | float, longitude_rad: Floats | float) -> Floats:
    """C_ne (..., 3, 3): rows are the east, north and up unit vectors in ECEF."""
    sl, cl = np.sin(latitude_rad), np.cos(latitude_rad)
    so, co = np.sin(longitude_rad), np.cos(longitude_rad)
    zero = np.zeros_like(sl * so)
    east = np.stack([-so + zero, co + zero, zero], axis=-1)
    north = np.stack([-sl * co, -sl * so, cl + zero], axis=-1)
    up = np.stack([cl * co, cl * so, sl + zero], axis=-1)
    return np.stack([east, north, up], axis=-2)


@njit(cache=True)
def fill_axes(sl: float, cl: float, so: float, co: float, T: Floats) -> None:
    """C_ne into ``T`` (3, 3) by sine and cosine of latitude and of longitude."""
    T[0, 0], T[0, 1], T[0, 2] = -so, co, 0.0
    T[1, 0], T[1, 1], T[1, 2] = -sl * co, -sl * so, cl
    T[2, 0], T[2, 1], T[2, 2] = cl * co, cl * so, sl


@njit(cache=True)
def level_axes_at(r: Floats, T: Floats) -> None:
    """C_ne at the ECEF point ``r`` (3,) into ``T`` (3, 3); geodetic up by one Bowring step."""
    p = math.sqrt(r[0] * r[0] + r[1] * r[1])
    a, b = EQUATORIAL_RADIUS_M, POLAR_RADIUS_M
    reduced = math.atan2(r[2] * a, p * b)
    second = (a * a - b * b) / (b * b)
    latitude = math.atan2(
        r[2] + second * b * math.sin(reduced) ** 3,
        p - ECCENTRICITY_SQUARED * a * math.cos(reduced) ** 3,
    )
    sl, cl = math.sin(latitude), math.cos(latitude)
    fill_axes(sl, cl, r[1] / p, r[0] / p, T)
