"""A report is one file that draws every figure in a real browser and escapes every text."""

from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.report import figures
from imu_noise_id.report.curves import Part
from imu_noise_id.report.page import Figure, Page, Section, Snippet, Table, render
from imu_noise_id.report.plot import Axis, Layer, Plot
from imu_noise_id.spectrum import Spectrum

from helpers.browser import visit

EVIL = "<script>alert(1)</script>\"'&amp;</title></style>--></pre>{{ 7*7 }}"


def _every_plot() -> list[Plot]:
    x = np.geomspace(0.01, 100.0, 40)
    y = 1.0 / np.sqrt(x)
    spectrum = Spectrum(x, y, 0.8 * y, 1.2 * y, np.full(40, 20.0), 0.95)
    return [
        figures.spectrum_figure(spectrum, "rad/s", [Part("white_noise", y)], [Part("m", y)], [5.0]),
        figures.bode_figure(x, y, -y),
        figures.step_figure(x, y, EVIL),
        figures.pole_zero_figure([0.5 + 0.1j], []),
        figures.scatter_figure(x, y, [("a", np.eye(2)), ("b", 2.0 * np.eye(2))]),
        figures.areas_figure(x, [Part("a", y), Part(EVIL, y)], Axis("x"), Axis("y")),
        figures.with_guides(
            figures.lines_figure([(EVIL, x, y)], Axis("x", True), Axis(EVIL, True), ("b", x, y, y)),
            [3.0],
            "line",
        ),
        Plot(
            Axis("x"),
            Axis("y"),
            (
                Layer("bars", {"x": x, "low": -y, "high": y}, "bars", width=0.5),
                Layer("shade", {"low": np.array([1.0]), "high": np.array([2.0])}, alpha=0.2),
            ),
        ),
    ]


def _page() -> Page:
    drawn = tuple(Figure(EVIL, EVIL, plot) for plot in _every_plot())
    table = Table(EVIL, (EVIL, "n"), ((EVIL, "1"),), (1,))
    section = Section(EVIL, (EVIL,), drawn, (table,), (Snippet(EVIL, EVIL),), EVIL)
    return Page(EVIL, EVIL, (section,), ((EVIL, EVIL),), (EVIL,))


@pytest.mark.timeout(300)
@pytest.mark.parametrize("width", [400, 1280])
def test_a_browser_draws_every_figure_without_complaint(tmp_path: Path, width: int) -> None:
    path = tmp_path / "report.html"
    path.write_text(render(_page()), encoding="utf-8")
    seen = visit(path, width)
    assert seen.complaints == ()
    assert seen.attribute("data-drawn") == f"{len(_every_plot())}/{len(_every_plot())}"
    assert seen.attribute("data-ready") == "yes"
    assert seen.document.count("bk-Figure") >= len(_every_plot())


class _Scripts(HTMLParser):
    """Collects the script elements of a page and the text outside of them."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0
        self.sources: list[str] = []
        self.inside = False
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "script":
            self.count += 1
            self.inside = True
        self.sources += [v or "" for k, v in attrs if k in ("src", "href") and v]

    def handle_endtag(self, tag: str) -> None:
        self.inside = self.inside and tag != "script"

    def handle_data(self, data: str) -> None:
        if not self.inside:
            self.text += data


def test_text_from_outside_stays_text() -> None:
    seen = _Scripts()
    seen.feed(render(_page()))
    assert seen.count == 3  # Bokeh, the plots, and what draws them
    assert seen.text.count("<script>alert(1)</script>") >= 10
    assert "49" not in re.findall(r"\d+", seen.text.replace("{{ 7*7 }}", ""))


def test_a_page_fetches_nothing_and_stays_small() -> None:
    html = render(_page())
    seen = _Scripts()
    seen.feed(html)
    assert all(source.startswith(("#", "data:")) for source in seen.sources)
    assert len(html.encode()) < 3_000_000


def test_data_reach_the_page_in_single_precision() -> None:
    values = np.array([1.0, 2.5e-7, -3e8])
    html = render(
        Page("t", "v", (Section("s", (), (Figure("f", "c", Plot(
            Axis("x"), Axis("y"), (Layer("line", {"x": values, "y": values}),))),)),))
    )  # fmt: skip
    packed = re.search(r'"data":\{"x":"([^"]+)"', html)
    assert packed is not None
    read = np.frombuffer(base64.b64decode(packed.group(1)), "<f4")
    np.testing.assert_array_equal(read, values.astype("<f4"))
