"""The report of a reconciliation shows the gap where it was, before and after."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import (
    ChannelReconciliation,
    Gap,
    HeldOut,
    Reconciliation,
    Step,
    Where,
)
from imu_noise_id.recording import Channel, Recording, unit_of
from imu_noise_id.report.reconciliation import channel_sentence, reconciliation_page, verdict

from helpers.browser import visit

NAMES = ("linear_acceleration.x", "linear_acceleration.y", "linear_acceleration.z")
DOMAINS = (("spectrum", "Hz"), ("allan", "s"), ("time", "s"), ("amplitude", "m/s^2"))
START_NS = 10**18


@cache
def case() -> tuple[Recording, NoiseModel, Reconciliation]:
    """A line in x that was found, something in y that was not named, and z as it should be."""
    rng = np.random.default_rng(7)
    n = 8000
    stamp_ns = START_NS + np.arange(n, dtype=np.int64) * 10_000_000
    channels, models = [], []
    for name in NAMES:
        values = rng.normal(0.0, 0.01, n)
        if name.endswith("x"):
            values = values + 0.02 * np.sin(2.0 * np.pi * 21.5e-2 * np.arange(n))
        still = np.ones(n, dtype=bool)
        channels.append(Channel("/imu/<b>", name, unit_of(name), stamp_ns, values, still, 100.0))
        white = typed_effect("white_noise", name, {"density": 1e-3})
        models.append(ChannelModel(name, "/imu/<b>", unit_of(name), 100.0, 0.0, (white,)))
    line = typed_effect("periodic", NAMES[0], {"frequency_hz": 21.5, "amplitude": 0.02})
    step = Step("add", line, 9.0, 1.0, 1e-9, HeldOut(14.2, 1.1), "accelerometer x: a line <b>")
    mended = ChannelModel(NAMES[0], "/imu/<b>", "m/s^2", 100.0, 0.0, (*models[0].effects, line))
    places = tuple(Where(domain, 1.0, 2.0, unit, 9.0) for domain, unit in DOMAINS)
    verdicts = (
        ChannelReconciliation(
            "/imu/<b>", NAMES[0], "explained", Gap(14.2, 1e-9, places), Gap(1.1, 0.4), (step,)
        ),
        ChannelReconciliation(
            "/imu/<b>", NAMES[1], "unexplained", Gap(3.0, 1e-4, places), Gap(3.0, 1e-4, places)
        ),
        ChannelReconciliation("/imu/<b>", NAMES[2], "agrees", Gap(1.0, 0.5), Gap(1.0, 0.5)),
    )
    model = NoiseModel(tuple(models), source="model <i>")
    result = Reconciliation(verdicts, NoiseModel((mended, *models[1:])), 0.01, ("a note",))
    return Recording("bag", START_NS, tuple(channels)), model, result


def test_the_verdict_counts_and_tells() -> None:
    text = verdict(case()[2])
    assert text.startswith("The model agrees with the recording on 1 of 3 channels.")
    assert "Accelerometer x: a line <b>." in text
    assert "no effect of the catalogue explains" in text


def test_what_remains_is_placed_and_not_named() -> None:
    text = channel_sentence(case()[2].channels[1])
    assert "spectrum 1 to 2 Hz" in text


def test_a_model_that_agrees_is_said_so() -> None:
    _, _, result = case()
    alone = Reconciliation(result.channels[2:], result.model, 0.01)
    assert verdict(alone) == "The model agrees with the recording on all 1 channels."
    assert "Nothing was compared" in verdict(Reconciliation((), result.model, 0.01))


@pytest.mark.timeout(300)
def test_before_and_after_are_drawn_in_every_domain(tmp_path: Path) -> None:
    html = reconciliation_page(*case())
    for title in ("Spectrum", "Allan deviation", "Course in time", "Distribution of samples"):
        assert f"{title}, before" in html
        assert f"{title}, after" in html
    path = tmp_path / "report.html"
    path.write_text(html, encoding="utf-8")
    seen = visit(path)
    assert seen.complaints == ()
    assert seen.attribute("data-drawn") == "16/16"


def test_a_constant_is_said_to_be_one() -> None:
    nothing = Gap(float("nan"), 0.0, (Where("amplitude", 0.37, 0.37, "m/s^2", -np.inf),))
    note = "every sample has the same value, and the model has noise: a sensor that hangs?"
    channel = ChannelReconciliation("/imu", NAMES[1], "unexplained", nothing, nothing, (), (note,))
    assert channel_sentence(channel) == f"Accelerometer y: {note}"
