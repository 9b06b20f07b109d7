"""Deterministic courses by generalised least squares in the DCT-II: ramp, temperature, steps."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy import fft

from imu_noise_id.effects.base import CourseEffect, Effect, ResponseEffect
from imu_noise_id.effects.bias_step import BiasStep
from imu_noise_id.effects.rate_ramp import RateRamp
from imu_noise_id.effects.temperature import Temperature
from imu_noise_id.model import Estimate, FittedEffect
from imu_noise_id.ordinates import Ordinates, bin_edges, ordinates
from imu_noise_id.recording import Floats
from imu_noise_id.selection import SLOW, prune, select, white_start, worth
from imu_noise_id.whittle import Fit, fit

PRICE = 12.0
CLEAR = 5.0
"""Nats by which a ramp must fit better than a slow term, or both names are said."""
CLEARLY = 6.0
"""Gain in 2 l that a course needs where it takes the place of a slow term (3 nats: what fits
equally keeps the name that asks for less)."""
MOST_STEPS = 3
SCAN = 2**16
ROUNDS = 3


@dataclass(frozen=True)
class Course:
    """One regressor and its estimate.

    Attributes
    ----------
    effect : CourseEffect
        With fitted values.
    unit_coefficients : (n,) float64
        DCT-II of the course at amount 1.
    amount, std_error : float
    note : str
        Which name fits about as well, where one does.
    """

    effect: CourseEffect
    unit_coefficients: Floats
    amount: float
    std_error: float
    note: str = ""

    def fitted(self, unit: str) -> FittedEffect:
        """Return the effect with its interval; the time of a step has none."""
        rows = []
        for parameter in self.effect.parameters:
            value = getattr(self.effect, parameter.name)
            name_of_unit = parameter.unit_for(unit)
            if parameter.name == "time_s":
                rows.append(Estimate(value, None, None, None, name_of_unit))
                continue
            reach = 1.96 * self.std_error
            rows.append(Estimate(value, self.std_error, value - reach, value + reach, name_of_unit))
        return FittedEffect(self.effect, tuple(rows), self.note)


@dataclass(frozen=True)
class Explained:
    """A record split into courses and noise.

    Attributes
    ----------
    courses : tuple of Course
    coefficients : (n,) float64
        DCT-II of what remains.
    fit : Fit
        Of what remains; its degrees of freedom are less by what the courses took.
    peaks_hz : tuple of float
        Where the bins are narrow.
    rivals : tuple of str
        Courses that would fit about as well as the slow terms.
    """

    courses: tuple[Course, ...]
    coefficients: Floats
    fit: Fit
    peaks_hz: tuple[float, ...]
    rivals: tuple[str, ...] = ()


def explain(
    coefficients: Floats,
    base: Fit,
    start_s: float,
    temperature: Floats | None,
    peaks_hz: tuple[float, ...] = (),
) -> Explained:
    """Add courses to a fitted spectrum as long as they are worth their price.

    Parameters
    ----------
    coefficients : (n,) float64
        DCT-II of a complete record.
    base : Fit
        Of its ordinates.
    start_s : float
        Time of the first sample.
    temperature : (n,) float64 or None
        At the samples.
    peaks_hz : tuple of float
        Of the bins, as the ordinates of ``base`` have them.
    """
    best = Explained((), coefficients, base, peaks_hz)
    if not _worth_a_look(coefficients, base, temperature):
        return best
    while True:
        trials, rivals = [best], []
        for effect, unit_course in _candidates(best, start_s, temperature):
            trial = _with_course(coefficients, best, effect, unit_course)
            if _clear(trial, best):
                trials.append(trial)
            elif _worth(trial) > _worth(best):
                rivals.append(effect.name)
        grown = max(trials, key=_worth)
        if grown is best:
            courses = tuple(_noted(c, best, base) for c in best.courses)
            return dataclasses.replace(_spent(best), courses=courses, rivals=tuple(rivals))
        best = grown


def _noted(course: Course, found: Explained, base: Fit) -> Course:
    """Say of a ramp that stands alone with white noise when a slow term fits the record as well."""
    alone = not _drifts(found.fit) and len(found.courses) == 1
    if not isinstance(course.effect, RateRamp) or not alone:
        return course
    rivals = [base] if _drifts(base) else _with_a_slow_term(found.fit.effects, base)
    equal = [r for r in rivals if found.fit.log_likelihood - r.log_likelihood < CLEAR]
    if not equal:
        return course
    rival = next(e.name for e in max(equal, key=worth).effects if isinstance(e, SLOW))
    return dataclasses.replace(
        course, note=f"between {course.effect.name} and {rival}: they fit this record equally"
    )


def _drifts(fitted: Fit) -> bool:
    return any(isinstance(e, SLOW) for e in fitted.effects)


def _with_a_slow_term(effects: tuple[Effect, ...], base: Fit) -> list[Fit]:
    bare = fit(effects, base.ordinates, base.floor)
    starts = (start for kind in SLOW for start in kind.starts(bare.residual))
    return [fit((*effects, start), base.ordinates, base.floor) for start in starts]


def _clear(trial: Explained, best: Explained) -> bool:
    """Whether a course stands for itself, or beats by far the slow terms that it replaces."""
    slow = [sum(isinstance(e, SLOW) for e in x.fit.effects) for x in (trial, best)]
    gain = trial.fit.log_likelihood - best.fit.log_likelihood
    return slow[0] >= slow[1] or 2.0 * gain > CLEARLY


def _worth(explained: Explained) -> float:
    n = explained.coefficients.size
    steps = sum(isinstance(c.effect, BiasStep) for c in explained.courses)
    return worth(explained.fit) - _step_price(n) * steps - PRICE * (len(explained.courses) - steps)


def _step_price(n: int) -> float:
    """Price of a step: that of a course and of the search over its time."""
    return PRICE + 2.0 * float(np.log(min(n, SCAN)))


def _worth_a_look(coefficients: Floats, base: Fit, temperature: Floats | None) -> bool:
    """False where only noise without memory was found and no regressor stands out of it."""
    if any(isinstance(effect, SLOW) for effect in base.effects):
        return True
    n, dt = coefficients.size, base.ordinates.sample_time_s
    regressors = [_ramp(n, dt)] + ([_dct(temperature)] if temperature is not None else [])
    psd = _low_psd(base, n)
    strong = any(abs(a / s) > 3.0 for a, s in (_gls(coefficients, x, psd, dt) for x in regressors))
    return strong or _scan(coefficients, base)[1] > _step_price(n)


def _candidates(
    current: Explained, start_s: float, temperature: Floats | None
) -> list[tuple[CourseEffect, Floats]]:
    n, dt = current.coefficients.size, current.fit.ordinates.sample_time_s
    taken = [c.effect.name for c in current.courses]
    out: list[tuple[CourseEffect, Floats]] = []
    if RateRamp.name not in taken:
        out.append((RateRamp(1.0), _ramp(n, dt)))
    if temperature is not None and Temperature.name not in taken and np.ptp(temperature) > 0.0:
        out.append((Temperature(1.0), _dct(temperature)))
    place, chi2 = _scan(current.coefficients, current.fit)
    if taken.count(BiasStep.name) < MOST_STEPS and chi2 > 0.4 * _step_price(n):
        effect = BiasStep(start_s + place * dt, 1.0)
        out.append((effect, _dct((np.arange(n) >= place).astype(float))))
    return out


def _dct(course: Floats) -> Floats:
    coefficients = np.asarray(fft.dct(course - course[0], norm="ortho"))
    coefficients[0] = 0.0
    return coefficients


def _ramp(n: int, sample_time_s: float) -> Floats:
    """DCT-II of the times of n samples: -sqrt(2/n) dt cos(x)/(2 sin^2 x) at odd k, x = pi k/2n."""
    coefficients = np.zeros(n)
    x = (0.5 * np.pi / n) * np.arange(1, n, 2)
    coefficients[1::2] = -np.sqrt(0.5 / n) * sample_time_s * np.cos(x) / np.sin(x) ** 2
    return coefficients


def _low_psd(current: Fit, n: int) -> Floats:
    """Fitted spectrum at the first ``SCAN`` ordinates, infinite at 0: all that courses reach."""
    frequency_hz = np.arange(1, min(n, SCAN)) / (2.0 * current.ordinates.duration_s)
    grid = current.ordinates.frequency_hz
    psd = np.exp(np.interp(frequency_hz, grid, np.log(current.spectrum.psd)))
    return np.concatenate(([np.inf], psd))


def _gls(coefficients: Floats, x: Floats, psd: Floats, sample_time_s: float) -> tuple[float, float]:
    """Amount of a regressor and its standard error, from the ordinates of ``psd``."""
    weighted = x[: psd.size] * (sample_time_s / psd)
    information = max(float(weighted @ x[: psd.size]), np.finfo(float).tiny)
    error = 1.0 / float(np.sqrt(information))
    return float(weighted @ coefficients[: psd.size]) / information, error


def _with_course(
    coefficients: Floats,
    current: Explained,
    effect: CourseEffect,
    unit_course: Floats,
) -> Explained:
    """Split off one course more: amount and spectrum in turn, all courses together."""
    dt = current.fit.ordinates.sample_time_s
    design = [*(c.unit_coefficients for c in current.courses), unit_course]
    effects = [c.effect for c in current.courses] + [effect]
    noise = current.fit
    for turn in range(ROUNDS):
        psd = _low_psd(noise, coefficients.size)
        if turn == 0:
            psd[1:] = np.median(psd[1:])
        slow = np.stack([x[: psd.size] for x in design])
        weighted = slow * (dt / psd)
        covariance = np.linalg.pinv(weighted @ slow.T, hermitian=True)
        amounts = covariance @ (weighted @ coefficients[: psd.size])
        rest = coefficients.copy()
        for amount, x in zip(amounts, design, strict=True):
            rest -= amount * x
        spectrum = _like(ordinates(rest, dt, current.peaks_hz), current.fit.ordinates)
        noise = fit(_with_white(noise.effects, spectrum), spectrum, noise.floor, rough=True)
        if turn == 0:
            noise = prune(noise, SLOW)
    errors = np.sqrt(np.diag(covariance))
    courses = tuple(
        Course(_with_amount(e, float(a)), x, float(a), float(s))
        for e, x, a, s in zip(effects, design, amounts, errors, strict=True)
    )
    return Explained(courses, rest, noise, current.peaks_hz)


def _with_white(effects: tuple[Effect, ...], spectrum: Ordinates) -> tuple[Effect, ...]:
    """Effects with white noise where they are slow alone: a course may leave nothing but that."""
    if all(isinstance(e, (*SLOW, ResponseEffect)) for e in effects):
        return (white_start(spectrum), *effects)
    return effects


def _like(fresh: Ordinates, model: Ordinates) -> Ordinates:
    """Fresh powers with the degrees of freedom of the ordinates before."""
    return dataclasses.replace(fresh, dof=model.dof)


def _with_amount(effect: CourseEffect, amount: float) -> CourseEffect:
    name = "height" if isinstance(effect, BiasStep) else effect.parameters[0].name
    changed = effect.replace(**{name: amount})
    assert isinstance(changed, CourseEffect)
    return changed


def _spent(explained: Explained) -> Explained:
    """Choose the noise again, less the degrees of freedom that the courses used (REML)."""
    if not explained.courses:
        return explained
    dt = explained.fit.ordinates.sample_time_s
    psd = _low_psd(explained.fit, explained.coefficients.size)
    design = np.stack([c.unit_coefficients for c in explained.courses])
    basis, _ = np.linalg.qr((design[:, : psd.size] * np.sqrt(dt / psd)).T)
    leverage = np.zeros(explained.coefficients.size)
    leverage[: psd.size] = np.sum(basis**2, axis=1)
    edges = bin_edges(explained.coefficients.size, dt, explained.peaks_hz)
    used = np.add.reduceat(leverage[: edges[-1]], edges[:-1])
    grid = explained.fit.ordinates
    dof = np.maximum(grid.dof - used, 1e-6)
    power = grid.power * grid.dof / dof
    reduced = dataclasses.replace(grid, dof=dof, power=power)
    return dataclasses.replace(
        explained, fit=select(reduced, explained.fit.floor, explained.fit.effects)
    )


def _scan(coefficients: Floats, noise: Fit) -> tuple[int, float]:
    """Sample after the most likely step, and its chi-square with one degree of freedom.

    With X_k(s) the DCT-II of a unit step at sample s, the score sum X_k C_k/S_k is a running sum of
    the doubly whitened record and the information sum X_k^2/S_k a cosine transform of weights, for
    all s at once.  Long records are scanned on their first ``SCAN`` ordinates.
    """
    n = coefficients.size
    m = min(n, SCAN)
    psd = _low_psd(noise, n) / noise.ordinates.sample_time_s
    weighted = coefficients[:m] / psd
    doubly = np.asarray(fft.idct(weighted, norm="ortho"))
    score = np.cumsum(doubly[::-1])[::-1]
    k = np.arange(m)
    power = np.zeros(m)
    power[1:] = 1.0 / (psd[1:] * 4.0 * m * np.sin(0.5 * np.pi * k[1:] / m) ** 2)
    information = power.sum() - np.real(fft.fft(power))
    edge = max(16, m // 1000)
    if m <= 4 * edge:
        return n // 2, 0.0
    inside = slice(edge, m - edge)
    chi2 = score[inside] ** 2 / np.maximum(information[inside], np.finfo(float).tiny)
    best = int(np.argmax(chi2))
    return round((best + edge) * n / m), float(chi2[best])
