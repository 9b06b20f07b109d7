"""What a person reads on the terminal: compact tables with units and intervals."""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING, Any

from imu_noise_id.model import ChannelModel, Estimate, NoiseModel
from imu_noise_id.wording import gap_text

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from imu_noise_id.reconcile import Reconciliation

PIPE_WIDTH = 160
NOT_SEEN = "not seen"


def number(value: float | str | None, precision: float | None = None) -> str:
    """A number with the digits that its interval's half width deserves (two of them).

    ``number(1.06432e-4, 3e-6)`` is ``1.064e-04``; without an interval four digits are shown.
    """
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    return _text(value, precision, _plain(value))


def _plain(value: float) -> bool:
    """Whether a number is written without an exponent."""
    return value == 0.0 or 1e-3 <= abs(value) < 1e5


def _text(value: float, precision: float | None, plain: bool) -> str:
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    magnitude = math.floor(math.log10(abs(value)))
    digits = 4
    if precision is not None and 0.0 < precision < math.inf:
        digits = min(max(2 + magnitude - math.floor(math.log10(precision)), 2), 8)
    if plain:
        return f"{value:.{max(digits - 1 - magnitude, 0)}f}"
    return f"{value:.{digits - 1}e}"


def interval(estimate: Estimate) -> str:
    """The 95 % interval, both ends written alike, or a dash."""
    if estimate.lower is None or estimate.upper is None:
        return "-"
    width = (estimate.upper - estimate.lower) / 2.0
    plain = _plain(estimate.lower) and _plain(estimate.upper)
    return f"{_text(estimate.lower, width, plain)} .. {_text(estimate.upper, width, plain)}"


def half_width(estimate: Estimate) -> float | None:
    """Half of the interval's width, or None."""
    if estimate.lower is None or estimate.upper is None:
        return None
    return (estimate.upper - estimate.lower) / 2.0


def console() -> Console:
    """Standard output: colours and its own width on a terminal, plain and wide in a pipe."""
    from rich.console import Console

    if sys.stdout.isatty():
        return Console(highlight=False)
    return Console(highlight=False, width=PIPE_WIDTH, color_system=None)


def model_table(model: NoiseModel) -> Table:
    """Return every parameter of every channel: value, 95 % interval, unit."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
    for heading in ("channel", "effect", "parameter"):
        table.add_column(heading, no_wrap=True)
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("95 % interval", justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for channel in model.channels:
        rows = channel_rows(channel)
        for index, row in enumerate(rows):
            cells = [Text(cell) for cell in row]
            cells[0].stylize("bold cyan")
            if row[4] == NOT_SEEN:
                for cell in cells[1:]:
                    cell.stylize("dim")
            table.add_row(*cells, end_section=index == len(rows) - 1)
    return table


def channel_rows(channel: ChannelModel) -> list[tuple[str, str, str, str, str, str]]:
    """Rows of the table of one channel; repeated names stay blank."""
    rows = []
    shown_channel, shown_effect = channel.name, ""
    for fitted in channel.effects:
        shown_effect = fitted.name
        for parameter, estimate in zip(fitted.effect.parameters, fitted.estimates, strict=True):
            value = number(estimate.value, half_width(estimate))
            row = (value, interval(estimate), estimate.unit)
            rows.append((shown_channel, shown_effect, parameter.name, *row))
            shown_channel = shown_effect = ""
    for bound in channel.bounds:
        value = f"< {number(bound.upper, bound.upper)}"
        rows.append((shown_channel, bound.name, bound.parameter, value, NOT_SEEN, bound.unit))
        shown_channel = ""
    if not rows:
        rows.append((channel.name, "no effect found", "", "-", "-", ""))
    return rows


def fleet_table(tree: dict[str, Any]) -> Table:
    """Return the parameters of a fleet: median and spread between units."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
    for heading in ("channel", "effect", "parameter"):
        table.add_column(heading, no_wrap=True)
    for heading in ("units", "median", "spread"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    shown = ""
    for row in tree["parameters"]:
        cells = (
            row["channel"] if row["channel"] != shown else "",
            row["effect"] + (f" {row['occurrence']}" if row["occurrence"] > 1 else ""),
            row["parameter"],
            f"{len(row['units'])} of {len(tree['units'])}",
            number(row["median"], row["spread"]),
            number(row["spread"], row["spread"]),
            row["unit"],
        )
        shown = row["channel"]
        table.add_row(*(Text(cell) for cell in cells))
    return table


def reconciliation_table(result: Reconciliation) -> Table:
    """Return the verdict on every channel: gap before, what was changed, gap after."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, header_style="bold")
    table.add_column("channel", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("gap", justify="right", no_wrap=True)
    table.add_column("after", justify="right", no_wrap=True)
    table.add_column("what was changed", overflow="fold")
    colours = {"agrees": "green", "explained": "cyan", "unexplained": "yellow"}
    for channel in result.channels:
        table.add_row(
            Text(channel.name, "bold"),
            Text(channel.verdict, colours.get(channel.verdict, "")),
            gap_text(channel.before.score),
            gap_text(channel.after.score),
            Text(", ".join(f"{step.action} {step.effect.name}" for step in channel.steps)),
        )
    return table
