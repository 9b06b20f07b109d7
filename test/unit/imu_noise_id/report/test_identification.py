"""The report of an identification says what was found, and a hostile topic stays text."""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.cca import past_future
from imu_noise_id.identify import Identification, identify_recording
from imu_noise_id.recording import Channel, Quality, ReceiverClaim, Recording, unit_of
from imu_noise_id.report.identification import identification_page, inside, verdict

from helpers.browser import visit

EVIL = "/imu/<script>alert(1)</script>"
START_NS = 10**18


def _channel(name: str, values: np.ndarray, rate_hz: float, quality: Quality) -> Channel:
    stamp_ns = START_NS + np.rint(np.arange(values.size) * 1e9 / rate_hz).astype(np.int64)
    still = np.ones(values.size, dtype=bool)
    topic = "/gps/fix" if name.startswith("position") else EVIL
    return Channel(topic, name, unit_of(name), stamp_ns, values, still, rate_hz, quality)


@cache
def identification() -> Identification:
    """Two gyro axes, one with a slow bias, and a receiver that claims half its scatter."""
    rng = np.random.default_rng(4)
    n, rate_hz = 12_000, 100.0
    slow = np.zeros(n)
    for k in range(1, n):
        slow[k] = 0.999 * slow[k - 1] + rng.normal(0.0, 2e-4)
    moved = Quality(static=False, moving_s=((30.0, 35.0),), notes=("a <b>note</b>",))
    channels = [
        _channel("angular_velocity.x", rng.normal(0.0, 1e-3, n), rate_hz, moved),
        _channel("angular_velocity.y", rng.normal(0.0, 1e-3, n) + slow, rate_hz, Quality()),
    ]
    fixes = rng.normal(0.0, 1.0, (3, 1200))
    channels += [
        _channel(f"position.{axis}", fixes[k], 10.0, Quality())
        for k, axis in enumerate(("east", "north", "up"))
    ]
    claim = ReceiverClaim(channels[-1].stamp_ns, np.tile(0.25 * np.eye(3), (1200, 1, 1)))
    recording = Recording("bag <script>", START_NS, tuple(channels), None, claim, ("whole",))
    found = identify_recording(recording)
    results = tuple(
        dataclasses.replace(r, cca=past_future(r.series) if r.channel.name[-1] == "y" else None)
        for r in found.channels
    )
    return dataclasses.replace(found, channels=results)


def test_the_verdict_says_what_was_found_and_how_well_it_fits() -> None:
    text = verdict(identification())
    assert "5 channels identified from 120 s" in text
    assert "moved" in text
    assert "gyroscope" in text
    assert "1\u00d710\u207b\u2074" in text or "1.0\u00d710\u207b\u2074" in text
    assert "%" in text


def test_white_noise_lies_inside_its_own_intervals() -> None:
    found = identification()
    share = inside(found.channels[0], found.recording)
    assert share is not None
    assert share > 0.8


def test_the_page_has_all_parts_and_sets_claim_beside_scatter() -> None:
    html = identification_page(identification())
    for part in ("Overview", "Gyroscope x", "Poles and zeros", "GNSS: claimed and true",
                 "How to use these numbers", "30 to 35 s: the platform moved"):  # fmt: skip
        assert part in html
    assert "The fixes scatter 2 times as much" in html
    assert len(html.encode()) < 3_000_000


@pytest.mark.timeout(300)
def test_a_topic_called_script_stays_text_in_a_real_browser(tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text(identification_page(identification()), encoding="utf-8")
    seen = visit(path, 1280, 1600)
    assert seen.complaints == ()
    assert seen.attribute("data-ready") == "yes"
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in seen.document


def test_an_empty_identification_still_has_a_page() -> None:
    empty = Identification(
        Recording("bag", START_NS, ()), (), dataclasses.replace(identification().model, channels=())
    )
    assert "Nothing could be identified" in identification_page(empty)
