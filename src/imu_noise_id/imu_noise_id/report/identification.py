"""``identify``'s report: what noise each channel has, how sure that is, and how to use it."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from imu_noise_id.curves import model_allan_variance, model_psd
from imu_noise_id.customary import customary
from imu_noise_id.errors import InputError
from imu_noise_id.export import FORMATS
from imu_noise_id.identify import ChannelResult, Identification
from imu_noise_id.model import ChannelModel
from imu_noise_id.recording import Floats, Recording
from imu_noise_id.report import figures
from imu_noise_id.report.curves import Part, allan_parts, envelope, psd_parts
from imu_noise_id.report.page import Figure, Page, Section, Snippet, Table, render
from imu_noise_id.report.plot import Axis
from imu_noise_id.report.receiver import receiver_section
from imu_noise_id.report.together import together_parts, together_section
from imu_noise_id.report.transfer import (
    cca_allan,
    transfer_figures,
    transfer_note,
    transfer_paragraphs,
    transfer_table,
)
from imu_noise_id.spectrum import spectrum
from imu_noise_id.terminal import half_width, interval, number
from imu_noise_id.wording import QUANTITIES, channel_label, powers

SENSORS = {
    "angular_velocity": "Gyroscope",
    "linear_acceleration": "Accelerometer",
    "magnetic_field": "Magnetometer",
    "heading": "Magnetic heading",
    "position": "GNSS position",
    "velocity": "GNSS velocity",
}
WORKERS = 2
TEMPERATURE_POINTS = 4096
SPECTRUM_BINS = 100
"""Bins per decade: narrow enough for a line to stand out of the noise beside it."""


def identification_page(identification: Identification) -> str:
    """Return the report of an identification as one HTML document."""
    recording = identification.recording
    sections = [_overview(identification)]
    joint = together_parts(identification.sensors)

    def section(result: ChannelResult) -> Section:
        part = joint.get((result.channel.topic, result.channel.name))
        return channel_section(result, recording, part)

    with ThreadPoolExecutor(WORKERS) as pool:
        sections += pool.map(section, identification.channels)
    sections += [together_section(s, identification.channels) for s in identification.sensors]
    receiver = receiver_section(recording)
    if receiver is not None:
        sections.append(receiver)
    sections.append(_usage(identification))
    page = Page(
        f"Noise of {recording.source}",
        verdict(identification),
        tuple(sections),
        _facts(identification),
        (*recording.notes, *identification.notes, *_channel_notes(identification.channels)),
    )
    return render(page)


def verdict(identification: Identification) -> str:
    """Return the answer in a few sentences: what was seen, how loud, how well it fits."""
    results = identification.channels
    if not results:
        return "Nothing could be identified: no channel stood still long enough."
    sentences = [_span_sentence(results)]
    for quantity, word in QUANTITIES.items():
        models = [r.model for r in results if r.model.name.split(".")[0] == quantity]
        if models:
            sentences.append(_sensor_sentence(word, models))
    shares = [share for r in results if (share := inside(r, identification.recording)) is not None]
    if shares:
        sentences.append(
            f"The models' Allan curves lie inside the measured 95 % intervals at "
            f"{100.0 * float(np.mean(shares)):.0f} % of the averaging times."
        )
    return " ".join(sentences)


def _span_sentence(results: Sequence[ChannelResult]) -> str:
    longest = max(r.channel.duration_s for r in results)
    moved = any(r.channel.quality.moving_s or not r.channel.quality.static for r in results)
    stood = "parts in which the platform moved were left out" if moved else "standing still"
    count = f"{len(results)} channel{'s' if len(results) > 1 else ''}"
    return f"{count} identified from {duration(longest)}, {stood}."


def _sensor_sentence(word: str, models: Sequence[ChannelModel]) -> str:
    densities = [e.effect.values()[0] for m in models if (e := m.find("white_noise")) is not None]
    if not densities:
        return f"The {word} shows no white noise."
    low, high = min(map(float, densities)), max(map(float, densities))
    span = powers(low) if high < 1.1 * low else f"{powers(low)} to {powers(high)}"
    text = f"The {word}\u2019s white noise is {span}\u00a0{models[0].unit}/\u221aHz"
    others = sorted({f.name for m in models for f in m.effects} - {"white_noise"})
    if others:
        text += "; beside it " + ", ".join(name.replace("_", " ") for name in others)
    return text + "."


def duration(seconds: float) -> str:
    """``449 s``, ``12.3 min``, ``5.1 h``."""
    if seconds < 600.0:
        return f"{seconds:.3g} s"
    if seconds < 7200.0:
        return f"{seconds / 60.0:.3g} min"
    return f"{seconds / 3600.0:.3g} h"


def inside(result: ChannelResult, recording: Recording) -> float | None:
    """Share of averaging times at which the model's Allan deviation is inside the interval."""
    curve = result.allan
    if curve is None or curve.tau_s.size == 0 or not result.model.effects:
        return None
    model = np.sqrt(_predicted(result, recording))
    return float(np.mean((model >= curve.lower) & (model <= curve.upper)))


