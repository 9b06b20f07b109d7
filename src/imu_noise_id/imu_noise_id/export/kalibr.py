"""Kalibr's ``imu.yaml``: one continuous density and one walk per sensor."""

from __future__ import annotations

from imu_noise_id.export.reduction import (
    WHITE_AND_DRIFT,
    Exported,
    channels_of,
    comment,
    joined,
    left_out,
    walk_density,
    white_density,
)
from imu_noise_id.model import NoiseModel

_SENSORS = (("accelerometer", "linear_acceleration"), ("gyroscope", "angular_velocity"))


def export(model: NoiseModel, rate_hz: float) -> Exported:
    """Write ``imu.yaml``; of the three axes the largest value, so that none is trusted too far.

    Raises
    ------
    InputError
        When a channel or its white noise is missing.
    """
    notes: list[str] = []
    lines = []
    topic = ""
    for sensor, quantity in _SENSORS:
        axes = channels_of(model, quantity, "kalibr")
        topic = axes["x"].topic
        for channel in axes.values():
            notes += left_out(channel, WHITE_AND_DRIFT, "kalibr")
        white = max(white_density(channel, rate_hz, "kalibr") for channel in axes.values())
        walk = max(walk_density(channel, notes) for channel in axes.values())
        unit = axes["x"].unit
        lines.append(f"{sensor}_noise_density: {_number(white)}  # {unit}/sqrt(Hz)")
        lines.append(f"{sensor}_random_walk: {_number(walk)}  # {unit}/s/sqrt(Hz)")
    notes = joined(notes)
    head = comment(
        [
            "Kalibr imu.yaml, written by imu_noise_id",
            "Continuous densities: Kalibr itself makes them discrete at update_rate, sigma per "
            "sample = noise_density*sqrt(update_rate), bias step = random_walk/sqrt(update_rate).",
            "noise_density is Allan's N (root of the two-sided spectrum); one value for three "
            "axes: the largest.",
            *notes,
        ]
    )
    body = "\n".join(lines)
    quoted = "'" + topic.replace("'", "''") + "'"
    return Exported(
        f"{head}{body}\nrostopic: {quoted}\nupdate_rate: {_number(rate_hz)}  # Hz\n", tuple(notes)
    )


def _number(value: float) -> str:
    """All digits, and a point before the exponent: YAML 1.1 takes 1e-05 for a text."""
    text = repr(float(value))
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
