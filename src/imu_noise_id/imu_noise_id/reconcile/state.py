"""One channel under comparison: its record, its current model, and what the model leaves of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import fft

from imu_noise_id.effects.base import CourseEffect, Effect
from imu_noise_id.effects.quantization import Quantization
from imu_noise_id.ordinates import Ordinates, bin_edges, ordinates
from imu_noise_id.reconcile.battery import Whitened
from imu_noise_id.reconcile.prior import MapFit, Prior, map_fit
from imu_noise_id.recording import Floats
from imu_noise_id.whittle import spectrum_of

COURSE_ROUNDS = 3
SETTLED = 0.02
"""Standard errors by which courses may still move."""


@dataclass(frozen=True)
class Column:
    """A signal of known shape and unknown size in the record.

    Attributes
    ----------
    effect : Effect
        With ``size`` 1 for courses; lines have two columns of one effect.
    shape : (n,) float64
    size, std_error : float
        What the given model says of the size; infinite ``std_error`` where it is free.
    given : bool
        Whether the given model has it.
    span_s : (float, float) or None
        From when to when a line is there; None: all the time.
    """

    effect: Effect
    shape: Floats
    size: float = 0.0
    std_error: float = np.inf
    given: bool = False
    span_s: tuple[float, float] | None = None

    @cached_property
    def coefficients(self) -> Floats:
        """DCT of the shape."""
        return _dct(self.shape)


@dataclass(frozen=True)
class State:
    """Record and current model of one channel.

    Attributes
    ----------
    values : (n,) float64
        Complete, cleaned of what is not noise by its spectrum (hits, bursts, holds).
    sample_time_s, start_s : float
    temperature : (n,) float64 or None
    effects : tuple of Effect
        Spectral effects, those of the prior first.
    prior : Prior
    columns : tuple of Column
    floor : float
        White spectrum of the rounding and of the dither, unit^2/Hz.
    dither : float
        Of the dither alone (``dither.py``).
    """

    values: Floats
    sample_time_s: float
    start_s: float
    temperature: Floats | None
    effects: tuple[Effect, ...]
    prior: Prior
    columns: tuple[Column, ...] = ()
    floor: float = 0.0
    dither: float = 0.0

    @property
    def time_s(self) -> Floats:
        """Time of each sample since the recording's first stamp."""
        return np.asarray(self.start_s + self.sample_time_s * np.arange(self.values.size))

    @property
    def rounding_step(self) -> float:
        """Step of the rounding that the spectrum has; 0 without one."""
        return float(np.sqrt(12.0 * max(self.floor - self.dither, 0.0) / self.sample_time_s))

    def with_values(self, values: Floats) -> State:
        """The same model on other samples."""
        return replace(self, values=values)


@dataclass(frozen=True)
class Analysis:
    """A state's best fit and what it leaves.

    Attributes
    ----------
    state : State
        As it was before the fit.
    fit : MapFit
    objective : float
        Log-likelihood less all prior costs, nats.
    sizes, errors : (c,) float64
        Of the columns, with standard errors.
    ordinates : Ordinates
        Of the record without its columns.
    coefficients : (n,) float64
        DCT of the record without its columns.
    """

    state: State
    fit: MapFit
    objective: float
    sizes: Floats
    errors: Floats
    ordinates: Ordinates
    coefficients: Floats

    @cached_property
    def inverse_psd(self) -> Floats:
        """1/S of the fit at each DCT ordinate, 0 at the level; (n,) float64."""
        state = self.state
        n = self.coefficients.size
        return inverse_psd(self.fit.effects, n, state.sample_time_s, state.floor)

    @cached_property
    def white(self) -> Whitened:
        """The record without its columns, whitened by the fit."""
        fit = self.fit
        white = whiten(
            self.coefficients, self.ordinates, fit.spectrum.psd, self.inverse_psd, self.state
        )
        gain = np.sqrt(self.inverse_psd * self.state.sample_time_s)
        pair = np.array([1.0, -1.0])
        flattest = rounding_kurtosis(fit.effects, self.state.sample_time_s, gain, (pair,))
        return replace(white, flattest=flattest)


