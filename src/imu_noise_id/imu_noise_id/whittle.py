"""Whittle likelihood of a sum of effects on DCT-II ordinates, and its maximum.

Each ordinate is S_k times chi-square over its degrees of freedom nu_k, so that

    l(theta) = -1/2 sum nu_k (log S_k + P_k/S_k),   J = 1/2 sum nu_k dlogS_k dlogS_k',

theta the logarithms of all free parameters; maximised by Fisher scoring with analytic derivatives
(Whittle 1953; Dzhaparidze 1986).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imu_noise_id.effects.base import Effect, ResponseEffect, StochasticEffect
from imu_noise_id.ordinates import Ordinates, Residual
from imu_noise_id.recording import Floats

MAX_STEP = 2.0
MAX_ITERATIONS = 60
TOLERANCE = 1e-5
ROUGH_ITERATIONS = 15
ROUGH_TOLERANCE = 0.05


@dataclass(frozen=True)
class Spectrum:
    """Modelled spectrum at the ordinates.

    Attributes
    ----------
    psd : (b,) float64
    tangent : (p, b) float64
        Derivatives of log psd by the logarithms of the free parameters, effects in order.
    """

    psd: Floats
    tangent: Floats


@dataclass(frozen=True)
class Fit:
    """Effects at the maximum of the likelihood.

    Attributes
    ----------
    effects : tuple of Effect
        Stochastic and response effects with fitted values.
    log_likelihood : float
    spectrum : Spectrum
        At the maximum.
    ordinates : Ordinates
    floor : float
        Known white spectrum beneath everything (rounding), unit^2/Hz.
    at_limit : (p,) bool
        Parameters that ended at a limit.
    """

    effects: tuple[Effect, ...]
    log_likelihood: float
    spectrum: Spectrum
    ordinates: Ordinates
    floor: float
    at_limit: np.ndarray

    @property
    def residual(self) -> Residual:
        """What the fit leaves, for score statistics."""
        tangent = self.spectrum.tangent
        return Residual(self.ordinates, self.spectrum.psd, tangent)

    @property
    def information(self) -> Floats:
        """Fisher information of the log parameters, (p, p)."""
        return information(self.spectrum.tangent, self.ordinates.dof)


def information(tangent: Floats, dof: Floats) -> Floats:
    """J = 1/2 sum nu dlogS dlogS', (p, p)."""
    return np.asarray((tangent * (0.5 * dof)) @ tangent.T)


def log_covariance(fitted: Fit) -> Floats:
    """Inverse information of the log parameters, (p, p); huge where nothing is known."""
    J = fitted.information
    scale = np.sqrt(np.maximum(np.diag(J), 1e-12))
    correlation = J / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(correlation)
    inverse = (vectors / np.maximum(values, 1e-10)) @ vectors.T
    return np.asarray(inverse / np.outer(scale, scale))


def spectrum_of(
    effects: tuple[Effect, ...], frequency_hz: Floats, sample_time_s: float, floor: float = 0.0
) -> Spectrum:
    """Spectrum R(f) * sum S_j(f) + floor with its log derivatives."""
    sources = np.zeros_like(frequency_hz)
    response = np.ones_like(frequency_hz)
    rows: list[tuple[bool, Floats]] = []
    for effect in effects:
        if isinstance(effect, StochasticEffect):
            sources += effect.psd(frequency_hz, sample_time_s)
            rows.append((False, effect.psd_gradient(frequency_hz, sample_time_s)))
        elif isinstance(effect, ResponseEffect):
            response = response * effect.power_response(frequency_hz, sample_time_s)
            rows.append((True, effect.log_response_gradient(frequency_hz, sample_time_s)))
    shaped = response * sources
    psd = np.maximum(shaped + floor, np.finfo(float).tiny)
    parts = [row * (shaped if is_log else response) / psd for is_log, row in rows]
    tangent = np.concatenate(parts) if parts else np.zeros((0, frequency_hz.size))
    return Spectrum(psd, tangent)


def log_likelihood(psd: Floats, ordinates: Ordinates) -> float:
    """Return l = -1/2 sum nu (log S + P/S)."""
    return float(-0.5 * np.sum(ordinates.dof * (np.log(psd) + ordinates.power / psd)))


def parameter_vector(effects: tuple[Effect, ...]) -> Floats:
    """Logarithms of the free parameters, effects and parameters in order."""
    return np.log([getattr(e, name) for e in effects for name in e.free()])


