"""Bokeh figures of curves: log axes, values under the pointer, a legend that hides what it names.

Every function takes small arrays (``curves`` makes them) and returns a Bokeh plot.  Colours are
middle tones that read on white and on black; what is marked ``ink`` takes the page's text colour.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.models import (
    BoxAnnotation,
    ColumnDataSource,
    HoverTool,
    Range1d,
    Span,
)
from bokeh.plotting import figure
from numpy.typing import ArrayLike

from imu_noise_id.recording import Floats
from imu_noise_id.report.curves import Envelope, Part, Spectrum

HEIGHT = 380
INK = "#1c2330"
MODEL = "#d9480f"
MUTED = "#8a94a3"
AXES = ("#2f7ed8", "#e8590c", "#2b9a66", "#a259c4", "#c79a00", "#d6457a")
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


def colour_of(label: str) -> str:
    """Colour of an effect, the same in every figure."""
    return COLOURS.get(label.split(" ")[0], MUTED)


def _small(**columns: ArrayLike) -> ColumnDataSource:
    """Columns in single precision: half the page's size, more digits than a screen shows."""
    return ColumnDataSource({key: np.asarray(value, np.float32) for key, value in columns.items()})


def _plot(x_label: str, y_label: str, x_log: bool, y_log: bool, **more: Any) -> Any:
    plot = figure(
        height=HEIGHT,
        sizing_mode="stretch_width",
        x_axis_type="log" if x_log else "linear",
        y_axis_type="log" if y_log else "linear",
        x_axis_label=x_label,
        y_axis_label=y_label,
        tools="pan,box_zoom,wheel_zoom,reset,save",
        active_drag=None,
        active_scroll=None,
        toolbar_location="above",
        background_fill_color=None,
        border_fill_color=None,
        outline_line_color=None,
        min_border_left=58,
        **more,
    )
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    for axis in plot.axis:
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = "12px"
        axis.major_label_text_font_size = "11px"
    plot.grid.grid_line_alpha = 0.9
    return plot


def _legend(plot: Any, columns: int = 2) -> Any:
    """Put the legend below the figure, where it covers nothing."""
    legend = plot.legend[0]
    plot.center.remove(legend)
    plot.add_layout(legend, "below")
    legend.ncols = columns
    legend.click_policy = "hide"
    legend.background_fill_color = None
    legend.border_line_color = None
    legend.label_text_font_size = "12px"
    legend.spacing = 0
    legend.padding = 4
    legend.margin = 0
    legend.glyph_height = 16
    return plot


def _hover(plot: Any, renderers: list[Any], tooltips: list[tuple[str, str]]) -> None:
    plot.add_tools(HoverTool(renderers=renderers, tooltips=tooltips, mode="mouse"))


def _line(plot: Any, x: ArrayLike, y: ArrayLike, label: str, colour: str, **more: Any) -> Any:
    return plot.line(
        "x", "y", source=_small(x=x, y=y), legend_label=label, line_color=colour, **more
    )


def allan_figure(
    tau_s: Floats,
    deviation: Floats,
    lower: Floats,
    upper: Floats,
    unit: str,
    parts: Sequence[Part] = (),
    models: Sequence[Part] = (),
) -> Any:
    """Draw the measured deviation with its interval, each effect's share, and whole models."""
    bottom, top = float(np.min(lower)), float(np.max(upper))
    plot = _plot(
        "averaging time (s)",
        f"Allan deviation ({unit})",
        True,
        True,
        y_range=Range1d(bottom / 1.6, top * 1.6),
    )
    source = _small(tau=tau_s, deviation=deviation, lower=lower, upper=upper)
    plot.varea(
        "tau", "lower", "upper", source=source, fill_color=INK, fill_alpha=0.16, tags=["ink"],
        legend_label="95 % interval",
    )  # fmt: skip
    for part in parts:
        _line(plot, tau_s, part.values, part.label, colour_of(part.label), line_width=1.6,
              line_dash="dashed")  # fmt: skip
    lines = [
        _line(plot, tau_s, model.values, model.label, (MODEL, AXES[0])[k % 2], line_width=2.4)
        for k, model in enumerate(models)
    ]
    points = plot.scatter(
        "tau", "deviation", source=source, size=5, line_color=None, fill_color=INK, tags=["ink"],
        legend_label="measured",
    )  # fmt: skip
    _hover(
        plot,
        [points],
        [("tau", "@tau{0.000g} s"), ("deviation", "@deviation{0.000e}"),
         ("95 %", "@lower{0.000e} .. @upper{0.000e}")],
    )  # fmt: skip
    _hover(plot, lines, [("tau", "@x{0.000g} s"), ("model", "@y{0.000e}")])
    return _legend(plot)


