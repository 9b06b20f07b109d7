"""Saturation: values beyond the sensor's range come out at its limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, TransformEffect
from imu_noise_id.recording import Floats

BEYOND = 0.01
"""Samples beyond a full scale, over those that lie on it, that hits may have put there."""


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

    The value of largest magnitude must be taken by more samples (within 1e-9 of it) than its
    neighbour value explains: at least 5, and 4 times those at the next distinct magnitude on the
    same side.  A full scale holds on both sides: where the other one goes beyond, none.

    Parameters
    ----------
    values : (n,) float64
        Mean included.

    Returns
    -------
    limit : float or None
    samples : int
    """
    top, count = _most_piled(values)
    beyond = int(np.sum(np.abs(values) > abs(top) * (1.0 + 1e-9)))
    return (abs(top), count) if beyond <= BEYOND * count else (None, 0)


def one_sided_limit(values: Floats) -> float | None:
    """Value at which one side piles up while the other goes beyond: no full scale does that."""
    top, count = _most_piled(values)
    return top if count and saturation_limit(values)[0] is None else None


def _most_piled(values: Floats) -> tuple[float, int]:
    """Extreme value at which most samples pile up, with its sign, and their number; 0, 0 if none.

    On either side of the middle, that of the mean included: a full scale about zero, or another.
    """
    best = (0.0, 0)
    if values.size < 32:
        return best
    for sign in (1.0, -1.0):
        side = sign * values
        top, scale = float(side.max()), float(np.abs(values).max())
        below = side[side < top - 1e-9 * scale]
        at_top = values.size - below.size
        if below.size == 0 or at_top < 5:
            continue
        second = float(below.max())
        at_second = int(np.sum(below >= second - 1e-9 * scale))
        if at_top >= 4 * at_second and at_top > best[1]:
            best = (sign * top, at_top)
    return best
