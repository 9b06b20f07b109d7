"""robot_localization's process noise, and the covariances that its inputs should carry."""

from __future__ import annotations

from imu_noise_id.errors import InputError
from imu_noise_id.export.reduction import (
    Exported,
    channels_of,
    comment,
    has_axes,
    joined,
    left_out,
    slower_sensors,
    stationary_variance,
    white_power,
)
from imu_noise_id.model import NoiseModel

_HELD = frozenset(("white_noise", "output_rounding", "gauss_markov", "narrow_band"))
_QUANTITIES = {
    "angular_velocity": ("angular_velocity_covariance", "(rad/s)^2"),
    "linear_acceleration": ("linear_acceleration_covariance", "(m/s^2)^2"),
    "position": ("position_covariance", "m^2"),
    "velocity": ("velocity_covariance", "(m/s)^2"),
}
_STATES = [
    "x",
    "y",
    "z",
    "roll",
    "pitch",
    "yaw",
    "vx",
    "vy",
    "vz",
    "vroll",
    "vpitch",
    "vyaw",
    "ax",
    "ay",
    "az",
]
# the defaults of robot_localization: how the robot moves, which no still recording shows
_MOTION = (
    *(0.05, 0.05, 0.06, 0.03, 0.03, 0.06, 0.025, 0.025, 0.04),
    *(0.01, 0.01, 0.02, 0.01, 0.01, 0.015),
)


def export(model: NoiseModel, rate_hz: float) -> Exported:
    """Write two YAML fragments: ``process_noise_covariance`` and the messages' covariances.

    A measurement's variance is that of one message at ``rate_hz``: density^2 rate, plus the
    variance of Gauss-Markov and narrow-band terms, since the filter has no bias states.  The
    process noise of attitude and velocity is what integrated white noise adds per second.

    Raises
    ------
    InputError
        When the model has no channel that the filter takes, or one whose variance is not known.
    """
    notes = slower_sensors(model, rate_hz)
    process = dict(zip(_STATES, _MOTION, strict=True))
    lines = []
    for quantity, (key, unit) in _QUANTITIES.items():
        if not has_axes(model, quantity):
            continue
        axes = list(channels_of(model, quantity, "robot_localization").values())
        variances = []
        for channel in axes:
            notes += left_out(channel, _HELD, "robot_localization (it has no bias states)")
            variance = white_power(channel, rate_hz) * rate_hz + stationary_variance(channel)
            if not variance > 0.0:
                raise InputError(f"{channel.name}: no noise in the model with a variance")
            variances.append(variance)
        lines.append(f"    {key}: [{_matrix(variances)}]  # {unit} per message at {rate_hz:g} Hz")
        states = {
            "angular_velocity": ("roll", "pitch", "yaw"),
            "linear_acceleration": ("vx", "vy", "vz"),
        }.get(quantity, ())
        for state, channel in zip(states, axes, strict=False):
            process[state] = white_power(channel, rate_hz)
    if not lines:
        raise InputError(f"{model.source}: no IMU or GNSS channels: nothing for robot_localization")
    notes = joined(notes)
    return Exported(_text(process, lines, rate_hz, notes), tuple(notes))


def _text(process: dict[str, float], lines: list[str], rate_hz: float, notes: list[str]) -> str:
    head = comment(
        [
            "robot_localization fragments, written by imu_noise_id",
            "Process noise is per second (the filter multiplies by the time step). Attitude and "
            "velocity: N^2, what the integrated white noise of gyro and accelerometer adds; the "
            "other entries are robot_localization's defaults, which say how the robot moves: tune.",
            *notes,
        ]
    )
    measured = comment(
        [
            "What the drivers should put into Imu, NavSatFix and Twist messages: variance of one "
            f"message at {rate_hz:g} Hz = N^2*rate + variance of the correlated terms. Another "
            "rate needs another export.",
        ]
    )
    return (
        f"{head}ekf_filter_node:\n  ros__parameters:\n"
        f"    # order: {' '.join(_STATES)}; squared units per second\n"
        f"    process_noise_covariance: [{_matrix(list(process.values()))}]\n"
        f"{measured}measurement_covariances:\n  ros__parameters:\n" + "\n".join(lines) + "\n"
    )


def _matrix(diagonal: list[float]) -> str:
    size = len(diagonal)
    return ",\n        ".join(
        ", ".join(f"{diagonal[row]:.17e}" if row == column else "0.0" for column in range(size))
        for row in range(size)
    )
