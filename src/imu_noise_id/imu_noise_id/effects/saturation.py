"""Saturation: values beyond the sensor's range come out at its limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, TransformEffect
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class Saturation(TransformEffect):
    """y = min(max(x, -limit), limit), of the values with their mean.

    Attributes
    ----------
    limit : float
        Full scale, in the channel's unit.
    """

    limit: float

    name: ClassVar[str] = "saturation"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("limit", "{u}", True, "Full scale of the output"),
    )

    def apply(
        self, values: Floats, time_s: Floats, sample_time_s: float, rng: np.random.Generator
    ) -> Floats:
        """Clip to the full scale."""
        return np.clip(values, -self.limit, self.limit)


def saturation_limit(values: Floats) -> tuple[float | None, int]:
    """Full scale at which values pile up, with the number of samples that lie there.

    The value of largest magnitude must be taken by more samples (within 1e-9 of it, both signs)
    than its neighbour value explains: at least 5, and 4 times those at the next distinct magnitude
    on the same side.

    Parameters
    ----------
    values : (n,) float64
        Mean included.

    Returns
    -------
    limit : float or None
    samples : int
    """
    if values.size < 32:
        return None, 0
    best: tuple[float | None, int] = (None, 0)
    for sign in (1.0, -1.0):
        side = sign * values
        top = float(side.max())
        if top <= 0.0:
            continue
        below = side[side < top * (1.0 - 1e-9)]
        at_top = values.size - below.size
        if below.size == 0 or at_top < 5:
            continue
        second = float(below.max())
        at_second = int(np.sum(below >= second - 1e-9 * top))
        if at_top >= 4 * at_second and at_top > best[1]:
            best = (top, at_top)
    return best
