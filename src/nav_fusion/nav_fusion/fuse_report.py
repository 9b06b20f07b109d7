"""``fuse --bag``'s report: where it went, how sure it is, and whether that is true."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from imu_noise_id.report.figures import ALARM, MODEL, MUTED, PALETTE, ellipse
from imu_noise_id.report.page import Figure, Page, Section, Snippet, Table
from imu_noise_id.report.plot import Axis, Layer, Plot
from numpy.typing import NDArray
from scipy.special import gammaln

from nav_fusion.consistency import Innovations, mean_band
from nav_fusion.fuse import FuseResult
from nav_fusion.solution import Solution

Floats = NDArray[np.float64]

AXES = ("east", "north", "up")
BODY = ("x", "y", "z")
MOST_POINTS = 2000
"""Points of a curve; a screen shows no more."""
NIS_DOF = 3
NIS_WINDOW = 50
TWO_SIGMA = 2.0
_TIME = ("time", "@x{0.0} s")


def page_of(result: FuseResult, source: str) -> Page:
    """Return the report of a fused recording."""
    status, solution = result.status, result.solution
    latitude, longitude, altitude = result.origin
    return Page(
        f"{source} fused",
        verdict(result),
        (_consistency(result), _navigation(result), _biases(solution, _seconds(result)), _use()),
        (
            ("recording", source),
            ("noise model", result.engine.noise.source),
            ("IMU samples", f"{status.imu_samples:,}".replace(",", "\u2009")),
            ("origin", f"{latitude:.7f}\u00b0, {longitude:.7f}\u00b0, {altitude:.2f} m"),
        ),
        tuple(dict.fromkeys(result.notes)),
    )


def verdict(result: FuseResult) -> str:
    """Return the answer: how sure the filter is at the end, and whether its covariance holds."""
    status, end = result.status, result.solution
    sigma = np.sqrt(end.pose_covariance[-1].diagonal())
    horizontal = math.hypot(sigma[0], sigma[1])
    said = [
        f"At the end position is known to {horizontal:.2g} m (1 sigma, horizontal) and heading to "
        f"{math.degrees(sigma[5]):.2g}\u00b0, from {status.used} fixes."
    ]
    if status.nis_mean is None or status.nis_lower is None or status.nis_upper is None:
        said.append("Too few fixes to say whether the covariance is true.")
        return " ".join([*said, *_as_sentences(status.doubts)])
    band = f"{status.nis_lower:.2f} to {status.nis_upper:.2f}"
    mean = f"the fixes' mean normalised square is {status.nis_mean:.2f}, a true one's {band}"
    if status.nis_mean > status.nis_upper:
        said.append(f"The filter is too sure of itself: {mean}.")
    elif status.nis_mean < status.nis_lower:
        said.append(f"The filter is more careful than it need be: {mean}.")
    else:
        said.append(f"Its covariance agrees with the fixes: {mean}.")
    if status.white is not None:
        said.append(
            "The innovations are white: nothing predictable is left in them."
            if status.white
            else "The innovations are not white: something in them could have been predicted."
        )
    return " ".join([*said, *_as_sentences(status.doubts)])


def _as_sentences(notes: Sequence[str]) -> list[str]:
    return [f"{note[0].upper()}{note[1:]}." for note in notes]


def _seconds(result: FuseResult) -> Floats:
    """Times of the solution since its first, (k,)."""
    stamp_ns = result.solution.stamp_ns
    return (stamp_ns - stamp_ns[0]) * 1e-9


def _thinned(count: int) -> slice:
    return slice(None, None, max(1, -(-count // MOST_POINTS)))


def _consistency(result: FuseResult) -> Section:
    """Innovations against their sigmas, and the normalised squares."""
    found, status = result.innovations, result.status
    time_s = (found.stamp_ns - result.solution.stamp_ns[0]) * 1e-9
    figures: tuple[Figure, ...] = ()
    if time_s.size:
        figures = (
            *(_innovations(found, time_s, k) for k in range(NIS_DOF)),
            _nis(found, time_s, status.gate),
            _histogram(found.nis[found.used]),
        )
    rows = (
        ("fixes used", str(status.used)),
        ("kept out by the gate", f"{status.gated} (threshold {status.gate:.1f})"),
        ("late, brought in by rewinding", str(status.late)),
        ("rejected", str(status.rejected)),
        ("mean NIS", _or_dash(status.nis_mean)),
        ("band of a true filter, 95 %", _band(status.nis_lower, status.nis_upper)),
        ("correlation of neighbouring innovations", _or_dash(status.correlation)),
        ("IMU gaps", f"{status.gaps}, {status.gap_s:.3g} s together"),
    )
    return Section(
        "Is the covariance true?",
        (
            "An innovation is a fix less what the filter expected of it. If the noise model is "
            "true, 95 % of them lie within two sigmas, their normalised squares (NIS) average "
            f"{NIS_DOF}, and each is unlike the one before.",
        ),
        figures,
        (Table("Fixes", ("", ""), rows, (1,)),),
    )


def _or_dash(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"


def _band(low: float | None, high: float | None) -> str:
    return "-" if low is None or high is None else f"{low:.2f} to {high:.2f}"


def _innovations(found: Innovations, time_s: Floats, axis: int) -> Figure:
    thin = _thinned(time_s.size)
    t, value, sigma = time_s[thin], found.innovation[thin, axis], found.sigma[thin, axis]
    used = found.used[thin]
    hover = (_TIME, ("innovation", "@y{0.000} m"))
    layers = [
        Layer(
            "band",
            {"x": t, "low": -TWO_SIGMA * sigma, "high": TWO_SIGMA * sigma},
            "two sigmas",
            MUTED,
            alpha=0.25,
        ),
        Layer("points", {"x": t[used], "y": value[used]}, "used", PALETTE[0], size=3.5,
              hover=hover),
    ]  # fmt: skip
    if not used.all():
        out = {"x": t[~used], "y": value[~used]}
        layers.append(
            Layer("points", out, "gated", ALARM, marker="x", size=7, width=1.6, hover=hover)
        )
    inside = np.mean(np.abs(found.innovation[found.used, axis]) < 2 * found.sigma[found.used, axis])
    # at the start nothing is known and two sigmas are kilometres: the rest is shown
    reach = 1.2 * max(np.quantile(np.abs(value), 0.998), 2 * TWO_SIGMA * float(np.median(sigma)))
    return Figure(
        f"Innovations, {AXES[axis]}",
        f"{100 * inside:.0f} % of the fixes used lie within two sigmas; 95 % are expected."
        if found.used.any()
        else "No fix was used.",
        Plot(Axis("time (s)"), Axis("innovation (m)", False, -reach, reach), tuple(layers)),
    )


def _nis(found: Innovations, time_s: Floats, gate: float) -> Figure:
    """Draw each fix's normalised square, their running mean and the band that it should keep."""
    used = found.used
    thin = _thinned(time_s.size)
    hover = (_TIME, ("NIS", "@y{0.00}"))
    nis = np.maximum(found.nis, 1e-3)
    layers = [
        Layer("points", {"x": time_s[thin], "y": nis[thin]}, "each fix", PALETTE[0], size=3.0,
              alpha=0.6, hover=hover),
        _level(time_s, gate, "gate", ALARM),
    ]  # fmt: skip
    if used.sum() >= 2 * NIS_WINDOW:
        low, high = mean_band(NIS_DOF, NIS_WINDOW)
        mean = np.convolve(found.nis[used], np.full(NIS_WINDOW, 1.0 / NIS_WINDOW), "valid")
        at = time_s[used][NIS_WINDOW - 1 :][_thinned(mean.size)]
        label = f"mean of {NIS_WINDOW}"
        data = {"x": at, "y": mean[_thinned(mean.size)]}
        layers.append(Layer("line", data, label, MODEL, width=2.0, hover=hover))
        ends = np.array([time_s[0], time_s[-1]])
        band = {"x": ends, "low": np.full(2, low), "high": np.full(2, high)}
        layers.insert(0, Layer("band", band, "band of that mean, 95 %", MUTED, alpha=0.3))
    return Figure(
        "Normalised innovation squares",
        "The mean keeps within its band where the covariance is true; above it the filter is too "
        "sure, below it too careful.",
        Plot(Axis("time (s)"), Axis("NIS (3 degrees of freedom)", True), tuple(layers)),
    )


