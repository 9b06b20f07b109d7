"""imu_noise_id.reconcile.axes: which channels are held against each other."""

from __future__ import annotations

import numpy as np
from imu_noise_id.model import ChannelModel
from imu_noise_id.reconcile.axes import ties
from imu_noise_id.reconcile.battery import Whitened


def whitened(samples: np.ndarray) -> Whitened:
    none = np.zeros(0)
    return Whitened(samples, none, none, none, 0.01, 0.0)


def test_a_heading_is_not_held_against_the_field_that_it_is_computed_from() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.standard_normal((2, 12000))
    y = 0.3 * x + y
    records = {"magnetic_field.x": x, "magnetic_field.y": y, "heading": -y}
    models = {n: ChannelModel(n, "", "", 100.0, 0.0, (), None, 120.0) for n in records}
    (tie,) = ties({n: whitened(v) for n, v in records.items()}, models)
    assert (tie.first, tie.second) == ("magnetic_field.x", "magnetic_field.y")
    assert tie.log_p < -50.0


def test_a_correlation_is_of_the_channels_as_loud_as_what_they_share_has_made_them() -> None:
    """Of 0.5 it was told 1 in units of the model's own white noise, which whitened them."""
    rng = np.random.default_rng(1)
    own, shared = rng.standard_normal((2, 12000)), rng.standard_normal(12000)
    records = dict(zip(("angular_velocity.x", "angular_velocity.y"), own + shared, strict=True))
    models = {n: ChannelModel(n, "", "", 100.0, 0.0, (), None, 120.0) for n in records}
    (tie,) = ties({n: whitened(v) for n, v in records.items()}, models)
    assert abs(tie.value - 0.5) < 3.0 * tie.std_error
    assert 0.5 * 0.0075 < tie.std_error < 1.5 * 0.0075


def test_channels_far_louder_than_their_models_share_nothing_for_that() -> None:
    """Of six channels three times as loud as the model 15 of 15 pairs were tied."""
    rng = np.random.default_rng(2)
    names = [f"{s}.{a}" for s in ("angular_velocity", "linear_acceleration") for a in "xyz"]
    models = {n: ChannelModel(n, "", "", 100.0, 0.0, (), None, 120.0) for n in names}
    found = ties({n: whitened(3.0 * rng.standard_normal(12000)) for n in names}, models)
    assert len(found) == 15
    assert min(tie.log_p for tie in found) > np.log(1e-3)
