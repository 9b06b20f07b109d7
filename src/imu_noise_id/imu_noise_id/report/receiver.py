"""What the GNSS receiver says of itself beside what was measured."""

from __future__ import annotations

import numpy as np

from imu_noise_id.recording import Floats, Recording
from imu_noise_id.report import figures
from imu_noise_id.report.page import Figure, Section, Table
from imu_noise_id.terminal import number

AXES = ("east", "north", "up")
MOST_POINTS = 1500


def receiver_section(recording: Recording) -> Section | None:
    """Return the fixes with the claimed and the true ellipse, or None without fixes."""
    names = {c.name for c in recording.channels}
    if not {f"position.{axis}" for axis in AXES} <= names:
        return None
    values = [recording.channel(f"position.{axis}") for axis in AXES]
    still = values[0].still
    if still.sum() < 3:
        return None
    fixes = np.stack([channel.values[still] for channel in values])
    fixes = fixes - fixes.mean(axis=1, keepdims=True)
    measured = np.cov(fixes)
    claimed = None
    if recording.claim is not None and recording.claim.covariance.shape[0]:
        claimed = recording.claim.covariance.mean(axis=0)
    return Section(
        "GNSS: claimed and true",
        (_sentence(measured, claimed),),
        (_scatter(fixes, measured, claimed),),
        (_table(measured, claimed),),
    )


def _scatter(fixes: Floats, measured: Floats, claimed: Floats | None) -> Figure:
    step = max(1, -(-fixes.shape[1] // MOST_POINTS))
    ellipses = [("measured 95 %", measured[:2, :2])]
    if claimed is not None:
        ellipses.append(("claimed 95 %", claimed[:2, :2]))
    plot = figures.scatter_figure(fixes[0, ::step], fixes[1, ::step], ellipses)
    return Figure(
        "Fixes about their mean",
        "The receiver stood still: all scatter is its noise. A constant error cannot be seen "
        "this way, and slow noise only as far as the recording is long.",
        plot,
        wide=True,
    )


def _ratio(measured: float, claimed: float) -> float | None:
    return None if claimed <= 0.0 else float(np.sqrt(measured / claimed))


def _sentence(measured: Floats, claimed: Floats | None) -> str:
    if claimed is None:
        return "The receiver states no covariance, so there is nothing to compare with."
    ratio = _ratio(float(np.trace(measured[:2, :2])), float(np.trace(claimed[:2, :2])))
    if ratio is None:
        return "The receiver states a covariance of zero, which cannot be true."
    if ratio < 1.0:
        return (
            f"The receiver claims a horizontal sigma {1.0 / ratio:.2g} times the scatter of its "
            "fixes: it is cautious, or its slow error is longer than this recording."
        )
    return (
        f"The fixes scatter {ratio:.2g} times as much as the receiver claims: a filter that "
        "believes the claim will be too sure of its position."
    )


def _table(measured: Floats, claimed: Floats | None) -> Table:
    rows = []
    for k, axis in enumerate(AXES):
        true_m = float(np.sqrt(measured[k, k]))
        if claimed is None:
            rows.append((axis, number(true_m), "-", "-"))
            continue
        ratio = _ratio(float(measured[k, k]), float(claimed[k, k]))
        rows.append((axis, number(true_m), number(float(np.sqrt(claimed[k, k]))), number(ratio)))
    headings = ("axis", "measured sigma (m)", "claimed sigma (m)", "measured / claimed")
    return Table("Standard deviations", headings, tuple(rows), (1, 2, 3))
