"""Significance of a channel's battery: p-values of all statistics, and where the worst lie."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import betainc, chdtrc

from imu_noise_id.effects.base import Effect, StochasticEffect
from imu_noise_id.effects.bias_instability import BiasInstability
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.effects.quantization import Quantization
from imu_noise_id.effects.rate_ramp import RateRamp
from imu_noise_id.effects.rate_random_walk import RateRandomWalk
from imu_noise_id.effects.temperature import Temperature
from imu_noise_id.ordinates import Residual
from imu_noise_id.reconcile import bands
from imu_noise_id.reconcile.battery import battery
from imu_noise_id.reconcile.null import Null, log_p_of, z_of
from imu_noise_id.reconcile.prior import FREE_STD_ERROR, given_effects, map_fit, without
from imu_noise_id.reconcile.result import Where, distinct
from imu_noise_id.reconcile.state import Analysis, Column, State, analyse
from imu_noise_id.reconcile.steps import best_step, scan_density
from imu_noise_id.recording import Floats
from imu_noise_id.whittle import parameter_vector, spectrum_of

INDEPENDENT = 0.6
"""Tests that the battery is worth over those that it has: slow ones share what they see, and so do
fast ones (240 channels with nothing hidden: smallest p-values as of half as many)."""


FORM_ERROR = 0.25
"""Share of its size by which a real ramp or warming differs from the catalogue's straight line."""


@dataclass(frozen=True)
class Finding:
    """One statistic with its significance.

    Attributes
    ----------
    name : str
    log_p : float
    z : float
        Two-sided standard deviations of that p-value.
    where : Where
    """

    name: str
    log_p: float
    z: float
    where: Where


@dataclass(frozen=True)
class Findings:
    """The battery on one channel.

    Attributes
    ----------
    all : tuple of Finding
        Worst first.
    """

    all: tuple[Finding, ...]

    @property
    def worst(self) -> Finding:
        """Finding with the smallest p-value."""
        return self.all[0]

    @property
    def log_p(self) -> float:
        """Logarithm of the chance that the worst of so many is as bad or worse."""
        return combined(self.worst.log_p, INDEPENDENT * len(self.all))

    def significant(self, log_level: float) -> tuple[Where, ...]:
        """Where the findings lie that pass the level one by one, worst first, each place once."""
        limit = log_level - np.log(INDEPENDENT * len(self.all))
        return distinct(tuple(f.where for f in self.all if f.log_p < limit))


def combined(log_p: float, tests: float) -> float:
    """log(1 - (1 - p)^tests): Sidak, for so many independent tests."""
    if log_p < -12.0:
        return log_p + float(np.log(tests))
    p = min(np.exp(log_p), 1.0 - 1e-12)
    return float(np.log(-np.expm1(tests * np.log1p(-p))))


def examine(state: State, found: Analysis, null: Null, skip: frozenset[str]) -> Findings:
    """Battery, courses and the model's own parameters on one channel."""
    out = [
        _finding(s.name, null.log_p(s.name, s.nats), s.where)
        for s in battery(found.white)
        if s.name not in skip
    ]
    out.append(_steps(state, found))
    out += _courses(state, found)
    out += _shapes(state, found)
    out += _refits(state, found)
    out += _given_courses(state, found)
    out += _added_bands(state, found)
    return Findings(tuple(sorted(out, key=lambda f: f.log_p)))


def _finding(name: str, log_p: float, where: Where) -> Finding:
    z = z_of(log_p)
    return Finding(name, log_p, z, replace(where, z=float(np.copysign(z, where.z or 1.0))))


def _steps(state: State, found: Analysis) -> Finding:
    """Gain of the best step beside slow noise that floats, and the tail of such a maximum.

    The scores are locally an Ornstein-Uhlenbeck process, correlation 1 - c_t from one sample to the
    next: P(max |z| > u) = 2 u phi(u) sum c_t + 2 Phi(-u) (Pickands 1969; for white noise this is
    James, James and Siegmund 1987, eq. 5), u^2/2 the gain.
    """
    best = best_step(state, found)
    top = float(np.sqrt(2.0 * max(best.gain, 0.0)))
    log_density = -0.5 * top**2 - 0.5 * float(np.log(2.0 * np.pi))
    log_many = float(np.log(2.0 * max(top, 1.0) * scan_density(state, found) + 1e-300))
    log_p = min(float(np.logaddexp(log_p_of(top), log_many + log_density)), 0.0)
    place = Where("time", best.time_s, best.time_s, "s", float(np.sign(best.height)))
    return _finding("step", log_p, place)


