"""Courses that are no step: they take a while, and a step in their place is a wrong name.

A relaxation A (1 - exp(-(t - t0)/T)) after t0, a warming that began before the record among them,
and a ramp that ends.  What is done with after ``SHARE`` of the record, or after ``SHORTEST_S``, has
an edge and is a step.  None of them has a name in the catalogue.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import fft

from imu_noise_id.effects.base import Effect
from imu_noise_id.effects.bias_step import BiasStep
from imu_noise_id.reconcile.prior import given_effects
from imu_noise_id.reconcile.state import Analysis, Column, State, analyse, inverse_psd
from imu_noise_id.reconcile.steps import SHORTEST_S
from imu_noise_id.recording import Floats

SHARE = 0.05
LONGEST = 3.0
"""Length over the record's: of a relaxation, three times its time constant."""
LENGTHS, PLACES = 10, 64
POINTS, ORDINATES = 2048, 512
"""Of the grid on which places and lengths are tried, and of its cosine transform."""


def without_steps(state: State) -> tuple[State, int]:
    """State without the steps that were added to the given model, and their number."""
    kept = tuple(c for c in state.columns if c.given or not isinstance(c.effect, BiasStep))
    return replace(state, columns=kept), len(state.columns) - len(kept)


def best_course(state: State) -> Analysis | None:
    """Best fit with one smooth course beside the state's own columns; None in too short a record.

    Sought as steps are: under what is fitted and under the given model, all slow noise fitted anew
    beside the best place of each.
    """
    span_s = state.values.size * state.sample_time_s
    shortest = max(SHARE, SHORTEST_S / span_s)
    if shortest > 0.5 or state.values.size < 2 * POINTS:
        return None
    bare = analyse(state)
    given = given_effects(bare.fit.effects, state.prior)
    unit = (np.arange(POINTS) + 0.5) / POINTS
    courses = [
        (length, place, form)
        for length in np.geomspace(shortest, LONGEST, LENGTHS)
        for place in np.linspace(-0.5 * min(length, 1.0), 1.0, PLACES, endpoint=False)
        for form in (_ramp, _relaxation)
    ]
    shapes = np.array([form(unit - place, length) for length, place, form in courses])
    scale = float(np.sqrt(state.values.size / POINTS))
    transformed = scale * fft.dct(shapes, norm="ortho")[:, 1:ORDINATES]
    chosen = {_likeliest(transformed, bare, inverse) for inverse in _inverses(bare, given)}
    trials = []
    time = (np.arange(state.values.size) + 0.5) / state.values.size
    for index in sorted(chosen):
        length, place, form = courses[index]
        column = Column(BiasStep(state.start_s + place * span_s, 1.0), form(time - place, length))
        trials.append(analyse(replace(state, columns=(*state.columns, column), effects=given)))
    return max(trials, key=lambda trial: trial.objective)


def _ramp(since: Floats, length: float) -> Floats:
    return np.asarray(np.clip(since / length, 0.0, 1.0))


def _relaxation(since: Floats, length: float) -> Floats:
    return np.asarray(-np.expm1(-np.maximum(since, 0.0) * (3.0 / length)))


def _inverses(found: Analysis, given: tuple[Effect, ...]) -> tuple[Floats, Floats]:
    state = found.state
    n, dt = state.values.size, state.sample_time_s
    return found.inverse_psd, inverse_psd(given, n, dt, state.floor)


def _likeliest(shapes: Floats, found: Analysis, inverse: Floats) -> int:
    """Index of the course of the highest score, the state's own columns beside it free."""
    state = found.state
    root = np.sqrt(inverse[1:ORDINATES] * state.sample_time_s)
    record, tried = found.coefficients[1:ORDINATES] * root, shapes * root
    if state.columns:
        own = np.array([c.coefficients[1:ORDINATES] for c in state.columns]) * root
        basis = np.linalg.qr(own.T)[0]
        record = record - basis @ (basis.T @ record)
        tried = tried - (tried @ basis) @ basis.T
    power = np.sum(tried**2, axis=1)
    return int(np.argmax((tried @ record) ** 2 / np.maximum(power, 1e-12 * power.max())))
