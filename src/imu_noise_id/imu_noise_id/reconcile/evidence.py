"""The sentence that goes with every step."""

from __future__ import annotations

from collections.abc import Callable

from imu_noise_id.effects.bandwidth_limit import BandwidthLimit
from imu_noise_id.model import FittedEffect
from imu_noise_id.reconcile.result import ADD, REFIT
from imu_noise_id.wording import channel_label, gap_text

_THINGS: dict[str, Callable[[dict[str, float], str], str]] = {
    "white_noise": lambda v, u: f"white noise of {v['density']:.3g} {u}/sqrt(Hz)",
    "quantization": lambda v, u: f"quantization noise of {v['coefficient']:.3g} {u} s",
    "bias_instability": lambda v, u: f"a bias instability of {v['coefficient']:.3g} {u}",
    "gauss_markov": lambda v, u: (
        f"a wandering bias of {v['sigma']:.3g} {u} with a memory of {v['correlation_time_s']:.3g} s"
    ),
    "rate_random_walk": lambda v, u: f"a rate random walk of {v['coefficient']:.3g} {u}/sqrt(s)",
    "narrow_band": lambda v, u: (
        f"a narrow-band vibration at {v['frequency_hz']:.4g} Hz, {v['bandwidth_hz']:.2g} Hz wide, "
        f"of {v['sigma']:.3g} {u}"
    ),
    "periodic": lambda v, u: f"a {v['frequency_hz']:.4g} Hz vibration of {v['amplitude']:.3g} {u}",
    "rate_ramp": lambda v, u: f"a drift of {v['slope']:.3g} {u}/s",
    "bias_step": lambda v, u: f"a step of {v['height']:.3g} {u} at {v['time_s']:.4g} s",
    "temperature": lambda v, u: f"a temperature sensitivity of {v['coefficient']:.3g} {u}/K",
    "output_rounding": lambda v, u: f"rounding to {v['step']:.3g} {u}",
    "held_samples": lambda v, u: f"holding each sample for {v['factor']:.3g} messages",
    "saturation": lambda v, u: f"a full scale of {v['limit']:.4g} {u}",
    "outliers": lambda v, u: f"outliers of {v['scale']:.3g} {u} in {v['rate']:.2g} of the samples",
    "variance_change": lambda v, u: (
        f"noise of {v['ratio']:.3g} times the variance from {v['from_s']:.4g} to {v['to_s']:.4g} s"
    ),
    "random_telegraph": lambda v, u: (
        f"jumps of {v['height']:.3g} {u} every {v['mean_dwell_s']:.3g} s"
    ),
    "timestamp_jitter": lambda v, u: f"time-stamp jitter of {v['std_s']:.2g} s",
    "dropouts": lambda v, u: f"{v['rate']:.2g} gaps per second of {v['mean_length_s']:.2g} s",
    "bandwidth_limit": lambda v, u: (
        "a bandwidth of "
        f"{BandwidthLimit(v['cutoff_hz'], v['order'], v['damping']).half_power_hz:.3g} Hz (-3 dB)"
    ),
    "averaging": lambda v, u: f"averaging over {v['window_s']:.3g} s",
}


def sentence(
    name: str,
    unit: str,
    action: str,
    fitted: FittedEffect,
    unseen: tuple[float, float],
) -> str:
    """Say what was missing, or wrong, and what that did to the gap.

    Parameters
    ----------
    name, unit : str
        Of the channel.
    action : str
    fitted : FittedEffect
        Its note says what its numbers do not.
    unseen : tuple of (float, float)
        Gap on unseen data before and after.
    """
    effect = fitted.effect
    values = {p.name: getattr(effect, p.name) for p in effect.parameters}
    if effect.name == "cross_axis":
        thing = (
            f"noise shared with {channel_label(str(values['other']))} "
            f"(correlation {values['correlation']:.3f})"
        )
    else:
        thing = _THINGS[effect.name](values, unit)
    if action == ADD:
        what = f"{thing} was missing"
    elif action == REFIT:
        what = f"{effect.name} had other values: {thing}"
    else:
        what = f"{thing} is in the model and not in the recording"
    note = f"; {fitted.note}" if fitted.note else ""
    gap = f"gap {gap_text(unseen[0], 1)} -> {gap_text(unseen[1], 1)} on unseen data{note}"
    return f"{channel_label(name)}: {what} ({gap})"
