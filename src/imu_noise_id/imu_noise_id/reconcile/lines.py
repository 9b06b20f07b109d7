"""Lines that do not stand still, and lines that the model has.

A line whose phase wanders has sidebands within a few 1/T of it.  They are the line's own, so they
are taken from the record with it: its complex envelope, demodulated, as the first cosines of time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from imu_noise_id.effects.periodic import Periodic
from imu_noise_id.reconcile.state import Analysis, Column, State
from imu_noise_id.recording import Floats

Complexes = NDArray[np.complex128]

COSINES = 16
"""Half cycles of the envelope in the record: sidebands up to 8/T."""
MOST_WANDER = 0.3
WIDE_COSINES = 64
"""Half cycles of the envelope of a line that wanders off: by up to 32/T."""
LINE_KURTOSIS = 1.2
LOUD = 4.0
"""Power of the envelope over that of the noise in it."""
CLEAR_SCORE = 4.0
"""Squared deviates of an envelope's coefficient beyond which it is not left to noise, mean 2."""
PRESENT_NATS = 8.0
MOST_HARMONIC = 40
BESIDE = 3
"""Half spacings by which a harmonic may lie off the multiple."""
SURROUNDINGS = 40
HARMONIC_LOG_P = -10.0


def line_columns(frequency_hz: float, state: State) -> tuple[Column, Column]:
    """Cosine and sine of one line."""
    phase = 2.0 * np.pi * frequency_hz * state.time_s
    line = Periodic(frequency_hz, 1.0)
    return Column(line, np.cos(phase)), Column(line, np.sin(phase))


def strongest_line(samples: Floats, sample_time_s: float) -> float:
    """Frequency of the largest periodogram value, refined by a parabola, Hz."""
    power = np.abs(fft.rfft(samples, 2 * samples.size)) ** 2
    power[:2] = 0.0
    return _refined(samples, sample_time_s, 0.5 * float(np.argmax(power)))


