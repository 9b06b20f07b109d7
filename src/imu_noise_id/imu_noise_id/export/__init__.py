"""A noise model in the file of another tool, units converted and stated: one module a target."""

from __future__ import annotations

from collections.abc import Callable

from imu_noise_id.export import gazebo, gtsam, kalibr, robot_localization
from imu_noise_id.export.reduction import Exported
from imu_noise_id.model import NoiseModel

FORMATS: dict[str, Callable[[NoiseModel, float], Exported]] = {
    "kalibr": kalibr.export,
    "robot_localization": robot_localization.export,
    "gtsam": gtsam.export,
    "gazebo": gazebo.export,
}

__all__ = ["FORMATS", "Exported"]