def overview_figure(curves: Sequence[tuple[str, Any]], unit: str) -> Any:
    """Draw the Allan deviations of a sensor's axes together, each with its interval."""
    plot = _plot("averaging time (s)", f"Allan deviation ({unit})", True, True)
    lines = []
    for k, (label, curve) in enumerate(curves):
        colour = AXES[k % len(AXES)]
        source = _small(
            tau=curve.tau_s, deviation=curve.deviation, lower=curve.lower, upper=curve.upper
        )
        plot.varea(
            "tau", "lower", "upper", source=source, fill_color=colour, fill_alpha=0.15,
            legend_label=label,
        )  # fmt: skip
        lines.append(
            plot.line(
                "tau",
                "deviation",
                source=source,
                line_color=colour,
                line_width=2,
                name=label,
                legend_label=label,
            )  # fmt: skip
        )
    _hover(
        plot, lines, [("", "$name"), ("tau", "@tau{0.000g} s"), ("deviation", "@deviation{0.000e}")]
    )
    return _legend(plot, 3)


def spectrum_figure(
    measured: Spectrum,
    unit: str,
    parts: Sequence[Part] = (),
    models: Sequence[Part] = (),
    lines_hz: Sequence[float] = (),
) -> Any:
    """Root of the two-sided spectrum: measured with its interval, shares, models, and lines."""
    amplitude = np.sqrt(measured.psd)
    low, high = np.sqrt(measured.lower), np.sqrt(measured.upper)
    plot = _plot(
        "frequency (Hz)",
        f"density ({unit}/\u221aHz, two-sided)",
        True,
        True,
        y_range=Range1d(float(np.min(amplitude)) / 2.0, float(np.max(amplitude)) * 2.0),
    )
    source = _small(f=measured.frequency_hz, a=amplitude, lower=low, upper=high)
    plot.varea(
        "f", "lower", "upper", source=source, fill_color=INK, fill_alpha=0.14, tags=["ink"],
        legend_label="95 % interval",
    )  # fmt: skip
    shown = plot.line(
        "f", "a", source=source, line_color=INK, line_width=1.1, line_alpha=0.8, tags=["ink"],
        legend_label="measured",
    )  # fmt: skip
    for part in parts:
        _line(plot, measured.frequency_hz, np.sqrt(part.values), part.label,
              colour_of(part.label), line_width=1.6, line_dash="dashed")  # fmt: skip
    for k, model in enumerate(models):
        _line(plot, measured.frequency_hz, np.sqrt(model.values), model.label,
              (MODEL, AXES[0])[k % 2], line_width=2.4)  # fmt: skip
    for frequency in lines_hz:
        plot.add_layout(
            Span(location=frequency, dimension="height", line_color=COLOURS["periodic"],
                 line_dash="dotted", line_width=1.5)
        )  # fmt: skip
    _hover(plot, [shown], [("frequency", "@f{0.000g} Hz"), ("density", "@a{0.000e}")])
    return _legend(plot)


def time_figure(
    course: Envelope, mean: float, unit: str, left_out_s: Sequence[tuple[float, float]] = ()
) -> Any:
    """Extremes and mean of equal stretches of time, about the mean; what was left out is shaded."""
    plot = _plot("time since the first sample (s)", f"value \u2212 mean ({unit})", False, False)
    seen = np.isfinite(course.mean)
    time_s = course.time_s[seen]
    width = float(np.median(np.diff(course.time_s))) if course.time_s.size > 1 else 1.0
    source = _small(
        t=time_s, low=course.low[seen] - mean, high=course.high[seen] - mean,
        mean=course.mean[seen] - mean,
    )  # fmt: skip
    bars = plot.vbar(
        "t", width=width, bottom="low", top="high", source=source, fill_color=AXES[0],
        fill_alpha=0.45, line_color=None, legend_label="smallest to largest",
    )  # fmt: skip
    plot.scatter(
        "t", "mean", source=source, size=2.5, fill_color=INK, line_color=None, tags=["ink"],
        legend_label="mean of each stretch",
    )  # fmt: skip
    for begin, end in left_out_s:
        plot.add_layout(
            BoxAnnotation(left=begin, right=end, fill_color="#e03131", fill_alpha=0.16,
                          line_color="#e03131", line_alpha=0.5)
        )  # fmt: skip
    _hover(
        plot,
        [bars],
        [("time", "@t{0.0} s"), ("range", "@low{0.000e} .. @high{0.000e}"),
         ("mean", "@mean{0.000e}")],
    )  # fmt: skip
    return _legend(plot)


def step_figure(time_s: Floats, response: Floats, unit: str) -> Any:
    """Step response of a transfer function."""
    plot = _plot("time (s)", f"response to a unit step ({unit})", False, False)
    line = plot.line(
        "x", "y", source=_small(x=time_s, y=response), line_color=MODEL, line_width=2.2
    )
    _hover(plot, [line], [("time", "@x{0.000g} s"), ("response", "@y{0.000e}")])
    return plot