def _refined(samples: Floats, sample_time_s: float, peak: float) -> float:
    """Frequency of the maximum next to ``peak`` spacings, Hz."""
    n = samples.size
    # about the peak on a grid of an eighth of the spacing: one turn by an eighth after the other
    offsets = np.arange(-4, 5) / 8.0
    turned = samples * np.exp(-2j * np.pi * (peak + offsets[0]) / n * np.arange(n))
    eighth = np.exp(-2j * np.pi / (8.0 * n) * np.arange(n))
    values = []
    for _ in offsets:
        values.append(abs(turned.sum()) ** 2)
        turned *= eighth
    best = int(np.clip(np.argmax(values), 1, offsets.size - 2))
    left, middle, right = values[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float((peak + offsets[best] + shift / 8.0) / (n * sample_time_s))


def line_index(state: State, frequency_hz: float) -> int | None:
    """First of the two columns of the line nearest to a frequency."""
    return min(_pairs(state), key=lambda i: abs(_frequency(state, i) - frequency_hz), default=None)


def steadied(state: State, found: Analysis, index: int) -> tuple[State, float]:
    """A record without the wander of one of its lines.

    Parameters
    ----------
    state : State
    found : Analysis
        Of ``state``.
    index : int
        First of the line's two columns.

    Returns
    -------
    state : State
        The same where the line is steady, or where what surrounds it carries more than
        ``MOST_WANDER`` of its power and its amplitude is not constant: then it is a narrow band.
    price : float
        Nats for the envelope's coefficients, each of its own variance: sum of log(1 + z^2)/2.
    """
    n, dt = state.values.size, state.sample_time_s
    f = _frequency(state, index)
    if not COSINES < 2.0 * n * dt * f < 2.0 * n - COSINES:
        return state, 0.0
    turn = np.exp(2j * np.pi * f * state.time_s)
    slow = 2.0 * np.asarray(fft.idct(found.coefficients, norm="ortho")) * turn.conj()
    envelope = _cosines(slow)
    # a quadrature of white noise S has variance 2 S/dt
    variance = 2.0 / (dt * float(found.inverse_psd[round(2.0 * n * dt * f)]))
    near = np.zeros(n, dtype=complex)
    near[1 : COSINES + 1] = envelope[1 : COSINES + 1]  # without the line itself
    score = np.abs(near) ** 2 / variance
    total, chance = float(score.sum()), 2.0 * COSINES
    carrier = n * float(np.sum(found.sizes[index : index + 2] ** 2)) / variance
    if total < chance + 4.0 * np.sqrt(2.0 * chance):
        return state, 0.0
    if total > MOST_WANDER * carrier:
        line = complex(found.sizes[index], -found.sizes[index + 1])
        return _of_constant_amplitude(state, envelope, line, turn, variance)
    near *= 1.0 - np.sqrt(chance / total)  # what noise has there stays
    values: Floats = state.values - np.real(_course(near) * turn)
    return state.with_values(values), float(np.log1p(0.5 * score).sum())


def _of_constant_amplitude(
    state: State, envelope: Complexes, line: complex, turn: Complexes, variance: float
) -> tuple[State, float]:
    """The record with a steady line in place of one whose frequency wanders; else the same.

    The mean fourth power of the envelope over its squared mean square, noise taken off, is 1 for a
    line and 2 for a band.  Where it is ``LOUD``, at most 1.6 % of bands 1.5/T wide, and 0.2 % of
    those 3/T wide or more, fall below ``LINE_KURTOSIS``; a fainter one's kurtosis says nothing.
    A constant amplitude spares one of two quadratures, and half the price.
    """
    wide = envelope.copy()
    wide[WIDE_COSINES + 1 :] = 0.0
    wide[0] += line * np.sqrt(envelope.size)
    power = np.abs(_course(wide)) ** 2
    noise = 2.0 * variance * (WIDE_COSINES + 1) / envelope.size
    signal = float(power.mean()) - noise
    fourth = float(np.mean(power**2)) - 4.0 * signal * noise - 2.0 * noise**2
    if signal < LOUD * noise or fourth > LINE_KURTOSIS * signal**2:
        return state, 0.0
    score = np.abs(wide) ** 2 / variance
    heard = np.sqrt(np.where(score > CLEAR_SCORE, 2.0 / np.maximum(score, 1e-300), 1.0))
    steady = np.sqrt(signal) * line / max(abs(line), 1e-300)
    values: Floats = state.values - np.real((_course(wide * (1.0 - heard)) - steady) * turn)
    price = 0.5 * float(np.log1p(0.5 * score[score > CLEAR_SCORE]).sum())
    return state.with_values(values), price


def _cosines(course: Complexes) -> Complexes:
    return np.asarray(fft.dct(course.real, norm="ortho") + 1j * fft.dct(course.imag, norm="ortho"))


def _course(cosines: Complexes) -> Complexes:
    real, imaginary = (fft.idct(part, norm="ortho") for part in (cosines.real, cosines.imag))
    return np.asarray(real + 1j * imaginary)


def harmonics(state: State, found: Analysis, frequency_hz: float) -> list[tuple[float, float]]:
    """Lines at multiples of a line's frequency, folded at half the rate: one cause has them all.

    Each must stand out as one of so few places, and from what surrounds it: a band is no line.

    Returns
    -------
    list of (float, float)
        Frequency, Hz, and logarithm of the p-value, the strongest first.
    """
    white, dt = found.white.samples, state.sample_time_s
    n = white.size
    power = np.abs(fft.rfft(white, 2 * n)) ** 2 / n
    known = [_frequency(state, i) for i in _pairs(state)]
    places = float(np.log((MOST_HARMONIC - 1) * (2 * BESIDE + 1)))
    out: list[tuple[float, float]] = []
    for order in range(2, MOST_HARMONIC + 1):
        turns = order * frequency_hz * dt % 1.0
        at = round(2.0 * n * min(turns, 1.0 - turns))
        around = power[max(at - SURROUNDINGS, 0) : at + SURROUNDINGS + 1]
        if at < SURROUNDINGS or around.size <= 2 * SURROUNDINGS:
            continue
        peak = at - BESIDE + int(np.argmax(power[at - BESIDE : at + BESIDE + 1]))
        level = max(float(np.median(around)) / np.log(2.0), 1.0)
        log_p = places - float(power[peak]) / level
        f = _refined(white, dt, 0.5 * peak)
        if log_p < HARMONIC_LOG_P and all(abs(f - k) > 2.0 / (n * dt) for k in known):
            out.append((f, log_p))
            known.append(f)
    return sorted(out, key=lambda line: line[1])


def _pairs(state: State) -> list[int]:
    """First of the two columns of every line."""
    return [i for i, c in enumerate(state.columns) if isinstance(c.effect, Periodic)][::2]


def _frequency(state: State, index: int) -> float:
    effect = state.columns[index].effect
    assert isinstance(effect, Periodic)
    return effect.frequency_hz
