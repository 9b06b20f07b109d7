"""Output rounding: values come in multiples of the least significant digit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, Stage, TransformEffect
from imu_noise_id.recording import Floats

FINEST = 0.01
"""Smallest step, in standard deviations of the samples, that is worth a name: it adds 8e-6 of the
variance."""
SAME = 1e-4
"""Part of that step within which two values are one: conversions of units and frames leave such."""


@dataclass(frozen=True)
class OutputRounding(TransformEffect):
    """y = step * round(x/step); white, step^2/12, where the noise exceeds the step (Bennett 1948).

    Attributes
    ----------
    step : float
        Least significant digit in the channel's unit.
    """

    step: float

    name: ClassVar[str] = "output_rounding"
    stage = Stage.ROUNDING
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("step", "{u}", True, "Least significant digit of the output"),
    )

    def apply(
        self, values: Floats, time_s: Floats, sample_time_s: float, rng: np.random.Generator
    ) -> Floats:
        """Round to the nearest multiple of the step."""
        return self.step * np.rint(values / self.step)

    def added_psd(self, sample_time_s: float) -> float:
        """Two-sided level of the rounding error, step^2 dt/12, unit^2/Hz."""
        return self.step**2 * sample_time_s / 12.0


def rounding_step(values: Floats) -> float | None:
    """Step of the comb on which the values lie, or None where they lie on none.

    The differences of neighbouring distinct values are whole multiples of the step; it is started
    from the low quantiles of those differences and refined by least squares over growing distances.
    A comb finer than ``FINEST`` standard deviations is none; 98 % of the values must lie within
    0.1 steps of it (0.2 by chance); digits that the storage type adds do not count.

    Parameters
    ----------
    values : (n,) float64

    Returns
    -------
    float or None
        In the values' unit.
    """
    if values.size < 32:
        return None
    spread = float(np.subtract(*np.percentile(values, [84.0, 16.0]))) / 2.0
    distinct = np.unique(values)
    scale = max(spread, float(np.std(np.diff(values))) / np.sqrt(2.0))
    digits = max(1e-9 * float(np.abs(distinct).max()) * 1e-3, SAME * FINEST * scale)
    gaps = np.diff(distinct)
    gaps = gaps[gaps > digits]
    if gaps.size == 0 or gaps.size + 1 > 0.999 * values.size:
        return None  # constant, or hardly a value comes twice
    floor = max(FINEST * scale, digits)
    for quantile in (0.0, 0.02, 0.1, 0.3, 0.5):
        start = float(np.quantile(gaps, quantile, method="lower"))
        step = _refine(values, start) if start > 0.5 * floor else None
        if step is not None and step >= floor:
            return step
    return None


def _refine(values: Floats, start: float) -> float | None:
    """Least-squares step about ``start``, or None where the values do not lie on its comb."""
    low, high = np.quantile(values, [0.01, 0.99])  # hits need not lie on the comb
    middle = float(np.quantile(values, 0.5, method="lower"))  # a median may lie between two steps
    x = np.unique(values[(values >= low) & (values <= high)]) - middle
    x = x[np.argsort(np.abs(x))]
    step = start
    reach = 4.0
    while True:
        near = x[np.abs(x) <= reach * step]
        k = np.rint(near / step)
        if float(k @ k) > 0.0:
            step = float(k @ near / (k @ k))
        if near.size == x.size or reach > 1e7:
            break
        reach *= 2.0
    off = np.abs((values - middle) / step - np.rint((values - middle) / step))
    return step if np.mean(off < 0.1) >= 0.98 else None
