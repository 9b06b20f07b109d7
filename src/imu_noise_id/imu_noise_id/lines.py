"""Lines of a record: found in the Fourier transform, fitted on the demodulated record, removed.

The DCT splits a line by its phase, so lines are looked for here.  What keeps power beside its
largest ordinate after the best sinusoid is removed is no line but a narrow band.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from imu_noise_id.ordinates import Ordinates
from imu_noise_id.recording import Floats

MARGIN = 7.5
"""Nats over log(number of frequencies): a false line in 0.06 % of records."""

LEAST_CYCLES = 20
NEIGHBOURS = 8
BLOCKS = 256
MOST = 40
ROUNDS = 6
CARRIER = 0.6
"""Share of the power about a peak that its carrier holds in a line whose phase wanders; noise whose
bandwidth is 1/T or more leaves the carrier 0.44 of it or less on average."""
LINE_DOF = 3.0


@dataclass(frozen=True)
class Line:
    """A sinusoid ``amplitude cos(2 pi f k dt + phase)`` at sample k.

    Attributes
    ----------
    frequency_hz, amplitude, phase_rad : float
    psd : float
        Two-sided level of the noise about it.
    wander : (b,) complex128 or None
        Course of its relative amplitude and phase at the middles of b equal blocks, where these
        wander within the record: slower than ``NEIGHBOURS`` cycles, else it would be no line.
    """

    frequency_hz: float
    amplitude: float
    phase_rad: float
    psd: float
    wander: NDArray[np.complex128] | None = None

    @property
    def dof(self) -> float:
        """Degrees of freedom that its fit takes."""
        return LINE_DOF if self.wander is None else LINE_DOF + 2.0 * (2 * NEIGHBOURS)

    def course(self, n: int, sample_time_s: float) -> Floats:
        """Return its samples, (n,)."""
        angle = 2.0 * np.pi * self.frequency_hz * sample_time_s * np.arange(n) + self.phase_rad
        if self.wander is None:
            return self.amplitude * np.cos(angle)
        size = max(n // self.wander.size, 1)
        middle = (np.arange(self.wander.size) + 0.5) * size - 0.5
        wander = np.interp(np.arange(n), middle, self.wander)
        return self.amplitude * np.real(wander * np.exp(1j * angle))

    def standard_errors(self, duration_s: float) -> tuple[float, float]:
        """Of frequency and amplitude, at the Cramer-Rao bound (Rife and Boorstyn 1974)."""
        amplitude = np.sqrt(2.0 * self.psd / duration_s)
        frequency = np.sqrt(24.0 * self.psd / duration_s**3) / (2.0 * np.pi * self.amplitude)
        return float(frequency), float(amplitude)


def level_without_lines(ordinates: Ordinates, psd: Floats, half_width: int = 15) -> Floats:
    """Larger of a fitted spectrum and the running median of the ordinates, (b,).

    The median follows what the fit cannot describe and no line reaches it; among the single
    ordinates it is too rough, there the fit stands alone.
    """
    return np.where(
        ordinates.dof > 2.5, np.maximum(psd, running_median(ordinates, half_width)), psd
    )


def running_median(ordinates: Ordinates, half_width: int = 15) -> Floats:
    """Running median of the ordinates, scaled to their mean, (b,)."""
    dof = np.maximum(ordinates.dof, 1.0)
    level = ordinates.power / np.maximum(1.0 - 2.0 / (9.0 * dof), 0.3) ** 3
    half_width = min(half_width, max((dof.size - 1) // 2, 1))
    padded = np.pad(np.log(np.maximum(level, np.finfo(float).tiny)), half_width, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half_width + 1)
    return np.asarray(np.exp(np.median(windows, axis=1)))


def without_peaks(ordinates: Ordinates) -> Ordinates:
    """Ordinates with those that stand far out of the running median switched off (dof 0)."""
    ratio = ordinates.power / running_median(ordinates)
    spread = np.sqrt(2.0 / np.maximum(ordinates.dof, 1.0))
    standing_out = (ordinates.dof > 2.5) & (ratio > 1.0 + 6.0 * spread + 18.0 * spread**2)
    return dataclasses.replace(ordinates, dof=np.where(standing_out, 0.0, ordinates.dof))


def find_lines(
    coefficients: Floats, ordinates: Ordinates, psd: Floats
) -> tuple[tuple[Line, ...], tuple[float, ...]]:
    """Lines of a complete record, sought in the record whitened by its own spectrum.

    Parameters
    ----------
    coefficients : (n,) float64
        DCT-II of the record.
    ordinates : Ordinates
        Of the same, no degree of freedom spent.
    psd : (b,) float64
        Noise level without lines at the ordinates' frequencies.

    Returns
    -------
    lines : tuple of Line
    wide : tuple of float
        Frequencies that stand out but are no lines.
    """
    n, sample_time_s = coefficients.size, ordinates.sample_time_s
    count = ordinates.dof.astype(int)
    count[0] += 1  # the level itself
    scale = np.repeat(np.sqrt(psd / sample_time_s), count)
    np.divide(coefficients, scale, out=scale)
    white = np.asarray(fft.idct(scale, norm="ortho", overwrite_x=True))
    lines: list[Line] = []
    wide: list[float] = []
    for _ in range(ROUNDS):
        peaks = [0.5 * half / (n * sample_time_s) for half in _largest(*_peaks(white))]
        peaks = [f for f in peaks if not _near(f, wide, ordinates.duration_s)]
        if not peaks:
            break
        for frequency in peaks[: MOST - len(lines)]:
            line, is_line = _fit_line(white, sample_time_s, frequency)
            if is_line:
                white = white - line.course(n, sample_time_s)
                lines.append(line)
            else:
                wide.append(frequency)
    found = sorted((_coloured(x, ordinates, psd) for x in lines), key=lambda x: x.frequency_hz)
    return tuple(found), tuple(sorted(wide))


def _coloured(line: Line, ordinates: Ordinates, psd: Floats) -> Line:
    """Return a line of the white record as it was before whitening."""
    nearest = int(np.argmin(np.abs(ordinates.frequency_hz - line.frequency_hz)))
    level = float(psd[nearest])
    amplitude = line.amplitude * np.sqrt(level / ordinates.sample_time_s)
    return dataclasses.replace(line, amplitude=float(amplitude), psd=level)


def _near(frequency: float, others: list[float], duration_s: float) -> bool:
    reach = max(NEIGHBOURS / duration_s, 0.02 * frequency)
    return any(abs(frequency - other) < reach for other in others)


def _peaks(white: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Frequencies over the threshold, in halves of 1/T, and by how much their power exceeds it.

    Half-way between two ordinates the power is at most the sum of theirs.
    """
    n = white.size
    threshold = np.log(n / 2.0) + MARGIN
    transform = fft.rfft(white, norm="ortho")[LEAST_CYCLES : (n + 1) // 2]
    power = transform.real**2
    power += transform.imag**2
    loud = np.flatnonzero(power > 0.5 * threshold)
    before = np.unique(np.concatenate((loud - 1, loud)))
    before = before[(before >= 0) & (before < power.size - 1)]
    between = 0.5 * np.abs(transform[before + 1] - transform[before]) ** 2
    excess = np.concatenate((power[loud], between)) - threshold
    halves = 2 * LEAST_CYCLES + np.concatenate((2 * loud, 2 * before + 1))
    over = excess > 0.0
    return halves[over], excess[over]


def _largest(halves: NDArray[np.int64], excess: Floats) -> list[int]:
    """Frequencies, largest excess first, no sidelobe of a larger one among them."""
    chosen: list[int] = []
    for i in np.argsort(-excess)[: 20 * MOST]:
        distance = np.abs(halves[i] - halves[chosen])
        lobes = np.sum(excess[chosen] / np.maximum(0.5 * np.pi * distance, 1.0) ** 2)
        if np.all(distance > 2 * NEIGHBOURS) and excess[i] > 4.0 * lobes:
            chosen.append(int(i))
    return [int(half) for half in halves[chosen]]


def _fit_line(white: Floats, sample_time_s: float, frequency_hz: float) -> tuple[Line, bool]:
    """Sinusoid about a frequency, and whether it is a line.

    It is one if it stands out of the level within a quarter of the block rate, and leaves no more
    than that level on the ordinates beside it, or little beside what it holds itself.
    """
    n = white.size
    size = max(n // BLOCKS, 1)
    count = n // size
    blocks = white[: count * size].reshape(count, size)
    time_s = (np.arange(count, dtype=np.float64) + 0.5 * (1.0 - 1.0 / size)) * size * sample_time_s
    for last in (False, True):
        angle = 2.0 * np.pi * frequency_hz * sample_time_s * np.arange(size)
        baseband = (blocks @ np.cos(angle) - 1j * (blocks @ np.sin(angle))) / size
        baseband *= np.exp(-2j * np.pi * frequency_hz * sample_time_s * size * np.arange(count))
        offset_hz = _phase_slope(baseband, time_s) if last else _offset(baseband, time_s)
        frequency_hz += offset_hz
    baseband = baseband * np.exp(-2j * np.pi * offset_hz * time_s)
    mean = np.mean(baseband)
    line = Line(frequency_hz, float(2.0 * abs(mean)), float(np.angle(mean)), sample_time_s)
    power = np.abs(fft.fft(baseband - mean)) ** 2
    beside = np.concatenate((power[1 : NEIGHBOURS + 1], power[-NEIGHBOURS:]))
    wider = np.concatenate((power[1 : count // 4], power[-count // 4 :]))
    noise = count / size
    local = noise * max(float(np.median(wider)) / (noise * np.log(2.0)), 1.0)
    own = abs(count * mean) ** 2
    limit = np.log(2.0 * NEIGHBOURS) + MARGIN + 1e-3 * own / local
    stands_out = own > (np.log(n / 2.0) + MARGIN) * local
    if np.all(beside < limit * local):
        return line, bool(stands_out)
    wanders = own > CARRIER * (own + beside.sum())
    return _wandering(line, baseband), bool(stands_out and wanders)


def _wandering(line: Line, baseband: NDArray[np.complex128]) -> Line:
    """Return a line with the slow course of its amplitude and phase."""
    coefficients = fft.dct(baseband, norm="ortho")
    coefficients[2 * NEIGHBOURS :] = 0.0
    slow = fft.idct(coefficients, norm="ortho")
    rms = float(np.sqrt(np.mean(np.abs(slow) ** 2)))
    wander = slow * np.exp(-1j * line.phase_rad) / rms
    return dataclasses.replace(line, amplitude=2.0 * rms, wander=wander)


def _offset(baseband: np.ndarray, time_s: Floats) -> float:
    """Frequency of the largest ordinate of the zero-padded transform, refined by a parabola."""
    pad, reach = 16 * baseband.size, 32
    power = np.abs(fft.fft(baseband, pad)) ** 2
    nearby = np.concatenate((power[-reach:], power[: reach + 1]))
    best = int(np.argmax(nearby[1:-1])) + 1
    low, top, high = nearby[best - 1 : best + 2]
    curvature = low - 2.0 * top + high
    fraction = 0.5 * (low - high) / curvature if curvature < 0.0 else 0.0
    return float((best - reach + np.clip(fraction, -1.0, 1.0)) / (pad * (time_s[1] - time_s[0])))


def _phase_slope(baseband: np.ndarray, time_s: Floats) -> float:
    """Small frequency offset by least squares on the quadrature part."""
    mean = np.mean(baseband)
    centred = time_s - time_s.mean()
    quadrature = np.imag(baseband * np.conj(mean)) / max(abs(mean) ** 2, np.finfo(float).tiny)
    return float(centred @ quadrature / (centred @ centred) / (2.0 * np.pi))
