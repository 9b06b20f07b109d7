"""Put the fragments of the benchmarks together: docs/benchmarks.md and its picture."""

from __future__ import annotations

import datetime
import json
import os
import platform
import subprocess
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from results import RESULTS

DOCS = Path(__file__).resolve().parents[1] / "docs"
PARTS = {
    "allan": "Allan deviation",
    "reading": "MCAP to arrays",
    "commands": "Whole commands",
    "fuse": "Filter core",
    "reconcile": "Reconciliation",
    "live": "Live nodes",
}


def processor() -> str:
    """Return the processor's name as the kernel has it."""
    rows = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    found = next((r.partition(":")[2].strip() for r in rows if r.startswith("model name")), "")
    return found or platform.machine()


def head() -> str:
    """Return when, where and of what commit."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], check=False, capture_output=True, text=True
    ).stdout.strip()
    day = datetime.datetime.now(datetime.timezone.utc).date()
    return (
        "# Benchmarks\n\nWritten by `make bench`: one run, where a table does not say otherwise, "
        f"on {day}, commit `{commit}`, {os.cpu_count()} cores of {processor()}, Python "
        f"{platform.python_version()}, numpy {np.__version__}. Peers come from PyPI and run beside "
        "ours in the same process or in turn with it; nothing asserts an absolute time. What was "
        "tried and did not pay stands in [the notes](benchmarks_notes.md).\n"
    )


def load(name: str) -> Any:
    """Return a benchmark's figures, or None where it has not run."""
    path = RESULTS / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def draw(path: Path) -> None:
    """Draw how each cost grows."""
    figure, axes = plt.subplots(2, 2, figsize=(11, 7.5), constrained_layout=True)
    _allan(axes[0, 0])
    _reading(axes[0, 1])
    _reconcile(axes[1, 0])
    _live(axes[1, 1])
    for axis in axes.flat:
        axis.grid(alpha=0.3, which="both")
        if axis.get_legend_handles_labels()[0]:
            axis.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _allan(axis: plt.Axes) -> None:
    axis.set(title="Overlapping Allan deviation, one channel", xlabel="samples", ylabel="seconds")
    rows = load("allan")
    if rows is None:
        return
    size = [r["samples"] for r in rows["growth"]]
    axis.loglog(size, [r["allantools_s"] for r in rows["growth"]], "s-", label="allantools")
    axis.loglog(size, [r["ours_s"] for r in rows["growth"]], "o-", label="ours, with intervals")


def _reading(axis: plt.Axes) -> None:
    axis.set(title="Reading Imu messages", xlabel="thousand messages a second")
    rows = load("reading")
    if rows is None:
        return
    rates = {k: np.median([r["count"] / r["seconds"] / 1e3 for r in v]) for k, v in rows.items()}
    axis.barh(list(rates), list(rates.values()), color="#2f7ed8")
    axis.set_xscale("log")
    axis.invert_yaxis()


def _reconcile(axis: plt.Axes) -> None:
    axis.set(
        title="Reconciliation, 6 channels at 200 Hz", xlabel="minutes of data", ylabel="seconds"
    )
    rows = load("reconcile")
    if rows is None:
        return
    minutes = [r["minutes"] for r in rows]
    axis.loglog(minutes, [r["cold_s"] for r in rows], "o-", label="cold")
    axis.loglog(minutes, [r["warm_s"] for r in rows], "s-", label="null cached")


def _live(axis: plt.Axes) -> None:
    axis.set(title="Live nodes", xlabel="IMU rate (Hz)", ylabel="share of a core (%)")
    rows = load("live")
    if rows is None:
        return
    for node in dict.fromkeys(r["node"] for r in rows):
        own = [r for r in rows if r["node"] == node]
        axis.loglog(
            [r["rate_hz"] for r in own], [100 * r["cpu_of_a_core"] for r in own], "o-", label=node
        )


def main() -> None:
    """Write the page and the picture."""
    draw(DOCS / "pictures" / "benchmarks.png")
    parts = [head(), "![How each cost grows](pictures/benchmarks.png)\n"]
    for name, title in PARTS.items():
        path = RESULTS / f"{name}.md"
        text = path.read_text(encoding="utf-8") if path.is_file() else "Not run.\n"
        if text.startswith("## "):
            text = text.partition("\n")[2].lstrip("\n")
        parts.append(f"## {title}\n\n{text}")
    (DOCS / "benchmarks.md").write_text("\n".join(parts), encoding="utf-8")
    print(f"written: {DOCS / 'benchmarks.md'}")


if __name__ == "__main__":
    main()
