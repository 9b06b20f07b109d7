"""The units that data sheets use, beside SI."""

from __future__ import annotations

import math

from imu_noise_id.export.reduction import FLICKER_FLOOR

_DEGREE = math.pi / 180.0
_MICRO_G = 9.80665e-6
_FACTORS = {
    ("angular_velocity", "white_noise", "density"): (60.0 / _DEGREE, "deg/\u221ah"),
    ("angular_velocity", "bias_instability", "coefficient"): (
        3600.0 * FLICKER_FLOOR / _DEGREE,
        "deg/h (floor)",
    ),
    ("angular_velocity", "rate_random_walk", "coefficient"): (
        3600.0 * 60.0 / _DEGREE,
        "deg/h/\u221ah",
    ),
    ("angular_velocity", "gauss_markov", "sigma"): (3600.0 / _DEGREE, "deg/h"),
    ("angular_velocity", "periodic", "amplitude"): (1.0 / _DEGREE, "deg/s"),
    ("angular_velocity", "narrow_band", "sigma"): (1.0 / _DEGREE, "deg/s"),
    ("linear_acceleration", "white_noise", "density"): (
        1.0 / _MICRO_G,
        "\u00b5g/\u221aHz (two-sided)",
    ),
    ("linear_acceleration", "bias_instability", "coefficient"): (
        FLICKER_FLOOR / _MICRO_G,
        "\u00b5g (floor)",
    ),
    ("linear_acceleration", "gauss_markov", "sigma"): (1.0 / _MICRO_G, "\u00b5g"),
    ("linear_acceleration", "rate_random_walk", "coefficient"): (
        60.0 / _MICRO_G,
        "\u00b5g/\u221ah",
    ),
    ("magnetic_field", "white_noise", "density"): (1e9, "nT/\u221aHz"),
    ("heading", "white_noise", "density"): (1.0 / _DEGREE, "deg/\u221aHz"),
}


def customary(
    channel_name: str, effect: str, parameter: str, value: float
) -> tuple[float, str] | None:
    """Value and unit as data sheets print them, or None where they print SI.

    ``white_noise`` of a gyro is its angle random walk; a one-sided density in deg/s/sqrt(Hz) or
    micro-g/sqrt(Hz) is sqrt(2) larger than the two-sided one.
    """
    factor = _FACTORS.get((channel_name.split(".")[0], effect, parameter))
    return None if factor is None else (value * factor[0], factor[1])
