"""Curves that a model predicts: spectrum and Allan variance, to lay over a recording's."""

from __future__ import annotations

import numpy as np

from imu_noise_id.allan import allan_exact
from imu_noise_id.effects.base import CourseEffect, ResponseEffect, StochasticEffect
from imu_noise_id.effects.outliers import Outliers
from imu_noise_id.effects.output_rounding import OutputRounding
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.model import ChannelModel
from imu_noise_id.recording import Floats
from imu_noise_id.series import Series

INTEGRAL_POINTS = 2**14
COURSE_POINTS = 4096


def model_psd(model: ChannelModel, frequency_hz: Floats, sample_time_s: float) -> Floats:
    """Two-sided PSD of a channel without its lines and courses, (n,).

    Parameters
    ----------
    model : ChannelModel
    frequency_hz : (n,) float64
        Above 0 and up to half the rate.
    sample_time_s : float
    """
    effects = [f.effect for f in model.effects]
    psd = np.zeros_like(frequency_hz)
    for effect in effects:
        if isinstance(effect, StochasticEffect):
            psd += effect.psd(frequency_hz, sample_time_s)
    for effect in effects:
        if isinstance(effect, ResponseEffect):
            psd *= effect.power_response(frequency_hz, sample_time_s)
    return psd + _added_psd(model, sample_time_s)


def model_allan_variance(
    model: ChannelModel,
    tau_s: Floats,
    sample_time_s: float,
    temperature: Floats | None = None,
    span_s: tuple[float, float] | None = None,
) -> Floats:
    """Allan variance that a channel's model predicts, (t,).

    Sources by their own laws; a response by the integral of what it takes away,

        4 int S(f) (1 - R(f)) sin^4(pi f tau)/(m sin(pi f dt))^2 df;

    courses by the Allan variance of their samples over the time that the curve describes.

    Parameters
    ----------
    model : ChannelModel
    tau_s : (t,) float64
    sample_time_s : float
    temperature : (n,) float64, optional
        At uniform times over the span, where the model has a temperature effect.
    span_s : (float, float), optional
        First and last time of the samples, since the recording's first stamp; the whole duration
        of the model when left out.
    """
    effects = [f.effect for f in model.effects]
    held = _held(model, tau_s / sample_time_s)
    total = held * _added_psd(model, sample_time_s) / tau_s
    for effect in effects:
        if isinstance(effect, StochasticEffect):
            factor = held if isinstance(effect, WhiteNoise) else 1.0
            total = total + factor * effect.allan_variance(tau_s, sample_time_s)
    if any(isinstance(e, ResponseEffect) for e in effects):
        total = total - _taken_away(model, tau_s, sample_time_s)
    courses = [e for e in effects if isinstance(e, CourseEffect)]
    span_s = span_s or (0.0, model.duration_s or 0.0)
    if courses and span_s[1] > span_s[0]:
        total = total + _course_allan(courses, tau_s, span_s, temperature)
    return np.maximum(total, 0.0)


def _held(model: ChannelModel, m: Floats) -> Floats:
    """Factor on the Allan variance of white noise of which every sample is sent k times.

    Averaged over the phase of the hold the samples have r(h) = 1 - h/k; sums of m have variance
    V = m + 2 sum (m - h) r(h), neighbouring sums covariance C = sum min(h, 2 m - h) r(h).
    """
    found = model.find("held_samples")
    k = float(getattr(found.effect, "factor", 1.0)) if found else 1.0
    lag = np.arange(1, int(np.ceil(k)))[:, None]
    r = 1.0 - lag / k
    V = m + 2.0 * np.sum(np.maximum(m - lag, 0.0) * r, axis=0)
    C = np.sum(np.maximum(np.minimum(lag, 2.0 * m - lag), 0.0) * r, axis=0)
    return np.asarray((V - C) / m)


def _added_psd(model: ChannelModel, sample_time_s: float) -> float:
    """White spectrum of outliers, and of rounding where it is white beside the noise."""
    level = 0.0
    for fitted in model.effects:
        if isinstance(fitted.effect, Outliers):
            level += fitted.effect.rate * fitted.effect.scale**2 * sample_time_s
        elif isinstance(fitted.effect, OutputRounding):
            added = fitted.effect.added_psd(sample_time_s)
            level += added if added < 0.5 * _fast_noise(model, sample_time_s) else 0.0
    return level


def _fast_noise(model: ChannelModel, sample_time_s: float) -> float:
    """White level that differs from sample to sample as much as the sources do, unit^2/Hz."""
    tau_s = np.array([sample_time_s])
    sources = (f.effect for f in model.effects if isinstance(f.effect, StochasticEffect))
    return sample_time_s * sum(float(e.allan_variance(tau_s, sample_time_s)[0]) for e in sources)


def _taken_away(model: ChannelModel, tau_s: Floats, sample_time_s: float) -> Floats:
    step = 0.5 / sample_time_s / INTEGRAL_POINTS
    frequency_hz = (np.arange(INTEGRAL_POINTS, dtype=np.float64) + 0.5) * step
    sources = np.zeros_like(frequency_hz)
    response = np.ones_like(frequency_hz)
    for effect in (f.effect for f in model.effects):
        if isinstance(effect, StochasticEffect):
            sources += effect.psd(frequency_hz, sample_time_s)
        elif isinstance(effect, ResponseEffect):
            response = response * effect.power_response(frequency_hz, sample_time_s)
    weight = sources * (1.0 - response) / np.sin(np.pi * sample_time_s * frequency_hz) ** 2
    kernel = [float(weight @ np.sin(np.pi * t * frequency_hz) ** 4) for t in tau_s]
    return 4.0 * step * np.array(kernel) * (sample_time_s / tau_s) ** 2


def _course_allan(
    courses: list[CourseEffect],
    tau_s: Floats,
    span_s: tuple[float, float],
    temperature: Floats | None,
) -> Floats:
    time_s = np.linspace(*span_s, COURSE_POINTS)
    if temperature is not None:
        place = np.linspace(0.0, 1.0, temperature.size)
        temperature = np.interp(np.linspace(0.0, 1.0, COURSE_POINTS), place, temperature)
    total: Floats = np.sum([c.course(time_s, temperature) for c in courses], axis=0)
    step_s = float(time_s[1] - time_s[0])
    m = np.unique(np.maximum(np.rint(tau_s / step_s), 1.0)).astype(np.int64)
    series = Series(total, np.ones(COURSE_POINTS, dtype=bool), step_s)
    curve = allan_exact(series, m[m <= COURSE_POINTS // 2 - 1])
    log_tau = np.log(np.maximum(curve.tau_s, step_s))
    variance = np.maximum(curve.deviation**2, np.finfo(float).tiny)
    shown = np.exp(np.interp(np.log(tau_s), log_tau, np.log(variance)))
    return np.asarray(np.where(tau_s < step_s, shown * (tau_s / step_s) ** 2, shown))
