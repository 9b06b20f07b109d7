"""The given model as prior knowledge: a fit in which it floats within its own uncertainty.

A parameter whose logarithm is known with standard error s is pulled back by

    pi(d) = (sqrt(1 + 4 d^2) - 1)/(4 s^2),

d the distance along an eigenvector of the covariance: d^2/(2 s^2) where the parameter is well
known, |d|/(2 s^2) beyond, as the chi-square law of an estimated power has it.  A slow term whose
level is known to a factor of two is not held by a parabola that it never had.

An identified model also has drifts that its recording was too short to show.  Their room is a
Gauss-Markov term whose cost is its likelihood in that recording: of a term with spectrum x_k, over
the model's own at the low ordinates there,

    pi(x) = 1/2 sum_k [log(1 + x_k) - w x_k/(1 + x_k)],

w the power of those ordinates over the model's: 1 on average, and as the model's upper bound of a
walk says where it has one, since the likelihood has dropped by 1.35 nats there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from scipy.special import chdtri

from imu_noise_id.effects.base import Effect, ResponseEffect, StochasticEffect
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.effects.rate_random_walk import RateRandomWalk
from imu_noise_id.intervals import ONE_SIDED_DROP
from imu_noise_id.model import ChannelModel
from imu_noise_id.ordinates import Ordinates
from imu_noise_id.recording import Floats
from imu_noise_id.whittle import (
    Spectrum,
    information,
    log_likelihood,
    parameter_vector,
    spectrum_of,
    with_parameters,
)

TYPED_STD_ERROR = 0.002
"""Relative standard error of a value that comes without one: what is typed is meant, to as much as
ten minutes at 200 Hz tell of a white level."""
WIDEST_STD_ERROR = 3.0
ITERATIONS = 40
LONGEST_STEP = 1.5
PROMISE = 1e-3
"""Nats left to gain at which a fit stops."""

DRIFT_ORDINATES = 128
SHORTEST_DRIFT = 1.0 / 64.0
"""Correlation time of an unseen drift over the record: faster ones reach beyond the ordinates."""
LONGER = 1.5
"""Length of a record over that of the model's, from which slow terms leave room below."""
FREE_STD_ERROR = 1e3
BEYOND = 1e-3
"""Chance of parameters as far from the model's, taken together."""
SLOW = ("rate_random_walk", "gauss_markov", "bias_instability")
LOUDEST_SEEN = 10.0
FRACTIONS = np.concatenate(([0.0], np.geomspace(1e-4, 1.0, 60)))


@dataclass(frozen=True)
class UnseenDrift(GaussMarkov):
    """A slow term within what an identified model leaves open; never part of an answer."""

    name: ClassVar[str] = "unseen_drift"

    def limits(self, sample_time_s: float, duration_s: float) -> tuple[tuple[float, float], ...]:
        """Correlation times from a 64th of the record."""
        sigma, (_, longest) = super().limits(sample_time_s, duration_s)
        return sigma, (min(SHORTEST_DRIFT * duration_s, longest), longest)


