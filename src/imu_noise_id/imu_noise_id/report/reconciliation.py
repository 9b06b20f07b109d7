"""``reconcile``'s report: the gap, what was missing, and the gap after it was added."""

from __future__ import annotations

import numpy as np
from scipy import special

from imu_noise_id.allan import allan
from imu_noise_id.curves import model_allan_variance, model_psd
from imu_noise_id.effects.base import CourseEffect
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.reconcile import ChannelReconciliation, Reconciliation
from imu_noise_id.recording import Floats, Recording
from imu_noise_id.report import figures
from imu_noise_id.report.curves import envelope
from imu_noise_id.report.page import Figure, Page, Section, Table, render
from imu_noise_id.report.plot import Axis, Plot
from imu_noise_id.series import Series, to_series
from imu_noise_id.spectrum import spectrum
from imu_noise_id.terminal import half_width, interval, number
from imu_noise_id.wording import channel_label, gap_text

BINS = 61


def reconciliation_page(recording: Recording, model: NoiseModel, result: Reconciliation) -> str:
    """Return the report of a reconciliation as one HTML document."""
    sections = [_overview(result)]
    sections += [
        _channel(recording, model, result, channel)
        for channel in result.channels
        if channel.verdict != "agrees"
    ]
    page = Page(
        f"{recording.source} against {model.source}",
        verdict(result),
        tuple(sections),
        (
            ("recording", recording.source),
            ("model", model.source),
            ("false alarms", f"{100.0 * result.false_alarm_rate:.2g} % of recordings"),
        ),
        (*recording.notes, *result.notes, *_notes(result)),
    )
    return render(page)


def verdict(result: Reconciliation) -> str:
    """Return the answer in a few sentences."""
    if not result.channels:
        return "Nothing was compared: recording and model have no channel in common."
    changed = [c for c in result.channels if c.verdict != "agrees"]
    if not changed:
        return f"The model agrees with the recording on all {len(result.channels)} channels."
    agree = len(result.channels) - len(changed)
    sentences = [
        f"The model agrees with the recording on {agree} of {len(result.channels)} channels."
    ]
    sentences += [channel_sentence(channel) for channel in changed[:6]]
    if len(changed) > 6:
        sentences.append(f"{len(changed) - 6} more are below.")
    return " ".join(sentences)


def channel_sentence(channel: ChannelReconciliation) -> str:
    """Return the evidence of each step, and what remains."""
    said = [f"{step.evidence}." for step in channel.steps]
    label = channel_label(channel.name)
    if channel.verdict == "unexplained" and np.isfinite(channel.after.score):
        places = [f"{w.domain} {w.from_:.3g} to {w.to:.3g} {w.unit}" for w in channel.after.where]
        where = f" in {', '.join(list(dict.fromkeys(places))[:3])}" if places else ""
        said.append(f"{label}: something remains{where} that no effect of the catalogue explains.")
    said += [f"{label}: {note}{'' if note.endswith('?') else '.'}" for note in channel.notes]
    return " ".join(sentence[:1].upper() + sentence[1:] for sentence in said)


def _notes(result: Reconciliation) -> tuple[str, ...]:
    agreeing = [c for c in result.channels if c.verdict == "agrees"]  # the others' are said above
    return tuple(f"{c.name}: {note}" for c in agreeing for note in c.notes)


def _chance(p_value: float) -> str:
    return f"{p_value:.2g}" if np.isfinite(p_value) else "-"


def _overview(result: Reconciliation) -> Section:
    rows = []
    for channel in result.channels:
        steps = "; ".join(f"{step.action} {step.effect.name}" for step in channel.steps)
        rows.append(
            (
                *(channel.name, channel.verdict),
                *(gap_text(channel.before.score), _chance(channel.before.p_value)),
                *(gap_text(channel.after.score), _chance(channel.after.p_value)),
                steps,
            )
        )
    headings = ("channel", "verdict", "gap before", "p", "gap after", "p", "what was changed")
    return Section(
        "Overview",
        (
            "The gap is 1 where recording and model differ as much as two simulations of the "
            "model do; it is measured on the part of the recording that no fit has seen.",
        ),
        (),
        (Table("", headings, tuple(rows), (2, 3, 4, 5)),),
    )


def _channel(
    recording: Recording, model: NoiseModel, result: Reconciliation, channel: ChannelReconciliation
) -> Section:
    before, after = model.channel(channel.name), result.model.channel(channel.name)
    series = to_series(recording.channel(channel.name), recording.start_ns)
    domains = [place.domain for place in channel.before.where] or ["allan"]
    drawn = []
    for domain in dict.fromkeys(_DRAWN.get(domain, "allan") for domain in domains):
        drawn += [
            Figure(f"{_TITLES[domain]}, {when}", _CAPTIONS[domain], plot)
            for when, side in (("before", before), ("after", after))
            if (plot := _plot(domain, series, side)) is not None
        ]
    label = channel_label(channel.name)
    return Section(
        f"{label[:1].upper()}{label[1:]}",
        (channel_sentence(channel),),
        tuple(drawn),
        (_steps(channel), _places(channel)),
        (),
        channel.verdict,
    )


_DRAWN = {"spectrum": "spectrum", "allan": "allan", "time": "time", "amplitude": "amplitude",
          "regressor": "time"}  # fmt: skip
