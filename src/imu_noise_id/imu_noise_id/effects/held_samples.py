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
WHOLE = 0.02
CLOSER = 4
"""Times that the factor and the repeats of rounding are found from one another."""
TOGETHER, APART = 32, 8.0
"""Fewest runs whose sum is looked at, and the variance that it shall have by chance."""


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
    equal values must be as long as the factor, give or take one, and keep time: a slow course that
    is rounded repeats too, now often and now seldom.

    Parameters
    ----------
    values : list of (n,) float64
        Constant channels say nothing and are left out.

    Returns
    -------
    float
        A factor within 2 %, or two standard errors, of a whole number is that number.
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
    runs = np.diff(fresh)
    lone, factor = 1.0, float(runs.mean())
    for _ in range(CLOSER):  # a slow course repeats more often soon than late
        lone = 1.0 - chance_repeats(moving, int(np.ceil(0.95 * factor)))
        factor = max(float(runs.mean()) * lone, 1.0)
    if np.mean(np.abs(runs - factor) < REGULAR) < 0.9 * lone**2:
        return 1.0  # repeats that come and go are no hold: interpolation, say
    if not _keeps_time(runs, factor, lone):
        return 1.0
    near = max(WHOLE, 2.0 * float(np.sqrt((1.0 - lone) / runs.size)))  # of c
    return float(round(factor)) if abs(factor / round(factor) - 1.0) < near else factor


def _keeps_time(runs: NDArray[np.int64], factor: float, lone: float) -> bool:
    """Whether the sums of many runs vary as a hold's do, rather than as those of chance repeats.

    A hold is never more than a message off its time, but for the c = 1 - ``lone`` of its samples
    that rounding hides: m runs have the variance m factor^2 c/(1 - c)^2 of geometric numbers and
    some of the one message.  Repeats at random have m r/(1 - r)^2.
    """
    mean = float(runs.mean())
    each = mean * (mean - 1.0)  # r = 1 - 1/mean
    many = min(int(max(TOGETHER, APART / max(each, 1e-9))), runs.size // 8)
    if many < 2:
        return True
    seen = float(np.var(runs[: runs.size // many * many].reshape(-1, many).sum(axis=1)))
    hold = many * factor**2 * (1.0 - lone) / lone**2 + 1.0
    return seen < 0.5 * (hold + many * each)


def chance_repeats(values: list[Floats], apart: int) -> float:
    """Fraction of samples equal in every channel to one that is no hold away: by rounding alone."""
    apart = min(apart, values[0].size - 2)
    same = [np.all([v[far:] == v[:-far] for v in values], axis=0) for far in (apart, apart + 1)]
    return float(np.mean([np.mean(s) for s in same]))
