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
