"""Result files hold strict JSON: null for what cannot be had, and a fleet side by side."""

from __future__ import annotations

import json

import numpy as np
import pytest
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.results_file import Unit, fleet_tree, json_text

NAME = "angular_velocity.x"


def test_what_is_not_finite_becomes_null_and_arrays_become_lists() -> None:
    tree = {
        "a": np.array([1.0, np.nan, np.inf]),
        "b": np.float64("nan"),
        "c": (1 + 2j, 3 + 0j),
        "d": np.int64(4),
        "e": np.bool_(True),
        "f": "<text> \u00e4",
    }
    read = json.loads(json_text(tree))
    assert read["a"] == [1.0, None, None]
    assert read["b"] is None
    assert read["c"] == [[1.0, 2.0], 3.0]
    assert read["d"] == 4
    assert read["e"] is True
    assert read["f"] == "<text> \u00e4"


def _model(density: float) -> NoiseModel:
    fitted = typed_effect("white_noise", NAME, {"density": density})
    return NoiseModel((ChannelModel(NAME, "/imu/data", "rad/s", 100.0, 0.0, (fitted,)),))


def test_a_fleet_gives_median_and_spread_between_its_units() -> None:
    units = [Unit(f"u{k}", f"bag{k}", _model(d)) for k, d in enumerate((1e-4, 2e-4, 4e-4))]
    tree = fleet_tree([*units, Unit("bad", "bag", None, "broken")])
    (row,) = tree["parameters"]
    assert row["median"] == 2e-4
    assert row["spread"] == pytest.approx(np.std([1e-4, 2e-4, 4e-4], ddof=1))
    assert [unit["value"] for unit in row["units"]] == [1e-4, 2e-4, 4e-4]
    assert tree["units"][-1] == {
        "name": "bad",
        "bag": "bag",
        "status": "failed",
        "error": "broken",
    }


def test_a_fleet_of_one_has_no_spread() -> None:
    (row,) = fleet_tree([Unit("u", "bag", _model(1e-4))])["parameters"]
    assert row["spread"] is None
