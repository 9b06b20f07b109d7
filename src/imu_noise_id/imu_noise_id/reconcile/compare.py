"""Significance of a channel's battery: p-values of all statistics, and where the worst lie."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import fft
from scipy.special import chdtrc

from imu_noise_id.effects.base import Effect
from imu_noise_id.effects.bias_instability import BiasInstability
from imu_noise_id.effects.rate_ramp import RateRamp
from imu_noise_id.effects.rate_random_walk import RateRandomWalk
from imu_noise_id.effects.temperature import Temperature
from imu_noise_id.ordinates import Residual
from imu_noise_id.reconcile.battery import battery
from imu_noise_id.reconcile.null import Null, log_p_of, z_of
from imu_noise_id.reconcile.prior import FREE_STD_ERROR, map_fit, without
from imu_noise_id.reconcile.result import Where
from imu_noise_id.reconcile.state import Analysis, Column, State, analyse
from imu_noise_id.recording import Floats

UNSEEN_GAIN = 6.0


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
        return combined(self.worst.log_p, len(self.all))

    def significant(self, log_level: float) -> tuple[Where, ...]:
        """Where the findings lie that pass the level one by one, worst first."""
        limit = log_level - np.log(len(self.all))
        return tuple(f.where for f in self.all if f.log_p < limit)


def combined(log_p: float, tests: int) -> float:
    """log(1 - (1 - p)^tests): Sidak, an upper bound where the tests are dependent."""
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
    out.append(_drift(state, found))
    refit = _refit(state, found)
    if refit is not None:
        out.append(refit)
    return Findings(tuple(sorted(out, key=lambda f: f.log_p)))


def _finding(name: str, log_p: float, where: Where) -> Finding:
    z = z_of(log_p)
    return Finding(name, log_p, z, replace(where, z=float(np.copysign(z, where.z or 1.0))))


def step_scores(state: State, found: Analysis) -> tuple[Floats, Floats, float]:
    """Score of a step before every sample, by generalised least squares.

    z(t) = s_t' V^-1 y / sqrt(s_t' V^-1 s_t), V diagonal in the DCT-II.  The numerator is a reversed
    sum of V^-1 y; the denominator, with the DCT of a step, -sin(pi k t/n)/(sqrt(2 n)
    sin(pi k/2n)), is a cosine sum in k.

    Returns
    -------
    z : (n - 1,) float64
        For a step between samples t and t + 1, t = 0 ... n - 2.
    power : (n - 1,) float64
        The denominator squared.
    increment : float
        Variance of the numerator's difference from one sample to the next.
    """
    n = found.coefficients.size
    weight = found.inverse_psd * state.sample_time_s
    v = fft.idct(found.coefficients * weight, norm="ortho")
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


def _steps(state: State, found: Analysis) -> Finding:
    """Largest step score, and the tail of such a maximum.

    The scores are locally an Ornstein-Uhlenbeck process, correlation 1 - c_t from one sample to the
    next: P(max |z| > u) = 2 u phi(u) sum c_t + 2 Phi(-u) (Pickands 1969; for white noise this is
    James, James and Siegmund 1987, eq. 5).
    """
    z, power, increment = step_scores(state, found)
    edge = max(16, z.size // 200)
    inner = slice(edge, z.size - edge)
    z, power = z[inner], power[inner]
    at = int(np.argmax(np.abs(z)))
    top = abs(float(z[at]))
    correlation = 0.5 * (power[1:] + power[:-1] - increment) / np.sqrt(power[1:] * power[:-1])
    changes = float(np.sum(1.0 - np.clip(correlation, -1.0, 1.0)))
    log_density = -0.5 * top**2 - 0.5 * float(np.log(2.0 * np.pi))
    log_many = float(np.log(2.0 * max(top, 1.0) * changes + 1e-300)) + log_density
    log_p = min(float(np.logaddexp(log_p_of(top), log_many)), 0.0)
    time_s = state.start_s + (at + edge + 1) * state.sample_time_s
    return _finding("step", log_p, Where("time", time_s, time_s, "s", float(np.sign(z[at]))))


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
    grown = replace(state, columns=(*state.columns, column), effects=found.fit.effects)
    fitted = analyse(grown)
    gain = max(fitted.objective - found.objective, 0.0)
    if state.prior.drift is not None:
        gain = max(gain - UNSEEN_GAIN, 0.0)
    sign = float(np.sign(fitted.sizes[-1]))
    return _finding(name, _log_chi2(1, 2.0 * gain), replace(place, z=sign))


def _drift(state: State, found: Analysis) -> Finding:
    """Gain of a walk or of flicker beside what there is; half a chi-square with one degree each.

    A model that was identified without any slow term passed over one of up to ``UNSEEN_GAIN`` nats:
    that much is no news.
    """
    residual = Residual(found.ordinates, found.fit.spectrum.psd, found.fit.spectrum.tangent)
    gain = 0.0
    for kind in (RateRandomWalk, BiasInstability):
        for start in kind.starts(residual)[:1]:
            effects = (*found.fit.effects, start)
            grown = map_fit(effects, found.ordinates, state.prior, state.floor)
            gain = max(gain, grown.objective - found.fit.objective)
    if state.prior.drift is not None:
        gain = max(gain - UNSEEN_GAIN, 0.0)
    f = found.white.frequency_hz
    place = Where("allan", 0.1 / float(f[0]), 0.5 / float(f[0]), "s", 1.0)
    return _finding("drift", _log_chi2(1, 2.0 * gain), place)


def _log_chi2(dof: int, value: float) -> float:
    """Logarithm of the upper tail."""
    tail = float(chdtrc(dof, value))
    return float(np.log(tail)) if tail > 1e-290 else -0.5 * value


def _refit(state: State, found: Analysis) -> Finding | None:
    """Gain of letting the model's own parameters go: chi-square over their number."""
    q = state.prior.centre.size
    if q == 0 or not np.any(state.prior.std_error < FREE_STD_ERROR):
        return None
    free = map_fit(
        found.fit.effects, found.ordinates, without(state.prior, list(range(q))), state.floor
    )
    gain = max(free.objective - found.fit.objective, 0.0)
    log_p = _log_chi2(q, 2.0 * gain)
    f = found.white.frequency_hz
    return _finding("refit", log_p, Where("spectrum", float(f[0]), float(f[-1]), "Hz", 1.0))
