"""The pictures of the reports: curves in, a plot out.

Colours are middle tones that read on white and on black.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from imu_noise_id.allan import AllanCurve
from imu_noise_id.recording import Floats
from imu_noise_id.report.curves import Envelope, Part
from imu_noise_id.report.plot import INK, Axis, Layer, Plot
from imu_noise_id.spectrum import Spectrum

MODEL = "#e8590c"
SECOND_MODEL = INK
THIRD_MODEL = "#a259c4"
MUTED = "#8a94a3"
ALARM = "#e03131"
PALETTE = ("#2f7ed8", "#e8590c", "#2b9a66", "#a259c4", "#c79a00", "#d6457a", "#12a5a5", "#8a6d3b")
COLOURS = {
    "white_noise": "#2f7ed8",
    "quantization": "#12a5a5",
    "bias_instability": "#2b9a66",
    "gauss_markov": "#a259c4",
    "rate_random_walk": "#c79a00",
    "rate_ramp": "#8a6d3b",
    "periodic": "#d6457a",
    "narrow_band": "#e0568f",
    "output_rounding": "#5f7d95",
    "outliers": "#e03131",
    "random_telegraph": "#7a5195",
}
_CURVE_HOVER = (("averaging time", "@x{0.000a} s"), ("value", "@y{0.000e}"))


def colour_of(label: str) -> str:
    """Colour of an effect, the same in every picture."""
    return COLOURS.get(label.split(" ")[0], MUTED)


def _model_lines(
    x: Floats, models: Sequence[Part], hover: tuple[tuple[str, str], ...]
) -> list[Layer]:
    return [
        Layer(
            "line",
            {"x": x, "y": model.values},
            model.label,
            (MODEL, SECOND_MODEL, THIRD_MODEL)[k % 3],
            ("solid", "dashdot", "dotdash")[k % 3],
            width=2.4,
            hover=hover,
        )
        for k, model in enumerate(models)
    ]


def _shares(x: Floats, parts: Sequence[Part]) -> list[Layer]:
    return [
        Layer("line", {"x": x, "y": part.values}, part.label, colour_of(part.label), "dashed")
        for part in parts
    ]


def allan_figure(
    curve: AllanCurve, unit: str, parts: Sequence[Part] = (), models: Sequence[Part] = ()
) -> Plot:
    """Draw the measured deviation with its interval, each effect's share, and whole models."""
    data = {"x": curve.tau_s, "y": curve.deviation, "low": curve.lower, "high": curve.upper}
    hover = (*_CURVE_HOVER, ("95 %", "@low{0.000e} to @high{0.000e}"))
    return Plot(
        Axis("averaging time (s)", True),
        Axis(f"Allan deviation ({unit})", True, *_log_room(curve.lower, curve.upper)),
        (
            Layer("band", data, "95 % interval", alpha=0.16),
            *_shares(curve.tau_s, parts),
            *_model_lines(curve.tau_s, models, _CURVE_HOVER),
            Layer("points", data, "measured", hover=hover),
        ),
    )


def _log_room(low: Floats, high: Floats) -> tuple[float, float]:
    return float(np.min(low)) / 1.6, float(np.max(high)) * 1.6


def overview_figure(curves: Sequence[tuple[str, AllanCurve]], unit: str) -> Plot:
    """Draw the Allan deviations of a sensor's axes together, each with its interval."""
    layers = []
    for k, (label, curve) in enumerate(curves):
        data = {"x": curve.tau_s, "y": curve.deviation, "low": curve.lower, "high": curve.upper}
        colour = PALETTE[k % len(PALETTE)]
        hover = (("axis", label), *_CURVE_HOVER)
        layers.append(Layer("band", data, label, colour, alpha=0.15))
        layers.append(Layer("line", data, label, colour, width=2.0, hover=hover))
    return Plot(
        Axis("averaging time (s)", True),
        Axis(f"Allan deviation ({unit})", True),
        tuple(layers),
        columns=3,
    )