def analyse(state: State) -> Analysis:
    """Fit a state's effects within their prior and its columns, and whiten what is left.

    The columns are sized first, under the spectrum of the state's effects as they are: a walk that
    is fitted first grows to hold a step, and the two alternate for long.
    """
    C = _dct(state.values - state.values[0])
    X = np.array([c.coefficients for c in state.columns]).reshape(-1, C.size)
    sizes, errors = np.zeros(0), np.zeros(0)
    effects, rest = state.effects, C
    for _ in range(COURSE_ROUNDS if state.columns else 1):
        if state.columns:
            inverse = inverse_psd(effects, C.size, state.sample_time_s, state.floor)
            before = sizes
            sizes, errors = generalised_least_squares(state, C, inverse)
            if before.size and np.all(np.abs(sizes - before) < SETTLED * errors):
                break
            rest = C - sizes @ X
        bins = ordinates(rest, state.sample_time_s)
        fitted = map_fit(effects, bins, state.prior, state.floor)
        effects = fitted.effects
    cost = sum(
        0.5 * ((size - c.size) / c.std_error) ** 2
        for size, c in zip(sizes, state.columns, strict=True)
    )
    return Analysis(state, fitted, fitted.objective - cost, sizes, errors, bins, rest)


def whiten(
    coefficients: Floats, bins: Ordinates, psd: Floats, inverse: Floats, state: State
) -> Whitened:
    """Record of unit white noise where ``psd`` is right."""
    scaled = coefficients * np.sqrt(inverse * state.sample_time_s)
    samples = np.asarray(fft.idct(scaled, norm="ortho"))
    return Whitened(
        samples, bins.frequency_hz, bins.power / psd, bins.dof, state.sample_time_s, state.start_s
    )


def rounding_kurtosis(
    effects: tuple[Effect, ...], sample_time_s: float, gain: Floats, shapes: tuple[Floats, ...]
) -> float:
    """Excess kurtosis of a whitened record in which an integrator's rounding is uniform.

    Quantization noise is what rounding leaves of an angle, differenced: where it dominates, rates
    have a triangular law.  The simulator's own is Gaussian, so that anything from here to 0 agrees.
    Fourth cumulants of independent parts add, -6/5 sigma^4 for a uniform one.

    Parameters
    ----------
    effects : tuple of Effect
    sample_time_s : float
        Over which the sensor integrates.
    gain : (n,) float64
        Of the whitening at each DCT ordinate.
    shapes : tuple of (m,) float64
        What one rounding error is in the record.
    """
    sigma = sum(e.coefficient for e in effects if isinstance(e, Quantization)) / sample_time_s
    if sigma == 0.0:
        return 0.0
    total = 0.0
    for shape in shapes:
        course = np.zeros(gain.size)
        course[gain.size // 2 :][: shape.size] = shape
        total += float(np.sum(np.asarray(fft.idct(_dct(course) * gain, norm="ortho")) ** 4))
    return -1.2 * sigma**4 * total


def inverse_psd(effects: tuple[Effect, ...], n: int, sample_time_s: float, floor: float) -> Floats:
    """1/S at the n DCT ordinates, interpolated between bins; 0 for the level."""
    edges = bin_edges(n, sample_time_s)
    middle = 0.5 * (edges[:-1] + edges[1:] - 1)
    log_psd = np.log(
        spectrum_of(effects, middle / (2.0 * n * sample_time_s), sample_time_s, floor).psd
    )
    inverse = np.exp(-np.interp(np.arange(n), middle, log_psd))
    inverse[0] = 0.0
    return np.asarray(inverse)


def course_column(
    effect: CourseEffect,
    state: State,
    size_name: str,
    std_error: float = np.inf,
    given: bool = False,
) -> Column:
    """Column of a course that is proportional to its parameter ``size_name``."""
    size = float(getattr(effect, size_name))
    unit = effect.replace(**{size_name: 1.0})
    assert isinstance(unit, CourseEffect)
    shape = unit.course(state.time_s, state.temperature)
    return Column(unit, shape, size if given else 0.0, std_error, given)


def _dct(values: Floats) -> Floats:
    return np.asarray(fft.dct(values, norm="ortho"))


def generalised_least_squares(
    state: State, coefficients: Floats, inverse: Floats
) -> tuple[Floats, Floats]:
    """Sizes of a state's columns with standard errors, what the given model says of them counted.

    Parameters
    ----------
    state : State
    coefficients, inverse : (n,) float64
        DCT of the record, and 1/S.
    """
    X = np.array([c.coefficients for c in state.columns])
    weight = inverse * state.sample_time_s
    prior = np.array([1.0 / c.std_error**2 for c in state.columns])
    centre = np.array([c.size for c in state.columns])
    normal = (X * weight) @ X.T + np.diag(prior)
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    covariance = np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-10)
    covariance /= np.outer(scale, scale)
    right = (X * weight) @ coefficients + np.diag(prior) @ centre
    return covariance @ right, np.sqrt(np.diag(covariance))
