"""East, north, up against an independent way through earth-centred coordinates."""

import numpy as np
import pytest
from imu_noise_id.geodesy import ECCENTRICITY_SQUARED, SEMI_MAJOR_M, enu_about_mean


def earth_centred(latitude_deg, longitude_deg, altitude_m):
    lat, lon = np.deg2rad(latitude_deg), np.deg2rad(longitude_deg)
    n = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY_SQUARED * np.sin(lat) ** 2)
    return np.array(
        (
            (n + altitude_m) * np.cos(lat) * np.cos(lon),
            (n + altitude_m) * np.cos(lat) * np.sin(lon),
            (n * (1 - ECCENTRICITY_SQUARED) + altitude_m) * np.sin(lat),
        )
    )


@pytest.mark.parametrize("latitude_deg", [-60.0, 0.0, 45.0, 80.0])
def test_metres_about_the_mean(latitude_deg):
    rng = np.random.default_rng(3)
    lat = latitude_deg + rng.normal(0, 1e-4, 500)
    lon = 7.0 + rng.normal(0, 1e-4, 500)
    alt = 300.0 + rng.normal(0, 5.0, 500)
    middle = lat.mean(), lon.mean(), alt.mean()
    phi, lam = np.deg2rad(middle[0]), np.deg2rad(middle[1])
    turn = np.array(
        (
            (-np.sin(lam), np.cos(lam), 0.0),
            (-np.sin(phi) * np.cos(lam), -np.sin(phi) * np.sin(lam), np.cos(phi)),
            (np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)),
        )
    )
    exact = turn @ (earth_centred(lat, lon, alt) - earth_centred(*middle)[:, np.newaxis])
    np.testing.assert_allclose(enu_about_mean(lat, lon, alt), exact, atol=2e-4)


def test_fixes_on_both_sides_of_the_date_line_are_neighbours():
    lon = np.array([179.99999, -179.99999])
    east = enu_about_mean(np.zeros(2), lon, np.zeros(2))[0]
    np.testing.assert_allclose(east, [-1.113195, 1.113195], atol=1e-5)
