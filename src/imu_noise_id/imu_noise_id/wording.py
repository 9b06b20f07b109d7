"""Effects and findings in words, for the terminal and the report."""

from __future__ import annotations

from imu_noise_id.effects.base import Effect
from imu_noise_id.model import FittedEffect

QUANTITIES = {
    "angular_velocity": "gyroscope",
    "linear_acceleration": "accelerometer",
    "magnetic_field": "magnetometer",
    "heading": "heading",
    "position": "position",
    "velocity": "velocity",
}
_SUPERSCRIPTS = str.maketrans(
    "-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"
)
_PHRASES = {
    "white_noise": "white noise of {density}",
    "periodic": "a line at {frequency_hz} of amplitude {amplitude}",
    "narrow_band": "a vibration about {frequency_hz}, {bandwidth_hz} wide, of {sigma}",
    "gauss_markov": "a Gauss-Markov drift of {sigma} and {correlation_time_s}",
    "bias_step": "a step of {height} at {time_s}",
    "rate_ramp": "a ramp of {slope}",
    "temperature": "a dependence on temperature of {coefficient}",
    "output_rounding": "rounding to {step}",
    "held_samples": "samples repeated {factor} times",
    "saturation": "saturation at {limit}",
    "outliers": "outliers in a fraction {rate} of the samples, of {scale}",
    "variance_change": "noise of {ratio} times the variance from {from_s} to {to_s}",
    "cross_axis": "a correlation of {correlation} with {other}",
    "timestamp_jitter": "time stamps that jitter by {std_s}",
    "dropouts": "gaps, {rate}, of {mean_length_s} on average",
    "bandwidth_limit": "a bandwidth of {cutoff_hz}",
    "averaging": "a moving average over {window_s}",
    "random_telegraph": "random jumps of {height}, {mean_dwell_s} apart",
}


def channel_label(name: str) -> str:
    """``angular_velocity.x`` -> ``gyroscope x``."""
    quantity, _, axis = name.partition(".")
    return f"{QUANTITIES.get(quantity, quantity)} {axis}".strip()


def powers(value: float) -> str:
    """Two digits as people write them: ``1.2\u00d710\u207b\u2074``."""
    if value == 0.0 or 1e-2 <= abs(value) < 1e3:
        return f"{value:.2g}"
    mantissa, _, exponent = f"{value:.1e}".partition("e")
    return f"{mantissa}\u00d710{str(int(exponent)).translate(_SUPERSCRIPTS)}"


def describe(effect: Effect, unit: str) -> str:
    """Effect with its values: ``a line at 43.1 Hz of amplitude 0.021 m/s^2``."""
    values = {}
    for parameter, value in zip(effect.parameters, effect.values(), strict=True):
        shown = value if isinstance(value, str) else f"{value:.3g}"
        unit_text = parameter.unit_for(unit)
        values[parameter.name] = shown if unit_text in ("", "1") else f"{shown} {unit_text}"
    phrase = _PHRASES.get(effect.name)
    if phrase is not None:
        return phrase.format(**values)
    return f"{effect.name.replace('_', ' ')} of {', '.join(values.values())}"


def step_sentence(action: str, fitted: FittedEffect, unit: str) -> str:
    """What a step of reconciliation says of the model."""
    what = describe(fitted.effect, unit)
    if action == "add":
        return f"{what} was missing"
    if action == "remove":
        return f"{what} is in the model, not in the recording"
    return f"{fitted.name.replace('_', ' ')} has other values: {what}"
