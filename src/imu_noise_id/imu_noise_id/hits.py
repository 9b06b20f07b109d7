"""Outliers as a mixture: how many samples are hit, and how hard, whatever the hits' own law.

Deviations of a whitened record are clean ones, Gaussian, and a few that were hit.  The catalogue's
hits are Gaussian too; those of a bus or of a supply are often *not* small ones, so that few lie
between them and the noise, and a Gaussian law that is read from the far ones has most hits where
none is; others have more small ones yet, as Laplace's law has.  Hits of either sign whose magnitude
lies anywhere between two limits, the lower of which may be none, are the third law: the record
chooses.  Tails of another kind than a mixture's have their hits by the dozen in a hundred samples
under any of these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.special import expit, gammaincc, log_ndtr, logit, ndtr, softmax, stdtr

from imu_noise_id.recording import Floats

FINE, FINE_TO, WIDER = 0.1, 6.0, 1.05
"""Width of the bins of the deviations, up to where, and by how much each is wider from there on."""
LOWS, LAST_LOW, NARROWEST = 16, 0.95, 0.1
"""Lower limits that are tried, the last as a part of the largest deviation; narrowest range."""
STEPS, CLOSE = 40, 0.01
"""Of scoring, at most; gain in nats of one after which the next gains nothing."""
MEDIAN = 0.6744897501960817
"""Of the magnitudes of clean samples, in their deviations."""
SLIGHT = 1e-4
"""Step of a parameter from which slopes are taken."""
_LEAST = 1e-15


class Law(Protocol):
    """Distribution of hits, in deviations of the clean samples, or an array of such."""

    @property
    def size(self) -> Floats:
        """Root mean square."""

    def beyond(self, x: Floats) -> Floats:
        """Chance that the magnitude of a sample that was hit exceeds x."""

    def log_density(self, x: Floats) -> Floats:
        """Of samples that were hit, at x."""


@dataclass(frozen=True)
class Normal:
    """Gaussian hits."""

    size: Floats

    def beyond(self, x: Floats) -> Floats:
        """Chance that the magnitude of a sample that was hit exceeds x."""
        return np.asarray(2.0 * ndtr(-x / np.hypot(1.0, self.size)))

    def log_density(self, x: Floats) -> Floats:
        """Of samples that were hit, at x."""
        total = np.hypot(1.0, self.size)
        return np.asarray(-0.5 * (x / total) ** 2 - np.log(total) - 0.5 * np.log(2.0 * np.pi))


@dataclass(frozen=True)
class Laplace:
    """Hits of either sign whose magnitudes are exponential: most of them small."""

    size: Floats

    def beyond(self, x: Floats) -> Floats:
        """Chance that the magnitude of a sample that was hit exceeds x."""
        near, far = self._sides(x)
        return np.asarray(2.0 * ndtr(-x) + near - far)

    def log_density(self, x: Floats) -> Floats:
        """Of samples that were hit, at x."""
        near, far = self._sides(np.abs(x))
        return np.asarray(np.log(np.maximum((near + far) * 0.5 * self._pace, 1e-300)))

    @property
    def _pace(self) -> Floats:
        return np.asarray(np.sqrt(2.0) / np.maximum(self.size, NARROWEST))

    def _sides(self, x: Floats) -> tuple[Floats, Floats]:
        """Both exponentials about x, smoothed by the clean samples."""
        pace = self._pace
        near = np.exp(0.5 * pace**2 - pace * x + log_ndtr(x - pace))
        return near, np.exp(0.5 * pace**2 + pace * x + log_ndtr(-x - pace))


@dataclass(frozen=True)
class Even:
    """Hits of either sign whose magnitudes lie evenly between two limits."""

    low: Floats
    high: Floats

    @property
    def size(self) -> Floats:
        """Root mean square."""
        return np.asarray(np.sqrt((self.low**2 + self.low * self.high + self.high**2) / 3.0))

    def beyond(self, x: Floats) -> Floats:
        """Chance that the magnitude of a sample that was hit exceeds x."""
        low, high = self.low, self.high
        sides = _area(x - low) - _area(x - high) - _area(-x - low) + _area(-x - high)
        return np.asarray(1.0 - sides / (high - low))

    def log_density(self, x: Floats) -> Floats:
        """Of samples that were hit, at x."""
        low, high = self.low, self.high
        sides = ndtr(high - x) - ndtr(low - x) + ndtr(high + x) - ndtr(low + x)
        return np.asarray(np.log(np.maximum(0.5 * sides, _LEAST) / (high - low)))


def _area(x: Floats) -> Floats:
    """Integral of the normal distribution function up to x."""
    return np.asarray(x * ndtr(x) + np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi))


@dataclass(frozen=True)
class Mixture:
    """Clean samples and hits, or an array of such.

    Attributes
    ----------
    rate : float
        Fraction of the samples that are hit.
    spread : float
        Deviation of the clean samples, in assumed ones.
    law : Law
        Of the hits.
    """

    rate: Floats
    spread: Floats
    law: Law

    def within(self, bounds: Floats) -> Floats:
        """Chance that a sample that was hit lies within bounds about the middle."""
        return np.asarray(1.0 - self.law.beyond(bounds / self.spread))

    def odds(self, unit: Floats) -> Floats:
        """Chance that a sample was hit, over that it was not."""
        x = unit / self.spread
        excess = self.law.log_density(x) + 0.5 * x**2 + 0.5 * np.log(2.0 * np.pi)
        return np.asarray(np.exp(np.clip(excess + logit(self.rate), -700.0, 700.0)))


NO_HITS = Mixture(np.zeros(()), np.ones(()), Normal(np.zeros(())))


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
        tails and no hits, over the likeliest mixture's; 0 where the clean samples' law is hidden.
    """

    best: Mixture
    rate: float
    scale: float
    rate_error: float
    scale_error: float
    tails: float = 0.0


