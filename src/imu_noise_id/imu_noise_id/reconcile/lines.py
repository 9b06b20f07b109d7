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
SPAN_BLOCKS = 256
LEAST_SPAN, MOST_SPAN = 0.05, 0.9
"""Shares of the record for which a line that comes or goes is there."""
LEAST_CYCLES = 16.0
"""Of a line that is there for a while: fewer are a bump, or what leans against a filter's end."""
AROUND = 16
ABSENT = 0.1
"""Power outside its span over that within, of a line that is not there."""
HARMONIC_LOG_P = -10.0


def line_columns(
    frequency_hz: float, state: State, span_s: tuple[float, float] | None = None
) -> tuple[Column, Column]:
    """Cosine and sine of one line, nothing outside its span."""
    phase = 2.0 * np.pi * frequency_hz * state.time_s
    line = Periodic(frequency_hz, 1.0)
    there = np.ones(phase.size)
    if span_s is not None:
        there = ((state.time_s >= span_s[0]) & (state.time_s < span_s[1])).astype(float)
    shapes = there * np.cos(phase), there * np.sin(phase)
    cosine, sine = (Column(line, shape, span_s=span_s) for shape in shapes)
    return cosine, sine


def beside_a_line(pair: tuple[Column, Column], state: State) -> bool:
    """Whether a line is within two spacings of one that is there at the same time.

    Then it is that line which wanders: two such columns are nearly the same, and of any size.
    """
    reach_hz = 2.0 / (state.values.size * state.sample_time_s)
    (line, _), frequency_hz = pair, _line_of(pair[0]).frequency_hz
    return any(
        abs(_frequency(state, i) - frequency_hz) < reach_hz
        and bool(np.any((state.columns[i].shape != 0.0) & (line.shape != 0.0)))
        for i in _pairs(state)
    )


def line_span(white: Floats, sample_time_s: float) -> tuple[float, int, int] | None:
    """Frequency and samples [first, last) of the strongest line, if it comes or goes."""
    part, frequency_hz, span = white, 0.0, None
    for _ in range(2):  # outside its span a line's frequency is of noise
        frequency_hz = strongest_line(part, sample_time_s)
        span = span_at(frequency_hz, white, sample_time_s)
        if span is None:
            return None
        part = np.zeros(white.size)
        part[slice(*span)] = white[slice(*span)]
    if span is None:
        return None
    cycles = min(frequency_hz, 0.5 / sample_time_s - frequency_hz) * (span[1] - span[0])
    return (frequency_hz, *span) if cycles * sample_time_s > LEAST_CYCLES else None


def span_at(frequency_hz: float, white: Floats, sample_time_s: float) -> tuple[int, int] | None:
    """Samples [first, last) of a line of that frequency, if it is there for a while only.

    The window in which the line's ordinate gains most, beyond the places that there are for it;
    None where that is most of the record or a small part of it, or where the line, or one within
    ``AROUND`` spacings, is outside it too.
    """
    turned = white * np.exp(-2j * np.pi * frequency_hz * sample_time_s * np.arange(white.size))
    first, last = _window(turned)
    if not LEAST_SPAN < (last - first) / white.size < MOST_SPAN:
        return None
    inside = abs(complex(turned[first:last].mean())) ** 2
    turned[first:last] = 0.0
    blocks = np.add.reduceat(turned, _grid(white.size)[:-1])
    outside = np.abs(np.fft.fft(blocks, 4 * blocks.size)) ** 2 / (white.size - last + first) ** 2
    near = np.concatenate((outside[: 4 * AROUND + 1], outside[-4 * AROUND :]))
    return (first, last) if near.max() < ABSENT * inside else None


def given_span(
    state: State, found: Analysis, index: int
) -> tuple[tuple[float, float], tuple[Column, Column]] | None:
    """When a line of the model is there, if for a while only, and its columns for that while."""
    n, dt = state.values.size, state.sample_time_s
    pair = state.columns[index : index + 2]
    shapes = np.array([column.coefficients for column in pair])
    whole = found.coefficients + found.sizes[index : index + 2] @ shapes
    white = np.asarray(fft.idct(whole * np.sqrt(found.inverse_psd * dt), norm="ortho"))
    ends = span_at(_frequency(state, index), white, dt)
    if ends is None:
        return None
    there = np.zeros(n)
    there[slice(*ends)] = white[slice(*ends)]
    frequency_hz = _refined(there, dt, _frequency(state, index) * n * dt)
    span_s = state.start_s + ends[0] * dt, state.start_s + ends[1] * dt
    return span_s, line_columns(frequency_hz, state, span_s)


_ONLY = "there from {:.4g} to {:.4g} s only; a model has it all the time"


def span_note(span_s: tuple[float, float]) -> str:
    """What the note of a line says that is there for a while only."""
    return _ONLY.format(*span_s)


def has_span(note: str) -> bool:
    """Whether a note says that a line is there for a while only."""
    return _ONLY.rpartition("; ")[2] in note


def _grid(count: int) -> np.ndarray:
    return np.linspace(0, count, max(min(SPAN_BLOCKS, count // 4), 1) + 1).astype(int)


def _window(turned: Complexes) -> tuple[int, int]:
    """The window of demodulated white samples whose sum stands out most, to the sample."""
    n = turned.size
    total = np.concatenate(([0.0], np.cumsum(turned)))

    def net(first: np.ndarray, last: np.ndarray) -> Floats:
        m = np.maximum(last - first, 1).astype(float)
        places = n / np.maximum(np.minimum(m, n - m), 1.0)
        return np.asarray(np.abs(total[last] - total[first]) ** 2 / m - np.log(places))

    grid = _grid(n)
    i, j = np.triu_indices(grid.size, 1)
    at = int(np.argmax(net(grid[i], grid[j])))
    first, last = int(grid[i[at]]), int(grid[j[at]])
    block = int(grid[1])
    if first > 0:
        starts = np.arange(max(first - block, 0), min(first + block, last - 1) + 1)
        first = int(starts[np.argmax(net(starts, np.array(last)))])
    if last < n:
        ends = np.arange(max(last - block, first + 1), min(last + block, n) + 1)
        last = int(ends[np.argmax(net(np.array(first), ends))])
    return first, last


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
    if not COSINES < 2.0 * n * dt * f < n - COSINES:
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
    return _line_of(state.columns[index]).frequency_hz


def _line_of(column: Column) -> Periodic:
    assert isinstance(column.effect, Periodic)
    return column.effect
