"""A picture as data: axes and layers that the page's script hands to Bokeh in the browser.

Building the figures in the browser keeps the page small and Python free of the plotting library:
a report of fifty figures is written in a fraction of a second.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

INK = "ink"
"""The page's own text colour, dark on light and light on dark."""


@dataclass(frozen=True)
class Axis:
    """One axis.

    Attributes
    ----------
    label : str
    log : bool
    low, high : float or None
        Range shown at first; None follows the data.
    """

    label: str
    log: bool = False
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True)
class Layer:
    """One thing that is drawn.

    Attributes
    ----------
    kind : str
        ``line`` (x, y), ``band`` (x, low, high), ``points`` (x, y), ``bars`` (x, low, high, and
        ``width``), ``guide`` (x: a vertical line each) or ``shade`` (low, high: stretches of x).
    data : mapping of str to array
        Columns; further ones are there for ``hover``.
    label : str
        Name in the legend; layers of one name are hidden together.  Empty: not in the legend.
    colour : str
        ``ink`` for the page's text colour.
    dash, marker : str
        Of lines; of points.
    width, alpha, size : float
        Line width in pixels (bars: in units of x), opacity, marker size.
    hover : tuple of (str, str)
        Name and Bokeh format of what the pointer shows; empty: nothing.
    second : bool
        Whether it belongs to the axis on the right.
    """

    kind: str
    data: Mapping[str, ArrayLike]
    label: str = ""
    colour: str = INK
    dash: str = "solid"
    marker: str = "circle"
    width: float = 1.6
    alpha: float = 1.0
    size: float = 5.0
    hover: tuple[tuple[str, str], ...] = ()
    second: bool = False


@dataclass(frozen=True)
class Plot:
    """A picture.

    Attributes
    ----------
    x, y : Axis
    layers : tuple of Layer
        The last on top.
    second_y : Axis or None
        An axis on the right.
    equal : bool
        Whether both axes have the same scale.
    """

    x: Axis
    y: Axis
    layers: tuple[Layer, ...]
    second_y: Axis | None = None
    equal: bool = False
    columns: int = field(default=2)


def plot_tree(plot: Plot) -> dict[str, Any]:
    """Return the picture as JSON data; columns in single precision, more than a screen shows."""
    return {
        "x": _axis_tree(plot.x),
        "y": _axis_tree(plot.y),
        "second_y": None if plot.second_y is None else _axis_tree(plot.second_y),
        "equal": plot.equal,
        "columns": plot.columns,
        "layers": [_layer_tree(layer) for layer in plot.layers],
    }


def _axis_tree(axis: Axis) -> dict[str, Any]:
    return {"label": axis.label, "log": axis.log, "low": axis.low, "high": axis.high}


def _layer_tree(layer: Layer) -> dict[str, Any]:
    return {
        "kind": layer.kind,
        "data": {name: _packed(column) for name, column in layer.data.items()},
        "label": layer.label,
        "colour": layer.colour,
        "dash": layer.dash,
        "marker": layer.marker,
        "width": layer.width,
        "alpha": layer.alpha,
        "size": layer.size,
        "hover": [list(pair) for pair in layer.hover],
        "second": layer.second,
    }


def _packed(column: ArrayLike) -> str:
    """Little-endian float32 in base64."""
    return base64.b64encode(np.asarray(column, "<f4").tobytes()).decode("ascii")