def _predicted(result: ChannelResult, recording: Recording) -> Floats:
    """Allan variance that the model predicts at the measured averaging times."""
    assert result.allan is not None
    return model_allan_variance(
        result.model,
        result.allan.tau_s,
        result.series.sample_time_s,
        _warmth(result, recording),
        result.series.span_s,
    )


def _warmth(result: ChannelResult, recording: Recording) -> Floats | None:
    """Temperature at uniform times over the channel, where its model depends on it."""
    course = recording.temperature
    if result.model.find("temperature") is None or course is None:
        return None
    time_s = np.linspace(*result.series.span_s, TEMPERATURE_POINTS)
    return np.interp(time_s, (course.stamp_ns - recording.start_ns) * 1e-9, course.values)


def _facts(identification: Identification) -> tuple[tuple[str, str], ...]:
    recording = identification.recording
    topics = sorted({(r.channel.topic, r.channel.rate_hz) for r in identification.channels})
    facts = [("recording", recording.source)]
    facts += [(topic, f"{rate_hz:.5g} Hz") for topic, rate_hz in topics]
    if identification.channels:
        samples = sum(int(r.series.observed.sum()) for r in identification.channels)
        facts.append(("samples used", f"{samples:,}".replace(",", "\u2009")))
    return tuple(facts)


def _channel_notes(results: Sequence[ChannelResult]) -> tuple[str, ...]:
    """Notes of the channels, each once with the channels that it concerns."""
    said: dict[str, list[str]] = {}
    for result in results:
        for note in (*result.channel.quality.notes, *result.notes):
            said.setdefault(note, []).append(result.channel.name)
    return tuple(f"{', '.join(names)}: {note}" for note, names in said.items())


def _overview(identification: Identification) -> Section:
    drawn = []
    for quantity, title in SENSORS.items():
        curves = [
            (r.channel.name.partition(".")[2] or r.channel.name, r.allan)
            for r in identification.channels
            if r.channel.name.split(".")[0] == quantity and r.allan is not None
            and r.allan.tau_s.size
        ]  # fmt: skip
        if curves:
            unit = next(
                r.channel.unit
                for r in identification.channels
                if r.channel.name.split(".")[0] == quantity
            )
            drawn.append(
                Figure(
                    f"{title}: Allan deviation",
                    "Falling with slope \u22121/2: white noise. Flat: bias instability. Rising: "
                    "walk or drift. The band is the 95 % interval.",
                    figures.overview_figure(curves, unit),
                )
            )
    drawn += _temperature(identification.recording)
    rows = [row for r in identification.channels for row in parameter_rows(r.model, named=True)]
    return Section(
        "Overview",
        (
            "Every effect that the recording shows, with its 95 % interval. \u201cBelow\u201d "
            "means that the term was not seen, and how large it can be at most.",
            *([transfer_note()] if any(r.cca for r in identification.channels) else []),
        ),
        tuple(drawn),
        (Table("All parameters", PARAMETER_HEADINGS, tuple(rows), (3, 4)),),
    )


