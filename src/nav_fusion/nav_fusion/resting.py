"""What rest tells one hypothesis, and what contradicts it: velocity 0, and the gyro's mean rate."""

from __future__ import annotations

import math

import numpy as np
from imu_noise_id.compiled import njit

from nav_fusion.correction import (
    Floats,
    Update,
    apply_correction,
    gain,
    innovation_covariance,
    joseph,
    keep_heading,
    shift_state,
    symmetrise,
    whiten,
)
from nav_fusion.earth import EARTH_RATE_RAD_S, level_axes_at, plumb_at
from nav_fusion.observe import (
    DRIFT,
    DRIFT_WEIGHT,
    RESULT,
    SLOW_DRIFT,
    SLOW_WEIGHT,
    STILL_UPDATES,
    VELOCITY_DRIFT,
    Sensing,
)
from nav_fusion.state import DRIFTS, LOG_WEIGHT, NAV, POSITION, SLOW, STRIDE, Q, R, SlowModel, V
from nav_fusion.strapdown import rotation_matrix

DRIFT_LIMIT, SLOW_LIMIT, COLOUR_LIMIT = 5.5, 5.0, 4.0
"""How many sigma of them, and of the receiver's colour, contradict rest.

Of 10 fixes a second the means do so by chance less than once in ten days, a colour of 30 s about
once in two: rest that is contradicted by chance is believed again (``stillness.watch_denied``).
"""


@njit(cache=True)
def prepare_stop(s: Floats, m: int, variance: float, u: Update) -> float:
    """Velocity 0 with a variance: y = -v; returns log det S."""
    u.H[:, :] = 0.0
    u.R[:, :] = 0.0
    for i in range(3):
        u.y[i] = -s[V + i]
        u.H[i, 3 + i] = 1.0
        u.R[i, i] = variance
    return innovation_covariance(s[SLOW + m :], NAV + m, 3, u)


@njit(cache=True)
def is_slow(s: Floats, m: int, highest: float) -> bool:
    """Whether a hypothesis knows its speed to be below one, m/s, at two sigmas."""
    P = s[SLOW + m :]
    speed2 = s[V] ** 2 + s[V + 1] ** 2 + s[V + 2] ** 2
    widest = max(P[3 * (STRIDE + 1)], P[4 * (STRIDE + 1)], P[5 * (STRIDE + 1)])
    return math.sqrt(speed2) + 2.0 * math.sqrt(max(widest, 0.0)) <= highest


@njit(cache=True)
def may_rest(s: Floats, m: int, variance: float, sensing: Sensing, u: Update) -> bool:
    """Whether what a hypothesis knows of its velocity is rest: near enough 0, and no contradiction.

    Quiet sensors alone do not tell rest from an even drive.
    """
    if not is_slow(s, m, sensing.still[2]):
        return False
    prepare_stop(s, m, variance, u)
    return whiten(3, u) <= sensing.gate[3]


@njit(cache=True)
def colour_of(s: Floats, slow: SlowModel, axis: int) -> tuple[float, float]:
    """Colour of the fixes along an axis, summed over its states: estimate and model's variance."""
    total, variance = 0.0, 0.0
    for k in range(slow.target.size):
        if slow.target[k] == POSITION + axis:
            total += s[SLOW + k]
            variance += slow.variance[k]
    return total, variance


@njit(cache=True)
def fixes_contradict(s: Floats, slow: SlowModel) -> bool:
    """Whether fixes or velocities move away from a platform that rests.

    Their innovations have had one sign for some seconds (or, by less, for half a minute), or what
    the fixes differ by is more than the receiver's colour should be.
    """
    short = DRIFT_LIMIT * math.sqrt(DRIFT_WEIGHT / (2.0 - DRIFT_WEIGHT))
    long = SLOW_LIMIT * math.sqrt(SLOW_WEIGHT / (2.0 - SLOW_WEIGHT))
    for a in range(3):
        colour, variance = colour_of(s, slow, a)
        drifts = abs(s[DRIFT + a]) > short or abs(s[SLOW_DRIFT + a]) > long
        drifts = drifts or abs(s[VELOCITY_DRIFT + a]) > short
        if drifts or colour**2 > COLOUR_LIMIT**2 * variance > 0.0:
            return True
    return False


@njit(cache=True)
def loudest_colour(slow: SlowModel, axis: int) -> int:
    """Index of the slow state that is most of the fixes' colour along an axis, or -1."""
    found = -1
    for k in range(slow.target.size):
        if slow.target[k] == POSITION + axis and (
            found < 0 or slow.variance[k] > slow.variance[found]
        ):
            found = k
    return found


