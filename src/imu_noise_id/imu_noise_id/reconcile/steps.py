"""Where a level jumps, weighed beside slow noise that could have carried the record there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from imu_noise_id.effects.bias_step import BiasStep
from imu_noise_id.reconcile.prior import given_effects
from imu_noise_id.reconcile.state import Analysis, State, analyse, course_column, inverse_psd
from imu_noise_id.recording import Floats

EDGE_SHARE = 200
EDGE_SAMPLES = 16
WORTH_A_CLOSER_LOOK = 4.0


@dataclass(frozen=True)
class StepTrial:
    """The best step of a record, all slow noise fitted anew beside it.

    Attributes
    ----------
    time_s : float
    height : float
    gain : float
        Nats of the objective over no step.
    state, found : State, Analysis
        With the step as the last column.
    """

    time_s: float
    height: float
    gain: float
    state: State
    found: Analysis


def step_scores(
    coefficients: Floats, inverse: Floats, sample_time_s: float
) -> tuple[Floats, Floats, float]:
    """Score of a step before every sample, by generalised least squares.

    z(t) = s_t' V^-1 y / sqrt(s_t' V^-1 s_t), V diagonal in the DCT-II.  The numerator is a reversed
    sum of V^-1 y; the denominator, with the DCT of a step, -sin(pi k t/n)/(sqrt(2 n)
    sin(pi k/2n)), is a cosine sum in k.

    Parameters
    ----------
    coefficients, inverse : (n,) float64
        DCT-II of the record and 1/S.
    sample_time_s : float

    Returns
    -------
    z : (n - 1,) float64
        For a step between samples t and t + 1, t = 0 ... n - 2.
    power : (n - 1,) float64
        The denominator squared.
    increment : float
        Variance of the numerator's difference from one sample to the next.
    """
    n = coefficients.size
    weight = inverse * sample_time_s
    v = fft.idct(coefficients * weight, norm="ortho")
    numerator = np.cumsum(v[::-1])[::-1][1:]
    k = np.arange(1, n)
    a = weight[1:] / (2.0 * n * np.sin(0.5 * np.pi * k / n) ** 2)
    # sum_k a_k sin^2(pi k t/n) = (sum a - sum a cos(2 pi k t/n))/2
    spectrum = fft.rfft(np.concatenate(([0.0], a)))
    cosine = np.empty(n)
    cosine[: spectrum.size] = spectrum.real
    cosine[spectrum.size :] = spectrum.real[1 : n - spectrum.size + 1][::-1]
    power = np.maximum(0.5 * (a.sum() - cosine[1:]), 1e-300)
    return numerator / np.sqrt(power), power, float(weight.mean())


def best_step(state: State, found: Analysis) -> StepTrial:
    """The step that gains most, all slow noise fitted anew beside it.

    Slow noise that floats grows to hold a step, and then hides it.  So its place is sought under
    the model as given too, and every fit starts from there, with the step already taken out.
    """
    n, dt = found.coefficients.size, state.sample_time_s
    given = inverse_psd(given_effects(found.fit.effects, state.prior), n, dt, state.floor)
    times = {_place(found.coefficients, inverse, state) for inverse in (found.inverse_psd, given)}
    best = max((_trial(state, found, t) for t in sorted(times)), key=lambda trial: trial.gain)
    if best.gain < WORTH_A_CLOSER_LOOK:
        return best
    shape = np.asarray(fft.dct(best.state.columns[-1].shape, norm="ortho"))
    with_step = best.found.coefficients + best.height * shape
    moved = _place(with_step, best.found.inverse_psd, state)
    if moved not in times:
        best = max(best, _trial(state, found, moved), key=lambda trial: trial.gain)
    return best


def scan_density(state: State, found: Analysis) -> float:
    """Sum of 1 - correlation of neighbouring step scores: how many places a scan has."""
    z, power, increment = step_scores(found.coefficients, found.inverse_psd, state.sample_time_s)
    power = power[_inner(z.size)]
    correlation = 0.5 * (power[1:] + power[:-1] - increment) / np.sqrt(power[1:] * power[:-1])
    return float(np.sum(1.0 - np.clip(correlation, -1.0, 1.0)))


def _inner(size: int) -> slice:
    edge = max(EDGE_SAMPLES, size // EDGE_SHARE)
    return slice(edge, size - edge)


def _place(coefficients: Floats, inverse: Floats, state: State) -> float:
    z, _, _ = step_scores(coefficients, inverse, state.sample_time_s)
    inner = _inner(z.size)
    at = inner.start + int(np.argmax(np.abs(z[inner])))
    return state.start_s + (at + 1) * state.sample_time_s


def _trial(state: State, found: Analysis, time_s: float) -> StepTrial:
    column = course_column(BiasStep(time_s, 1.0), state, "height")
    effects = given_effects(found.fit.effects, state.prior)
    grown = replace(state, columns=(*state.columns, column), effects=effects)
    fitted = analyse(grown)
    gain = fitted.objective - found.objective
    grown = replace(grown, effects=fitted.fit.effects)
    return StepTrial(time_s, float(fitted.sizes[-1]), gain, grown, fitted)
