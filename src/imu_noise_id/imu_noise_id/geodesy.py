"""Latitude, longitude and height to metres about a point (WGS 84)."""

from __future__ import annotations

import numpy as np

from imu_noise_id.recording import Floats

SEMI_MAJOR_M = 6_378_137.0
ECCENTRICITY_SQUARED = 6.694_379_990_141_316e-3


def curvature_radii(latitude_rad: float) -> tuple[float, float]:
    """Radii of curvature in the meridian, M, and in the prime vertical, N, in metres.

    M = a (1 - e^2) / (1 - e^2 sin^2 lat)^(3/2), N = a / (1 - e^2 sin^2 lat)^(1/2)
    (Groves 2013, Principles of GNSS, Inertial and Multisensor Integrated Navigation, eq. 2.105-6).
    """
    w = 1.0 - ECCENTRICITY_SQUARED * np.sin(latitude_rad) ** 2
    prime_vertical = SEMI_MAJOR_M / np.sqrt(w)
    return float(prime_vertical * (1.0 - ECCENTRICITY_SQUARED) / w), float(prime_vertical)


def enu_about_mean(latitude_deg: Floats, longitude_deg: Floats, altitude_m: Floats) -> Floats:
    """East, north and up of each fix from the mean of all, shape (3, n).

    north = dlat (M + h), east = dlon (N + h) cos(lat): exact enough (1e-6 of the distance) within a
    few kilometres of the mean.
    """
    longitude = longitude_deg[0] + np.remainder(longitude_deg - longitude_deg[0] + 180.0, 360) - 180
    known_m = altitude_m[np.isfinite(altitude_m)] if np.isnan(altitude_m).any() else altitude_m
    known_m = known_m if known_m.size else np.zeros(1)
    middle = [x[0] + np.mean(x - x[0]) for x in (latitude_deg, longitude, known_m)]
    latitude_rad = np.deg2rad(middle[0])
    meridian, prime_vertical = curvature_radii(latitude_rad)
    north = np.deg2rad(latitude_deg - middle[0]) * (meridian + middle[2])
    east = np.deg2rad(longitude - middle[1]) * (prime_vertical + middle[2]) * np.cos(latitude_rad)
    return np.array((east, north, altitude_m - middle[2]))
