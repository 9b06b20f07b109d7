"""Canonical correlation analysis in the report: words, validation, step response, Bode, poles."""

from __future__ import annotations

import numpy as np

from imu_noise_id.cca import WHAT_AN_INPUT_CAN_FIND, Cca
from imu_noise_id.identify import ChannelResult
from imu_noise_id.recording import Floats
from imu_noise_id.report import figures
from imu_noise_id.report.curves import Part
from imu_noise_id.report.page import Figure, Table
from imu_noise_id.report.plot import Axis, Layer, Plot
from imu_noise_id.series import Series
from imu_noise_id.terminal import number
from imu_noise_id.transfer_function import drive, frequency_response, step_response

SHOWN_SAMPLES = 400
CURVE_POINTS = 200


def cca_allan(result: ChannelResult) -> Part | None:
    """Allan deviation of the canonical-correlation model, to lay over the measured one."""
    if result.cca is None or result.cca_deviation is None:
        return None
    return Part(f"CCA, order {result.cca.order}", result.cca_deviation)


def transfer_paragraphs(result: ChannelResult) -> list[str]:
    """Say what past and future have to do with each other, and whether Allan says the same."""
    cca = result.cca
    if cca is None:
        return []
    largest = float(cca.canonical_correlations[0]) if cca.canonical_correlations.size else 0.0
    level = f"{largest:.3f} against a chance level of {cca.chance_level:.3f}"
    states = f"{cca.order} state{'s' if cca.order > 1 else ''}"
    if cca.order == 0:
        text = f"Canonical correlation finds no dynamics: past and future correlate by {level}."
    elif cca.significant:
        text = f"Canonical correlation of past and future ({level}) finds a model of {states}."
    else:
        text = (
            f"Past and future correlate by {level}, but the likelihood shows a model of {states} "
            "beyond chance."
        )
    apart = result.cca_distance
    if apart is not None:
        text += f" Its Allan curve is {100.0 * apart:.2g} % from the measured one."
    return [text]


def transfer_note() -> str:
    """Say what an independent input can and cannot find."""
    return WHAT_AN_INPUT_CAN_FIND


def transfer_figures(result: ChannelResult) -> list[Figure]:
    """Return the pictures of the shaping filter; none where there are no dynamics."""
    cca = result.cca
    if cca is None or cca.order == 0 or not cca.H_z.stable:
        return []
    drawn = [_validation(result.series, cca, result.channel.unit), _bode(cca)]
    step = _step(cca, result.channel.unit)
    if step is not None:
        drawn.append(step)
    drawn.append(
        Figure(
            "Poles and zeros",
            f"Of H(z); {'minimum phase' if cca.minimum_phase else 'not minimum phase'}. A pole "
            "near 1 is slow; a zero beside it is the white noise over it.",
            figures.pole_zero_figure(cca.H_z.poles, cca.H_z.zeros),
        )
    )
    return drawn


def _validation(series: Series, cca: Cca, unit: str) -> Figure:
    """The model driven by white noise over the longest whole stretch of the record's beginning."""
    n = min(SHOWN_SAMPLES, series.values.size)
    rng = np.random.default_rng(0)
    warm = 20 * n
    output = drive(cca.H_z, rng.standard_normal(warm + n))[warm:]
    shown = series.observed[:n]
    time_s = series.time_s[:n]
    measured = series.values[:n] - series.mean
    plot = Plot(
        Axis("time since the first sample (s)"),
        Axis(f"value \u2212 mean ({unit})"),
        (
            Layer("line", {"x": time_s[shown], "y": measured[shown]}, "record", width=1.4),
            Layer("line", {"x": time_s, "y": output}, "model", figures.MODEL, width=1.4),
        ),
    )
    return Figure(
        "Model driven by white noise",
        "The first samples of the record and as many of the model's. The driving noise of the "
        "sensor is not known, so they agree in size and texture, not sample by sample.",
        plot,
    )


def _grid(cca: Cca) -> Floats:
    """Frequencies from well below the slowest pole to half the rate, dense at resonances."""
    dt = cca.H_z.sample_time_s
    nyquist_hz = 0.5 / dt
    decay = np.maximum(np.abs(np.log(np.abs(cca.H_z.poles))), 1e-9)
    corner_hz = max(float(np.min(decay)) / dt / (2.0 * np.pi), 1e-6 * nyquist_hz)
    low_hz = min(corner_hz / 30.0, nyquist_hz / 100.0)
    parts = [np.geomspace(low_hz, 0.999 * nyquist_hz, CURVE_POINTS)]
    for pole, rate in zip(cca.H_z.poles, decay, strict=True):
        centre_hz, width_hz = abs(np.angle(pole)) / dt / (2.0 * np.pi), rate / dt / (2.0 * np.pi)
        parts.append(centre_hz + width_hz * np.sinh(np.linspace(-8.0, 8.0, 81)))
    grid = np.unique(np.concatenate(parts))
    return grid[(grid >= low_hz) & (grid < nyquist_hz)]


def _bode(cca: Cca) -> Figure:
    frequency_hz = _grid(cca)
    response = frequency_response(cca.H_z, frequency_hz)
    gain_db = 20.0 * np.log10(np.abs(response))
    phase_deg = np.degrees(np.unwrap(np.angle(response)))
    return Figure(
        "Bode diagram",
        "From white noise of unit variance per sample to the channel.",
        figures.bode_figure(frequency_hz, gain_db, phase_deg),
    )


def _step(cca: Cca, unit: str) -> Figure | None:
    settling_s = cca.settling_time_s
    if cca.H_s is None or not cca.H_s.stable or settling_s is None:
        return None
    time_s = np.linspace(0.0, 1.5 * settling_s or 10.0 * cca.H_z.sample_time_s, CURVE_POINTS)
    return Figure(
        "Step response",
        f"Of H(s); it settles within 2 % in {settling_s:.3g} s.",
        figures.step_figure(time_s, step_response(cca.H_s, time_s), unit),
    )


def transfer_table(result: ChannelResult) -> list[Table]:
    """Return the numbers of the shaping filter."""
    cca = result.cca
    if cca is None or cca.order == 0:
        return []
    rows = [
        ("H(z) numerator", _coefficients(cca.H_z.numerator), "powers of 1/z"),
        ("H(z) denominator", _coefficients(cca.H_z.denominator), "powers of 1/z"),
    ]
    if cca.H_s is not None:
        rows.append(("H(s) numerator", _coefficients(cca.H_s.numerator), "powers of s"))
        rows.append(("H(s) denominator", _coefficients(cca.H_s.denominator), "powers of s"))
    rows += [
        ("settling time", number(cca.settling_time_s), "s, to 2 %"),
        ("rise time", number(cca.rise_time_s), "s, 10 to 90 %"),
        ("bandwidth from the rise time", number(cca.bandwidth_rise_hz), "Hz, 0.35/rise time"),
        ("bandwidth", number(cca.bandwidth_3db_hz), "Hz, \u22123 dB"),
        ("innovation variance", number(cca.innovation_variance), f"({result.channel.unit})\u00b2"),
    ]
    return [Table("Transfer function", ("what", "value", "unit"), tuple(rows), (1,))]


def _coefficients(values: Floats) -> str:
    return "  ".join(number(float(v), abs(float(v)) / 1e4) for v in values)
