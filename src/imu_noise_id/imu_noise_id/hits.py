"""Outliers as a mixture: how many samples are hit, and how hard, whatever the hits' own law.

Deviations of a whitened record are clean ones, Gaussian, and a few that were hit.  The catalogue's
hits are Gaussian too; those of a bus or of a supply are often *not* small ones, so that few lie
between them and the noise, and a Gaussian law that is read from the far ones has most hits where
none is.  Hits of either sign whose magnitude lies anywhere between two limits, the lower of which
may be none, are the other law: the record chooses.  Tails of another kind than a mixture's have
their hits by the dozen in a hundred samples under either law.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, gammaincc, logit, ndtr, softmax, stdtr

from imu_noise_id.recording import Floats

FINE, FINE_TO, WIDER = 0.1, 6.0, 1.05
"""Width of the bins of the deviations, up to where, and by how much each is wider from there on."""
LOWS, LAST_LOW, NARROWEST = 16, 0.95, 0.1
"""Lower limits that are tried, the last as a part of the largest deviation; narrowest range."""
_LEAST = 1e-15


@dataclass(frozen=True)
class Mixture:
    """Clean samples and hits, in assumed deviations of the clean ones.

    Attributes
    ----------
    rate : float
        Fraction of the samples that are hit.
    scale : float
        Root mean square of the hits.
    spread : float
        Deviation of the clean samples.
    limits : (float, float) or None
        Least and largest magnitude of hits that lie evenly between; None where they are Gaussian.
    """

    rate: float
    scale: float
    spread: float
    limits: tuple[float, float] | None = None

    def within(self, bounds: Floats) -> Floats:
        """Chance that a sample that was hit lies within bounds about the middle."""
        if self.limits is None:
            return np.asarray(1.0 - 2.0 * ndtr(-bounds / np.hypot(self.spread, self.scale)))
        low, high = (limit / self.spread for limit in self.limits)
        x = bounds / self.spread
        sides = _area(x - low) - _area(x - high) - _area(-x - low) + _area(-x - high)
        return np.asarray(sides / (high - low))

    def odds(self, unit: Floats) -> Floats:
        """Chance that a sample was hit, over that it was not."""
        x = unit / self.spread
        if self.limits is None:
            total = float(np.hypot(self.spread, self.scale)) / self.spread
            excess = -np.log(total) + 0.5 * x**2 * (1.0 - 1.0 / total**2)
        else:
            low, high = (limit / self.spread for limit in self.limits)
            sides = ndtr(high - x) - ndtr(low - x) + ndtr(high + x) - ndtr(low + x)
            density = 0.5 * np.maximum(sides, _LEAST) / (high - low)
            excess = np.log(density) + 0.5 * x**2 + 0.5 * np.log(2.0 * np.pi)
        return np.asarray(np.exp(np.clip(excess + logit(self.rate), -700.0, 700.0)))


def _area(x: Floats) -> Floats:
    """Integral of the normal distribution function up to x."""
    return np.asarray(x * ndtr(x) + np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi))


@dataclass(frozen=True)
class Answer:
    """The likeliest mixture, and what all that are as likely say of rate and scale.

    Small hits go unseen, so that between hits of any magnitude up to one and only of those near it
    the record often does not choose, while their rates differ by half.

    Attributes
    ----------
    best : Mixture
    rate, scale : float
        Geometric means over the mixtures, weighed by likelihood.
    rate_error, scale_error : float
        Standard errors of their logarithms.
    tails : float
        Log-likelihood of the likelier of Student's and the generalized normal law, which have long
        tails and no hits, over the likeliest mixture's.
    """

    best: Mixture
    rate: float
    scale: float
    rate_error: float
    scale_error: float
    tails: float = 0.0


def hit_mixtures(unit: Floats, rate: float, scale: float) -> Answer:
    """Mixtures of clean deviations and hits, by the counts of magnitudes.

    Gaussian hits weigh as much beforehand as those of all lower limits together.

    Parameters
    ----------
    unit : (n,) float64
        White samples over their robust deviation, centred.
    rate, scale : float
        Of Gaussian hits, to start from.
    """
    edges = _edges(float(np.abs(unit).max()))
    counts = np.histogram(np.abs(unit), edges)[0].astype(float)
    first, top = float(logit(np.clip(rate, 1e-9, 0.5))), float(edges[-1])
    lows = np.linspace(0.0, LAST_LOW * top, LOWS)
    found = [_likeliest(_gaussian, counts, edges, (first, 0.0, float(np.log(scale))))]
    start = (first, 0.0, float(np.log(top)))
    for low in lows:
        found.append(_likeliest(_limited(float(low)), counts, edges, start))
        start = (found[-1][2][0], found[-1][2][1], float(np.log(max(top - low, 0.5))))
    prior = np.log(np.array([1.0, *np.full(LOWS, 1.0 / LOWS)]))
    weight = softmax(prior - np.array([loss for _, loss, _ in found]))
    logs = np.log([[m.rate, m.scale / m.spread] for m, _, _ in found])
    mean = weight @ logs
    spread = weight @ (logs - mean) ** 2
    hits = max(float(np.exp(mean[0])) * unit.size, 1.0)
    best, loss, _ = found[int(np.argmax(weight))]
    tails = loss - min(_least(law, counts, edges, shape) for law, shape in LONG_TAILED)
    errors = np.sqrt(spread + np.array([2.0, 1.0 / 1.2]) / hits)
    rate, scale = (float(v) for v in np.exp(mean))
    return Answer(best, rate, scale, float(errors[0]), float(errors[1]), tails)


def _edges(top: float) -> Floats:
    edges = [*(FINE * np.arange(round(FINE_TO / FINE) + 1))]
    while edges[-1] <= top:
        edges.append(edges[-1] * WIDER)
    return np.array(edges)


def _gaussian(theta: Floats) -> Mixture:
    return Mixture(float(expit(theta[0])), float(np.exp(theta[2])), float(np.exp(theta[1])))


def _limited(low: float) -> Callable[[Floats], Mixture]:
    def form(theta: Floats) -> Mixture:
        width = float(np.exp(theta[2])) + NARROWEST
        scale = float(np.sqrt(low**2 + low * width + width**2 / 3.0))
        rate, spread = float(expit(theta[0])), float(np.exp(theta[1]))
        return Mixture(rate, scale, spread, (low, low + width))

    return form


def _likeliest(
    form: Callable[[Floats], Mixture], counts: Floats, edges: Floats, start: tuple[float, ...]
) -> tuple[Mixture, float, Floats]:
    """Mixture of one form, its negative log-likelihood and its parameters."""

    def loss(theta: Floats) -> float:
        mixed = form(np.clip(theta, -30.0, 30.0))
        x = edges / mixed.spread
        clean = 2.0 * (ndtr(-x[:-1]) - ndtr(-x[1:]))
        hit = np.maximum(np.diff(mixed.within(edges)), _LEAST)
        return -float(counts @ np.log((1.0 - mixed.rate) * clean + mixed.rate * hit))

    lowest, theta = _minimum(loss, start, (0.5, 0.01, 0.5))
    return form(theta), lowest, theta


def _student(x: Floats, degrees: float) -> Floats:
    """Chance that a magnitude exceeds x."""
    return np.asarray(2.0 * stdtr(degrees, -x))


def _generalized_normal(x: Floats, power: float) -> Floats:
    """Chance that a magnitude exceeds x: Laplace's law at power 1, the normal one at 2."""
    return np.asarray(gammaincc(1.0 / power, x**power))


