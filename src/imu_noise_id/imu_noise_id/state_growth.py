"""One more state for an innovations model: found in its innovations, refined by likelihood.

The new state (or complex pair) comes from the canonical variates of the innovations of the model so
far, is put in cascade with it, and all is refined by exact likelihood at the full rate.  It stays
if it gains more than the best of all states gains on white noise in 99 % of records (``chance``).
The likelihood decides, not the correlation: the lagged products of 20 block means are a test of
hundreds of directions, and a weak slow state that the likelihood shows stays below their level.
"""

from __future__ import annotations

import numpy as np

from imu_noise_id import innovations
from imu_noise_id.canonical_variates import Correlations, StateSpace, regressed
from imu_noise_id.chance import gain_by_chance
from imu_noise_id.innovations import Innovations
from imu_noise_id.recording import Floats, Mask

CLIMB_ROWS = 1 << 18
"""Samples from which a new state is refined: the leading ones, or its block means if it is slow."""
MANY_STARTS = 1 << 16
"""Samples up to which several starts of a first-order model are refined."""


def grow(
    values: Floats,
    observed: Mask,
    model: Innovations,
    found: list[Correlations],
    room: int,
    forced: bool = False,
) -> Innovations | None:
    """Put the new state in cascade with the model, refine, return the best for its states.

    ``found`` are the correlations of the model's innovations at every scale.
    A state that is ``forced`` is refined to the end; another one only while it may yet stay.
    """
    by_order: dict[int, list[tuple[Floats, Floats]]] = {}
    blocks: dict[int, list[int]] = {}
    for scale in found:
        for phi, theta in _starts(scale, room, observed):
            poles = innovations.admissible(np.asarray(np.polymul(model.phi, phi), float))
            zeros = innovations.admissible(np.asarray(np.polymul(model.theta, theta), float))
            by_order.setdefault(poles.size, []).append((poles, zeros))
            blocks.setdefault(poles.size, []).append(scale.block)
    chosen: list[tuple[Innovations, int]] = []
    for size, same in by_order.items():
        candidates = innovations.evaluate_all(values, observed, same)
        ranked = sorted(zip(candidates, blocks[size], strict=True), key=lambda c: c[0].deviance)
        chosen += ranked[: 3 if size == 2 and values.size <= MANY_STARTS else 1]
    refined = [
        _refined(values, observed, model, start, block, forced)
        for start, block in chosen
        if np.isfinite(start.deviance)
    ]
    return min(refined, key=lambda grown: _charged(grown, model.order), default=None)


def likelier(grown: Innovations, model: Innovations) -> bool:
    """Whether the states that were added gain more than white noise gives away by chance."""
    return _charged(grown, model.order) < model.deviance


def _charged(grown: Innovations, order: int) -> float:
    """Deviance of a model with more states than ``order``, and what they gain by chance."""
    return grown.deviance + gain_by_chance(grown.observed, grown.order - order)


def _starts(found: Correlations, room: int, observed: Mask) -> list[tuple[Floats, Floats]]:
    """Polynomials at the full rate of one more state, and of a pair where lags are samples."""
    pair = found.block == 1 and found.values[1:2] > found.chance_level
    orders = range(1, min(2 if pair else 1, room) + 1)
    starts = [_polynomials(regressed(found, order, 1.0)) for order in orders]
    if found.block == 1:
        return starts
    if _too_slow(found.block, observed):
        means = found.means[:, 0]
        coarse = innovations.evaluate(means, found.observed, *starts[0])
        climbed = innovations.maximise(means, found.observed, coarse)
        starts = [(climbed.phi, climbed.theta)]
    return [_finer(phi, theta, found.block) for phi, theta in starts if 0.0 < -phi[1] < 1.0]


def _too_slow(block: int, observed: Mask) -> bool:
    """Whether the leading samples from which a state is refined do not show it."""
    return bool(observed.sum() > CLIMB_ROWS and block > CLIMB_ROWS >> 10)


def _polynomials(space: StateSpace) -> tuple[Floats, Floats]:
    """Phi and theta of a model with one output."""
    phi = np.poly(space.A) if space.A.size else np.ones(1)
    theta = np.poly(space.A - space.K @ space.C) if space.A.size else np.ones(1)
    return innovations.stable(np.real(phi)), innovations.stable(np.real(theta))


def _finer(phi: Floats, theta: Floats, block: int) -> tuple[Floats, Floats]:
    """First-order polynomials of block means, at the rate of the samples."""
    gain = theta.sum() / phi.sum()  # at zero frequency, whatever the rate
    pole = (-phi[1]) ** (1.0 / block)
    zero = np.clip(1.0 - (1.0 - pole) * gain, -0.99, 1.0 - 1e-9)
    return np.array([1.0, -pole]), np.array([1.0, -zero])


def _refined(
    values: Floats,
    observed: Mask,
    model: Innovations,
    start: Innovations,
    block: int,
    forced: bool,
) -> Innovations:
    """Climb from a start, its new state found in blocks of that size."""
    asked = -np.inf if forced else gain_by_chance(start.observed, start.order - model.order)
    if observed.sum() <= CLIMB_ROWS:
        return innovations.maximise(values, observed, start, reach=model.deviance - asked)
    if _too_slow(block, observed):
        return start
    end = CLIMB_ROWS
    while short := CLIMB_ROWS - int(observed[:end].sum()):
        end += short
    part, seen = values[:end], observed[:end]
    before = innovations.evaluate(part, seen, model.phi, model.theta)
    share = before.observed / start.observed
    reach = before.deviance - share * asked
    climbed = innovations.maximise(part, seen, start, reach=reach)
    return innovations.evaluate(values, observed, climbed.phi, climbed.theta)
