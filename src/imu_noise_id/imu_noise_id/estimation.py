"""One series -> its effects: contamination, gaps, lines, spectrum and courses, in that order."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from imu_noise_id.ambiguity import equal_names, upper_bounds
from imu_noise_id.contamination import Contamination, find_contamination
from imu_noise_id.courses import Explained, explain
from imu_noise_id.dither import dithered, fill_floor
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.effects.periodic import Periodic
from imu_noise_id.gaps import draw_missing, interpolate, roughly_filled
from imu_noise_id.intervals import estimates
from imu_noise_id.lines import Line, find_lines, level_without_lines, without_peaks
from imu_noise_id.model import Estimate, FittedEffect, UpperBound
from imu_noise_id.ordinates import Ordinates, cosine_coefficients, fast_length, ordinates
from imu_noise_id.recording import Floats, Mask
from imu_noise_id.selection import SLOW, SMOOTH, select
from imu_noise_id.series import Series
from imu_noise_id.whittle import Fit, spectrum_of

LEAST_DRAWS, MOST_DRAWS = 2, 12
SKIRT = 0.15
NARROW_HZ = 1.0
LONGEST_WHITE = 2**20


@dataclass(frozen=True)
class SeriesModel:
    """Noise of one series.

    Attributes
    ----------
    mean : float
        Of the samples that are no outliers.
    effects : tuple of FittedEffect
        In physical order.
    log_covariance : (p, p) float64
        Of the logarithms of the free parameters of the spectral effects, in the order of
        ``effects``; other parameters have rows of their variance, uncorrelated.
    bounds : tuple of UpperBound
    notes : tuple of str
    fit : Fit
        Of the spectrum of what the courses and the lines leave.
    white : (m,) float32
        Leading samples of the record, whitened, of unit variance.
    """

    mean: float
    effects: tuple[FittedEffect, ...]
    log_covariance: Floats
    bounds: tuple[UpperBound, ...]
    notes: tuple[str, ...]
    fit: Fit
    white: NDArray[np.float32]


@dataclass(frozen=True)
class Analysis:
    """A complete record taken apart."""

    lines: tuple[Line, ...]
    explained: Explained

    def deterministic(self, n: int, sample_time_s: float) -> Floats:
        """Lines and courses at the samples, (n,)."""
        total = np.zeros(n)
        for course in self.explained.courses:
            total += fft.idct(course.amount * course.unit_coefficients, norm="ortho")
        for line in self.lines:
            total += line.course(n, sample_time_s)
        return total


def estimate_series(
    series: Series,
    unit: str,
    rng: np.random.Generator,
    temperature: Floats | None = None,
) -> SeriesModel:
    """Effects of one series with intervals.

    Parameters
    ----------
    series : Series
        At least 32 observed samples that are not all equal.
    unit : str
        Unit of the channel.
    rng : numpy.random.Generator
        Draws missing samples; another one for each channel, or they seem to share noise.
    temperature : (n,) float64 or None
        At the samples of the series.
    """
    contamination = find_contamination(series, unit)
    analysis, whole = _analyse_mended(series, contamination, temperature, rng)
    fitted = analysis.explained.fit
    spectral, covariance = estimates(fitted, unit)
    named = tuple(
        dataclasses.replace(e, note=note)
        for e, note in zip(spectral, equal_names(fitted, analysis.explained.rivals), strict=True)
    )
    lines = tuple(_line_effect(x, fitted.ordinates.duration_s, unit) for x in analysis.lines)
    courses = tuple(c.fitted(unit) for c in analysis.explained.courses)
    effects, log_covariance = _in_order(
        named, covariance, (*courses, *lines, *contamination.effects)
    )
    mean = dataclasses.replace(series, observed=contamination.observed).mean
    bounds = upper_bounds(fitted, unit)
    white = _whitened(analysis, whole, contamination.observed)
    return SeriesModel(mean, effects, log_covariance, bounds, contamination.notes, fitted, white)


def _whitened(analysis: Analysis, whole: Floats, observed: Mask) -> NDArray[np.float32]:
    """Leading samples of the noise divided by the root of its spectrum, 0 where none was seen."""
    fitted = analysis.explained.fit
    grid = fitted.ordinates
    course = analysis.deterministic(whole.size, grid.sample_time_s)
    rest = whole[:LONGEST_WHITE] - course[:LONGEST_WHITE]
    coefficients = cosine_coefficients(rest)
    frequency_hz = np.arange(rest.size) / (2.0 * rest.size * grid.sample_time_s)
    psd = np.exp(np.interp(frequency_hz, grid.frequency_hz, np.log(fitted.spectrum.psd)))
    coefficients[0] = 0.0
    coefficients /= np.sqrt(psd / grid.sample_time_s)
    white = np.where(observed[: rest.size], fft.idct(coefficients, norm="ortho"), 0.0)
    return white.astype(np.float32)


def _analyse_mended(
    series: Series,
    contamination: Contamination,
    temperature: Floats | None,
    rng: np.random.Generator,
) -> tuple[Analysis, Floats]:
    """Analysis of the record, its missing samples drawn given the others, and that record."""
    size = fast_length(series.values.size)
    dt = series.sample_time_s
    observed = contamination.observed[:size]
    values, floor = _no_quieter(series.values[:size], contamination.floor, dt, rng)
    heat = None if temperature is None else temperature[:size]
    known = (series.start_s, heat, contamination.worth * _worth(observed))
    if observed.all():
        whole, coefficients, added = dithered(values, dt, rng)
        return _analyse(coefficients, dt, floor + added, *known), whole
    unseen = _unseen(observed)
    filled = roughly_filled(values, observed, rng)
    least = _draws(observed)
    for draw in range(MOST_DRAWS):
        coefficients = cosine_coefficients(filled)
        added = fill_floor(coefficients, dt, unseen)
        if draw >= least and added == 0.0:
            break
        beneath = floor + added
        smooth = select(without_peaks(ordinates(coefficients, dt)), beneath, (), SMOOTH)
        filled = _redrawn(values, observed, filled, smooth, 0.0, rng)
    filled, coefficients, added = dithered(filled, dt, rng, unseen)
    floor = floor + added
    analysis = _analyse(coefficients, dt, floor, *known)
    course = analysis.deterministic(size, dt)
    filled = _redrawn(filled, observed, filled, analysis.explained.fit, course, rng)
    return _analyse(cosine_coefficients(filled), dt, floor, *known), filled


def _no_quieter(
    values: Floats, floor: float, sample_time_s: float, rng: np.random.Generator
) -> tuple[Floats, float]:
    """Values with as much white noise as coarse rounding took from them, and the floor then."""
    if floor >= 0.0:
        return values, floor
    return values + rng.standard_normal(values.size) * np.sqrt(-floor / sample_time_s), 0.0


def _unseen(observed: Mask) -> float:
    """Share of neighbouring samples of which one or both are missing."""
    return 1.0 - float(np.mean(observed[1:] & observed[:-1]))


def _worth(observed: Mask) -> float:
    """Information of a record whose missing samples are drawn, of a whole one's.

    With an unseen share g the seen samples have 1 - g of it, and the drawn ones scatter about the
    draw before: a variance is (1 + g/(1 + g))/(1 - g) of a whole record's.
    """
    unseen = _unseen(observed)
    return (1.0 - unseen**2) / (1.0 + 2.0 * unseen)


def _draws(observed: Mask) -> int:
    """How often the missing samples are drawn anew: till what was filled first is forgotten.

    A drawn sample repeats what the fit before said of it, so that with an unseen share g an error e
    of the first fill's spectrum is g^k e after k draws; n samples show one of about 2/sqrt(n).
    """
    unseen = float(np.clip(_unseen(observed), 1e-6, 0.99))
    needed = np.ceil(np.log(2.0 / np.sqrt(observed.size)) / np.log(unseen))
    return int(np.clip(needed, LEAST_DRAWS, MOST_DRAWS))


def _redrawn(
    values: Floats,
    observed: Mask,
    filled: Floats,
    fitted: Fit,
    course: Floats | float,
    rng: np.random.Generator,
) -> Floats:
    """Record with its missing samples drawn from a fit to how they were filled before."""
    dt = fitted.ordinates.sample_time_s

    def psd(frequency_hz: Floats) -> Floats:
        return spectrum_of(fitted.effects, frequency_hz, dt, fitted.floor).psd

    noise = interpolate(filled - course, observed)
    return np.where(observed, values, course + draw_missing(noise, observed, dt, psd, rng))


def _analyse(
    coefficients: Floats,
    sample_time_s: float,
    floor: float,
    start_s: float,
    temperature: Floats | None,
    worth: float,
) -> Analysis:
    """Take the DCT-II of a complete record apart that has a share ``worth`` of its information."""
    grid = ordinates(coefficients, sample_time_s)
    base = select(without_peaks(grid), floor, (), SMOOTH)
    lines, wide = find_lines(coefficients, grid, level_without_lines(grid, base.spectrum.psd))
    clear = tuple(line for line in lines if _apart(line, wide))
    grid, rest = _without_lines(coefficients, sample_time_s, clear, wide)
    fitted = select(_spent(grid, clear, worth), floor, base.effects)
    if wide:
        level = level_without_lines(grid, fitted.spectrum.psd)
        more, _ = find_lines(rest, grid, level)
        if more:
            clear = (*clear, *more)
            grid, rest = _without_lines(coefficients, sample_time_s, clear, wide)
            fitted = select(_spent(grid, clear, worth), floor, fitted.effects)
    peaks = _narrow_peaks(fitted)
    if peaks:
        wide = (*wide, *peaks)
        grid = ordinates(rest, sample_time_s, wide)
        fitted = select(_spent(grid, clear, worth), floor, fitted.effects)
    return Analysis(clear, explain(rest, fitted, start_s, temperature, wide))


def _narrow_peaks(fitted: Fit) -> tuple[float, ...]:
    """Centres of narrow bands so narrow that the width of the bins would widen them."""
    return tuple(
        effect.frequency_hz
        for effect in fitted.effects
        if isinstance(effect, NarrowBand) and effect.bandwidth_hz < NARROW_HZ
    )


def _apart(line: Line, wide: tuple[float, ...]) -> bool:
    """Whether no wide peak is near whose skirts could be taken for the line."""
    return all(abs(line.frequency_hz / peak - 1.0) > SKIRT for peak in wide)


def _without_lines(
    coefficients: Floats, sample_time_s: float, lines: tuple[Line, ...], wide: tuple[float, ...]
) -> tuple[Ordinates, Floats]:
    """Ordinates and DCT-II of a record less its lines."""
    rest = coefficients
    if lines:
        courses = sum(line.course(coefficients.size, sample_time_s) for line in lines)
        rest = coefficients - cosine_coefficients(np.asarray(courses))
    return ordinates(rest, sample_time_s, wide), rest


def _spent(grid: Ordinates, lines: tuple[Line, ...], worth: float) -> Ordinates:
    """Degrees of freedom less what lines took and what samples that are not seen cost."""
    dof = grid.dof.copy()
    for line in lines:
        nearest = int(np.argmin(np.abs(grid.frequency_hz - line.frequency_hz)))
        dof[nearest] = max(dof[nearest] - line.dof, 0.1 * dof[nearest])
    power = grid.power * (grid.dof / dof)
    return dataclasses.replace(grid, dof=worth * dof, power=power)


def _line_effect(line: Line, duration_s: float, unit: str) -> FittedEffect:
    frequency_error, amplitude_error = line.standard_errors(duration_s)
    pairs = ((line.frequency_hz, frequency_error, "Hz"), (line.amplitude, amplitude_error, unit))
    rows = tuple(Estimate(v, s, v - 1.96 * s, v + 1.96 * s, u) for v, s, u in pairs)
    return FittedEffect(Periodic(line.frequency_hz, line.amplitude), rows)


def _in_order(
    spectral: tuple[FittedEffect, ...], covariance: Floats, others: tuple[FittedEffect, ...]
) -> tuple[tuple[FittedEffect, ...], Floats]:
    """Effects in physical order with the covariance of all their numbers."""
    effects = (*spectral, *others)
    rows: list[list[int]] = []
    variances = list(np.diag(covariance))
    used = 0
    for i, fitted in enumerate(effects):
        own = []
        free = fitted.effect.free() if i < len(spectral) else ()
        for parameter, estimate in zip(fitted.effect.parameters, fitted.estimates, strict=True):
            if parameter.name in free:
                own.append(used)
                used += 1
            elif not isinstance(estimate.value, str):
                own.append(len(variances))
                variances.append(_variance(estimate, parameter.positive))
        rows.append(own)
    whole = np.diag(np.array(variances))
    whole[: covariance.shape[0], : covariance.shape[0]] = covariance
    order = sorted(range(len(effects)), key=lambda i: (effects[i].effect.stage, _rank(effects[i])))
    index = [j for i in order for j in rows[i]]
    return tuple(effects[i] for i in order), whole[np.ix_(index, index)]


def _rank(fitted: FittedEffect) -> tuple[int, str, float]:
    """White noise first, then the slow terms, then the rest by name and frequency."""
    frequency = getattr(fitted.effect, "frequency_hz", 0.0)
    place = 0 if fitted.name == "white_noise" else 1 if isinstance(fitted.effect, SLOW) else 2
    return place, fitted.name, frequency


def _variance(estimate: Estimate, positive: bool) -> float:
    error = estimate.std_error or 0.0
    if positive and isinstance(estimate.value, float) and estimate.value > 0.0:
        error /= estimate.value
    return error**2