def _courses(state: State, found: Analysis) -> list[Finding]:
    """Gain of a straight line in time and of the temperature, the slow noise fitted anew.

    A drift disguises itself as slow noise, so its score beside that noise says little.
    """
    out = []
    t = state.time_s
    place = Where("time", float(t[0]), float(t[-1]), "s", 0.0)
    if not any(c.effect.name == "rate_ramp" for c in state.columns):
        out.append(_course(state, found, "ramp", RateRamp(1.0), (t - t.mean()), place))
    T = state.temperature
    if T is None or float(np.ptp(T)) < 1e-6:
        return out
    if not any(c.effect.name == "temperature" for c in state.columns):
        place = Where("regressor", float(T.min()), float(T.max()), "degC", 0.0)
        out.append(_course(state, found, "temperature", Temperature(1.0), T - T.mean(), place))
    return out


def _course(
    state: State, found: Analysis, name: str, effect: Effect, shape: Floats, place: Where
) -> Finding:
    column = Column(effect, shape)
    fitted = with_column(state, found, column)
    gain = max(fitted.objective - found.objective, 0.0)
    log_p = gain_log_p(freedom(state, found, column), 2.0 * gain)
    return _finding(name, log_p, replace(place, z=float(np.sign(fitted.sizes[-1]))))


def freedom(state: State, found: Analysis, column: Column) -> float:
    """Degrees of freedom by which the variance of a course's size is known.

    nu = 2/(g' Cov g) with g the derivatives of that variance's logarithm: those of log S, averaged
    where the whitened course is (Satterthwaite 1946).  Of a drift that shows in few ordinates, few.
    """
    spectrum, bins = found.fit.spectrum, found.ordinates
    weight = column.coefficients**2 * found.inverse_psd
    frequency_hz = np.arange(weight.size) / (2.0 * weight.size * state.sample_time_s)
    mean = [float(np.interp(frequency_hz, bins.frequency_hz, t) @ weight) for t in spectrum.tangent]
    slope = np.array(mean) / float(np.sum(weight))
    return 2.0 / max(float(slope @ found.fit.covariance @ slope), 1e-9)


def with_column(state: State, found: Analysis, column: Column) -> Analysis:
    """Best fit with one course more.

    From the fit's own effects, and where an unseen drift has grown to hold the course, from the
    model as given: the two alternate too slowly to find their way back.  That drift may then hold
    as much of the course as its form is wrong by.
    """
    columns, drift = (*state.columns, column), state.prior.drift
    if drift is None:
        return analyse(replace(state, columns=columns, effects=found.fit.effects))
    starts = (found.fit.effects, given_effects(found.fit.effects, state.prior))
    trials = [analyse(replace(state, columns=columns, effects=effects)) for effects in starts]
    best = max(trials, key=lambda trial: trial.objective)
    room = drift.with_room(_form_error(column, float(best.sizes[-1]), state, drift.frequency_hz))
    prior = replace(state.prior, drift=room)
    return analyse(replace(state, columns=columns, effects=best.fit.effects, prior=prior))


def _form_error(column: Column, size: float, state: State, frequency_hz: Floats) -> Floats:
    """PSD of what a course's form may be wrong by, its zeros between ordinates filled."""
    power = (FORM_ERROR * size * column.coefficients) ** 2 * state.sample_time_s
    envelope = np.maximum(power, np.append(power[1:], 0.0))
    ordinate = frequency_hz * 2.0 * state.values.size * state.sample_time_s
    return np.asarray(np.interp(ordinate, np.arange(1, power.size), envelope[1:]))


def _shapes(state: State, found: Analysis) -> list[Finding]:
    """Gains of the catalogue's smooth spectra, each one more term beside all that floats.

    A strength alone gains half a chi-square of one degree, none where it would be negative; a
    correlation time that is sought as well makes it two degrees.
    """
    f = found.white.frequency_hz
    slow = Where("allan", 0.1 / float(f[0]), 0.5 / float(f[0]), "s", 1.0)
    fast = Where("spectrum", 0.5 * float(f[-1]), float(f[-1]), "Hz", 1.0)
    bases = footings(state, found)
    half = float(np.log(2.0))
    drift = max(_gain(k, bases, state, found) for k in (RateRandomWalk, BiasInstability))
    blue = _gain(Quantization, bases, state, found)
    wander = _gain(GaussMarkov, bases, state, found)
    return [
        _finding("drift", _log_chi2(1, 2.0 * drift), slow),
        _finding("blue", _log_chi2(1, 2.0 * blue) - half, fast),
        _finding("wander", _log_chi2(2, 2.0 * wander), slow),
    ]


