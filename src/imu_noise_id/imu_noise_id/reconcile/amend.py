"""What the given model has: refits with other values, and removals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from imu_noise_id.effects.base import Effect, ResponseEffect
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.effects.random_telegraph import RandomTelegraph
from imu_noise_id.reconcile.candidate import (
    PRICE_PER_PARAMETER,
    Candidate,
    candidate_of,
    rows_of,
)
from imu_noise_id.reconcile.compare import freed_column, residual_of
from imu_noise_id.reconcile.prior import (
    FREE_STD_ERROR,
    SLOW,
    Prior,
    UnseenDrift,
    given_effects,
    without,
)
from imu_noise_id.reconcile.result import REFIT, REMOVE
from imu_noise_id.reconcile.state import Analysis, State
from imu_noise_id.recording import Floats
from imu_noise_id.selection import RESPONSES
from imu_noise_id.whittle import spectrum_of

SAME_TIME = float(np.log(2.0))
"""Logarithm of the ratio of two memories whose sum is not told from one."""


def same_noise(new: Effect, given: tuple[Effect, ...]) -> bool:
    """Whether a noise overlaps one that is given: then that one is to be refitted, not doubled.

    Bands by their widths, exponentials by their times: within a factor of two the sum of both has
    the spectrum of one.
    """
    if isinstance(new, NarrowBand):
        bands = [e for e in given if isinstance(e, NarrowBand)]
        apart = [abs(new.frequency_hz - e.frequency_hz) for e in bands]
        reach = [new.bandwidth_hz + e.bandwidth_hz for e in bands]
        return any(a < r for a, r in zip(apart, reach, strict=True))
    if isinstance(new, GaussMarkov):
        times = [e.correlation_time_s for e in given if isinstance(e, GaussMarkov)]
        times += [0.5 * e.mean_dwell_s for e in given if isinstance(e, RandomTelegraph)]
        return any(abs(np.log(new.correlation_time_s / t)) < SAME_TIME for t in times)
    return False


def refits(state: State, found: Analysis) -> list[Candidate]:
    """Let go of one of the model's effects at a time."""
    out = []
    for index, effect in enumerate(found.fit.effects):
        rows = [r for r in rows_of(state, index) if r < state.prior.centre.size]
        if not rows or not np.any(state.prior.std_error < FREE_STD_ERROR):
            continue
        price = PRICE_PER_PARAMETER * len(rows)
        freed = replace(state, effects=found.fit.effects, prior=without(state.prior, rows))
        starts = (effect, *_other_windows(state, found, index))
        states = [replace(freed, effects=_with(freed, index, start)) for start in starts]
        pairs = zip(starts, states, strict=True)
        trials = [candidate_of(REFIT, start, price, found, begun) for start, begun in pairs]
        trial = max(trials, key=lambda c: c.gain)
        moved, others = trial.found.fit.effects[index], _without(state.effects, index)
        if same_noise(effect, others) or not same_noise(moved, others):
            out.append(replace(trial, effect=moved))
    for index, column in enumerate(state.columns):
        if column.given and np.isfinite(column.std_error):
            freed = replace(freed_column(state, index), effects=found.fit.effects)
            trial = candidate_of(REFIT, column.effect, PRICE_PER_PARAMETER, found, freed)
            effect = _sized(column.effect, float(trial.found.sizes[index]))
            out.append(replace(trial, effect=effect))
    return out


def _other_windows(state: State, found: Analysis, index: int) -> list[ResponseEffect]:
    """Far starts for a filter of the model, whose likelihood has several maxima; of any form."""
    given = given_effects(found.fit.effects, state.prior)
    now = given[index]
    if not isinstance(now, ResponseEffect):
        return []
    f, dt = found.ordinates.frequency_hz, state.sample_time_s
    beneath = spectrum_of(_without(given, index), f, dt, state.floor).psd
    kinds = [kind for kind in RESPONSES if kind.name == now.name]
    starts = [s for kind in kinds for s in likely_starts(kind, state, found, beneath)]
    return [s for s in starts if s.free() == now.free()]


def _with(state: State, index: int, effect: Effect) -> tuple[Effect, ...]:
    return (*state.effects[:index], effect, *state.effects[index + 1 :])


def _without(effects: tuple[Effect, ...], index: int) -> tuple[Effect, ...]:
    return effects[:index] + effects[index + 1 :]


def _sized(effect: Effect, size: float) -> Effect:
    """A course with its last parameter, to which it is proportional, set."""
    return effect.replace(**{effect.parameters[-1].name: size})


def likely_starts(
    kind: type[ResponseEffect], state: State, found: Analysis, beneath: Floats
) -> list[ResponseEffect]:
    """Best start of every order of a filter upon a spectrum (b,) whose level is free.

    A corner fits the wrong order better than a far one its own.
    """
    f, dt = found.ordinates.frequency_hz, state.sample_time_s
    ranked = []
    for start in kind.starts(residual_of(state, found)):
        relative = beneath * start.power_response(f, dt)
        level = found.ordinates.dof @ (found.ordinates.power / relative)
        level /= found.ordinates.dof.sum()
        misfit = found.ordinates.power / (relative * level)
        loss = 0.5 * float(found.ordinates.dof @ (np.log(relative * level) + misfit))
        ranked.append((loss, start))
    ranked.sort(key=lambda item: -item[0])
    return list({getattr(start, "order", 0.0): start for _, start in ranked}.values())


def removals(state: State, found: Analysis) -> list[Candidate]:
    """Leave out one of the model's effects; worth it where its absence explains more."""
    out = []
    given = given_effects(found.fit.effects, state.prior)
    for index, effect in enumerate(given):
        rows = rows_of(state, index)
        in_prior = [r for r in rows if r < state.prior.centre.size]
        if not in_prior or len(found.fit.effects) < 2:
            continue
        effects = _without(found.fit.effects, index)
        if not any(e.name in ("white_noise", "quantization") for e in effects):
            continue
        prior = _marginal(state, in_prior)
        # what the others were fitted to with it may be far from what they are without it
        starts = [effects, _without(given, index)]
        if prior.drift is not None and effect.name in SLOW:
            # nor may the room for drift take over, unsaid, what is no more in the model
            prior = replace(prior, drift=None)
            starts = [tuple(e for e in some if not isinstance(e, UnseenDrift)) for some in starts]
        without_it = [replace(state, effects=start, prior=prior) for start in starts]
        tried = [candidate_of(REMOVE, effect, 0.0, found, start) for start in without_it]
        out.append(replace(max(tried, key=lambda c: c.gain), effect=effect))
    for index, column in enumerate(state.columns):
        if column.given:
            columns = state.columns[:index] + state.columns[index + 1 :]
            fewer = replace(state, columns=columns, effects=found.fit.effects)
            gone = _sized(column.effect, column.size)
            out.append(candidate_of(REMOVE, gone, 0.0, found, fewer))
    return out


def _marginal(state: State, rows: list[int]) -> Prior:
    """Prior of the parameters that stay when ``rows`` leave the model."""
    prior = without(state.prior, rows)
    keep = np.setdiff1d(np.arange(prior.centre.size), rows)
    inside = np.flatnonzero(np.any(prior.axes[keep] != 0.0, axis=0)) if keep.size else keep
    return replace(
        prior,
        centre=prior.centre[keep],
        axes=prior.axes[np.ix_(keep, inside)],
        std_error=prior.std_error[inside],
    )
