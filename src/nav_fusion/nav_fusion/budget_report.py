"""The budget as a page: sigmas over time, sensors side by side, and what causes them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from imu_noise_id.report.curves import Part
from imu_noise_id.report.figures import PALETTE, areas_figure
from imu_noise_id.report.page import Figure, Page, Section, Table
from imu_noise_id.report.plot import Axis, Layer, Plot

from nav_fusion.budget import Budget, Scenario, Share

MOST_SHOWN = 7
_TIMES_S = (1.0, 10.0, 60.0, 300.0)
_QUANTITIES = (
    ("position", "position_sigma_m", "m", 1.0),
    ("velocity", "velocity_sigma_m_s", "m/s", 1.0),
    ("heading", "heading_sigma_rad", "deg", math.degrees(1.0)),
)


def page_of(budgets: Sequence[Budget]) -> Page:
    """Return the report of one or several models."""
    sections = [_compared(budgets, k) for k in range(len(budgets[0].scenarios))]
    sections += [_causes(b, s) for b in budgets for s in b.scenarios]
    return Page(
        "Error budget",
        _verdict(budgets),
        tuple(sections),
        tuple(("model", b.model) for b in budgets),
        tuple(dict.fromkeys(n for b in budgets for n in b.notes)),
    )


def _verdict(budgets: Sequence[Budget]) -> str:
    said = []
    for b in budgets:
        free = b.scenarios[0]
        k = _at(free, 60.0)
        top = max(free.shares, key=lambda s: s.position[k])
        said.append(
            f"{b.model}: {free.position_sigma_m[k]:.3g} m after {free.time_s[k]:.0f} s without "
            f"fixes, {100 * top.position[k]:.0f} % of the variance by {_label(top)}."
        )
    return "  ".join(said)


def _at(scenario: Scenario, time_s: float) -> int:
    return int(np.argmin(np.abs(scenario.time_s - time_s)))


def _label(share: Share) -> str:
    return f"{share.effect} of the {share.sensor}"


def _compared(budgets: Sequence[Budget], k: int) -> Section:
    figures, rows = [], []
    for title, name, unit, scale in _QUANTITIES:
        layers = tuple(
            Layer(
                "line",
                {"x": s.time_s[1:], "y": scale * getattr(s, name)[1:]},
                b.model,
                PALETTE[i % len(PALETTE)],
            )
            for i, (b, s) in enumerate((b, b.scenarios[k]) for b in budgets)
        )
        figures.append(
            Figure(
                f"{title}, {budgets[0].scenarios[k].name}",
                "One standard deviation over time.",
                Plot(Axis("time, s", True), Axis(f"{title} sigma, {unit}", True), layers),
            )
        )
    for b in budgets:
        s = b.scenarios[k]
        for time_s in (t for t in _TIMES_S if t <= s.time_s[-1] * 1.001):
            i = _at(s, time_s)
            rows.append(
                (
                    b.model,
                    f"{s.time_s[i]:.3g}",
                    *(f"{scale * getattr(s, name)[i]:.3g}" for _, name, _, scale in _QUANTITIES),
                )
            )
    table = Table(
        "Sensors side by side",
        ("model", "time, s", "position, m", "velocity, m/s", "heading, deg"),
        tuple(rows),
        (1, 2, 3, 4),
    )
    return Section(f"Scenario: {budgets[0].scenarios[k].name}", (), tuple(figures), (table,))


def _causes(budget: Budget, scenario: Scenario) -> Section:
    i = scenario.time_s.size - 1
    shares = sorted(scenario.shares, key=lambda s: -s.position[i])
    rows = tuple(
        (s.effect, s.sensor, *(f"{100 * x[i]:.1f}" for x in (s.position, s.velocity, s.heading)))
        for s in shares
    )
    parts = [Part(_label(s), 100 * s.position[1:]) for s in shares[:MOST_SHOWN]]
    if len(shares) > MOST_SHOWN:
        rest = sum(100 * s.position[1:] for s in shares[MOST_SHOWN:])
        parts.append(Part("all others", np.asarray(rest)))
    plot = areas_figure(
        scenario.time_s[1:],
        parts,
        Axis("time, s", True),
        Axis("share of the position's variance, %", False, 0.0, 100.0),
    )
    table = Table(
        f"Shares of the variance after {scenario.time_s[i]:.0f} s, %",
        ("effect", "sensor", "position", "velocity", "heading"),
        rows,
        (2, 3, 4),
    )
    return Section(
        f"Causes: {budget.model}, {scenario.name}",
        (
            "Why Allan values get inflated: what a static record shows is only its white noise and "
            "slow terms.  Turn-on bias, temperature, vibration and the start stand beside them.",
        ),
        (Figure("What causes the position error", "Shares of the variance, stacked.", plot),),
        (table,),
    )
