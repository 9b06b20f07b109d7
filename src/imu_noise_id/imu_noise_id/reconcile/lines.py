"""Lines that do not stand still, and lines that the model has.

A line whose phase wanders has sidebands within a few 1/T of it.  They are the line's own, so they
are taken from the record with it: its complex envelope, demodulated, as the first cosines of time.
"""

from __future__ import annotations

import numpy as np
from scipy import fft

from imu_noise_id.effects.periodic import Periodic
from imu_noise_id.reconcile.state import Analysis, State
from imu_noise_id.recording import Floats

COSINES = 16
"""Half cycles of the envelope in the record: sidebands up to 8/T."""
MOST_WANDER = 0.3
PRESENT_NATS = 8.0


def line_index(state: State, frequency_hz: float) -> int | None:
    """First of the two columns of the line nearest to a frequency."""
    pairs = [i for i, c in enumerate(state.columns) if isinstance(c.effect, Periodic)][::2]
    return min(pairs, key=lambda i: abs(_frequency(state, i) - frequency_hz), default=None)


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
        ``MOST_WANDER`` of its power: then it is a narrow band.
    price : float
        Nats for the envelope's coefficients, each of its own variance: sum of log(1 + z^2)/2.
    """
    n, dt = state.values.size, state.sample_time_s
    f = _frequency(state, index)
    if not COSINES < 2.0 * n * dt * f < 2.0 * n - COSINES:
        return state, 0.0
    turn = np.exp(2j * np.pi * f * state.time_s)
    slow = 2.0 * np.asarray(fft.idct(found.coefficients, norm="ortho")) * turn.conj()
    envelope = fft.dct(slow.real, norm="ortho") + 1j * fft.dct(slow.imag, norm="ortho")
    envelope[0] = 0.0  # the line itself
    envelope[COSINES + 1 :] = 0.0
    # a quadrature of white noise S has variance 2 S/dt
    variance = 2.0 / (dt * float(found.inverse_psd[round(2.0 * n * dt * f)]))
    score = np.abs(envelope[1 : COSINES + 1]) ** 2 / variance
    total, chance = float(score.sum()), 2.0 * COSINES
    carrier = n * float(np.sum(found.sizes[index : index + 2] ** 2)) / variance
    if total < chance + 4.0 * np.sqrt(2.0 * chance) or total > MOST_WANDER * carrier:
        return state, 0.0
    envelope *= 1.0 - np.sqrt(chance / total)  # what noise has there stays
    course = fft.idct(envelope.real, norm="ortho") + 1j * fft.idct(envelope.imag, norm="ortho")
    values: Floats = state.values - np.real(course * turn)
    return state.with_values(values), float(np.log1p(0.5 * score).sum())


def _frequency(state: State, index: int) -> float:
    effect = state.columns[index].effect
    assert isinstance(effect, Periodic)
    return effect.frequency_hz