def hit_mixtures(unit: Floats, rate: float, scale: float, seen_from: float = 0.0) -> Answer:
    """Mixtures of clean deviations and hits, by the counts of magnitudes.

    Gaussian hits weigh as much beforehand as Laplace's, and as those of all lower limits together.

    Parameters
    ----------
    unit : (n,) float64
        White samples over their robust deviation, centred.
    rate, scale : float
        Of Gaussian hits, to start from.
    seen_from : float
        Magnitude beneath which something hides the law of the samples, but for their median.
    """
    edges = _edges(float(np.abs(unit).max()))
    if seen_from > 0.0:
        edges = np.concatenate(([0.0, MEDIAN], edges[edges > seen_from]))
    counts = np.histogram(np.abs(unit), edges)[0].astype(float)
    first, top = float(logit(np.clip(rate, 1e-9, 0.5))), float(edges[-1])
    lows = np.linspace(0.0, LAST_LOW * top, LOWS)
    start = np.array([[first], [0.0], [np.log(scale)]])
    even = np.array([np.full(LOWS, first), np.zeros(LOWS), np.log(np.maximum(top - lows, 0.5))])
    found = (
        _likeliest(_normal, np.zeros(1), start, counts, edges),
        _likeliest(_laplace, np.zeros(1), start, counts, edges),
        _likeliest(_even, lows, even, counts, edges),
    )
    loss = np.concatenate([losses for _, losses in found])
    mixtures = [mixture for group, _ in found for mixture in group]
    weight = softmax(np.log([1.0, 1.0, *np.full(LOWS, 1.0 / LOWS)]) - loss)
    logs = np.log([[float(m.rate), float(m.law.size)] for m in mixtures])
    mean = weight @ logs
    spread = weight @ (logs - mean) ** 2
    hits = max(float(np.exp(mean[0])) * unit.size, 1.0)
    best = int(np.argmax(weight))
    rivals = [_least(law, counts, edges, shape) for law, shape in LONG_TAILED if seen_from == 0.0]
    tails = loss[best] - min(rivals, default=loss[best])
    errors = np.sqrt(spread + np.array([2.0, 1.25]) / hits)  # of a size: Laplace's, the widest
    numbers = (float(v) for v in (*np.exp(mean), *errors, tails))
    return Answer(mixtures[best], *numbers)


def _edges(top: float) -> Floats:
    edges = [*(FINE * np.arange(round(FINE_TO / FINE) + 1))]
    while edges[-1] <= top:
        edges.append(edges[-1] * WIDER)
    return np.array(edges)