_TITLES = {
    "spectrum": "Spectrum",
    "allan": "Allan deviation",
    "time": "Course in time",
    "amplitude": "Distribution of samples",
}
_CAPTIONS = {
    "spectrum": "The measured root spectrum and the band in which 95 % of the model's own lie.",
    "allan": "The measured deviation and the band in which 95 % of the model's own lie.",
    "time": "Mean of each stretch of time, and the course that the model knows.",
    "amplitude": "Share of samples by size, and the Gaussian that the model's spectrum implies.",
}


def _plot(domain: str, series: Series, model: ChannelModel) -> Plot | None:
    return {"spectrum": _spectrum, "allan": _allan, "time": _time, "amplitude": _amplitude}[domain](
        series, model
    )


def _band(freedom: Floats) -> tuple[Floats, Floats]:
    """Factors within which 95 % of estimates of a variance lie."""
    return special.chdtri(freedom, 0.975) / freedom, special.chdtri(freedom, 0.025) / freedom


def _allan(series: Series, model: ChannelModel) -> Plot | None:
    curve = allan(series)
    if curve is None or curve.tau_s.size == 0:
        return None
    variance = model_allan_variance(model, curve.tau_s, series.sample_time_s)
    low, high = _band(curve.degrees_of_freedom)
    return figures.lines_figure(
        [("measured", curve.tau_s, curve.deviation)],
        Axis("averaging time (s)", True),
        Axis(f"Allan deviation ({model.unit})", True, *_room(curve.deviation)),
        ("model's 95 % band", curve.tau_s, np.sqrt(variance * low), np.sqrt(variance * high)),
    )


def _room(values: Floats) -> tuple[float, float]:
    return float(np.min(values)) / 2.0, float(np.max(values)) * 2.0


def _spectrum(series: Series, model: ChannelModel) -> Plot | None:
    measured = spectrum(series, bins_per_decade=60)
    if measured.psd.size == 0:
        return None
    f = measured.frequency_hz
    psd = model_psd(model, f, series.sample_time_s)
    tones = [float(e.effect.values()[0]) for e in model.effects if e.name == "periodic"]
    low, high = _band(measured.degrees_of_freedom)
    plot = figures.lines_figure(
        [("measured", f, np.sqrt(measured.psd))],
        Axis("frequency (Hz)", True),
        Axis(f"density ({model.unit}/\u221aHz, two-sided)", True, *_room(np.sqrt(measured.psd))),
        ("model's 95 % band", f, np.sqrt(psd * low), np.sqrt(psd * high)),
    )
    return figures.with_guides(plot, tones, "model's lines")


def _time(series: Series, model: ChannelModel) -> Plot:
    course = envelope(series)
    seen = np.isfinite(course.mean)
    time_s = course.time_s[seen]
    known = np.zeros_like(time_s)
    for fitted in model.effects:
        if isinstance(fitted.effect, CourseEffect):
            known += fitted.effect.course(time_s, None)
    known += float(np.mean(course.mean[seen] - known))
    return figures.lines_figure(
        [("measured", time_s, course.mean[seen]), ("model's course", time_s, known)],
        Axis("time since the first sample (s)"),
        Axis(f"mean of each stretch ({model.unit})"),
    )


def _amplitude(series: Series, model: ChannelModel) -> Plot:
    values = series.values[series.observed] - series.mean
    sigma = float(np.sqrt(np.median(values**2)) / 0.6745) or float(np.std(values))
    edges = np.linspace(-6.0, 6.0, BINS) * sigma
    counts, _ = np.histogram(np.clip(values, edges[0], edges[-1]), edges)
    middle = 0.5 * (edges[1:] + edges[:-1])
    frequency_hz = np.linspace(1.0, 4096.0, 4096) / (8192.0 * series.sample_time_s)
    psd = model_psd(model, frequency_hz, series.sample_time_s)
    expected_sigma = float(np.sqrt(np.mean(psd) / series.sample_time_s))
    width = edges[1] - edges[0]
    expected = np.exp(-0.5 * (middle / expected_sigma) ** 2) * width / expected_sigma
    expected /= np.sqrt(2.0 * np.pi)
    share = counts / max(values.size, 1)
    shown = share > 0.0
    return figures.lines_figure(
        [("measured", middle[shown], share[shown]), ("model, Gaussian", middle, expected)],
        Axis(f"sample \u2212 mean ({model.unit})"),
        Axis("share of samples", True, 0.3 / max(values.size, 1), 1.0),
    )


def _steps(channel: ChannelReconciliation) -> Table:
    rows = []
    for step in channel.steps:
        action, effect = step.action, step.effect.name
        gaps = (gap_text(step.held_out.gap_before), gap_text(step.held_out.gap_after))
        for parameter, e in zip(step.effect.effect.parameters, step.effect.estimates, strict=True):
            value = number(e.value, half_width(e))
            rows.append((action, effect, parameter.name, value, interval(e), e.unit, *gaps))
            action, effect, gaps = "", "", ("", "")
    headings = (
        *("action", "effect", "parameter", "value", "95 % interval", "unit"),
        *("unseen gap before", "after"),
    )
    return Table("Steps", headings, tuple(rows), (3, 4, 6, 7))


def _places(channel: ChannelReconciliation) -> Table:
    rows = [
        (when, place.domain, f"{place.from_:.4g}", f"{place.to:.4g}", place.unit, f"{place.z:.1f}")
        for when, gap in (("before", channel.before), ("after", channel.after))
        for place in gap.where
    ]
    headings = ("when", "domain", "from", "to", "unit", "standard deviations")
    return Table("Where they differ", headings, tuple(rows), (2, 3, 5))
