"""Small arrays for pictures, from recordings of any length and from models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imu_noise_id.effects.base import Effect, ResponseEffect, StochasticEffect
from imu_noise_id.effects.outliers import Outliers
from imu_noise_id.effects.output_rounding import OutputRounding
from imu_noise_id.effects.rate_ramp import RateRamp
from imu_noise_id.recording import Floats
from imu_noise_id.series import Series


@dataclass(frozen=True)
class Envelope:
    """Smallest and largest sample, and mean, of equal stretches of time; NaN where none was seen.

    Attributes
    ----------
    time_s, low, high, mean : (b,) float64
    """

    time_s: Floats
    low: Floats
    high: Floats
    mean: Floats


def envelope(series: Series, most: int = 500) -> Envelope:
    """Reduce a series to at most ``most`` stretches without losing an extreme."""
    n = series.values.size
    width = max(1, -(-n // most))
    count = -(-n // width)
    starts = np.arange(count, dtype=np.int64) * width
    seen = series.observed
    low = np.minimum.reduceat(np.where(seen, series.values, np.inf), starts)
    high = np.maximum.reduceat(np.where(seen, series.values, -np.inf), starts)
    samples = np.add.reduceat(seen.astype(float), starts)
    total = np.add.reduceat(np.where(seen, series.values, 0.0), starts)
    empty = samples == 0
    mean = np.where(empty, np.nan, total / np.maximum(samples, 1.0))
    middle = series.start_s + series.sample_time_s * (starts + 0.5 * (width - 1)).astype(float)
    return Envelope(middle, np.where(empty, np.nan, low), np.where(empty, np.nan, high), mean)


@dataclass(frozen=True)
class Part:
    """One effect's share of a curve.

    Attributes
    ----------
    label : str
    values : (n,) float64
    """

    label: str
    values: Floats


def psd_parts(effects: tuple[Effect, ...], frequency_hz: Floats, dt: float) -> list[Part]:
    """Spectrum of each source behind the sensor's bandwidth."""
    response = np.ones_like(frequency_hz)
    for effect in effects:
        if isinstance(effect, ResponseEffect):
            response = response * effect.power_response(frequency_hz, dt)
    return [
        Part(label, effect.psd(frequency_hz, dt) * response)
        for label, effect in labelled(effects)
        if isinstance(effect, StochasticEffect) and effect.name != "periodic"
    ]


def labelled(effects: tuple[Effect, ...]) -> list[tuple[str, Effect]]:
    """Names that tell effects of one kind apart: ``gauss_markov``, ``gauss_markov 2``."""
    counts: dict[str, int] = {}
    named = []
    for effect in effects:
        counts[effect.name] = counts.get(effect.name, 0) + 1
        number = counts[effect.name]
        named.append((effect.name if number == 1 else f"{effect.name} {number}", effect))
    return named


def allan_parts(effects: tuple[Effect, ...], tau_s: Floats, dt: float) -> list[Part]:
    """Allan deviation that each effect alone would show."""
    parts = []
    for label, effect in labelled(effects):
        if isinstance(effect, StochasticEffect):
            variance = effect.allan_variance(tau_s, dt)
        elif isinstance(effect, RateRamp):
            variance = 0.5 * (effect.slope * tau_s) ** 2
        elif isinstance(effect, OutputRounding):
            variance = effect.added_psd(dt) / tau_s
        elif isinstance(effect, Outliers):
            variance = effect.rate * effect.scale**2 * dt / tau_s
        else:
            continue
        parts.append(Part(label, np.sqrt(np.maximum(variance, 0.0))))
    return parts