def _temperature(recording: Recording) -> list[Figure]:
    channel = recording.temperature
    if channel is None or channel.values.size < 2:
        return []
    step = max(1, channel.values.size // 500)
    time_s = (channel.stamp_ns[::step] - recording.start_ns).astype(np.float64) * 1e-9
    plot = figures.lines_figure(
        [("temperature", time_s, channel.values[::step])],
        Axis("time (s)"),
        Axis("temperature (\u00b0C)"),
    )
    return [Figure("Temperature", f"Topic {channel.topic}.", plot)]


PARAMETER_HEADINGS = (
    *("channel", "effect", "parameter", "value", "95 % interval", "unit", "as data sheets say"),
)


def parameter_rows(model: ChannelModel, named: bool) -> list[tuple[str, ...]]:
    """Rows of the parameter table; the channel only in its first row, or not at all."""
    rows: list[tuple[str, ...]] = []
    channel, effect = (model.name if named else ""), ""
    for fitted in model.effects:
        effect = fitted.name
        for parameter, estimate in zip(fitted.effect.parameters, fitted.estimates, strict=True):
            usual = ""
            if isinstance(estimate.value, float):
                found = customary(model.name, fitted.name, parameter.name, estimate.value)
                usual = "" if found is None else f"{number(found[0])} {found[1]}"
            value = number(estimate.value, half_width(estimate))
            rows.append(
                (channel, effect, parameter.name, value, interval(estimate), estimate.unit, usual)
            )
            channel = effect = ""
        if fitted.note:
            rows.append((channel, "", "", "", "", "", fitted.note))
    for bound in model.bounds:
        value = f"below {number(bound.upper, bound.upper / 10)}"
        rows.append(
            (channel, bound.name, bound.parameter, value, "not seen", bound.unit, bound.note)
        )
        channel = ""
    return rows or [(channel, "none found", "", "", "", "", "")]


def channel_section(
    result: ChannelResult, recording: Recording, joint: Part | None = None
) -> Section:
    """Everything about one channel; ``joint`` is the Allan curve of all axes' model."""
    effects = tuple(fitted.effect for fitted in result.model.effects)
    names = [fitted.name.replace("_", " ") for fitted in result.model.effects]
    paragraphs = [_channel_sentence(result, recording, names)]
    paragraphs += transfer_paragraphs(result)
    drawn = [f for f in (_allan(result, recording, joint), _spectrum(result)) if f is not None]
    drawn.append(_course(result))
    drawn += transfer_figures(result)
    rows = tuple(row[1:] for row in parameter_rows(result.model, named=False))
    tables = [Table("Effects", PARAMETER_HEADINGS[1:], rows, (2, 3)), *transfer_table(result)]
    mark = f"{len(effects)} effect{'' if len(effects) == 1 else 's'}"
    return Section(_heading(result), tuple(paragraphs), tuple(drawn), tuple(tables), (), mark)


def _heading(result: ChannelResult) -> str:
    label = channel_label(result.channel.name)
    return label[:1].upper() + label[1:]


def _channel_sentence(result: ChannelResult, recording: Recording, names: Sequence[str]) -> str:
    channel = result.channel
    found = ", ".join(names) if names else "no noise that can be named"
    text = (
        f"{channel.name} of {channel.topic}: {found}. Mean {number(result.series.mean)} "
        f"{channel.unit}, {duration(channel.duration_s)} at {channel.rate_hz:.5g} Hz."
    )
    share = inside(result, recording)
    if share is not None:
        text += f" The model is inside the Allan intervals at {100 * share:.0f} % of the times."
    return text


def _allan(result: ChannelResult, recording: Recording, joint: Part | None) -> Figure | None:
    curve = result.allan
    if curve is None or curve.tau_s.size == 0 or not np.all(curve.lower > 0.0):
        return None
    dt = result.series.sample_time_s
    has_effects = bool(result.model.effects)
    models = [Part("model", np.sqrt(_predicted(result, recording)))] if has_effects else []
    warmth = _warmth(result, recording)
    parts = allan_parts(result.model, curve.tau_s, dt, warmth, result.series.span_s)
    models += [part for part in (cca_allan(result), joint) if part is not None]
    plot = figures.allan_figure(curve, result.channel.unit, parts, models)
    caption = "Measured, with each effect's own share (dashed) and all of them together."
    return Figure("Allan deviation", f"{caption} {curve.note}".strip(), plot)


def _spectrum(result: ChannelResult) -> Figure | None:
    measured = spectrum(result.series, SPECTRUM_BINS)
    if measured.psd.size == 0 or not np.all(measured.psd > 0.0):
        return None
    effects = tuple(fitted.effect for fitted in result.model.effects)
    dt = result.series.sample_time_s
    f = measured.frequency_hz
    models = [Part("model", model_psd(result.model, f, dt))] if effects else []
    tones = [float(e.values()[0]) for e in effects if e.name in ("periodic", "narrow_band")]
    plot = figures.spectrum_figure(
        measured, result.channel.unit, psd_parts(result.model, f, dt), models, tones
    )
    shown = ", ".join(f"{tone:.4g} Hz" for tone in tones)
    said = f" Dotted: lines and vibrations at {shown}." if tones else ""
    return Figure("Spectrum", f"Root of the two-sided spectrum and the model over it.{said}", plot)


def _course(result: ChannelResult) -> Figure:
    quality = result.channel.quality
    spans = quality.moving_s
    plot = figures.time_figure(
        envelope(result.series), result.series.mean, result.channel.unit, spans
    )
    left_out = []
    if spans:
        shown = ", ".join(f"{begin:.4g} to {end:.4g} s" for begin, end in spans[:6])
        more = f" and {len(spans) - 6} more" if len(spans) > 6 else ""
        left_out.append(f"{shown}{more}: the platform moved (shaded)")
    counts = {
        "missing in gaps": quality.missing,
        "with a repeated stamp": quality.duplicates,
        "out of order": quality.out_of_order,
        "not finite": quality.non_finite,
    }
    left_out += [f"{count} samples {what}" for what, count in counts.items() if count]
    said = "; ".join(left_out) if left_out else "nothing"
    return Figure("Time course", f"Left out: {said}.", plot)


def _usage(identification: Identification) -> Section:
    rates = [r.channel.rate_hz for r in identification.channels]
    rate_hz = max(rates) if rates else 100.0
    suffix = {"gazebo": "sdf"}
    snippets = []
    for name, export in FORMATS.items():
        try:
            text = export(identification.model, rate_hz).text
        except InputError as error:
            text = f"not possible with this recording: {error}\n"
        command = (
            f"ros2 run imu_noise_id export --model model.yaml --format {name} "
            f"--rate {rate_hz:.5g} --output {name}.{suffix.get(name, 'yaml')}"
        )
        snippets.append(Snippet(USES[name], f"{command}\n\n{text}"))
    return Section(
        "How to use these numbers",
        (
            "A density is continuous: per \u221aHz, whatever the rate. A tool that wants the sigma "
            "of one sample wants density \u00d7 \u221arate. A data sheet\u2019s density is usually "
            "one-sided and \u221a2 larger than the two-sided one here.",
            "The model goes straight into the filter (ros2 run nav_fusion fuse --model model.yaml) "
            "and into a simulation (ros2 run imu_noise_id simulate --model model.yaml).",
        ),
        snippets=tuple(snippets),
    )


USES = {
    "kalibr": "Kalibr: continuous densities, one per sensor",
    "robot_localization": "robot_localization: variances of messages, noise per second",
    "gtsam": "GTSAM: continuous covariances per axis",
    "gazebo": "Gazebo: sigma per sample at the sensor's rate",
}