@dataclass(frozen=True)
class DriftPrior:
    """Room for a slow term that the model's recording was too short to show.

    Attributes
    ----------
    frequency_hz : (m,) float64
        Low ordinates of that recording.
    inverse : (m,) float64
        1/S of the model there.
    sample_time_s : float
    power : float
        w, of that recording's ordinates there over the model's spectrum.
    """

    frequency_hz: Floats
    inverse: Floats
    sample_time_s: float
    power: float = 1.0

    @property
    def start(self) -> tuple[float, float]:
        """Logarithms of a term that shows in no ordinate."""
        time_s = 0.1 / float(self.frequency_hz[0])
        peak = UnseenDrift(1.0, time_s).psd(self.frequency_hz[:1], self.sample_time_s)
        return float(0.5 * np.log(0.1 / (peak * self.inverse[:1])[0])), float(np.log(time_s))

    def cost(self, theta: Floats) -> float:
        """Nats of the drift of these log parameters, (2,)."""
        drift = self._drift(theta)
        x = drift.psd(self.frequency_hz, self.sample_time_s) * self.inverse
        return float(passed_over(x, self.power))

    def slope(self, theta: Floats) -> Floats:
        """Derivative by the log parameters, (2,)."""
        drift = self._drift(theta)
        x = drift.psd(self.frequency_hz, self.sample_time_s) * self.inverse
        by_x = 0.5 * (1.0 / (1.0 + x) - self.power / (1.0 + x) ** 2)
        gradient = drift.psd_gradient(self.frequency_hz, self.sample_time_s) * self.inverse
        return np.asarray(gradient @ by_x)

    def left_open(self, theta: Floats) -> Floats:
        """The log parameters, their strength cut to what the model's interval leaves open."""
        if self.cost(theta) <= ONE_SIDED_DROP:
            return theta
        low, high = theta[0] - 20.0, theta[0]
        for _ in range(40):
            middle = 0.5 * (low + high)
            open_yet = self.cost(np.array([middle, theta[1]])) <= ONE_SIDED_DROP
            low, high = (middle, high) if open_yet else (low, middle)
        return np.array([low, theta[1]])

    def with_room(self, psd: Floats) -> DriftPrior:
        """The prior where a spectrum (m,) more would not have been a drift."""
        return replace(self, inverse=1.0 / (1.0 / self.inverse + psd))

    def _drift(self, theta: Floats) -> UnseenDrift:
        return UnseenDrift(*np.exp(theta).tolist())


def passed_over(x: Floats, power: float) -> Floats:
    """Nats against a term of relative spectrum x (..., m) where the ordinates had ``power``."""
    return np.asarray(0.5 * np.sum(np.log1p(x) - power * x / (1.0 + x), axis=-1))


def power_seen(x: Floats) -> float:
    """Power w at which the likelihood of a term drops by 1.35 nats at relative spectrum x (m,)."""
    low, high = 0.0, LOUDEST_SEEN
    for _ in range(40):
        w = 0.5 * (low + high)
        costs = passed_over(np.outer(FRACTIONS, x), w)
        low, high = (w, high) if costs[-1] - costs.min() > ONE_SIDED_DROP else (low, w)
    return low


@dataclass(frozen=True)
class Prior:
    """What the model says of the first parameters of a list of effects.

    Attributes
    ----------
    centre : (q,) float64
        Log parameters of the model's spectral effects; parameters after these are free.
    axes : (q, q) float64
        Eigenvectors of the covariance, columns.
    std_error : (q,) float64
        Along the eigenvectors; ``FREE_STD_ERROR`` where the prior is dropped.
    drift : DriftPrior or None
        Of the two parameters after those, an :class:`UnseenDrift`.
    """

    centre: Floats
    axes: Floats
    std_error: Floats
    drift: DriftPrior | None = None

    @classmethod
    def none(cls) -> Prior:
        """Nothing known of anything."""
        return cls(np.zeros(0), np.zeros((0, 0)), np.zeros(0))

    def cost(self, theta: Floats) -> float:
        """Nats that the distance from the model costs."""
        q = self.centre.size
        cost = self._cost_along(self.axes.T @ (theta[:q] - self.centre))
        return cost + (self.drift.cost(theta[q : q + 2]) if self.drift else 0.0)

    def _cost_along(self, d: Floats) -> float:
        return float(np.sum((np.sqrt(1.0 + 4.0 * d**2) - 1.0) / (4.0 * self.std_error**2)))

    def drawn_back(self, theta: Floats) -> Floats:
        """Log parameters (q,) no farther from the model than in all but ``BEYOND`` of recordings.

        What is free stays; the rest goes straight back towards the model.
        """
        d = self.axes.T @ (theta - self.centre)
        held = self.std_error < FREE_STD_ERROR
        most = 0.5 * float(chdtri(max(np.count_nonzero(held), 1), BEYOND))
        if self._cost_along(d) <= most:
            return theta
        low, high = 0.0, 1.0
        for _ in range(40):
            middle = 0.5 * (low + high)
            inside = self._cost_along(np.where(held, middle * d, d)) <= most
            low, high = (middle, high) if inside else (low, middle)
        return np.asarray(self.centre + self.axes @ np.where(held, low * d, d))

    def slope_and_curvature(self, theta: Floats) -> tuple[Floats, Floats]:
        """Gradient (p,) of the cost and a curvature (p, p) that majorises it."""
        q = self.centre.size
        d = self.axes.T @ (theta[:q] - self.centre)
        weight = 1.0 / (self.std_error**2 * np.sqrt(1.0 + 4.0 * d**2))
        slope = np.zeros(theta.size)
        curvature = np.zeros((theta.size, theta.size))
        slope[:q] = self.axes @ (weight * d)
        curvature[:q, :q] = (self.axes * weight) @ self.axes.T
        if self.drift:
            slope[q : q + 2] = self.drift.slope(theta[q : q + 2])
            curvature[[q, q + 1], [q, q + 1]] = 2.0 * np.abs(slope[q : q + 2])
        return slope, curvature