def _level(time_s: Floats, value: float, label: str, colour: str) -> Layer:
    ends = {"x": np.array([time_s[0], time_s[-1]]), "y": np.full(2, value)}
    return Layer("line", ends, label, colour, "dashed")


def _histogram(nis: Floats) -> Figure:
    """Distribution of the squares beside chi-square with three degrees of freedom."""
    edges = np.linspace(0.0, 20.0, 41)
    counts, _ = np.histogram(np.minimum(nis, 19.99), edges)
    width = float(edges[1] - edges[0])
    middle = 0.5 * (edges[:-1] + edges[1:])
    share = counts / max(counts.sum(), 1) / width
    x = np.linspace(0.05, 20.0, 200)
    half = 0.5 * NIS_DOF
    density = np.exp((half - 1.0) * np.log(x / 2.0) - x / 2.0 - gammaln(half)) / 2.0
    hover = (("NIS", "@x{0.0}"), ("share", "@high{0.000}"))
    bars = {"x": middle, "low": np.zeros(middle.size), "high": share}
    layers = (
        Layer("bars", bars, "fixes used", PALETTE[0], width=0.9 * width, alpha=0.5, hover=hover),
        Layer("line", {"x": x, "y": density}, "chi-square, 3", MODEL, width=2.2),
    )
    return Figure(
        "Distribution of the squares",
        "Bars above the curve at the right: rare large errors that the model does not know.",
        Plot(Axis("NIS"), Axis("density"), layers),
    )


