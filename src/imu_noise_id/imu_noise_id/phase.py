"""Which cell of a clock a stamp belongs to, when stamps jitter and some samples are lost.

Two ways.  `whole_jumps` follows the stamps' lag behind the count of samples and needs no steady
clock, but takes losses that come as often as every tenth sample for a slower clock.  Where the
sensor keeps a clock, the stamps ``t_k = (c_k + phase) dt + jitter`` have a spectral line at ``1 /
dt`` whatever is lost: ``|mean exp(2 pi i t_k / dt)| = exp(-2 pi^2 s^2)`` for Gaussian jitter of
``s`` periods (0.45 for a fifth, 0.21 for 0.28), against ``n^-1/2`` for stamps without a clock.
`clock_period` finds that line, `clock_cells` counts along it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imu_noise_id.compiled import njit
from imu_noise_id.recording import Floats, Stamps

_GAIN = 0.05
_SETTLED = 20
_LEAST_COHERENCE = 4.0
"""Times n^-1/2, what n stamps without a clock have; e^-16 of those have more."""
_STRETCHES = 4
_SEARCHED = (-0.15, 0.15)
"""Relative frequencies; a first guess of the period is not further off."""
_STALL = 2.5
"""Periods off its cell; more is no jitter but a sender that stalled."""
_WINDOW = 1024
_LEAST_SAMPLES = 256


@njit(cache=True)
def whole_jumps(phase: Floats) -> NDArray[np.int64]:
    """Sum of the whole jumps before each sample, up and down.

    A second-order loop, critically damped, follows the phase and its slow drift between jumps; what
    leaves it by half or more is a jump of the nearest whole number.  For some samples after a jump
    the loop runs on without looking, so that one jump after the other is not taken for a drift.

    Parameters
    ----------
    phase : (n,) float64
        In periods.

    Returns
    -------
    (n,) int64
    """
    jumps = np.zeros(phase.size, np.int64)
    if phase.size == 0:
        return jumps
    followed, drift, total = phase[0], 0.0, 0
    since = _SETTLED
    for k in range(phase.size):
        followed += drift
        error = phase[k] - total - followed
        since += 1
        if abs(error) >= 0.5:
            jump = int(np.rint(error))
            total += jump
            error -= jump
            since = 0
        if since >= _SETTLED:
            followed += _GAIN * error
            drift += 0.25 * _GAIN * _GAIN * error
        jumps[k] = total
    return jumps


def clock_period(
    stamp_ns: Stamps, guess_ns: float, searched: tuple[float, float] = _SEARCHED
) -> float | None:
    """Period of the clock that the stamps keep, whatever is lost; None where they keep none.

    The highest point of the stamps' own spectrum, summed over some stretches of the recording,
    within 15 % of the guess or what is to be ``searched``, in relative frequencies; then the slope
    of all stamps over the cells counted with it.
    """
    size = min(_WINDOW, stamp_ns.size)
    first = np.unique(np.linspace(0, stamp_ns.size - size, _STRETCHES).astype(np.int64))
    low, high = searched
    frequency = np.linspace(1.0 + low, 1.0 + high, int(4 * (high - low) * size) + 1)
    power = np.zeros(frequency.size)
    for begin in first.tolist():
        part = stamp_ns[begin : begin + size]
        turns = np.outer(frequency, (part - part[0]) / guess_ns)
        power += np.abs(np.exp(2j * np.pi * turns).mean(axis=1)) ** 2
    power /= first.size
    top = int(power.argmax())
    if power[top] < _LEAST_COHERENCE**2 / size or top in (0, power.size - 1):
        return None
    below, here, above = power[top - 1 : top + 2]
    offset = 0.5 * (below - above) / (below - 2.0 * here + above)
    period_ns = guess_ns / float(frequency[top] + offset * (frequency[1] - frequency[0]))
    elapsed = (stamp_ns - stamp_ns[0]).astype(np.float64)
    cell = clock_cells(elapsed / period_ns)
    if cell is None:
        return period_ns
    x = cell - cell.mean()
    return float(x @ elapsed / (x @ x))


def clock_cells(position: Floats) -> NDArray[np.int64] | None:
    """Strictly increasing cells nearest to positions (in periods) on a clock whose phase drifts.

    The phase is the argument of the mean of ``exp(2 pi i position)`` over 1024 samples; what is
    left without it and without the count of samples is fitted by the nearest sequence of whole
    numbers that never falls.  None where the phase is not clear throughout, or the sender stalled.
    """
    from scipy.ndimage import uniform_filter1d  # slow to import, seldom needed

    if position.size < _LEAST_SAMPLES:
        return None
    window = min(_WINDOW, position.size)
    turn = np.exp(2j * np.pi * position)
    mean = uniform_filter1d(turn.real, window) + 1j * uniform_filter1d(turn.imag, window)
    if np.abs(mean).min() < _LEAST_COHERENCE / np.sqrt(window):
        return None
    phase = np.unwrap(np.angle(mean)) / (2.0 * np.pi)
    count = np.arange(position.size)
    ahead = position - phase - count
    lost = np.rint(_never_falling(ahead))
    if np.abs(ahead - lost).max() > _STALL:
        return None
    cell = count + lost.astype(np.int64)
    return cell - cell[0]


@njit(cache=True)
def _never_falling(values: Floats) -> Floats:
    """Least-squares fit that never falls (pooling of adjacent violators)."""
    level = np.empty_like(values)
    weight = np.empty(values.size, np.int64)
    top = -1
    for value in values:
        top += 1
        level[top], weight[top] = value, 1
        while top > 0 and level[top - 1] > level[top]:
            both = weight[top - 1] + weight[top]
            level[top - 1] += (level[top] - level[top - 1]) * weight[top] / both
            weight[top - 1] = both
            top -= 1
    fitted = np.empty_like(values)
    end = 0
    for k in range(top + 1):
        fitted[end : end + weight[k]] = level[k]
        end += weight[k]
    return fitted


def warm_up() -> None:
    """Compile."""
    whole_jumps(np.zeros(2))
    _never_falling(np.zeros(2))