def _gain(
    kind: type[StochasticEffect], bases: tuple[Footing, ...], state: State, found: Analysis
) -> float:
    gain = 0.0
    for effects, residual in bases:
        for start in kind.starts(residual)[:1]:
            grown = map_fit((*effects, start), found.ordinates, state.prior, state.floor)
            gain = max(gain, grown.objective - found.fit.objective)
    return gain


def residual_of(state: State, found: Analysis) -> Residual:
    """What a fit leaves, for the effects' own starting values."""
    known = _known(found.fit.effects, state)
    spectrum = found.fit.spectrum
    return Residual(found.ordinates, spectrum.psd, spectrum.tangent, known)


def _known(effects: tuple[Effect, ...], state: State) -> Floats:
    theta = parameter_vector(effects) if effects else np.zeros(0)
    return state.prior.slope_and_curvature(theta)[1]


Footing = tuple[tuple[Effect, ...], Residual]


def footings(state: State, found: Analysis) -> tuple[Footing, ...]:
    """Effects beside which one more may start, and what they leave.

    The fit's own; where an unseen drift floats, which may have grown to hold what is sought, the
    model as given too.
    """
    own = (found.fit.effects, residual_of(state, found))
    if state.prior.drift is None:
        return (own,)
    effects = given_effects(found.fit.effects, state.prior)
    bins = found.ordinates
    spectrum = spectrum_of(effects, bins.frequency_hz, bins.sample_time_s, state.floor)
    q = state.prior.centre.size
    kept = np.setdiff1d(np.arange(spectrum.tangent.shape[0]), [q, q + 1])
    known = _known(effects, state)[np.ix_(kept, kept)]
    return (effects, Residual(bins, spectrum.psd, spectrum.tangent[kept], known)), own


def _log_chi2(dof: int, value: float) -> float:
    """Logarithm of the upper tail."""
    tail = float(chdtrc(dof, value))
    return float(np.log(tail)) if tail > 1e-290 else -0.5 * value


def gain_log_p(dof: float, value: float) -> float:
    """Logarithm of the two tails where a gain 2 G = (nu + 1) log(1 + t^2/nu) has this ``value``."""
    tail = float(betainc(0.5 * dof, 0.5, np.exp(-value / (dof + 1.0))))
    return float(np.log(tail)) if tail > 1e-290 else -0.5 * value * dof / (dof + 1.0)


def _refits(state: State, found: Analysis) -> list[Finding]:
    """Gain of letting one of the model's effects go: chi-square over its parameters."""
    out = []
    q = state.prior.centre.size
    if not np.any(state.prior.std_error < FREE_STD_ERROR):
        return []
    f = found.white.frequency_hz
    place = Where("spectrum", float(f[0]), float(f[-1]), "Hz", 1.0)
    row = 0
    for effect in found.fit.effects:
        rows = list(range(row, row + len(effect.free())))
        row += len(rows)
        if not rows or rows[-1] >= q:
            continue
        free = map_fit(found.fit.effects, found.ordinates, without(state.prior, rows), state.floor)
        gain = max(free.objective - found.fit.objective, 0.0)
        out.append(_finding(f"refit {effect.name}", _log_chi2(len(rows), 2.0 * gain), place))
    return out


def _given_courses(state: State, found: Analysis) -> list[Finding]:
    """Gain of letting the size of one of the model's courses go."""
    out = []
    t = state.time_s
    for index, column in enumerate(state.columns):
        if column.given and np.isfinite(column.std_error):
            freed = analyse(replace(freed_column(state, index), effects=found.fit.effects))
            gain = max(freed.objective - found.objective, 0.0)
            more = abs(freed.sizes[index]) - abs(column.size)
            place = Where("time", float(t[0]), float(t[-1]), "s", float(np.sign(more)))
            name = f"refit {column.effect.name}"
            out.append(_finding(name, _log_chi2(1, 2.0 * gain), place))
    return out


def _added_bands(state: State, found: Analysis) -> list[Finding]:
    """Whether a band that was added rings steadily: one of the model's is taken as it is."""
    out = []
    row = 0
    for effect in found.fit.effects:
        row += len(effect.free())
        if isinstance(effect, NarrowBand) and row > state.prior.centre.size:
            half_hz = 0.5 * effect.bandwidth_hz
            low, high = effect.frequency_hz - half_hz, effect.frequency_hz + half_hz
            place = Where("amplitude", low, high, "Hz", 1.0)
            out.append(_finding(bands.NAME, bands.intermittence(found, effect), place))
    return out


def freed_column(state: State, index: int) -> State:
    """The state with the size of one of its columns free."""
    free = replace(state.columns[index], size=0.0, std_error=np.inf)
    return replace(state, columns=(*state.columns[:index], free, *state.columns[index + 1 :]))
