"""Statistics of a whitened record: each small where the model is right, whatever the model.

A record whitened with the right spectrum is white Gaussian noise of unit variance, so one null
distribution per length serves every channel (:mod:`~imu_noise_id.reconcile.null`).  Each statistic
is given in nats: half a squared standard deviation, a log-likelihood ratio, or a periodogram
ordinate; all have an exponential tail.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.effects.variance_change import variance_scan
from imu_noise_id.ordinates import Ordinates, Residual, bin_edges
from imu_noise_id.reconcile.patches import loudest_patch
from imu_noise_id.reconcile.prior import Prior, map_fit
from imu_noise_id.reconcile.result import Where
from imu_noise_id.recording import Floats
from imu_noise_id.whittle import log_likelihood

NAMES = (
    "spectrum",
    "band",
    "line",
    "modulation",
    "kurtosis",
    "skewness",
    "extreme",
    "burst",
    "levels",
    "patch",
)
"""Statistics with a simulated null, in the order of their columns."""

BURST_BLOCKS = 256
SMALLEST_LOW_DOF = 4.0
FEWEST_BLOCKS = 200


@dataclass(frozen=True)
class Whitened:
    """A record divided by the root of its modelled spectrum.

    Attributes
    ----------
    samples : (n,) float64
        Unit variance.
    frequency_hz, ratio, dof : (b,) float64
        Binned ordinates over the modelled spectrum, with degrees of freedom.
    sample_time_s, start_s : float
    flattest : float
        Least excess kurtosis that the model's own noise may have, not positive.
    """

    samples: Floats
    frequency_hz: Floats
    ratio: Floats
    dof: Floats
    sample_time_s: float
    start_s: float
    flattest: float = 0.0


@dataclass(frozen=True)
class Statistic:
    """One member of the battery.

    Attributes
    ----------
    name : str
    nats : float
    where : Where
        Its ``z`` is filled in from the p-value.
    """

    name: str
    nats: float
    where: Where


def white_record(samples: Floats, sample_time_s: float) -> Whitened:
    """White noise as the model's own simulations look after whitening."""
    n = samples.size
    edges = bin_edges(n, sample_time_s)
    dof = np.diff(edges).astype(float)
    coefficients = np.asarray(fft.dct(samples, norm="ortho"))
    ratio = np.add.reduceat(coefficients**2, edges[:-1]) / dof
    frequency_hz = 0.5 * (edges[:-1] + edges[1:] - 1) / (2.0 * n * sample_time_s)
    return Whitened(samples, frequency_hz, ratio, dof, sample_time_s, 0.0)


def battery(record: Whitened) -> tuple[Statistic, ...]:
    """All statistics of ``NAMES``, in order."""
    return (
        _spectrum(record),
        _band(record),
        _line(record, record.samples, "line", "spectrum"),
        _line(record, _unit(record.samples**2), "modulation", "time"),
        *_moments(record),
        _burst(record),
        _levels(record),
        _patch(record),
    )


def deviance(ratio: Floats, dof: Floats) -> Floats:
    """Nats by which a mean power ``ratio`` of ``dof`` degrees of freedom prefers its own level."""
    safe = np.maximum(ratio, 1e-300)
    return np.asarray(0.5 * dof * (ratio - 1.0 - np.log(safe)))


def _unit(values: Floats) -> Floats:
    centred = values - values.mean()
    return np.asarray(centred / max(float(centred.std()), 1e-300))


def _spectrum(record: Whitened) -> Statistic:
    """Window of bins, of doubling widths, whose mean power differs most."""
    power = np.concatenate(([0.0], np.cumsum(record.ratio * record.dof)))
    total = np.concatenate(([0.0], np.cumsum(record.dof)))
    best, place, sign = -1.0, (0, 1), 1.0
    width = 1
    while width <= record.ratio.size:
        dof = total[width:] - total[:-width]
        mean = (power[width:] - power[:-width]) / dof
        nats = deviance(mean, dof)
        nats[(mean < 1.0) & (dof < SMALLEST_LOW_DOF)] = 0.0
        at = int(np.argmax(nats))
        if nats[at] > best:
            best, place, sign = float(nats[at]), (at, at + width), float(np.sign(mean[at] - 1.0))
        width *= 2
    f = record.frequency_hz
    low, high = float(f[place[0]]), float(f[place[1] - 1])
    return Statistic("spectrum", best, Where("spectrum", low, high, "Hz", sign))


def _band(record: Whitened) -> Statistic:
    """Gain of the best narrow band over what is white, less the logarithm of its places.

    A window of bins fits it less well.
    """
    f, one = record.frequency_hz, np.ones(record.ratio.size)
    n, dt = record.samples.size, record.sample_time_s
    bins = Ordinates(f, record.ratio, record.dof, dt, n * dt)
    starts = band_starts(Residual(bins, one, np.zeros((0, f.size))))
    if not starts:
        return Statistic(
            "band", -float(np.log(n)), Where("spectrum", float(f[0]), float(f[-1]), "Hz", 1.0)
        )
    fitted = map_fit(starts, bins, Prior.none(), 1.0)
    (band,) = fitted.effects
    assert isinstance(band, NarrowBand)
    gain = fitted.objective - log_likelihood(one, bins) - float(np.log(band_places(band, n, dt)))
    low = max(band.frequency_hz - 0.5 * band.bandwidth_hz, 0.0)
    place = Where("spectrum", low, band.frequency_hz + 0.5 * band.bandwidth_hz, "Hz", 1.0)
    return Statistic("band", gain, place)


