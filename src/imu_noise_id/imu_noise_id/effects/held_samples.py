"""Held samples: a value is sent again until the sensor has a new one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from imu_noise_id.effects.base import Parameter, Stage, TransportEffect
from imu_noise_id.recording import Floats

REGULAR = 1.2
"""Messages by which a run may differ from the factor."""


@dataclass(frozen=True)
class HeldSamples(TransportEffect):
    """Message k carries sample ceil(floor(k/factor) factor): a zero-order hold.

    Attributes
    ----------
    factor : float
        Messages per new sample, at least 1; not a whole number where the rates do not divide.
    """

    factor: float

    name: ClassVar[str] = "held_samples"
    stage = Stage.HOLD
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("factor", "1", True, "Messages per new sample"),
    )

    def transport(
        self, stamp_s: Floats, sample_time_s: float, rng: np.random.Generator
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Send every stamp, with the latest sample."""
        k = np.arange(stamp_s.size)
        fresh = np.ceil(np.floor(k / self.factor + 1e-9) * self.factor - 1e-9)
        return stamp_s, fresh.astype(np.int64)


def fresh_samples(values: Floats) -> NDArray[np.bool_]:
    """Which samples differ from their predecessor, the first included; shape (n,)."""
    return np.concatenate(([True], values[1:] != values[:-1]))


def held_factor(values: list[Floats]) -> float:
    """Messages per new sample, from the channels of one topic; 1.0 where none is held.

    A message is held where every channel repeats its value.  With c the fraction of repeats that
    rounding alone explains, and r the fraction seen, the factor is (1 - c)/(1 - r).  The runs of
    equal values must be as long as the factor, give or take one.

    Parameters
    ----------
    values : list of (n,) float64
        Constant channels say nothing and are left out.

    Returns
    -------
    float
        A factor within 2 % of a whole number is that number.
    """
    moving = [v for v in values if v.size > 64 and np.any(v[1:] != v[0])]
    if not moving:
        return 1.0
    # a channel that lost samples of its own (NaN) no longer lies beside the others
    most = max(v.size for v in moving)
    moving = [v for v in moving if v.size == most]
    fresh = np.flatnonzero(np.any([fresh_samples(v) for v in moving], axis=0))
    if fresh.size < 8:
        return 1.0
    lone = 1.0 - chance_repeats(moving)
    runs = np.diff(fresh)
    factor = max(float(runs.mean()) * lone, 1.0)
    if np.mean(np.abs(runs - factor) < REGULAR) < 0.9 * lone**2:
        return 1.0  # repeats that come and go are no hold: interpolation, say
    return float(round(factor)) if abs(factor / round(factor) - 1.0) < 0.02 else factor


def chance_repeats(values: list[Floats]) -> float:
    """Fraction of samples equal in every channel to one far away: what rounding alone repeats."""
    same = [np.all([v[far:] == v[:-far] for v in values], axis=0) for far in (17, 31, 53)]
    return float(np.mean([np.mean(s) for s in same]))