LONG_TAILED = ((_student, 8.0), (_generalized_normal, 1.5))
"""Laws of a scale and one number of its shape, with where that is sought from."""


def _least(
    law: Callable[[Floats, float], Floats], counts: Floats, edges: Floats, shape: float
) -> float:
    """Least negative log-likelihood of a law over its scale and its shape."""

    def loss(theta: Floats) -> float:
        scale, number = np.exp(np.clip(theta, -3.0, 9.0))
        chance = -np.diff(law(edges / scale, float(number)))
        return -float(counts @ np.log(np.maximum(chance, _LEAST)))

    return _minimum(loss, (0.0, float(np.log(shape))), (0.1, 0.3))[0]


def _minimum(
    loss: Callable[[Floats], float], start: tuple[float, ...], steps: tuple[float, ...]
) -> tuple[float, Floats]:
    """Least value of a loss and where it is, by the simplex of Nelder and Mead."""
    from scipy.optimize import minimize  # only what was hit needs it

    options = {"maxiter": 300, "xatol": 3e-3, "fatol": 3e-2}
    simplex = np.array([start, *(start + np.diag(steps))])
    found = minimize(
        loss, start, method="Nelder-Mead", options={**options, "initial_simplex": simplex}
    )
    return float(found.fun), np.clip(found.x, -30.0, 30.0)
