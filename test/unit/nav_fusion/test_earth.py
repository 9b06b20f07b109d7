"""nav_fusion.earth: the zonal field against Somigliana, coordinates there and back."""

from __future__ import annotations

import numpy as np
import pytest
from nav_fusion.earth import (
    ecef_from_geodetic,
    geodetic_from_ecef,
    level_axes,
    level_axes_at,
    normal_gravity,
    somigliana_gravity,
)


@pytest.mark.parametrize("latitude_deg", [-90.0, -35.0, 0.0, 20.0, 47.0, 89.9])
@pytest.mark.parametrize("altitude_m", [-400.0, 0.0, 9000.0])
def test_gravity_is_somiglianas_and_points_down(latitude_deg: float, altitude_m: float) -> None:
    latitude, longitude = np.radians(latitude_deg), 0.4
    g = np.zeros(3)
    normal_gravity(ecef_from_geodetic(latitude, longitude, altitude_m), g)
    local = level_axes(latitude, longitude) @ g
    assert -local[2] == pytest.approx(somigliana_gravity(latitude, altitude_m), abs=3e-6)
    assert abs(local[0]) < 1e-6
    assert abs(local[1]) < 1e-5 + 1e-8 * abs(altitude_m)  # plumb lines bend with height


def test_geodetic_coordinates_come_back() -> None:
    rng = np.random.default_rng(2)
    latitude, longitude = rng.uniform(-1.57, 1.57, 500), rng.uniform(-3.14, 3.14, 500)
    altitude = rng.uniform(-5000.0, 40000.0, 500)
    found = geodetic_from_ecef(ecef_from_geodetic(latitude, longitude, altitude))
    np.testing.assert_allclose(found[0], latitude, atol=1e-12)
    np.testing.assert_allclose(found[1], longitude, atol=1e-12)
    np.testing.assert_allclose(found[2], altitude, atol=1e-7)


def test_the_compiled_level_axes_are_the_array_ones() -> None:
    latitude, longitude = 0.82, -2.1
    T = np.zeros((3, 3))
    level_axes_at(ecef_from_geodetic(latitude, longitude, 3000.0), T)
    np.testing.assert_allclose(T, level_axes(latitude, longitude), atol=1e-10)