def band_starts(residual: Residual) -> tuple[NarrowBand, ...]:
    """The window of power that gains most beyond the logarithm of its places."""
    bins = residual.ordinates
    n = round(bins.duration_s / bins.sample_time_s)

    def net(window: tuple[float, NarrowBand]) -> float:
        return window[0] - float(np.log(band_places(window[1], n, bins.sample_time_s)))

    found = sorted(NarrowBand.windows(residual), key=net, reverse=True)
    return tuple(start for _, start in found[:1])


def band_places(band: NarrowBand, n: int, sample_time_s: float) -> float:
    """How many bands of that width there are up to half the rate of n samples."""
    width_hz = max(band.bandwidth_hz, 1.0 / (n * sample_time_s))
    return max(0.5 / sample_time_s / width_hz, 1.0)


def _line(record: Whitened, unit: Floats, name: str, domain: str) -> Statistic:
    """Largest ordinate of the periodogram at every half spacing, exponential with mean 1.

    On whole spacings a line that lies between two loses up to 60 % of its power, here 19 %.
    """
    n = unit.size
    power = np.abs(fft.rfft(unit, 2 * n)[2:]) ** 2 / n
    at = int(np.argmax(power))
    f = (0.5 * at + 1.0) / (n * record.sample_time_s)
    half = 0.5 / (n * record.sample_time_s)
    return Statistic(name, float(power[at]), Where(domain, f - half, f + half, "Hz", 1.0))


def _moments(record: Whitened) -> tuple[Statistic, Statistic, Statistic]:
    unit = _unit(record.samples)
    n = unit.size
    square = unit * unit
    excess = float(np.mean(square * square)) - 3.0
    kurtosis = (excess - min(max(excess, record.flattest), 0.0)) / np.sqrt(24.0 / n)
    skewness = float(np.mean(square * unit)) / np.sqrt(6.0 / n)
    extreme = float(np.abs(record.samples).max())
    span = (0.0, extreme, "sigma")
    return (
        Statistic(
            "kurtosis", 0.5 * kurtosis**2, Where("amplitude", *span, float(np.sign(kurtosis)))
        ),
        Statistic(
            "skewness", 0.5 * skewness**2, Where("amplitude", *span, float(np.sign(skewness)))
        ),
        Statistic("extreme", 0.5 * extreme**2, Where("amplitude", 5.0, extreme, "sigma", 1.0)),
    )


def _burst(record: Whitened) -> Statistic:
    """Gain of the best window of another variance, less the logarithm of its places."""
    first, last, ratio, gain, places = variance_scan(record.samples, BURST_BLOCKS)
    times = record.start_s + record.sample_time_s * np.array([first, last])
    sign = 1.0 if ratio > 1.0 else -1.0
    return Statistic(
        "burst",
        gain - float(np.log(places)),
        Where("time", float(times[0]), float(times[1]), "s", sign),
    )


def _patch(record: Whitened) -> Statistic:
    """Gain of the best band that is louder or quieter for a while, less the log of its places."""
    patch = loudest_patch(record.samples, record.sample_time_s)
    times = record.start_s + record.sample_time_s * np.array([patch.first, patch.last])
    sign = 1.0 if patch.ratio > 1.0 else -1.0
    return Statistic("patch", patch.net, Where("time", float(times[0]), float(times[1]), "s", sign))


def normal_of_kurtosis(kurtosis: float, n: int) -> float:
    """Standard normal deviate of the kurtosis of n white samples (Anscombe and Glynn 1983).

    Over its standard error it has a long upper tail: of 200 samples one in 10^4 reaches 6, and one
    in 10^3 reaches 4.7.
    """
    mean = 3.0 * (n - 1.0) / (n + 1.0)
    variance = 24.0 * n * (n - 2.0) * (n - 3.0) / ((n + 1.0) ** 2 * (n + 3.0) * (n + 5.0))
    skewness = (6.0 * (n * n - 5.0 * n + 2.0) / ((n + 7.0) * (n + 9.0))) * np.sqrt(
        6.0 * (n + 3.0) * (n + 5.0) / (n * (n - 2.0) * (n - 3.0))
    )
    a = 6.0 + 8.0 / skewness * (2.0 / skewness + np.sqrt(1.0 + 4.0 / skewness**2))
    x = (kurtosis - mean) / np.sqrt(variance)
    # two levels alone leave less than the formula was made for
    root = np.cbrt((1.0 - 2.0 / a) / max(1.0 + x * np.sqrt(2.0 / (a - 4.0)), 1e-6))
    return float((1.0 - 2.0 / (9.0 * a) - root) / np.sqrt(2.0 / (9.0 * a)))


def _levels(record: Whitened) -> Statistic:
    """Kurtosis of block means, over block lengths: a level that jumps between two values."""
    worst, tau, size = 0.0, 0.0, 16
    while record.samples.size // size >= FEWEST_BLOCKS:
        count = record.samples.size // size
        unit = _unit(record.samples[: count * size].reshape(count, size).mean(axis=1))
        z = normal_of_kurtosis(float(np.mean(unit**4)), count)
        if abs(z) > abs(worst):
            worst, tau = z, size * record.sample_time_s
        size *= 2
    place = Where("amplitude", tau, tau, "s", float(np.sign(worst)))
    return Statistic("levels", 0.5 * worst**2, place)
