"""Parameters of the ``fuse`` node: the filter's own, with units and ranges, and the node's."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from imu_noise_id.errors import InputError
from imu_noise_id.ros.parameters import Setting
from imu_noise_id.topics import DEFAULTS

from nav_fusion.parameters import RANGES, Parameters
from nav_fusion.published import BODY_FRAME, WORLD_FRAME

AIDS = ("fix", "vel", "mag")
UNITS = {
    "lever_arm_m": "antenna from the IMU, body axes, m",
    "mounting_rpy_rad": "roll, pitch, yaw that turn IMU axes into body axes, rad",
    "hard_iron_t": "subtracted from the magnetic field, sensor axes, T",
    "soft_iron": "3 x 3 matrix, row by row, that multiplies what is left of the field",
    "initial_heading_rad": "heading at the start, from east counter-clockwise, rad",
    "origin": "latitude deg, longitude deg, altitude m of the world frame",
}

NODE = (
    *(
        Setting(f"{kind}_topic", DEFAULTS[kind], f"topic of the {kind} messages; empty: not used")
        for kind in ("imu", *AIDS)
    ),
    Setting("model_topic", "/identify/model", "noise model of identify; empty: not used"),
    Setting("model_file", "", "model.yaml; goes before model_topic"),
    Setting(
        "model_wait_s", 2.0, "how long to wait for model_topic before the defaults, s", 0.0, 600.0
    ),
    Setting("queue_depth", 5000, "messages that may wait for this node, a topic", 200, 100_000),
    Setting("world_frame", WORLD_FRAME, "frame of the odometry, east-north-up (REP 105)"),
    Setting("body_frame", BODY_FRAME, "frame of the body, whose axes mounting_rpy_rad gives"),
    Setting("publish_tf", True, "world to body on /tf, where tf2_ros is installed"),
    Setting("heading_known", False, "whether initial_heading_rad holds"),
    Setting("origin_given", False, "whether origin holds; else the first fix used is the origin"),
)


def _setting(name: str, default: Any) -> Setting:
    if name in RANGES:
        low, high, unit = RANGES[name]
        meaning = f"{name.replace('_', ' ')}, {unit or '1'}"
        return Setting(name, default, meaning, low, high)
    return Setting(name, _flat(name, default), UNITS.get(name, name.replace("_", " ")))


def _flat(name: str, default: Any) -> Any:
    if name == "soft_iron":
        return [value for row in default for value in row]
    if name == "origin":
        return [0.0, 0.0, 0.0]
    if isinstance(default, tuple):
        return list(default)
    if isinstance(default, float) and math.isnan(default):
        return 0.0
    return default


FILTER = tuple(_setting(f.name, f.default) for f in fields(Parameters))
SETTINGS = (*NODE, *FILTER)


def filter_parameters(values: Mapping[str, Any]) -> Parameters:
    """Return the filter's parameters from the node's.

    Raises
    ------
    InputError
        When one is out of its range.
    """
    given = {setting.name: values[setting.name] for setting in FILTER}
    for name in ("lever_arm_m", "mounting_rpy_rad", "hard_iron_t", "origin"):
        given[name] = _vector(name, given[name], 3)
    rows = _vector("soft_iron", given["soft_iron"], 9)
    given["soft_iron"] = (rows[0:3], rows[3:6], rows[6:9])
    if not values["origin_given"]:
        given["origin"] = None
    if not values["heading_known"]:
        given["initial_heading_rad"] = math.nan
    return Parameters(**given)


def _vector(name: str, value: Any, size: int) -> tuple[float, ...]:
    if len(value) != size or not all(math.isfinite(v) for v in value):
        raise InputError(f"parameter {name}: {size} finite numbers are needed, not {list(value)}")
    return tuple(float(v) for v in value)