def spectrum_figure(
    measured: Spectrum,
    unit: str,
    parts: Sequence[Part] = (),
    models: Sequence[Part] = (),
    lines_hz: Sequence[float] = (),
) -> Plot:
    """Root of the two-sided spectrum: measured with its interval, shares, models, and lines."""
    x, y = measured.frequency_hz, np.sqrt(measured.psd)
    data = {"x": x, "y": y, "low": np.sqrt(measured.lower), "high": np.sqrt(measured.upper)}
    hover = (("frequency", "@x{0.0000a} Hz"), ("density", "@y{0.000e}"))
    roots = [Part(part.label, np.sqrt(part.values)) for part in (*parts, *models)]
    layers = [
        Layer("band", data, "95 % interval", alpha=0.14),
        Layer("line", data, "measured", width=1.1, alpha=0.8, hover=hover),
        *_shares(x, roots[: len(parts)]),
        *_model_lines(x, roots[len(parts) :], hover),
    ]
    if lines_hz:
        layers.append(
            Layer("guide", {"x": np.array(lines_hz)}, "lines", COLOURS["periodic"], "dotted")
        )
    return Plot(
        Axis("frequency (Hz)", True),
        Axis(f"density ({unit}/\u221aHz, two-sided)", True, *_log_room(y, y)),
        tuple(layers),
    )


def time_figure(
    course: Envelope, mean: float, unit: str, left_out_s: Sequence[tuple[float, float]] = ()
) -> Plot:
    """Extremes and mean of equal stretches of time, about the mean; what was left out is shaded."""
    seen = np.isfinite(course.mean)
    width = float(course.time_s[1] - course.time_s[0]) if course.time_s.size > 1 else 1.0
    data = {
        "x": course.time_s[seen],
        "low": course.low[seen] - mean,
        "high": course.high[seen] - mean,
        "y": course.mean[seen] - mean,
    }
    hover = (
        ("time", "@x{0.0} s"),
        ("from, to", "@low{0.000e}, @high{0.000e}"),
        ("mean", "@y{0.000e}"),
    )
    layers = [
        Layer(
            "bars", data, "smallest to largest", PALETTE[0], width=width, alpha=0.45, hover=hover
        ),
        Layer("points", data, "mean of each stretch", size=2.5),
    ]
    if left_out_s:
        spans = np.array(left_out_s)
        layers.append(
            Layer("shade", {"low": spans[:, 0], "high": spans[:, 1]}, "", ALARM, alpha=0.16)
        )
    return Plot(
        Axis("time since the first sample (s)"),
        Axis(f"value \u2212 mean ({unit})"),
        tuple(layers),
    )


def step_figure(time_s: Floats, response: Floats, unit: str) -> Plot:
    """Step response of a transfer function."""
    hover = (("time", "@x{0.000a} s"), ("response", "@y{0.000e}"))
    line = Layer("line", {"x": time_s, "y": response}, "", MODEL, width=2.2, hover=hover)
    return Plot(Axis("time (s)"), Axis(f"response to a unit step ({unit})"), (line,))


def bode_figure(frequency_hz: Floats, gain_db: Floats, phase_deg: Floats) -> Plot:
    """Gain and phase over frequency."""
    low, high = float(np.min(phase_deg)), float(np.max(phase_deg))
    room = max(0.1 * (high - low), 5.0)
    gain = Layer(
        "line",
        {"x": frequency_hz, "y": gain_db},
        "gain",
        MODEL,
        width=2.2,
        hover=(("frequency", "@x{0.0000a} Hz"), ("gain", "@y{0.00} dB")),
    )
    phase = Layer(
        "line",
        {"x": frequency_hz, "y": phase_deg},
        "phase",
        PALETTE[0],
        "dashed",
        width=1.8,
        hover=(("frequency", "@x{0.0000a} Hz"), ("phase", "@y{0.0} deg")),
        second=True,
    )
    return Plot(
        Axis("frequency (Hz)", True),
        Axis("gain (dB)"),
        (gain, phase),
        Axis("phase (deg)", False, low - room, high + room),
    )


