"""A report page: a verdict, then sections of text, figures and tables, in one file.

The page is generic: ``identify`` and ``reconcile`` here, ``fuse`` and ``budget`` of nav_fusion fill
it.  Bokeh draws the figures in the browser, Jinja2 escapes every text; nothing is fetched.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from imu_noise_id import __version__
from imu_noise_id.errors import InputError
from imu_noise_id.report.plot import Plot, plot_tree

_BOKEH_FILES = ("bokeh.min.js", "bokeh-api.min.js")


@dataclass(frozen=True)
class Figure:
    """A picture with a title and what to look at in it.

    Attributes
    ----------
    title : str
    caption : str
        One or two sentences; plain text.
    plot : Plot
    wide : bool
        Whether it takes the whole width of the page.
    """

    title: str
    caption: str
    plot: Plot
    wide: bool = False


@dataclass(frozen=True)
class Table:
    """A table; cells are texts, columns of numbers are named by their index.

    Attributes
    ----------
    title : str
    headings : tuple of str
    rows : tuple of tuple of str
    numeric : tuple of int
        Columns that are set to the right.
    """

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[int, ...] = ()


@dataclass(frozen=True)
class Snippet:
    """Lines to copy: a command, a file for another tool."""

    title: str
    text: str


@dataclass(frozen=True)
class Section:
    """A part of the page with a heading that the contents link to.

    Attributes
    ----------
    title : str
    paragraphs : tuple of str
        Plain text.
    figures, tables, snippets
        Shown in this order.
    verdict : str
        A short mark beside the heading ("agrees", "2 effects"), or empty.
    links : tuple of (str, str)
        Text and target, relative to the page: what says more.
    """

    title: str
    paragraphs: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()
    tables: tuple[Table, ...] = ()
    snippets: tuple[Snippet, ...] = ()
    verdict: str = ""
    links: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Page:
    """What a report says.

    Attributes
    ----------
    title : str
    verdict : str
        The answer, in a sentence or two.
    sections : tuple of Section
    facts : tuple of (str, str)
        Name and value: what was looked at.
    notes : tuple of str
        What a reader must know before believing the rest.
    """

    title: str
    verdict: str
    sections: tuple[Section, ...]
    facts: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = field(default=())


def render(page: Page) -> str:
    """Return the page as one HTML document that needs nothing else."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("imu_noise_id.report", "template"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["ref"] = id
    figures = [figure for section in page.sections for figure in section.figures]
    numbers = {id(figure): f"figure-{k + 1}" for k, figure in enumerate(figures)}
    return environment.get_template("page.html.j2").render(
        page=page,
        anchors=_anchors(page.sections),
        numbers=numbers,
        plots=_script_json([plot_tree(figure.plot) for figure in figures]),
        bokeh=_bokeh(),
        style=_text("page.css"),
        script=_text("page.js"),
        version=__version__,
    )


def _anchors(sections: Sequence[Section]) -> list[str]:
    return [f"section-{k + 1}" for k in range(len(sections))]


def _script_json(tree: Any) -> str:
    """JSON that is safe inside a script element: no text in it can end the element."""
    text = json.dumps(tree, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _text(name: str) -> str:
    return (resources.files(__package__) / "template" / name).read_text(encoding="utf-8")


@cache
def _bokeh() -> str:
    """Bokeh's browser library, what plain figures need of it."""
    found = find_spec("bokeh")  # the files only: importing the package takes a second
    if found is None or not found.submodule_search_locations:
        raise InputError("no report without Bokeh: python -m pip install 'bokeh>=3.4'")
    folder = Path(found.submodule_search_locations[0], "server", "static", "js")
    scripts = [(folder / name).read_text(encoding="utf-8") for name in _BOKEH_FILES]
    return "\n".join(scripts).replace("</script", "<\\/script")
