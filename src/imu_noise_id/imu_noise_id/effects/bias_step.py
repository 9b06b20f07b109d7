"""Bias step: the level jumps once and stays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import CourseEffect, Parameter
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class BiasStep(CourseEffect):
    """x(t) = height for t >= time_s, else 0.

    Attributes
    ----------
    time_s : float
        Seconds since the recording's first stamp.
    height : float
        Of either sign, in the channel's unit.
    """

    time_s: float
    height: float

    name: ClassVar[str] = "bias_step"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("time_s", "s", False, "When the level jumps, since the first stamp"),
        Parameter("height", "{u}", False, "Level after minus level before"),
    )

    def course(self, time_s: Floats, temperature: Floats | None) -> Floats:
        """Height from ``time_s`` on."""
        return np.where(time_s >= self.time_s, self.height, 0.0)


def step_scan(values: Floats, edge: int = 16) -> tuple[int, float, float]:
    """Most likely single step in white samples: first sample after it, height, score.

    With b_k = mean after k minus mean before k, the score is |b_k| sqrt(k (n - k)/n)/sigma, sigma
    from the differences of neighbours (a step in one of n differences leaves it alone).

    Parameters
    ----------
    values : (n,) float64
    edge : int
        Samples at either end where no step is looked for.

    Returns
    -------
    index : int
    height : float
    score : float
        Standard normal at a given k where there is no step.
    """
    n = values.size
    if n < 2 * edge + 2:
        return n // 2, 0.0, 0.0
    centred = values - values.mean()
    sum_before = np.cumsum(centred)[edge - 1 : n - edge - 1]
    k = np.arange(edge, n - edge)
    height = -sum_before * (n / (k * (n - k)))
    sigma = float(np.sqrt(0.5 * np.mean(np.diff(values) ** 2)))
    score = np.abs(height) * np.sqrt(k * (n - k) / n)
    best = int(np.argmax(score))
    return edge + best, float(height[best]), float(score[best] / sigma) if sigma > 0.0 else 0.0
