"""One innovations model for all axes of a sensor, by the canonical correlations of their pasts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imu_noise_id import joint_innovations
from imu_noise_id.canonical_variates import (
    SCALE,
    SHORTEST,
    StateSpace,
    blocks_of,
    centred,
    regressed,
    scan,
)
from imu_noise_id.recording import Floats
from imu_noise_id.series import Series

JOINT_ROWS = 1 << 17
"""Rows at most from which a joint model is refined."""
MOST_STATES = 6


@dataclass(frozen=True)
class Joint:
    """One innovations model for several channels (the axes of a sensor), see ``Cca``."""

    order: int
    canonical_correlations: Floats
    chance_level: float
    significant: bool
    state_space: StateSpace
    rows: int
    block: int
    notes: tuple[str, ...] = ()


def joint(channels: tuple[Series, ...], order: int | None = None) -> Joint:
    """One innovations model of several channels on the same grid.

    The state is the canonical variates at the scale that stands highest above chance; A, C, K come
    by regression and are refined by Gauss and Newton on ln det of the innovations' covariance over
    at most ``JOINT_ROWS`` rows of that scale.

    Parameters
    ----------
    channels : tuple of Series
        Of one grid; a sample counts where all of them were observed.
    order : int, optional

    Raises
    ------
    ValueError
        When too few samples were observed on all channels, or one is constant.
    """
    observed = np.logical_and.reduce([channel.observed for channel in channels])
    if observed.sum() < SHORTEST * len(channels):
        raise ValueError(f"{int(observed.sum())} samples observed on all channels are too few")
    values = np.stack([centred(channel.values, observed) for channel in channels], axis=1)
    sigma = np.sqrt(np.mean(values[observed] ** 2, axis=0))
    if not np.all(sigma > 0.0):
        raise ValueError("a channel is constant")
    best = max(scan(values / sigma, observed), key=lambda c: c.excess)
    states = int(np.sum(best.values > best.chance_level)) if order is None else order
    states = min(states, MOST_STATES)
    means, seen = values / sigma, observed
    for _ in range(round(np.log(best.block) / np.log(SCALE))):
        means, seen = blocks_of(means, seen, SCALE)
    start = regressed(best, states, channels[0].sample_time_s * best.block)
    A, C, K, covariance = joint_innovations.maximise(
        means[:JOINT_ROWS], seen[:JOINT_ROWS], start.A, start.C, start.K
    )
    notes = []
    if best.block > 1:
        notes.append(f"model of the means of {best.block} samples, where the slow state shows")
    scaled = StateSpace(
        A, sigma[:, None] * C, K / sigma, covariance * np.outer(sigma, sigma), start.sample_time_s
    )
    return Joint(
        order=states,
        canonical_correlations=best.values,
        chance_level=best.chance_level,
        significant=best.excess > 1.0,
        state_space=scaled,
        rows=best.rows,
        block=best.block,
        notes=tuple(notes),
    )


def warm_up() -> None:
    """Compile what the model needs into numba's cache, for a build to call."""
    rng = np.random.default_rng(0)
    channels = tuple(
        Series(rng.standard_normal(400), np.ones(400, dtype=bool), 1.0) for _ in range(2)
    )
    joint(channels, order=1)
