"""Small arrays for pictures, from recordings of any length and from models."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

from imu_noise_id.effects.base import Effect, ResponseEffect, StochasticEffect
from imu_noise_id.recording import Floats
from imu_noise_id.series import Series
from imu_noise_id.whittle import spectrum_of

SEGMENT = 4096
SEGMENTS = 128
SLOW_SAMPLES = 2**16
PER_DECADE = 60
_GRID = 8192


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
    starts = np.arange(count) * width
    seen = series.observed
    low = np.minimum.reduceat(np.where(seen, series.values, np.inf), starts)
    high = np.maximum.reduceat(np.where(seen, series.values, -np.inf), starts)
    samples = np.add.reduceat(seen.astype(float), starts)
    total = np.add.reduceat(np.where(seen, series.values, 0.0), starts)
    empty = samples == 0
    mean = np.where(empty, np.nan, total / np.maximum(samples, 1.0))
    middle = series.start_s + series.sample_time_s * (starts + 0.5 * (width - 1))
    return Envelope(middle, np.where(empty, np.nan, low), np.where(empty, np.nan, high), mean)


@dataclass(frozen=True)
class Spectrum:
    """Two-sided power spectral density on log-spaced frequencies, with 95 % intervals.

    Attributes
    ----------
    frequency_hz, psd, lower, upper : (b,) float64
        unit^2/Hz; the interval is that of the average of independent ordinates.
    """

    frequency_hz: Floats
    psd: Floats
    lower: Floats
    upper: Floats


def spectrum(series: Series) -> Spectrum:
    """Spectrum of a series: whole-record averages at low, segments at high frequency.

    Block means of the whole record (at most 2^16 of them) show the low frequencies, up to 128
    segments of 4096 samples the high ones, so the work does not grow with the recording.  Hann
    taper; absent samples stand at the mean and their share is divided out.
    """
    values = np.where(series.observed, series.values - series.mean, 0.0)
    share = float(series.observed.mean())
    dt = series.sample_time_s
    n = values.size
    block = max(1, -(-n // SLOW_SAMPLES))
    slow = values[: n // block * block].reshape(-1, block).mean(axis=1)
    f_slow, p_slow = _periodogram(slow[None, :], dt * block)
    if block > 1 or n > 4 * SEGMENT:
        f_fast, p_fast = _periodogram(_segments(values), dt)
        # block means lose power towards their Nyquist frequency; segments blur their first bins
        border = min(0.1 / (dt * block), 40.0 * f_fast[1])
        low, high = f_slow < border, f_fast >= border
        f = np.concatenate((f_slow[low], f_fast[high]))
        p = np.concatenate((p_slow[low], p_fast[high]))
        segments = min(SEGMENTS, max(1, n // SEGMENT))
        dof = np.concatenate((np.full(low.sum(), 2.0), np.full(high.sum(), 2.0 * segments)))
    else:
        f, p = f_slow, p_slow
        dof = np.full(f.size, 2.0)
    return _binned(f, p / share, dof)


def _segments(values: Floats) -> Floats:
    count = min(SEGMENTS, values.size // SEGMENT)
    starts = np.linspace(0, values.size - SEGMENT, max(count, 1)).astype(int)
    return np.stack([values[s : s + SEGMENT] for s in starts])


def _periodogram(rows: Floats, dt: float) -> tuple[Floats, Floats]:
    """Mean over rows of the Hann-tapered periodogram, frequency 0 left out."""
    rows = signal.detrend(rows, axis=-1)
    taper = signal.windows.hann(rows.shape[-1], sym=False)
    ordinates = np.abs(np.fft.rfft(rows * taper, axis=-1)) ** 2 * dt / np.sum(taper**2)
    frequency = np.fft.rfftfreq(rows.shape[-1], dt)
    return frequency[1:], ordinates.mean(axis=0)[1:]


def _binned(frequency_hz: Floats, psd: Floats, dof: Floats) -> Spectrum:
    """Average ordinates in bins of equal width in log f; the first ones stay single."""
    decades = np.log10(frequency_hz / frequency_hz[0])
    index = np.floor(decades * PER_DECADE).astype(int)
    _, starts, counts = np.unique(index, return_index=True, return_counts=True)
    mean_f = np.add.reduceat(frequency_hz, starts) / counts
    mean_p = np.add.reduceat(psd, starts) / counts
    # neighbours of a Hann-tapered periodogram share about a third of their information
    total = np.add.reduceat(dof, starts)
    nu = np.where(counts > 1, total / 1.5, total)
    from scipy.stats import chi2

    return Spectrum(
        mean_f, mean_p, mean_p * nu / chi2.ppf(0.975, nu), mean_p * nu / chi2.ppf(0.025, nu)
    )


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


def _floor(effects: tuple[Effect, ...], dt: float) -> float:
    """White spectrum that rounding and outliers add to the sources, unit^2/Hz."""
    floor = 0.0
    for effect in effects:
        if effect.name == "output_rounding":
            floor += getattr(effect, "step") ** 2 / 12.0 * dt  # noqa: B009
        elif effect.name == "outliers":
            floor += getattr(effect, "rate") * getattr(effect, "scale") ** 2 * dt  # noqa: B009
    return floor


def model_psd(effects: tuple[Effect, ...], frequency_hz: Floats, dt: float) -> Floats:
    """Two-sided spectrum of all effects together; lines have no continuous spectrum."""
    return spectrum_of(effects, frequency_hz, dt, _floor(effects, dt)).psd


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
        elif effect.name == "rate_ramp":
            variance = 0.5 * (float(effect.values()[0]) * tau_s) ** 2
        elif effect.name in ("output_rounding", "outliers"):
            variance = _floor((effect,), dt) / tau_s
        else:
            continue
        parts.append(Part(label, np.sqrt(np.maximum(variance, 0.0))))
    return parts


def model_allan(effects: tuple[Effect, ...], tau_s: Floats, dt: float) -> Floats:
    """Allan deviation of all effects together, the sensor's bandwidth included.

    The variances add; what a bandwidth changes is the integral of its share of the spectrum,
    2 int (R(f) - 1) S(f) sin^4(pi f tau)/(m sin(pi f dt))^2 df over both signs of f.
    """
    variance = np.zeros_like(tau_s)
    for part in allan_parts(effects, tau_s, dt):
        variance += part.values**2
    if any(isinstance(effect, ResponseEffect) for effect in effects):
        frequency_hz = (np.arange(_GRID) + 0.5) * (0.5 / dt / _GRID)
        sources = tuple(e for e in effects if isinstance(e, StochasticEffect))
        change = (
            spectrum_of(
                tuple(e for e in effects if isinstance(e, StochasticEffect | ResponseEffect)),
                frequency_hz,
                dt,
            ).psd
            - spectrum_of(sources, frequency_hz, dt).psd
        )
        step = frequency_hz[1] - frequency_hz[0]
        for k, tau in enumerate(tau_s):
            kernel = np.sin(np.pi * frequency_hz * tau) ** 4
            kernel /= (tau / dt * np.sin(np.pi * frequency_hz * dt)) ** 2
            variance[k] += 4.0 * step * float(kernel @ change)
    return np.sqrt(np.maximum(variance, 0.0))
