"""Whether another place of the antenna, or another delay, explains the fixes better.

A lever arm or a delay that was forgotten shows as noise beyond the model, and no sum of innovations
tells it from others: the filter follows it.  Filters that are told of one do tell: each rival gives
the same fixes a likelihood, and their mean over that of the filter is an e-value
(:mod:`nav_fusion.evidence`), which exceeds 1/alpha by chance with probability alpha at most.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from nav_fusion import evidence
from nav_fusion.consistency import innovations_of
from nav_fusion.engine import Engine
from nav_fusion.parameters import RANGES, Parameters, Vector

LATER_S = (-0.2, -0.1, 0.1, 0.2, 0.3)
ARMS_M: tuple[tuple[str, Vector], ...] = (
    ("ahead", (1.0, 0.0, 0.0)),
    ("behind", (-1.0, 0.0, 0.0)),
    ("to the left", (0.0, 1.0, 0.0)),
    ("to the right", (0.0, -1.0, 0.0)),
    ("above", (0.0, 0.0, 1.0)),
    ("below", (0.0, 0.0, -1.0)),
)
SETTLING_FIXES = 10
LONGEST_S = 300.0
"""So much of a recording decides."""


def rivals_of(p: Parameters) -> list[tuple[str, Parameters]]:
    """Settings beside those given, each with what it says."""
    low, high, _ = RANGES["gnss_delay_s"]
    delays = [p.gnss_delay_s + more for more in LATER_S if low <= p.gnss_delay_s + more <= high]
    found = [(f"gnss_delay_s {d:.3g}", replace(p, gnss_delay_s=d)) for d in delays]
    for where, (x, y, z) in ARMS_M:
        a, b, c = p.lever_arm_m
        said = f"the antenna (lever_arm_m) about 1 m further {where}"
        found.append((said, replace(p, lever_arm_m=(a + x, b + y, c + z))))
    return found


def log_likelihoods(engine: Engine) -> dict[int, float]:
    """Of each fix by its own stamp; none where the filter was aligned more than once.

    Those at the beginning, when the first has just been taken, are left out.  With the sigmas of
    the innovations alone: that their axes are correlated is nearly the same for all rivals.
    """
    if engine._core is None or engine.counts.restarts:
        return {}
    p, found = engine.parameters, innovations_of(engine)
    gate = float(chdtri(3, 1.0 - p.gate_confidence))
    each = -0.5 * np.minimum(found.nis, gate) - np.log(found.sigma).sum(axis=1)
    stamps = (found.stamp_ns + round(p.gnss_delay_s * 1e9))[SETTLING_FIXES:]
    return dict(zip(stamps.tolist(), each[SETTLING_FIXES:].tolist(), strict=True))


def gain_of(rival: dict[int, float], own: dict[int, float]) -> float:
    """Log likelihood of the fixes that both took, over the own; minus infinity for a few."""
    both = rival.keys() & own.keys()
    if 2 * len(both) < len(own):
        return -math.inf
    return math.fsum(rival[k] - own[k] for k in both)


def likelier(fused: Callable[[Parameters], Engine], parameters: Parameters) -> str | None:
    """Return a sentence about the setting that the fixes speak for; ``fused`` runs a filter."""
    own = log_likelihoods(fused(parameters))
    if not own:
        return None
    named = rivals_of(parameters)
    gains = np.array([gain_of(log_likelihoods(fused(p)), own) for _, p in named])
    together = float(np.logaddexp.reduce(gains)) - math.log(len(named))
    if not together > evidence.limit(1):
        return None
    best = int(np.argmax(gains))
    return (
        f"of settings that may be wrong, the fixes speak for {named[best][0]} (log likelihood "
        f"{gains[best]:+.0f} in {LONGEST_S:.0f} s or less): measure it, and set it"
    )