def _navigation(result: FuseResult) -> Section:
    """Where it went and how sure of that the filter is."""
    solution, time_s = result.solution, _seconds(result)
    thin = _thinned(time_s.size)
    sigma = np.sqrt(np.diagonal(solution.pose_covariance, axis1=1, axis2=2))[thin]
    speed = np.sqrt(np.diagonal(solution.velocity_covariance, axis1=1, axis2=2))[thin]
    heading = np.degrees(np.unwrap(solution.heading))[thin]
    t = time_s[thin]
    figures = (
        _track(solution),
        Figure(
            "Position: one sigma",
            "Falling: fixes are averaged. Rising: no fix, and the IMU alone holds the position.",
            _curves(t, sigma[:, :3], AXES, "sigma (m)", log=True),
        ),
        Figure(
            "Velocity: one sigma",
            "Of the IMU relative to the Earth.",
            _curves(t, speed, AXES, "sigma (m/s)", log=True),
        ),
        Figure(
            "Heading",
            "Of the body's x axis from east, counter-clockwise, with two sigmas. Without a "
            "magnetometer only accelerated motion tells it.",
            _with_band(t, heading, np.degrees(sigma[:, 5]), "heading (deg)"),
        ),
    )
    known = result.status.heading_known_s
    text = (
        "The heading was never told apart from its rivals."
        if known is None
        else f"The heading was settled {known:.1f} s after the start."
    )
    return Section("Where it went, and how sure it is", (text,), figures)


def _track(solution: Solution) -> Figure:
    thin = _thinned(len(solution.position))
    east, north = solution.position[thin, 0], solution.position[thin, 1]
    hover = (("east", "@x{0.00} m"), ("north", "@y{0.00} m"))
    x, y = ellipse(solution.pose_covariance[-1][:2, :2])
    end = solution.position[-1]
    layers = (
        Layer("line", {"x": east, "y": north}, "filter", PALETTE[0], width=1.8, hover=hover),
        Layer("points", {"x": east[:1], "y": north[:1]}, "start", MODEL, size=9),
        Layer("line", {"x": end[0] + x, "y": end[1] + y}, "95 % at the end", MODEL, width=2.2),
    )
    return Figure(
        "Track",
        "East and north of the origin, both to the same scale.",
        Plot(Axis("east (m)"), Axis("north (m)"), layers, equal=True),
    )


def _curves(t: Floats, columns: Floats, names: Sequence[str], label: str, *, log: bool) -> Plot:
    layers = tuple(
        Layer(
            "line",
            {"x": t, "y": columns[:, k]},
            name,
            PALETTE[k],
            width=1.8,
            hover=(("axis", name), _TIME, ("value", "@y{0.000e}")),
        )
        for k, name in enumerate(names)
    )
    return Plot(Axis("time (s)"), Axis(label, log), layers, columns=3)


def _with_band(t: Floats, value: Floats, sigma: Floats, label: str) -> Plot:
    band = {"x": t, "low": value - TWO_SIGMA * sigma, "high": value + TWO_SIGMA * sigma}
    hover = (_TIME, ("value", "@y{0.000}"))
    return Plot(
        Axis("time (s)"),
        Axis(label),
        (
            Layer("band", band, "two sigmas", MUTED, alpha=0.3),
            Layer("line", {"x": t, "y": value}, "estimate", PALETTE[0], width=1.8, hover=hover),
        ),
    )


def _biases(solution: Solution, time_s: Floats) -> Section:
    """Biases that the filter learned, in body axes."""
    thin = _thinned(time_s.size)
    figures = []
    for title, unit, value, sigma in (
        ("Gyroscope", "rad/s", solution.gyro_bias, solution.gyro_bias_sigma),
        ("Accelerometer", "m/s\u00b2", solution.accel_bias, solution.accel_bias_sigma),
    ):
        layers = []
        for k, axis in enumerate(BODY):
            t, v, s = time_s[thin], value[thin, k], sigma[thin, k]
            hover = (("axis", axis), _TIME, ("bias", "@y{0.000e}"))
            band = {"x": t, "low": v - TWO_SIGMA * s, "high": v + TWO_SIGMA * s}
            layers.append(Layer("band", band, axis, PALETTE[k], alpha=0.12))
            layers.append(Layer("line", {"x": t, "y": v}, axis, PALETTE[k], width=1.8, hover=hover))
        figures.append(
            Figure(
                f"{title} bias",
                "With two sigmas; a bias that nothing tells keeps the width that it began with.",
                Plot(Axis("time (s)"), Axis(f"bias ({unit})"), tuple(layers), columns=3),
            )
        )
    return Section("Biases", (), tuple(figures))


def _use() -> Section:
    text = (
        "ros2 run nav_fusion play --bag filtered        # /odometry/filtered and /gps/filtered\n"
        "ros2 run nav_fusion fuse --ros-args -p model_file:=model.yaml     # the same, live\n"
    )
    return Section(
        "How to use this",
        (
            "filtered/ is a rosbag2 folder with the odometry and the antenna's position, both with "
            "covariance, stamped with the state's time; Foxglove and PlotJuggler open it.",
        ),
        snippets=(Snippet("Commands", text),),
    )