def bode_figure(frequency_hz: Floats, gain_db: Floats, phase_deg: Floats) -> Any:
    """Gain and phase over frequency."""
    from bokeh.models import LinearAxis

    plot = _plot("frequency (Hz)", "gain (dB)", True, False)
    source = _small(f=frequency_hz, gain=gain_db, phase=phase_deg)
    gain = plot.line("f", "gain", source=source, line_color=MODEL, line_width=2.2,
                     legend_label="gain")  # fmt: skip
    low, high = float(np.min(phase_deg)), float(np.max(phase_deg))
    room = max(0.1 * (high - low), 5.0)
    plot.extra_y_ranges = {"phase": Range1d(low - room, high + room)}
    axis = LinearAxis(y_range_name="phase", axis_label="phase (deg)")
    axis.axis_label_text_font_style = "normal"
    axis.axis_label_text_font_size = "12px"
    axis.major_label_text_font_size = "11px"
    plot.add_layout(axis, "right")
    phase = plot.line("f", "phase", source=source, line_color=AXES[0], line_width=1.8,
                      line_dash="dashed", y_range_name="phase", legend_label="phase")  # fmt: skip
    _hover(plot, [gain, phase], [("frequency", "@f{0.000g} Hz"), ("gain", "@gain{0.00} dB"),
                                 ("phase", "@phase{0.0} deg")])  # fmt: skip
    return _legend(plot)


def pole_zero_figure(poles: ArrayLike, zeros: ArrayLike) -> Any:
    """Poles and zeros in the z plane, with the unit circle."""
    plot = _plot("real part", "imaginary part", False, False, match_aspect=True)
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    plot.line("x", "y", source=_small(x=np.cos(angle), y=np.sin(angle)), line_color=MUTED,
              legend_label="unit circle")  # fmt: skip
    drawn = []
    for points, marker, label, colour in (
        (np.atleast_1d(np.asarray(poles, complex)), "x", "pole", MODEL),
        (np.atleast_1d(np.asarray(zeros, complex)), "circle", "zero", AXES[0]),
    ):
        if points.size:
            drawn.append(
                plot.scatter("x", "y", source=_small(x=points.real, y=points.imag), marker=marker,
                             size=13, line_color=colour, line_width=2.4, fill_color=None,
                             legend_label=label)
            )  # fmt: skip
    _hover(plot, drawn, [("real", "@x{0.000000}"), ("imaginary", "@y{0.000000}")])
    return _legend(plot, 3)


def scatter_figure(east_m: Floats, north_m: Floats, ellipses: Sequence[tuple[str, Floats]]) -> Any:
    """Fixes in the plane with 95 % ellipses: those measured and those claimed."""
    plot = _plot("east of the mean (m)", "north of the mean (m)", False, False, match_aspect=True)
    points = plot.scatter("x", "y", source=_small(x=east_m, y=north_m), size=4, fill_color=AXES[0],
                          fill_alpha=0.45, line_color=None, legend_label="fixes")  # fmt: skip
    for k, (label, covariance) in enumerate(ellipses):
        x, y = ellipse(covariance)
        _line(plot, x, y, label, (MODEL, INK)[k % 2], line_width=2.2,
              line_dash=("solid", "dashed")[k % 2], tags=["ink"] if k % 2 else [])  # fmt: skip
    _hover(plot, [points], [("east", "@x{0.000} m"), ("north", "@y{0.000} m")])
    return _legend(plot, 3)


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
    x_label: str,
    y_label: str,
    x_log: bool = False,
    y_log: bool = False,
    band: tuple[str, Floats, Floats, Floats] | None = None,
) -> Any:
    """Draw named lines, over a band where one is given (label, x, low, high)."""
    plot = _plot(x_label, y_label, x_log, y_log)
    if band is not None:
        label, x, low, high = band
        plot.varea("x", "low", "high", source=_small(x=x, low=low, high=high), fill_color=MUTED,
                   fill_alpha=0.35, legend_label=label)  # fmt: skip
    drawn = [
        _line(plot, x, y, label, AXES[k % len(AXES)], line_width=2, name=label)
        for k, (label, x, y) in enumerate(lines)
    ]
    _hover(plot, drawn, [("", "$name"), ("x", "@x{0.000g}"), ("y", "@y{0.000e}")])
    return _legend(plot)


def areas_figure(x: Floats, parts: Sequence[Part], x_label: str, y_label: str) -> Any:
    """Draw shares stacked on each other: an error budget."""
    plot = _plot(x_label, y_label, False, False)
    below = np.zeros_like(x)
    drawn = []
    for k, part in enumerate(parts):
        above = below + part.values
        source = _small(x=x, below=below, above=above, share=part.values)
        plot.varea("x", "below", "above", source=source, fill_alpha=0.75,
                   fill_color=COLOURS.get(part.label.split(" ")[-1], AXES[k % len(AXES)]),
                   legend_label=part.label)  # fmt: skip
        drawn.append(plot.line("x", "above", source=source, line_alpha=0.0, name=part.label))
        below = above
    _hover(plot, drawn, [("", "$name"), ("x", "@x{0.000g}"), ("share", "@share{0.000e}")])
    return _legend(plot)


__all__ = [
    *("allan_figure", "areas_figure", "bode_figure", "colour_of", "ellipse", "lines_figure"),
    *("overview_figure", "pole_zero_figure", "scatter_figure", "spectrum_figure", "step_figure"),
    "time_figure",
]
