"""Whole jumps of a phase that drifts and jitters, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from imu_noise_id.recording import Floats

_GAIN = 0.05
_SETTLED = 20


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


def warm_up() -> None:
    """Compile."""
    whole_jumps(np.zeros(2))