@dataclass(frozen=True)
class MapFit:
    """Effects at the maximum of likelihood times prior.

    Attributes
    ----------
    effects : tuple of Effect
    objective : float
        Log-likelihood less the prior's cost, nats.
    likelihood : float
    spectrum : Spectrum
    covariance : (p, p) float64
        Of the log parameters, data and prior together.
    """

    effects: tuple[Effect, ...]
    objective: float
    likelihood: float
    spectrum: Spectrum
    covariance: Floats


def spectral(effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Effects that the spectrum shows and that have a free parameter, in the given order."""
    kinds = (StochasticEffect, ResponseEffect)
    return tuple(e for e in effects if isinstance(e, kinds) and e.name != "periodic" and e.free())


def prior_of(model: ChannelModel) -> Prior:
    """Prior on the spectral effects of a channel's model.

    Parameters
    ----------
    model : ChannelModel
        Without a covariance its standard errors hold, without one a value is taken as known to
        ``TYPED_STD_ERROR``.
    """
    numeric: list[tuple[bool, bool]] = []  # (estimated at all, wanted here) of each number
    errors: list[float] = []  # of the wanted ones
    for fitted in model.effects:
        wanted = fitted.effect.free() if spectral((fitted.effect,)) else ()
        for parameter, estimate in zip(fitted.effect.parameters, fitted.estimates, strict=True):
            if isinstance(estimate.value, str):
                continue
            numeric.append((parameter.name in fitted.effect.free(), parameter.name in wanted))
            if parameter.name in wanted:
                said = (estimate.std_error or 0.0) / float(estimate.value or 1.0)
                errors.append(max(said, TYPED_STD_ERROR))
    effects = spectral(tuple(f.effect for f in model.effects))
    centre = parameter_vector(effects) if effects else np.zeros(0)
    covariance = np.diag(np.array(errors) ** 2)
    given = model.log_covariance
    if given is not None:
        if given.shape[0] != len(numeric):  # rows of what is estimated only
            numeric = [pair for pair in numeric if pair[0]]
        rows = [row for row, pair in enumerate(numeric) if pair[1]]
        if given.shape == (len(numeric), len(numeric)):
            covariance = np.nan_to_num(0.5 * (given + given.T))[np.ix_(rows, rows)]
    if centre.size == 0:
        return Prior.none()
    variance, axes = np.linalg.eigh(covariance)
    std_error = np.sqrt(np.maximum(variance, 1e-8))
    return Prior(centre, axes, np.minimum(std_error, WIDEST_STD_ERROR))


def unseen_drift(
    model: ChannelModel,
    effects: tuple[Effect, ...],
    sample_time_s: float,
    floor: float,
    length_s: float,
) -> tuple[UnseenDrift, DriftPrior] | None:
    """Room for drift under an identified model; None for a typed one, or one with a slow term.

    A slow term says nothing below the ordinates of its recording: there is room where the record
    compared, of ``length_s``, is distinctly longer.  A ramp that the model has may have been a
    walk: its power over the recording is room too.
    """
    duration_s = float(model.duration_s or 0.0)
    known = model.log_covariance is not None and duration_s > 0.0
    slow = any(model.find(name) for name in SLOW)
    if not known or not effects or (slow and length_s < LONGER * duration_s):
        return None
    f = np.arange(1, DRIFT_ORDINATES + 1) / (2.0 * duration_s)
    f = f[f < 0.25 / sample_time_s]
    psd = spectrum_of(effects, f, sample_time_s, floor).psd
    ramp = model.find("rate_ramp")
    if ramp is not None:
        # DCT-II of a ramp R t: odd ordinates of 8 R^2 T^3/(pi k)^4, the even ones alike here
        slope = float(ramp.estimates[0].value or 0.0)
        psd = psd + 8.0 * slope**2 * duration_s**3 / (np.pi * 2.0 * duration_s * f) ** 4
    bound = next((b.upper for b in model.bounds if b.name == RateRandomWalk.name), None)
    walk = None if bound is None else RateRandomWalk(bound).psd(f, sample_time_s) / psd
    power = 1.0 if walk is None else power_seen(walk)
    drift = DriftPrior(f, 1.0 / psd, sample_time_s, power)
    return UnseenDrift(*np.exp(drift.start).tolist()), drift


def within_intervals(effects: tuple[Effect, ...], prior: Prior) -> tuple[Effect, ...]:
    """Effects of a fit, nothing of the model's farther off than the model leaves open.

    A fit leaves the intervals at a price wherever the record pays for it: that is a gap.
    """
    if not effects:
        return effects
    theta = parameter_vector(effects)
    q = prior.centre.size
    kept = theta.copy()
    kept[:q] = prior.drawn_back(theta[:q])
    if prior.drift is not None:
        kept[q : q + 2] = prior.drift.left_open(theta[q : q + 2])
    return effects if np.array_equal(kept, theta) else with_parameters(effects, kept)


def given_effects(effects: tuple[Effect, ...], prior: Prior) -> tuple[Effect, ...]:
    """Effects of a fit with the prior's own back at what the given model says."""
    theta = parameter_vector(effects) if effects else np.zeros(0)
    q = prior.centre.size
    theta[:q] = prior.centre
    if prior.drift is not None:
        theta[q : q + 2] = prior.drift.start
    return with_parameters(effects, theta)


def without(prior: Prior, dropped: list[int]) -> Prior:
    """The prior of the other parameters, the ``dropped`` ones being free."""
    keep = np.ones(prior.centre.size, dtype=bool)
    keep[dropped] = False
    if not keep.any():
        return replace(prior, std_error=np.full(prior.centre.size, FREE_STD_ERROR))
    covariance = (prior.axes * prior.std_error**2) @ prior.axes.T
    block = np.zeros_like(covariance)
    variance, axes = np.linalg.eigh(covariance[np.ix_(keep, keep)])
    kept, free = np.flatnonzero(keep), np.flatnonzero(~keep)
    block[np.ix_(kept, np.arange(kept.size))] = axes
    block[free, kept.size + np.arange(free.size)] = 1.0
    std_error = np.concatenate(
        (np.sqrt(np.maximum(variance, 1e-8)), np.full(free.size, FREE_STD_ERROR))
    )
    return replace(prior, axes=block, std_error=std_error)


def widened(prior: Prior, row: int, std_error: float) -> Prior:
    """The prior with one more reason for one of its parameters to differ."""
    covariance = (prior.axes * prior.std_error**2) @ prior.axes.T
    covariance[row, row] += std_error**2
    variance, axes = np.linalg.eigh(covariance)
    return replace(prior, axes=axes, std_error=np.sqrt(np.maximum(variance, 1e-8)))


def map_fit(
    effects: tuple[Effect, ...], ordinates: Ordinates, prior: Prior, floor: float = 0.0
) -> MapFit:
    """Maximise Whittle's likelihood times the prior by damped scoring.

    Parameters
    ----------
    effects : tuple of Effect
        The prior's effects first, starting values.
    ordinates : Ordinates
    prior : Prior
    floor : float
        Known white spectrum beneath everything, unit^2/Hz.
    """
    theta = parameter_vector(effects) if effects else np.zeros(0)
    lower, upper = _limits(effects, ordinates)
    theta = np.clip(theta, lower, upper)
    spectrum, likelihood = _evaluate(effects, theta, ordinates, floor)
    objective = likelihood - prior.cost(theta)
    damping = 1e-4
    for _ in range(ITERATIONS):
        step, promised = _step(spectrum, ordinates, theta, prior, (lower, upper), damping)
        if promised < PROMISE:
            break
        trial = np.clip(theta + step, lower, upper)
        if not np.isfinite(trial).all():
            break
        trial_spectrum, trial_likelihood = _evaluate(effects, trial, ordinates, floor)
        trial_objective = trial_likelihood - prior.cost(trial)
        if trial_objective > objective:
            theta, spectrum, likelihood = trial, trial_spectrum, trial_likelihood
            objective = trial_objective
            damping = max(0.1 * damping, 1e-7)
        else:
            damping = max(8.0 * damping, 1e-3)
            if damping > 1e6:
                break
    curvature = information(spectrum.tangent, ordinates.dof) + prior.slope_and_curvature(theta)[1]
    ridge = np.diag(1e-9 * np.diag(curvature) + 1e-3)
    covariance = np.asarray(np.linalg.inv(curvature + ridge)) if theta.size else np.zeros((0, 0))
    return MapFit(with_parameters(effects, theta), objective, likelihood, spectrum, covariance)


def _limits(effects: tuple[Effect, ...], ordinates: Ordinates) -> tuple[Floats, Floats]:
    pairs: list[tuple[float, float]] = []
    for effect in effects:
        limits = effect.limits(ordinates.sample_time_s, ordinates.duration_s)
        if len(limits) != len(effect.free()):
            names = [p.name for p in effect.parameters]
            limits = tuple(limits[names.index(name)] for name in effect.free())
        values = [float(getattr(effect, name)) for name in effect.free()]
        pairs += [
            (min(low, v), max(high, v)) for (low, high), v in zip(limits, values, strict=True)
        ]
    bounds = np.array(pairs).reshape(-1, 2)
    with np.errstate(divide="ignore"):
        return np.log(bounds[:, 0]), np.log(bounds[:, 1])


def _evaluate(
    effects: tuple[Effect, ...], theta: Floats, ordinates: Ordinates, floor: float
) -> tuple[Spectrum, float]:
    spectrum = spectrum_of(
        with_parameters(effects, theta), ordinates.frequency_hz, ordinates.sample_time_s, floor
    )
    return spectrum, log_likelihood(spectrum.psd, ordinates)


def _step(
    spectrum: Spectrum,
    ordinates: Ordinates,
    theta: Floats,
    prior: Prior,
    limits: tuple[Floats, Floats],
    damping: float,
) -> tuple[Floats, float]:
    pull, curvature = prior.slope_and_curvature(theta)
    misfit = ordinates.power / spectrum.psd - 1.0
    slope = spectrum.tangent @ (0.5 * ordinates.dof * misfit) - pull
    stuck = ((theta <= limits[0]) & (slope < 0.0)) | ((theta >= limits[1]) & (slope > 0.0))
    move = np.flatnonzero(~stuck)
    step = np.zeros_like(theta)
    if move.size == 0:
        return step, 0.0
    J = information(spectrum.tangent[move], ordinates.dof) + curvature[np.ix_(move, move)]
    scale = np.maximum(np.diag(J), 1e-6)
    damped = J + np.diag((damping + 1e-9) * scale)
    step[move] = _bounded(damped, slope[move])
    return step, float(slope @ step)


def _bounded(curvature: Floats, slope: Floats) -> Floats:
    """Solve for a step of at most ``LONGEST_STEP`` in any parameter.

    Those that would go farther go that far and the others make the best of it: scaled down
    altogether, a parameter that nothing holds would keep the others where they are.
    """
    whole = np.asarray(np.linalg.solve(curvature, slope), dtype=np.float64)
    far = np.abs(whole) > LONGEST_STEP
    if not far.any():
        return whole
    step: Floats = np.asarray(np.clip(whole, -LONGEST_STEP, LONGEST_STEP))
    near = ~far
    pull = slope[near] - curvature[np.ix_(near, far)] @ step[far]
    rest = np.linalg.solve(curvature[np.ix_(near, near)], pull)
    step[near] = np.clip(rest, -LONGEST_STEP, LONGEST_STEP)
    uphill = float(slope @ step) > 0.0
    return step if uphill else np.asarray(whole * (LONGEST_STEP / float(np.abs(whole).max())))
