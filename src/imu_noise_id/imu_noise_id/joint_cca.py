"""One innovations model for all axes of a sensor, by the canonical correlations of their pasts.

As for one channel (``cca``), states are added one (or a complex pair) at a time.  A new state is
fitted to block means of the innovations of the model so far, at the scales that stand highest above
chance, is put in cascade at the full rate, and stays if it gains more likelihood than white noise
gives away by chance, in those means and in the whole:

    x1' = A1 x1 + K1 (C2 x2 + e),   x2' = A2 x2 + K2 e,   y = C1 x1 + C2 x2 + e.

A state of block means with pole a becomes one of samples with pole a^(1/block) and the same gain at
zero frequency, I + C (1 - a)^-1 K.  The whole model is then refined by likelihood.  Of a record of
more than ``WHOLE_ROWS`` samples the block means are modelled so, without pairs (a vibration would
be folded), and the model is brought to the rate of the samples in the same way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from imu_noise_id import joint_innovations
from imu_noise_id.canonical_variates import (
    SCALE,
    SHORTEST,
    Correlations,
    StateSpace,
    blocks_of,
    centred,
    regressed,
    scan,
)
from imu_noise_id.chance import gain_by_chance
from imu_noise_id.recording import Floats, Mask
from imu_noise_id.series import Series
from imu_noise_id.spectrum import block_means

JOINT_ROWS = 1 << 17
"""Rows at most from which correlations are taken and a new state is fitted."""
WHOLE_ROWS = 1 << 16
"""Rows at most that are modelled: samples, or block means of a longer record."""
MOST_STATES = 6
SCALES_TRIED = 3
"""Scales whose states are fitted, the highest above chance first."""
STEPS = 5
"""Of the refinement of the whole model after each new state."""


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

    Parameters
    ----------
    channels : tuple of Series
        Of one grid; a sample counts where all of them were observed.
    order : int, optional
        Number of states; chosen where left out.

    Raises
    ------
    ValueError
        When too few samples were observed on all channels, or one is constant.
    """
    values, observed, block = _rows(channels)
    sigma = np.sqrt(np.mean(values[observed] ** 2, axis=0))
    if not np.all(sigma > 0.0):
        raise ValueError("a channel is constant")
    values = values / sigma
    first = found = _search(values, observed)
    model, rest = _white(values, observed, channels[0].sample_time_s * block), values
    most, pair = (MOST_STATES if order is None else order), 2 if block == 1 else 1
    while model.A.shape[0] < most:
        room = min(pair, most - model.A.shape[0])
        state = _next_state(rest, observed, found, room, order is not None)
        if state is None:
            break
        grown, rest = _with_state(values, observed, model, state)
        if order is None and not _likelier(grown, model, int(observed.sum())):
            break
        model, found = grown, _search(rest, observed)
    slow = f"slow states alone, of means of {block} samples: faster ones stand in one axis's model"
    return Joint(
        order=model.A.shape[0],
        canonical_correlations=first[0].values,
        chance_level=first[0].chance_level,
        significant=first[0].excess > 1.0,
        state_space=_at_samples(_in_units(model, sigma), block),
        rows=first[0].rows,
        block=first[0].block * block,
        notes=() if block == 1 else (slow,),
    )


def _rows(channels: tuple[Series, ...]) -> tuple[Floats, Mask, int]:
    """Centred samples, or means of blocks of a long record, (n, d); which count; the block."""
    observed = np.logical_and.reduce([channel.observed for channel in channels])
    if observed.sum() < SHORTEST * len(channels):
        raise ValueError(f"{int(observed.sum())} samples observed on all channels are too few")
    block = 1
    while observed.size > block * WHOLE_ROWS:
        block *= SCALE
    means = [
        block_means(Series(centred(channel.values, observed), observed, 1.0), block)
        for channel in channels
    ]
    return np.stack([mean.values for mean in means], axis=1), means[0].observed, block


def _at_samples(model: StateSpace, block: int) -> StateSpace:
    """Model of block means at the rate of the samples: A^(1/block), the same density at zero."""
    if block == 1 or not model.A.size:
        fine, K = model.A, model.K
    else:
        poles, vectors = np.linalg.eig(model.A.astype(complex))
        poles = np.where((poles.imag == 0.0) & (poles.real < 0.0), -poles, poles)
        root = np.diag(poles ** (1.0 / block))
        fine = np.real(vectors @ root @ np.linalg.inv(vectors))
        one = np.eye(fine.shape[0])
        K = (one - fine) @ np.linalg.solve(one - model.A, model.K)
    return StateSpace(
        fine, model.C, K, model.innovation_covariance * block, model.sample_time_s / block
    )


def _search(values: Floats, observed: Mask) -> list[Correlations]:
    """Correlations of all channels at every scale, the highest above chance first."""
    return sorted(scan(values, observed, JOINT_ROWS), key=lambda c: -c.excess)


def _white(values: Floats, observed: Mask, sample_time_s: float) -> StateSpace:
    """Model without a state."""
    d = values.shape[1]
    none, covariance = np.zeros((0, 0)), _covariance(values, observed)
    return StateSpace(none, np.zeros((d, 0)), np.zeros((0, d)), covariance, sample_time_s)


def _covariance(rest: Floats, observed: Mask) -> Floats:
    return np.asarray(rest[observed].T @ rest[observed] / observed.sum())