def with_parameters(effects: tuple[Effect, ...], theta: Floats) -> tuple[Effect, ...]:
    """Effects with other values of their free parameters."""
    changed, used = [], 0
    for effect in effects:
        names = effect.free()
        values = np.exp(theta[used : used + len(names)])
        changed.append(effect.replace(**dict(zip(names, map(float, values), strict=True))))
        used += len(names)
    return tuple(changed)


def _limits(effects: tuple[Effect, ...], ordinates: Ordinates) -> tuple[Floats, Floats]:
    """Lower and upper limits of the log parameters, (p,) each."""
    pairs = [
        pair
        for effect in effects
        for pair in effect.limits(ordinates.sample_time_s, ordinates.duration_s)
    ]
    bounds = np.array(pairs).reshape(-1, 2)
    with np.errstate(divide="ignore"):
        return np.log(bounds[:, 0]), np.log(bounds[:, 1])


def fit(
    effects: tuple[Effect, ...],
    ordinates: Ordinates,
    floor: float = 0.0,
    held: tuple[int, ...] = (),
    rough: bool = False,
) -> Fit:
    """Maximise the likelihood from the given values.

    Parameters
    ----------
    effects : tuple of Effect
        Starting values.
    ordinates : Ordinates
    floor : float
        Known white spectrum beneath everything.
    held : tuple of int
        Log parameters that stay where they are (for profiles).
    rough : bool
        Stop where 0.05 nats are left to gain, for trials.

    Returns
    -------
    Fit
    """
    theta = parameter_vector(effects)
    free = np.ones(theta.size, dtype=bool)
    free[list(held)] = False
    lower, upper = _limits(effects, ordinates)
    theta = np.where(free, np.clip(theta, lower, upper), theta)
    effects = with_parameters(effects, theta)
    spectrum, value = _evaluate(effects, ordinates, floor)
    damping = 1e-3
    enough = ROUGH_TOLERANCE if rough else TOLERANCE
    for _ in range(ROUGH_ITERATIONS if rough else MAX_ITERATIONS):
        step, gain = _step(spectrum, ordinates, theta, (lower, upper), free, damping)
        if gain * (1.0 + damping) < enough:
            break
        trial = np.clip(theta + step, np.minimum(lower, theta), np.maximum(upper, theta))
        trial_effects = with_parameters(effects, trial)
        trial_spectrum, trial_value = _evaluate(trial_effects, ordinates, floor)
        if trial_value > value:
            effects, theta = trial_effects, trial
            spectrum, value = trial_spectrum, trial_value
            lower, upper = _limits(effects, ordinates)
            damping = max(damping * 0.1, 1e-6)
        else:
            damping *= 8.0
            if damping > 1e8:
                break
    at_limit = (theta <= lower + 1e-9) | (theta >= upper - 1e-9)
    return Fit(effects, value, spectrum, ordinates, floor, at_limit)


def _evaluate(
    effects: tuple[Effect, ...], ordinates: Ordinates, floor: float
) -> tuple[Spectrum, float]:
    spectrum = spectrum_of(effects, ordinates.frequency_hz, ordinates.sample_time_s, floor)
    return spectrum, log_likelihood(spectrum.psd, ordinates)


def _step(
    spectrum: Spectrum,
    ordinates: Ordinates,
    theta: Floats,
    limits: tuple[Floats, Floats],
    free: np.ndarray,
    damping: float,
) -> tuple[Floats, float]:
    """Damped scoring step within the limits and the gain in likelihood that it promises."""
    misfit = ordinates.power / spectrum.psd - 1.0
    slope = spectrum.tangent @ (0.5 * ordinates.dof * misfit)
    stuck = ((theta <= limits[0]) & (slope < 0.0)) | ((theta >= limits[1]) & (slope > 0.0))
    move = np.flatnonzero(free & ~stuck)
    step = np.zeros_like(theta)
    if move.size == 0:
        return step, 0.0
    J = information(spectrum.tangent[move], ordinates.dof)
    scale = np.maximum(np.diag(J), 1e-10)
    damped = J + np.diag(damping * scale + 1e-9 * scale)
    step[move] = np.linalg.solve(damped, slope[move])
    longest = np.abs(step).max()
    if longest > MAX_STEP:
        step *= MAX_STEP / longest
    return step, float(slope @ step)