Form = Callable[[Floats, Floats, Floats], Law]
"""Law of a third parameter, the spread and a lower limit."""


def _normal(third: Floats, spread: Floats, low: Floats) -> Law:
    return Normal(third)


def _laplace(third: Floats, spread: Floats, low: Floats) -> Law:
    return Laplace(third)


def _even(third: Floats, spread: Floats, low: Floats) -> Law:
    return Even(low / spread, (low + third + NARROWEST) / spread)


def _likeliest(
    form: Form, lows: Floats, start: Floats, counts: Floats, edges: Floats
) -> tuple[list[Mixture], Floats]:
    """Likeliest mixtures of laws of one form, and their negative log-likelihoods.

    All at once, each by scoring that is damped as it asks for.

    Parameters
    ----------
    form : callable
    lows : (l,) float64
        Lower limits.
    start : (3, l) float64
        Log odds of a hit, log spread, log of the third parameter; one column for each law.
    counts : (b,) float64
        Of magnitudes between edges.
    edges : (b + 1,) float64
    """

    def chances(theta: Floats) -> Floats:
        mixed = _mixture(form, theta[..., np.newaxis], lows[:, np.newaxis])
        bounds = edges / mixed.spread
        clean = -2.0 * np.diff(ndtr(-bounds))
        hit = np.maximum(-np.diff(mixed.law.beyond(bounds)), _LEAST)
        return np.asarray((1.0 - mixed.rate) * clean + mixed.rate * hit)

    theta, damping = start.copy(), np.full(lows.size, 1e-2)
    chance = chances(theta)
    loss = -np.log(chance) @ counts
    for _ in range(STEPS):
        trial = theta + _scored(chances, theta, chance, counts, damping)
        tried = chances(trial)
        gain = loss + np.log(tried) @ counts
        better = gain > 0.0
        theta, chance = np.where(better, trial, theta), np.where(better[:, None], tried, chance)
        loss = loss - np.maximum(gain, 0.0)
        if np.all((better & (gain < CLOSE)) | (damping > 1e6)):
            break
        damping = np.where(better, 0.2, 10.0) * damping
    return [_mixture(form, theta[:, k], lows[k]) for k in range(lows.size)], loss


def _mixture(form: Form, theta: Floats, low: Floats) -> Mixture:
    """Mixture, or an array of them, of log odds of a hit, log spread, log third parameter."""
    rate, spread = expit(theta[0]), np.exp(theta[1])
    return Mixture(rate, spread, form(np.exp(theta[2]), spread, low))


def _scored(
    chances: Callable[[Floats], Floats],
    theta: Floats,
    chance: Floats,
    counts: Floats,
    damping: Floats,
) -> Floats:
    """Damped step of Fisher's scoring of every law, (3, l)."""
    slope = np.array(
        [(chances(theta + d) - chance) / SLIGHT for d in SLIGHT * np.eye(3)[..., None]]
    )
    score = np.sum(slope * (counts / chance), axis=2).T
    information = counts.sum() * np.einsum("ilb,jlb,lb->lij", slope, slope, 1.0 / chance)
    diagonal = np.einsum("lii->li", information)
    diagonal *= 1.0 + damping[:, np.newaxis]
    diagonal += 1e-9
    step = np.linalg.solve(information, score[..., np.newaxis])[..., 0]
    return np.asarray((step / np.maximum(1.0, np.abs(step).max(axis=1, keepdims=True))).T)


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
    """Least negative log-likelihood of a law over its scale and its shape, by Nelder and Mead."""
    from scipy.optimize import minimize  # only what was hit needs it

    def loss(theta: Floats) -> float:
        scale, number = np.exp(np.clip(theta, -3.0, 9.0))
        chance = -np.diff(law(edges / scale, float(number)))
        return -float(counts @ np.log(np.maximum(chance, _LEAST)))

    start = np.array([0.0, float(np.log(shape))])
    options = {"maxiter": 300, "xatol": 3e-3, "fatol": 3e-2}
    options["initial_simplex"] = start + np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.3]])
    return float(minimize(loss, start, method="Nelder-Mead", options=options).fun)