@njit(cache=True)
def forget_rest(s: Floats, slow: SlowModel, scale: Floats, speed: float, u: Update) -> None:
    """Widen what was believed of a platform at rest: its velocity, and how far the fixes were off.

    What the fixes differed by was taken for the receiver's colour, or is in their last innovations:
    it may be position instead.  The two change places, so that what the fixes say of their sum
    stays as it was.
    """
    m = slow.target.size
    P = s[SLOW + m :]
    level_axes_at(s[R : R + 3], u.T)
    for a in range(3):
        colour, variance = colour_of(s, slow, a)
        off2 = (s[DRIFT + a] * s[RESULT + 3 + a]) ** 2
        k = loudest_colour(slow, a)
        for i in range(3):
            for j in range(3):
                P[i * STRIDE + j] += off2 * u.T[a, i] * u.T[a, j]
        if k >= 0 and scale[a] > 0.0:
            swapped2 = max(colour * colour, variance)
            for i in range(3):
                cross = swapped2 * scale[a] * u.T[a, i]
                P[i * STRIDE + NAV + k] -= cross
                P[(NAV + k) * STRIDE + i] -= cross
                for j in range(3):
                    P[i * STRIDE + j] += swapped2 * scale[a] ** 2 * u.T[a, i] * u.T[a, j]
            P[(NAV + k) * (STRIDE + 1)] += swapped2
    for i in range(3):
        P[(3 + i) * (STRIDE + 1)] += speed * speed
    symmetrise(P, NAV + m)
    s[DRIFT : DRIFT + 3] = 0.0
    s[DRIFTS : DRIFTS + 6] = 0.0


@njit(cache=True)
def prepare_rates(
    s: Floats, slow: SlowModel, mean: Floats, gyro_psd: Floats, window_s: float, u: Update
) -> None:
    """Mean angular rate of a window at rest: the Earth's, the biases, and noise of the window.

    y = w - C' W - b and H = [C' W x, 1] with W the Earth's rate.  That the same noise has turned
    the attitude too in the same window is left out: taken exactly (C nonzero) it cost the
    covariance its positive definiteness in a long run.
    """
    m = slow.target.size
    rotation_matrix(s[Q : Q + 4], u.C)
    u.H[:, :] = 0.0
    u.R[:, :] = 0.0
    for a in range(3):
        u.y[a] = mean[a] - EARTH_RATE_RAD_S * u.C[2, a]
        u.H[a, 6], u.H[a, 7] = EARTH_RATE_RAD_S * u.C[1, a], -EARTH_RATE_RAD_S * u.C[0, a]
        u.R[a, a] = gyro_psd[a] / window_s
    for k in range(m):
        if slow.target[k] < 3:
            u.H[slow.target[k], NAV + k] = 1.0
            u.y[slow.target[k]] -= s[SLOW + k]


@njit(cache=True)
def finds_north(slow: SlowModel) -> bool:
    """Whether the gyro's biases are small beside the Earth's rate: a tenth of it, each axis."""
    variance = 0.0
    for k in range(slow.target.size):
        if slow.target[k] < 3:
            variance += slow.variance[k]
    return variance < 3.0 * (0.1 * EARTH_RATE_RAD_S) ** 2


@njit(cache=True)
def correct_by_rates(
    s: Floats,
    slow: SlowModel,
    mean: Floats,
    gyro_psd: Floats,
    window_s: float,
    sensing: Sensing,
    u: Update,
) -> None:
    """Correct by the mean angular rate of a window at rest; it counts in the log-likelihood."""
    m = slow.target.size
    n = NAV + m
    prepare_rates(s, slow, mean, gyro_psd, window_s, u)
    for a in range(3):
        u.R[a, a] += sensing.still[1] ** 2
    logarithm = innovation_covariance(s[SLOW + m :], n, 3, u)
    nis = whiten(3, u)
    s[LOG_WEIGHT] -= 0.5 * (min(nis, sensing.gate[3]) + logarithm)
    if nis > sensing.gate[3]:
        return
    gain(n, 3, u)
    if not finds_north(slow):
        keep_heading(s, 3, u)
        turn_back(s, u)
    joseph(s[SLOW + m :], n, 3, u)
    shift_state(s, m, 3, u)


@njit(cache=True)
def turn_back(s: Floats, u: Update) -> None:
    """Add to a gain that leaves the heading alone what the rate about the vertical tells of it.

    Until rest was known the vertical gyro's bias has turned the heading: once it is seen, that turn
    is too.  The best gain of this one component, cov(psi, y_up)/var(y_up); by the others, which
    have to do with tilt, the linearisation would make a wide heading known from nothing.
    """
    x, y, z = plumb_at(s[R], s[R + 1], s[R + 2])
    vertical = np.empty(3)  # in body axes
    for a in range(3):
        vertical[a] = u.C[0, a] * x + u.C[1, a] * y + u.C[2, a] * z
    common, variance = 0.0, 0.0
    for b in range(3):
        common += vertical[b] * (u.HP[b, 6] * x + u.HP[b, 7] * y + u.HP[b, 8] * z)
        along = 0.0
        for a in range(b, 3):
            along += u.S[a, b] * vertical[a]
        variance += along * along
    k = common / variance
    for a in range(3):
        u.K[a, 6] += k * vertical[a] * x
        u.K[a, 7] += k * vertical[a] * y
        u.K[a, 8] += k * vertical[a] * z


@njit(cache=True)
def correct_by_stop(
    s: Floats, slow: SlowModel, variance: float, sensing: Sensing, u: Update
) -> None:
    """Correct by a velocity of 0; it counts in the hypothesis's log-likelihood."""
    m = slow.target.size
    logarithm = prepare_stop(s, m, variance, u)
    nis = whiten(3, u)
    s[LOG_WEIGHT] -= 0.5 * (min(nis, sensing.gate[3]) + logarithm)
    if nis <= sensing.gate[3]:
        apply_correction(s, m, 3, False, u)
        s[STILL_UPDATES] += 1.0
