"""The fast part of an aid's noise as few states: a spectrum reduced to a rational one.

What a receiver's own filter, a resonance or a moving average leaves is neither white nor a
Gauss-Markov process.  Its spectrum at the receiver's rate is approximated by white noise, a
Gauss-Markov term and low-passes of second order (each a state or two of the filter, positive by
construction), by the least Whittle divergence

    D = 1/2 mean(S/M - 1 - log(S/M)),

the loss in log-likelihood of each measurement, in nats, when M is taken for S.  The fewest states
that lose less than ``ENOUGH_NATS`` are taken.  At the least D the mean of S/M is 1, so that the
normalised innovations keep their mean.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nav_fusion.noise_terms import PairTerm, SlowTerm, pair_step

Floats = NDArray[np.float64]
Term = SlowTerm | PairTerm

ENOUGH_NATS = 1e-3
"""One nat in a thousand measurements."""
GRID = 128
LEAST_WHITE = 1e-2
"""White part of what is seen, as a fraction of its standard deviation: keeps S well conditioned."""


@dataclass(frozen=True)
class Colour:
    """White sigma of each measurement, states' terms, and nats lost a measurement."""

    white_sigma: float
    terms: tuple[Term, ...]
    lost_nats: float


def grid(sample_time_s: float) -> Floats:
    """Frequencies (n,) in Hz, the middles of equal parts up to half the rate."""
    return (np.arange(GRID, dtype=np.float64) + 0.5) / (2.0 * GRID * sample_time_s)


def sampled_psd(term: Term, frequency_hz: Floats, sample_time_s: float) -> Floats:
    """Two-sided PSD of a term at a rate, (n,): dt s^2 Re(2 [(I - Phi u)^-1]_11 - 1), u = e^-iw dt.

    The sum over its lags, r(k) = s^2 [Phi^k]_11.
    """
    u = np.exp(-2j * np.pi * frequency_hz * sample_time_s)
    if isinstance(term, PairTerm):
        a, b, c, d = pair_step(*term.rates, term.spin_rad_s, sample_time_s)
        inverse = (1.0 - d * u) / (1.0 - (a + d) * u + (a * d - b * c) * u * u)
        sigma = term.sigma
    else:
        inverse = 1.0 / (1.0 - math.exp(-sample_time_s / term.correlation_time_s) * u)
        sigma = term.initial_sigma
    return np.asarray(sample_time_s * sigma**2 * (2.0 * inverse.real - 1.0))


def lost_nats(psd: Floats, model: Floats) -> float:
    """Divergence D of a model's spectrum from the true one."""
    ratio = psd / model
    return float(0.5 * np.mean(ratio - 1.0 - np.log(ratio)))


def reduced(psd: Floats, sample_time_s: float) -> Colour:
    """White noise and terms whose spectrum at the measurements' rate is nearest to ``psd``.

    Parameters
    ----------
    psd : (GRID,) float64
        Two-sided, at :func:`grid`.
    sample_time_s : float
    """
    variance = float(np.mean(psd)) / sample_time_s
    if variance <= 0.0:
        return Colour(0.0, (), 0.0)
    psd = np.maximum(psd, LEAST_WHITE**2 * variance * sample_time_s)
    best = Colour(math.sqrt(variance), (), lost_nats(psd, np.full(GRID, np.mean(psd))))
    for kinds in ("g", "p", "gp", "pp"):
        if best.lost_nats < ENOUGH_NATS:
            break
        found = _fitted(kinds, psd, sample_time_s, variance)
        if found.lost_nats < 0.5 * best.lost_nats:
            best = found
    return best


def _fitted(kinds: str, psd: Floats, sample_time_s: float, variance: float) -> Colour:
    """Least divergence with a white part and these kinds of term, from several starts.

    By Gauss-Newton on signed roots of the divergence's parts; parameters are logarithms, sigmas
    relative to that of the whole.
    """
    from scipy.optimize import least_squares  # only what is coloured needs it

    frequency_hz = grid(sample_time_s)

    def colour(x: Floats) -> Colour:
        x = np.clip(
            x, -12.0, np.log([2.0] + [v for k in kinds for v in _highest(k, sample_time_s)])
        )
        white = math.sqrt(variance * (math.exp(2 * x[0]) + LEAST_WHITE**2))
        terms, at = [], 1
        for kind in kinds:
            terms.append(_term(kind, np.exp(x[at:]), variance))
            at += SIZE[kind]
        return Colour(white, tuple(terms), 0.0)

    def model(x: Floats) -> Floats:
        found = colour(x)
        parts = (sampled_psd(t, frequency_hz, sample_time_s) for t in found.terms)
        return sum(parts, np.full(GRID, sample_time_s * found.white_sigma**2))

    def residual(x: Floats) -> Floats:
        ratio = psd / model(x)
        return np.sign(ratio - 1.0) * np.sqrt(np.maximum(ratio - 1.0 - np.log(ratio), 0.0))

    whole_s = max(float(psd[0]) / variance, sample_time_s)
    peak_hz = float(frequency_hz[np.argmax(psd)])
    results = [
        least_squares(residual, start, method="trf", max_nfev=60)
        for start in _starts(kinds, whole_s, peak_hz)
    ]
    best = min(results, key=lambda r: r.cost).x
    return replace(colour(best), lost_nats=lost_nats(psd, model(best)))


SIZE = {"g": 2, "p": 3}


def _highest(kind: str, sample_time_s: float) -> tuple[float, ...]:
    """Largest parameters: sigma, and time, or frequency and damping."""
    return (2.0, 1e4) if kind == "g" else (2.0, 2.0 / sample_time_s, 50.0)


def _starts(kinds: str, whole_s: float, peak_hz: float) -> list[Floats]:
    """Starts of all terms together; a second term of a kind begins four times as slow."""
    by_kind = {
        "g": [np.log([0.7, 0.5 * whole_s])],
        "p": [
            np.log([0.7, 2.0 / (math.pi * whole_s), 1.0]),
            np.log([0.7, max(peak_hz, 0.2 / whole_s), 0.3]),
        ],
    }
    starts = [np.log([0.2])]
    for place, kind in enumerate(kinds):
        shift = np.array([0.0, 1.4, 0.0] if kind == "g" else [0.0, -1.4, 0.0])
        starts = [
            np.concatenate((s, one + place * shift[: one.size]))
            for s in starts
            for one in by_kind[kind]
        ]
    return starts


def _term(kind: str, x: Floats, variance: float) -> Term:
    sigma = math.sqrt(variance) * float(x[0])
    if kind == "g":
        return SlowTerm.gauss_markov(sigma, float(x[1]), "fast_colour")
    return PairTerm.low_pass(sigma, float(x[1]), float(x[2]), "fast_colour")
