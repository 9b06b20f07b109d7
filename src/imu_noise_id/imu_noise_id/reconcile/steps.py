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
SHORTEST_S = 20.0
"""What takes longer is a smooth course."""
EDGE_PRICE = 3.0
"""Nats, for the length of an edge: a parameter."""
SOME = 2048
"""Ordinates that tell which edges matter."""
SHARP = 0.9
"""Of what an edged step explains, where a sharp one in its place explains so much."""


@dataclass(frozen=True)
class StepTrial:
    """The best step of a record, all slow noise fitted anew beside it.

    Attributes
    ----------
    time_s : float
        Of the middle of its edge.
    height : float
    gain : float
        Nats of the objective over no step, less the price of an edge.
    state, found : State, Analysis
        With the step as the last column.
    """

    time_s: float
    height: float
    gain: float
    state: State
    found: Analysis


def step_scores(
    coefficients: Floats, inverse: Floats, sample_time_s: float, edge: int = 1
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
    edge : int
        Samples over which the step is averaged twice; 1 for a sharp one.

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
    k = np.arange(1.0, n)
    course = np.append(1.0, np.ones(n - 1) if edge == 1 else _of_an_edge(edge, n, k))
    v = fft.idct(coefficients * weight * course, norm="ortho")
    numerator = np.cumsum(v[::-1])[::-1][1:]
    a = _energies(weight[1:], n, k) * course[1:] ** 2
    # sum_k a_k sin^2(pi k t/n) = (sum a - sum a cos(2 pi k t/n))/2
    spectrum = fft.rfft(np.concatenate(([0.0], a)))
    cosine = np.empty(n)
    cosine[: spectrum.size] = spectrum.real
    cosine[spectrum.size :] = spectrum.real[1 : n - spectrum.size + 1][::-1]
    power = np.maximum(0.5 * (a.sum() - cosine[1:]), 1e-300)
    return numerator / np.sqrt(power), power, float(np.mean(weight * course**2))


def _energies(weight: Floats, n: int, k: Floats) -> Floats:
    """Of a sharp step at the ordinates k, over sin^2(pi k t/n)."""
    return np.asarray(weight / (2.0 * n * np.sin(0.5 * np.pi * k / n) ** 2))


def _of_an_edge(edge: int, n: int, k: Floats) -> Floats:
    """DCT of a step that is averaged twice over ``edge`` samples, over that of a sharp one.

    Of sines that are averaged over their phase: Dirichlet's kernel, once an average.
    """
    half = 0.5 * np.pi * k / n
    return np.asarray((np.sin(edge * half) / (edge * np.sin(half))) ** 2)


def telling_edges(inverse: Floats, longest: int) -> list[int]:
    """Lengths of edges in samples, of which each explains what the one before does not.

    In white noise a sharp step in the place of an edged one explains nearly all of it.  In noise
    that is a walk from one sample to the next it explains the part of one increment.

    Parameters
    ----------
    inverse : (n,) float64
        1/S at the DCT ordinates.
    longest : int
    """
    n = inverse.size
    k = np.unique(np.rint(np.geomspace(1.0, n - 1.0, SOME)))
    energies = _energies(inverse[k.astype(np.int64)], n, k) * np.gradient(k)
    out, last = [1], np.ones(k.size)
    edge = 2
    while edge <= longest:
        course = _of_an_edge(edge, n, k)
        both = float(energies @ (last * course)) ** 2
        if both < SHARP * float(energies @ last**2) * float(energies @ course**2):
            out.append(edge)
            last = course
        edge *= 2
    return out


def best_step(state: State, found: Analysis) -> StepTrial:
    """The step that gains most, all slow noise fitted anew beside it.

    Slow noise that floats grows to hold a step, and then hides it.  So its place is sought under
    the model as given too, and every fit starts from there, with the step already taken out.
    """
    n, dt = found.coefficients.size, state.sample_time_s
    given = inverse_psd(given_effects(found.fit.effects, state.prior), n, dt, state.floor)
    places = {_place(found.coefficients, inverse, state) for inverse in (found.inverse_psd, given)}
    best = max((_trial(state, found, *p) for p in sorted(places)), key=lambda trial: trial.gain)
    if best.gain < WORTH_A_CLOSER_LOOK:
        return best
    shape = np.asarray(fft.dct(best.state.columns[-1].shape, norm="ortho"))
    with_step = best.found.coefficients + best.height * shape
    moved = _place(with_step, best.found.inverse_psd, state)
    if moved not in places:
        best = max(best, _trial(state, found, *moved), key=lambda trial: trial.gain)
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


def _place(coefficients: Floats, inverse: Floats, state: State) -> tuple[float, int]:
    """Time and edge, in samples, of the step that explains most for its price."""
    longest = round(0.5 * SHORTEST_S / state.sample_time_s)
    inner = _inner(coefficients.size - 1)
    best = -np.inf, 0, 1
    for edge in telling_edges(inverse, min(longest, coefficients.size // EDGE_SHARE)):
        z, _, _ = step_scores(coefficients, inverse, state.sample_time_s, edge)
        at = inner.start + int(np.argmax(np.abs(z[inner])))
        gain = 0.5 * float(z[at]) ** 2 - _edge_price(edge)
        best = max(best, (gain, at, edge), key=lambda b: b[0])
    _, at, edge = best
    return state.start_s + (at + 1) * state.sample_time_s, edge


def _edge_price(edge: int) -> float:
    return EDGE_PRICE if edge > 1 else 0.0


def _trial(state: State, found: Analysis, time_s: float, edge: int) -> StepTrial:
    column = course_column(BiasStep(time_s, 1.0), state, "height")
    if edge > 1:
        column = replace(column, shape=_edged(column.shape, edge))
    effects = given_effects(found.fit.effects, state.prior)
    grown = replace(state, columns=(*state.columns, column), effects=effects)
    fitted = analyse(grown)
    gain = fitted.objective - found.objective - _edge_price(edge)
    grown = replace(grown, effects=fitted.fit.effects)
    return StepTrial(time_s, float(fitted.sizes[-1]), gain, grown, fitted)


def _edged(sharp: Floats, edge: int) -> Floats:
    """A step averaged twice over ``edge`` samples, its middle in place."""
    twice = np.convolve(np.full(edge, 1.0 / edge), np.full(edge, 1.0 / edge))
    reach = edge - 1
    padded = np.concatenate((np.full(reach, sharp[0]), sharp, np.full(reach, sharp[-1])))
    return np.convolve(padded, twice, mode="valid")
