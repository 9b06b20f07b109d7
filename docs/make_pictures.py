"""Draw the pictures of docs/, every effect's signature: ``python docs/make_pictures.py``.

Needs the built workspace (``source env.sh``) and matplotlib (``tools/build docs``).
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from imu_noise_id.allan import allan
from imu_noise_id.effects import CATALOGUE
from imu_noise_id.effects.base import CouplingEffect, TransportEffect
from imu_noise_id.model import ChannelModel, NoiseModel, TemperatureCourse
from imu_noise_id.model_file import typed_effect
from imu_noise_id.series import to_series
from imu_noise_id.simulate import simulate_recording
from imu_noise_id.spectrum import spectrum

HERE = Path(__file__).parent
CHANNEL = "angular_velocity.x"
RATE_HZ = 100.0
DURATION_S = 1200.0
WHITE = {"density": 1.0e-3}
SHOWN: dict[str, dict[str, float | str]] = {
    "white_noise": {},
    "quantization": {"coefficient": 1.0e-4},
    "bias_instability": {"coefficient": 1.0e-3},
    "gauss_markov": {"sigma": 2.0e-3, "correlation_time_s": 20.0},
    "rate_random_walk": {"coefficient": 5.0e-4},
    "rate_ramp": {"slope": 1.0e-5},
    "periodic": {"frequency_hz": 12.0, "amplitude": 8.0e-3},
    "narrow_band": {"frequency_hz": 12.0, "bandwidth_hz": 1.0, "sigma": 8.0e-3},
    "temperature": {"coefficient": 1.0e-3},
    "bias_step": {"time_s": 500.0, "height": 6.0e-3},
    "random_telegraph": {"height": 6.0e-3, "mean_dwell_s": 40.0},
    "bandwidth_limit": {"cutoff_hz": 10.0, "order": 2.0, "damping": 0.5},
    "averaging": {"window_s": 0.035},
    "output_rounding": {"step": 0.02},
    "held_samples": {"factor": 4.0},
    "saturation": {"limit": 0.015},
    "outliers": {"rate": 0.002, "scale": 0.1},
    "variance_change": {"from_s": 400.0, "to_s": 600.0, "ratio": 6.0},
    "timestamp_jitter": {"std_s": 0.002},
    "dropouts": {"rate": 0.05, "mean_length_s": 1.0},
    "cross_axis": {"other": "angular_velocity.y", "correlation": 0.8},
}
"""Every effect of the catalogue, on top of white noise, strong enough to be seen."""


def channel(name: str, effect: str | None) -> ChannelModel:
    """Return a channel of white noise with one more effect."""
    effects = [typed_effect("white_noise", name, dict(WHITE))]
    if effect is not None and effect != "white_noise":
        effects.append(typed_effect(effect, name, SHOWN[effect]))
    return ChannelModel(name, "/imu/data", "rad/s", RATE_HZ, 0.0, tuple(effects))


def record(effect: str | None) -> NoiseModel:
    """Return the model that a picture plays."""
    channels = [channel(CHANNEL, effect)]
    if effect == "cross_axis":
        other = channel("angular_velocity.y", None)
        channels.append(other)
    time_s = np.linspace(0.0, DURATION_S, 200)
    warmth = TemperatureCourse(time_s, 25.0 + 8.0 * (1.0 - np.exp(-time_s / 400.0)))
    return NoiseModel(tuple(channels), warmth if effect == "temperature" else None)


def draw(effect: str) -> None:
    """Draw course, Allan deviation and spectrum with the effect (blue) and without it (grey)."""
    sides = []
    for which in (None, effect):
        rng = np.random.default_rng(1)
        played = simulate_recording(record(which), DURATION_S, rng)
        sides.append((played, to_series(played.channel(CHANNEL), played.start_ns)))
    figure, axes = plt.subplots(1, 3, figsize=(9.6, 2.5), dpi=75, layout="constrained")
    (_, without), (played, series) = sides
    draw_course(axes[0], effect, played, series)
    for shown, colour, width in ((without, "0.7", 1.2), (series, "#1f6fb4", 1.6)):
        curve = allan(shown)
        axes[1].loglog(curve.tau_s, curve.deviation, color=colour, lw=width)
        measured = spectrum(shown)
        axes[2].loglog(measured.frequency_hz, np.sqrt(measured.psd), color=colour, lw=width)
    axes[1].set_title("Allan deviation", fontsize=9)
    axes[1].set_xlabel("averaging time (s)", fontsize=8)
    axes[2].set_title("root of the spectrum", fontsize=9)
    axes[2].set_xlabel("frequency (Hz)", fontsize=8)
    for axis in axes:
        axis.tick_params(labelsize=7)
        axis.grid(alpha=0.3)
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(HERE / "pictures" / f"{effect}.png", metadata={"Software": None})
    plt.close(figure)


def draw_course(axis, effect, played, series) -> None:  # type: ignore[no-untyped-def]
    """Draw what shows the effect best: the course, a zoom, the stamps, or one axis on another."""
    kind = CATALOGUE[effect]
    axis.set_title("course", fontsize=9)
    axis.set_xlabel("time (s)", fontsize=8)
    if issubclass(kind, CouplingEffect):
        other = played.channel("angular_velocity.y").values[:3000]
        axis.plot(series.values[:3000], other, ".", ms=1.5, color="#1f6fb4")
        axis.set_title("axis y over axis x", fontsize=9)
        axis.set_xlabel("")
    elif effect == "timestamp_jitter":
        stamps = played.channel(CHANNEL).stamp_ns[:400]
        axis.plot(np.diff(stamps) * 1e-6, ".", ms=3, color="#1f6fb4")
        axis.set_title("time between stamps (ms)", fontsize=9)
        axis.set_xlabel("message", fontsize=8)
    else:
        zoom = effect in ("held_samples", "output_rounding", "bandwidth_limit", "averaging",
                          "periodic", "narrow_band", "quantization")  # fmt: skip
        stop = 120 if zoom else series.values.size
        shown = np.where(series.observed, series.values, np.nan)[:stop]
        style = {"drawstyle": "steps-post"} if issubclass(kind, TransportEffect) else {}
        axis.plot(series.time_s[:stop], shown, color="#1f6fb4", lw=0.9 if zoom else 0.3, **style)


def main() -> None:
    """Draw all of them; every effect of the catalogue must have a picture."""
    missing = set(CATALOGUE) - set(SHOWN)
    if missing:
        raise SystemExit(f"no picture described for {', '.join(sorted(missing))}")
    (HERE / "pictures").mkdir(exist_ok=True)
    for effect in SHOWN:
        draw(effect)


if __name__ == "__main__":
    main()