def pole_zero_figure(poles: ArrayLike, zeros: ArrayLike) -> Plot:
    """Poles and zeros in the z plane, with the unit circle."""
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    circle = {"x": np.cos(angle), "y": np.sin(angle)}
    layers = [Layer("line", circle, "unit circle", MUTED)]
    hover = (("real", "@x{0.000000}"), ("imaginary", "@y{0.000000}"))
    for points, marker, label, colour in (
        (np.atleast_1d(np.asarray(poles, complex)), "x", "pole", MODEL),
        (np.atleast_1d(np.asarray(zeros, complex)), "ring", "zero", PALETTE[0]),
    ):
        data = {"x": points.real, "y": points.imag}
        layers.append(
            Layer("points", data, label, colour, marker=marker, width=2.4, size=13, hover=hover)
        )
    return Plot(Axis("real part"), Axis("imaginary part"), tuple(layers), equal=True, columns=3)


def scatter_figure(east_m: Floats, north_m: Floats, ellipses: Sequence[tuple[str, Floats]]) -> Plot:
    """Fixes in the plane with 95 % ellipses: those measured and those claimed."""
    hover = (("east", "@x{0.000} m"), ("north", "@y{0.000} m"))
    data = {"x": east_m, "y": north_m}
    layers = [Layer("points", data, "fixes", PALETTE[0], alpha=0.4, size=4, hover=hover)]
    for k, (label, covariance) in enumerate(ellipses):
        x, y = ellipse(covariance)
        dash = ("solid", "dashed")[k % 2]
        layers.append(Layer("line", {"x": x, "y": y}, label, (MODEL, INK)[k % 2], dash, width=2.4))
    return Plot(
        Axis("east of the mean (m)"),
        Axis("north of the mean (m)"),
        tuple(layers),
        equal=True,
        columns=3,
    )


def ellipse(covariance: Floats, chance: float = 0.95) -> tuple[Floats, Floats]:
    """Outline that holds a two-dimensional Gaussian with a given chance, (121,) each."""
    scale = np.sqrt(-2.0 * np.log(1.0 - chance))
    values, vectors = np.linalg.eigh(covariance)
    angle = np.linspace(0.0, 2.0 * np.pi, 121)
    circle = np.stack((np.cos(angle), np.sin(angle)))
    outline = vectors @ (scale * np.sqrt(np.maximum(values, 0.0))[:, None] * circle)
    return outline[0], outline[1]


def lines_figure(
    lines: Sequence[tuple[str, Floats, Floats]],
    x: Axis,
    y: Axis,
    band: tuple[str, Floats, Floats, Floats] | None = None,
) -> Plot:
    """Draw named lines, over a band where one is given (label, x, low, high)."""
    layers = []
    if band is not None:
        label, at, low, high = band
        data = {"x": at, "low": low, "high": high}
        layers.append(Layer("band", data, label, MUTED, alpha=0.35))
    for k, (label, at, values) in enumerate(lines):
        hover = (("line", label), (x.label, "@x{0.000a}"), (y.label, "@y{0.000e}"))
        colour = PALETTE[k % len(PALETTE)]
        layers.append(Layer("line", {"x": at, "y": values}, label, colour, width=2.0, hover=hover))
    return Plot(x, y, tuple(layers))


def areas_figure(at: Floats, parts: Sequence[Part], x: Axis, y: Axis) -> Plot:
    """Draw shares stacked on each other: an error budget."""
    below = np.zeros_like(at)
    layers = []
    for k, part in enumerate(parts):
        above = below + part.values
        colour = COLOURS.get(part.label.split(" ")[-1], PALETTE[k % len(PALETTE)])
        data = {"x": at, "low": below, "high": above, "y": above, "share": part.values}
        hover = (("share of", part.label), (x.label, "@x{0.000a}"), (y.label, "@share{0.000e}"))
        layers.append(Layer("band", data, part.label, colour, alpha=0.75))
        layers.append(Layer("line", data, part.label, colour, width=1.0, hover=hover))
        below = above
    return Plot(x, y, tuple(layers))


def with_guides(plot: Plot, at: Sequence[float], label: str) -> Plot:
    """Add vertical lines to a picture."""
    if not at:
        return plot
    guides = Layer("guide", {"x": np.array(at)}, label, COLOURS["periodic"], "dotted")
    return dataclasses.replace(plot, layers=(*plot.layers, guides))
