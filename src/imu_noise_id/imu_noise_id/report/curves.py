"""Small arrays for pictures, from recordings of any length and from models."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from imu_noise_id.curves import model_allan_variance, model_psd
from imu_noise_id.effects.base import CourseEffect, Effect, StochasticEffect
from imu_noise_id.effects.outliers import Outliers
from imu_noise_id.effects.output_rounding import OutputRounding
from imu_noise_id.model import ChannelModel
from imu_noise_id.recording import Floats
from imu_noise_id.series import Series

SOURCES = (StochasticEffect, CourseEffect, Outliers, OutputRounding)
"""Effects that add to the signal, and so have a share of a curve."""


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
    samples = np.add.reduceat(series.observed, starts, dtype=float)

    def reduced(by: np.ufunc, nothing: float) -> Floats:
        seen = series.values
        if not series.complete:
            seen = np.where(series.observed, seen, nothing)
        return np.where(samples == 0, np.nan, by.reduceat(seen, starts))

    middle = series.start_s + series.sample_time_s * (starts + 0.5 * (width - 1)).astype(float)
    low, high = reduced(np.minimum, np.inf), reduced(np.maximum, -np.inf)
    return Envelope(middle, low, high, reduced(np.add, 0.0) / np.maximum(samples, 1.0))


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


def psd_parts(model: ChannelModel, frequency_hz: Floats, dt: float) -> list[Part]:
    """Spectrum of each source behind the sensor's bandwidth."""
    return [
        Part(label, model_psd(alone, frequency_hz, dt))
        for label, source, alone in _alone(model)
        if isinstance(source, StochasticEffect) and source.name != "periodic"
    ]


def allan_parts(
    model: ChannelModel,
    tau_s: Floats,
    dt: float,
    temperature: Floats | None = None,
    span_s: tuple[float, float] | None = None,
) -> list[Part]:
    """Allan deviation that each effect alone would show, arguments as `model_allan_variance`."""
    parts = []
    for label, source, alone in _alone(model):
        if isinstance(source, OutputRounding):
            variance = source.added_psd(dt) / tau_s
        else:
            variance = model_allan_variance(alone, tau_s, dt, temperature, span_s)
        parts.append(Part(label, np.sqrt(variance)))
    return parts


def _alone(model: ChannelModel) -> list[tuple[str, Effect, ChannelModel]]:
    """Each source's label, and the model with this source only; names that come twice counted."""
    sources = [f for f in model.effects if isinstance(f.effect, SOURCES)]
    others = tuple(f for f in model.effects if not isinstance(f.effect, SOURCES))
    names = [f.name for f in sources]
    alone = []
    for k, fitted in enumerate(sources):
        number = names[: k + 1].count(fitted.name)
        label = fitted.name if number == 1 else f"{fitted.name} {number}"
        alone.append((label, fitted.effect, replace(model, effects=(fitted, *others))))
    return alone