def _next_state(
    rest: Floats, observed: Mask, found: list[Correlations], room: int, forced: bool
) -> StateSpace | None:
    """Find the state or pair that gains most beyond chance, at the rate of the samples.

    Gains in block means say whether there is a state; which of two is the stronger they do not, for
    means of other blocks are other data.
    """
    best, most = None, -np.inf
    for order in range(1, room + 1):
        starts = [_start(rest, observed, scale, order) for scale in found[:SCALES_TRIED]]
        known = [start for start in starts if start is not None]
        if not known:
            continue
        start = max(known, key=lambda start: start.gain)
        state, gain = _fitted(start)
        price = gain_by_chance(int(start.seen.sum()), order, rest.shape[1])
        finer = _finer(state, start.block)
        if finer is None or (gain < price and not forced):
            continue
        left = joint_innovations.residuals(rest, observed, finer.A, finer.C, finer.K)
        net = _gain(rest, observed, _covariance(left, observed)) - price
        if net > most:
            best, most = finer, net
    return best


@dataclass(frozen=True)
class _Start:
    """State of block means by regression, the means, and its gain in deviance over none."""

    state: StateSpace
    means: Floats
    seen: Mask
    block: int
    gain: float


def _start(rest: Floats, observed: Mask, scale: Correlations, order: int) -> _Start | None:
    """Start from a scale; a pair only where blocks are samples."""
    if order > 1 and (scale.block > 1 or scale.values.size < order):
        return None
    state = regressed(scale, order, 1.0)
    if _finer(state, scale.block) is None:
        return None
    means, seen = _means(rest, observed, scale.block)
    left = joint_innovations.residuals(means, seen, state.A, state.C, state.K)
    gain = _gain(means, seen, _covariance(left, seen))
    return _Start(state, means, seen, scale.block, gain)


def _gain(means: Floats, seen: Mask, after: Floats) -> float:
    """Gain in deviance of innovations of that covariance over none."""
    logarithms = [np.linalg.slogdet(S)[1] for S in (_covariance(means, seen), after)]
    return float(seen.sum() * (logarithms[0] - logarithms[1]))


def _means(values: Floats, observed: Mask, block: int) -> tuple[Floats, Mask]:
    """Leading block means, averaged in the steps of the scan."""
    means, seen = values[: JOINT_ROWS * block], observed[: JOINT_ROWS * block]
    for _ in range(round(np.log(block) / np.log(SCALE))):
        means, seen = blocks_of(means, seen, SCALE)
    return means, seen


def _fitted(start: _Start) -> tuple[StateSpace, float]:
    """State refined on the rows it was found in, and its gain in deviance over none."""
    means, seen, first = start.means, start.seen, start.state
    A, C, K, covariance = joint_innovations.maximise(means, seen, first.A, first.C, first.K)
    return StateSpace(A, C, K, covariance, 1.0), _gain(means, seen, covariance)


def _finer(state: StateSpace, block: int) -> StateSpace | None:
    """State of block means at the rate of the samples; None where there is none."""
    if not joint_innovations.stable_both_ways(state.A, state.C, state.K):
        return None
    if state.A.shape[0] == 2 and not np.iscomplex(np.linalg.eigvals(state.A)).any():
        return None  # two real states come one by one
    if block == 1:
        return state
    pole = float(state.A[0, 0])
    if pole <= 0.0:
        return None
    fine = pole ** (1.0 / block)
    A, K = np.array([[fine]]), state.K * (1.0 - fine) / (1.0 - pole)
    known = joint_innovations.stable_both_ways(A, state.C, K)
    return replace(state, A=A, K=K) if known else None


def _with_state(
    values: Floats, observed: Mask, model: StateSpace, state: StateSpace
) -> tuple[StateSpace, Floats]:
    """Put a state in cascade with a model, refine; the model and its innovations."""
    none = np.zeros((state.A.shape[0], model.A.shape[0]))
    A = np.block([[model.A, model.K @ state.C], [none, state.A]])
    C, K = np.hstack((model.C, state.C)), np.vstack((model.K, state.K))
    A, C, K, _ = joint_innovations.maximise(values, observed, A, C, K, STEPS)
    rest = joint_innovations.residuals(values, observed, A, C, K)
    return StateSpace(A, C, K, _covariance(rest, observed), model.sample_time_s), rest


def _likelier(grown: StateSpace, model: StateSpace, samples: int) -> bool:
    """Whether the whole record gains more from the new states than white noise does by chance."""
    before, after = (np.linalg.slogdet(m.innovation_covariance)[1] for m in (model, grown))
    added = grown.A.shape[0] - model.A.shape[0]
    gain = samples * (before - after)
    return bool(gain > gain_by_chance(samples, added, model.C.shape[0]))


def _in_units(model: StateSpace, sigma: Floats) -> StateSpace:
    """Model of channels that were divided by their standard deviations."""
    return replace(
        model,
        C=sigma[:, None] * model.C,
        K=model.K / sigma,
        innovation_covariance=model.innovation_covariance * np.outer(sigma, sigma),
    )


def warm_up() -> None:
    """Compile what the model needs into numba's cache, for a build to call."""
    rng = np.random.default_rng(0)
    channels = tuple(
        Series(rng.standard_normal(400), np.ones(400, dtype=bool), 1.0) for _ in range(2)
    )
    joint(channels, order=1)
