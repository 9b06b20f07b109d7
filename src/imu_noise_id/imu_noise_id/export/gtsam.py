"""GTSAM's PreintegrationCombinedParams: continuous covariances, per axis."""

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

_KEYS = (
    ("accelerometer_covariance", "linear_acceleration", "white", "(m/s^2)^2/Hz"),
    ("gyroscope_covariance", "angular_velocity", "white", "(rad/s)^2/Hz"),
    ("bias_acc_covariance", "linear_acceleration", "walk", "(m/s^3)^2/Hz"),
    ("bias_omega_covariance", "angular_velocity", "walk", "(rad/s^2)^2/Hz"),
)
_HEAD = (
    "GTSAM PreintegrationCombinedParams, written by imu_noise_id",
    "Continuous covariances: squares of densities (Allan's N squared, walk squared), never "
    "multiplied by the rate; GTSAM divides by the sample time itself.",
    "Python: p = gtsam.PreintegrationCombinedParams.MakeSharedU(9.81)",
    "        p.setAccelerometerCovariance(np.array(values['accelerometer_covariance']))",
    "        p.setGyroscopeCovariance(np.array(values['gyroscope_covariance']))",
    "        p.setBiasAccCovariance(np.array(values['bias_acc_covariance']))",
    "        p.setBiasOmegaCovariance(np.array(values['bias_omega_covariance']))",
    "C++:    p->accelerometerCovariance = ...; p->gyroscopeCovariance = ...; "
    "p->biasAccCovariance = ...; p->biasOmegaCovariance = ...;",
)


def export(model: NoiseModel, rate_hz: float) -> Exported:
    """Write four 3 x 3 covariances as YAML, with the lines that hand them to GTSAM.

    Raises
    ------
    InputError
        When a channel or its white noise is missing.
    """
    notes: list[str] = []
    for quantity in ("linear_acceleration", "angular_velocity"):
        for channel in channels_of(model, quantity, "gtsam").values():
            notes += left_out(channel, WHITE_AND_DRIFT, "gtsam")
    lines = []
    for key, quantity, kind, unit in _KEYS:
        axes = channels_of(model, quantity, "gtsam").values()
        if kind == "white":
            densities = [white_density(channel, rate_hz, "gtsam") for channel in axes]
        else:
            densities = [walk_density(channel, notes) for channel in axes]
        lines.append(f"{key}:  # {unit}")
        lines += [f"- [{row}]" for row in _diagonal([d * d for d in densities])]
    notes = joined(notes)
    head = comment([*_HEAD, f"Rounding counts as white noise at {rate_hz:g} Hz.", *notes])
    return Exported(f"{head}rate_hz: {rate_hz!r}\n" + "\n".join(lines) + "\n", tuple(notes))


def _diagonal(values: list[float]) -> list[str]:
    return [
        ", ".join(f"{v:.17e}" if row == column else "0.0" for column in range(len(values)))
        for row, v in enumerate(values)
    ]
