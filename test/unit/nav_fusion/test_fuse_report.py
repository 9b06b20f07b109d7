"""The report of a fused recording: is its covariance true, and is every figure drawn?"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.report.page import render
from nav_fusion.consistency import Innovations
from nav_fusion.fuse import FuseResult, fuse_bag
from nav_fusion.fuse_report import page_of, verdict
from nav_fusion.parameters import Parameters

from helpers.browser import visit
from helpers.drive import drive, write


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> FuseResult:
    bag = write(drive(30.0), tmp_path_factory.mktemp("fused") / "bag")
    return fuse_bag(bag, parameters=Parameters(initial_heading_rad=0.0))


def with_nis(result: FuseResult, mean: float | None, white: bool | None) -> FuseResult:
    status = replace(result.status, nis_mean=mean, nis_lower=2.9, nis_upper=3.1, white=white)
    return replace(result, status=status)


@pytest.mark.parametrize(
    ("mean", "white", "says"),
    [
        (3.0, True, ("agrees with the fixes", "are white")),
        (4.0, False, ("too sure", "not white")),
        (1.0, None, ("more careful",)),
        (None, None, ("Too few fixes",)),
    ],
)
def test_the_verdict_says_whether_the_covariance_is_true(
    result: FuseResult, mean: float | None, white: bool | None, says: tuple[str, ...]
) -> None:
    text = verdict(with_nis(result, mean, white))
    assert all(words in text for words in says)


@pytest.mark.timeout(300)
def test_every_figure_is_drawn_in_a_page_of_under_three_megabytes(
    result: FuseResult, tmp_path: Path
) -> None:
    path = tmp_path / "report.html"
    path.write_text(render(page_of(result, "<bag>")), encoding="utf-8")
    assert path.stat().st_size < 3_000_000
    seen = visit(path)
    assert not seen.complaints
    assert seen.attribute("data-ready") == "yes"
    assert "&lt;bag&gt; fused" in seen.document


def test_innovations_at_the_start_do_not_set_the_scale(
    result: FuseResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = result.innovations
    sigma = np.ones_like(found.sigma)
    sigma[:2] = 1e6
    wild = replace(found, sigma=sigma)
    monkeypatch.setattr(FuseResult, "innovations", property(lambda _: wild))
    figure = page_of(result, "bag").sections[0].figures[0]
    assert figure.plot.y.high is not None
    assert figure.plot.y.high < 100.0


def test_a_recording_whose_fixes_all_repeat_has_no_figures_of_them(
    result: FuseResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    none = Innovations(
        np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3)), np.empty(0), np.empty(0, bool)
    )
    monkeypatch.setattr(FuseResult, "innovations", property(lambda _: none))
    assert page_of(result, "bag").sections[0].figures == ()
