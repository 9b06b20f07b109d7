"""Shared noise is found between sensors' channels, and only between those."""

from __future__ import annotations

import numpy as np
import pytest
from imu_noise_id.cross_axes import cross_axes


def residuals(*names: str) -> list[tuple[str, str, np.ndarray]]:
    """White residuals of which the first two share a fifth of their variance."""
    rng = np.random.default_rng(5)
    shared = rng.standard_normal(20_000)
    own = rng.standard_normal((len(names), 20_000))
    mix = [np.sqrt(0.8) * x + (np.sqrt(0.2) * shared if i < 2 else 0.0) for i, x in enumerate(own)]
    return [("/imu/mag", name, x.astype(np.float32)) for name, x in zip(names, mix, strict=True)]


def test_noise_that_two_axes_share_is_on_both_and_on_no_third() -> None:
    found = cross_axes(residuals("magnetic_field.x", "magnetic_field.y", "magnetic_field.z"))
    assert set(found) == {"magnetic_field.x", "magnetic_field.y"}
    (effect,) = found["magnetic_field.x"]
    assert effect.effect.other == "magnetic_field.y"
    assert effect.effect.correlation == pytest.approx(0.2, abs=4 / np.sqrt(20_000))


def test_a_heading_is_not_compared_with_the_field_that_it_is_computed_from() -> None:
    assert cross_axes(residuals("magnetic_field.x", "heading")) == {}
