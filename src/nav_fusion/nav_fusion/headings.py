"""What the headings of a filter are told, which of them live, and the one row that they give."""

from __future__ import annotations

import math

import numpy as np
from imu_noise_id.compiled import njit

from nav_fusion.arrays import (
    FIELD,
    FIX,
    IMU_RING,
    LOST_NS,
    MATRIX,
    OUT_BIAS,
    OUT_BIAS_VARIANCE,
    OUT_HYPOTHESES,
    OUT_P,
    OUT_RATE,
    OUT_RESTING,
    OUT_STILL,
    OUTCOME,
    REPOSE,
    RESTING,
    START,
    STILL,
    VELOCITY_KIND,
    Core,
    Floats,
    sensing_of,
    slow_of,
    update_of,
)
from nav_fusion.circle import AWAKENING, wake
from nav_fusion.earth import plumb_at
from nav_fusion.hypotheses import cross, heaviest, refresh_bias, settle, settle_all, some_sleep
from nav_fusion.observe import (
    ALIGNED_S,
    KEPT_OUT,
    LOST,
    RESULT,
    RESULT_SIZE,
    correct_by_field,
    correct_by_fix,
    correct_by_velocity,
)
from nav_fusion.state import ALIVE, BIAS, ELAPSED, LOG_WEIGHT, NAV, SLOW, STRIDE, Q, R, SlowModel, V
from nav_fusion.strapdown import Three, rotation_matrix


@njit(cache=True)
def heading_of(s: Floats, core: Core) -> float:
    """Yaw of a hypothesis about the sphere's vertical, for comparison with the others'."""
    C = core.work[MATRIX : MATRIX + 9].reshape(3, 3)
    rotation_matrix(s[Q : Q + 4], C)
    x, y, z = s[R], s[R + 1], s[R + 2]
    p = math.sqrt(x * x + y * y)
    radius = math.sqrt(p * p + z * z)
    sl, cl = z / radius, p / radius
    axis = 0
    up = cl * (x / p * C[0, 0] + y / p * C[1, 0]) + sl * C[2, 0]
    if abs(up) > 0.98:
        axis = 1
    east = -y / p * C[0, axis] + x / p * C[1, axis]
    north = -sl * (x / p * C[0, axis] + y / p * C[1, axis]) + cl * C[2, axis]
    return math.atan2(north, east)


@njit(cache=True)
def heading_variance(s: Floats, m: int) -> float:
    """Variance of psi about the sphere's vertical."""
    P = s[SLOW + m :]
    radius2 = s[R] ** 2 + s[R + 1] ** 2 + s[R + 2] ** 2
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += s[R + i] * s[R + j] * P[(6 + i) * STRIDE + 6 + j]
    return total / radius2


@njit(cache=True)
def wrap(angle: float) -> float:
    """Angle in [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@njit(cache=True)
def are_alike(core: Core, best: int) -> bool:
    """Whether the likelihoods of all that are followed are near the heaviest's."""
    for h in range(core.bank.shape[0]):
        behind = core.bank[best, LOG_WEIGHT] - core.bank[h, LOG_WEIGHT]
        if core.bank[h, ALIVE] > 0.0 and behind > AWAKENING:
            return False
    return True


@njit(cache=True)
def turn_alike(s: Floats, best: Floats, slow: SlowModel) -> bool:
    """Whether what two hypotheses say of the gyro's biases is the same, to half a sigma.

    Headings that began apart may meet by biases that are: which of them is true is still open.
    """
    P = best[SLOW + slow.target.size :]
    for axis in range(3):
        variance = 0.0
        for a in range(slow.target.size):
            for b in range(slow.target.size):
                if slow.target[a] == axis and slow.target[b] == axis:
                    variance += P[(NAV + a) * STRIDE + NAV + b]
        if (s[BIAS + axis] - best[BIAS + axis]) ** 2 > 0.25 * variance:
            return False
    return True


@njit(cache=True)
def prune(core: Core, time_s: float) -> None:
    """End hypotheses that are 10^-6 as likely as the best, or have become the same as it."""
    best = heaviest(core)
    if core.bank[best, ALIGNED_S] != 0.0:
        return
    if some_sleep(core):
        if are_alike(core, best):
            return
        wake(core)
        best = heaviest(core)
    m, slow = core.target.size, slow_of(core)
    here = heading_of(core.bank[best], core)
    certain = heading_variance(core.bank[best], m)
    alive = 0
    for h in range(core.bank.shape[0]):
        s = core.bank[h]
        if s[ALIVE] <= 0.0:
            continue
        behind = core.bank[best, LOG_WEIGHT] - s[LOG_WEIGHT]
        apart = wrap(heading_of(s, core) - here)
        same = certain < 0.01 and apart * apart < 0.25 * certain + 1e-6
        same = same and turn_alike(s, core.bank[best], slow)
        if h != best and (behind > 13.8 or same):
            s[ALIVE] = 0.0
        else:
            alive += 1
    if alive == 1:
        core.bank[best, ALIGNED_S] = time_s


@njit(cache=True)
def correct(core: Core, index: int, sample: int) -> None:
    """Apply measurement ``index`` to every living hypothesis; ``sample`` is the last before it."""
    kind, z = core.kind[index], core.z[index]
    time_s = float(core.measurement_ns[index] - core.cursor[START]) * 1e-9
    rate = core.work[:3]
    rests = core.shared[RESTING] == 1.0 or core.shared[REPOSE] == 1.0
    slow, sensing, update = slow_of(core), sensing_of(core), update_of(core)
    if kind == FIELD:
        wake(core)
    settle_all(core)
    for h in range(core.bank.shape[0]):
        s = core.bank[h]
        if s[ALIVE] <= 0.0:
            continue
        if kind == FIX:
            correct_by_fix(s, slow, z, time_s, rests, sensing, update)
        elif kind == VELOCITY_KIND:
            for i in range(3):
                rate[i] = core.imu[sample % IMU_RING, i] - s[BIAS + i]
            correct_by_velocity(s, slow, z, rate, rests, sensing, update)
        else:
            correct_by_field(s, slow, z, sensing, update)
        refresh_bias(s, slow)
    if kind == FIX:
        best = core.bank[heaviest(core)]
        if best[RESULT + RESULT_SIZE - 1] == LOST:
            best[RESULT + RESULT_SIZE - 1] = KEPT_OUT
            core.cursor[LOST_NS] = core.measurement_ns[index]
        core.z[index, OUTCOME : OUTCOME + RESULT_SIZE] = best[RESULT : RESULT + RESULT_SIZE]
    if kind != FIELD:
        prune(core, time_s)


@njit(cache=True)
def spread(core: Core, best: int, mean: Floats, P: Floats) -> int:
    """What the mixture has beyond the heaviest: mean (9,), covariance (81,); returns how many live.

    The attitude that is published is the heaviest's, so its spread is about that one.  At rest a
    velocity is what the accelerometer's noise has made of 0, along the body's axes: it is published
    at the heading that is, or its noise would cancel over the circle and its variance would not.
    """
    rests = core.shared[RESTING] == 1.0
    m = core.target.size
    s = core.bank[best]
    if s[ALIGNED_S] != 0.0:
        return 1
    here = heading_of(s, core)
    down = plumb_at(s[R], s[R + 1], s[R + 2])
    difference = np.zeros(NAV)
    total, turned2 = 0.0, 0.0
    alive = 0
    for h in range(core.bank.shape[0]):
        other = core.bank[h]
        alive += other[ALIVE] != 0.0
        if other[ALIVE] <= 0.0:
            continue
        weight = math.exp(other[LOG_WEIGHT] - s[LOG_WEIGHT])
        total += weight
        turn = wrap(heading_of(other, core) - here) if h != best else 0.0
        turned2 += weight * turn * turn
        v = turned_back((other[V], other[V + 1], other[V + 2]), down, turn if rests else 0.0)
        for i in range(3):
            difference[i] = other[R + i] - s[R + i]
            difference[3 + i] = v[i] - s[V + i]
            difference[6 + i] = -turn * down[i]
        own, its = s[SLOW + m :], other[SLOW + m :]
        for i in range(NAV):
            mean[i] += weight * difference[i]
            for j in range(NAV):
                beyond = its[i * STRIDE + j] - own[i * STRIDE + j]
                P[NAV * i + j] += weight * (beyond + difference[i] * difference[j])
    mean /= total
    for i in range(NAV):
        for j in range(NAV):
            P[NAV * i + j] /= total
            if i < 6 or j < 6:  # place and velocity are published at their mean, attitude is not
                P[NAV * i + j] -= mean[i] * mean[j]
    mean[6:] = 0.0
    if some_sleep(core):
        widen_heading(s, P, circle_variance(core.bank.shape[0]) - turned2 / total)
    return alive


@njit(cache=True)
def turned_back(v: Three, d: Three, angle: float) -> Three:
    """Turn a vector against a heading's ``angle`` (Rodrigues' formula, about down)."""
    c, s = math.cos(angle), math.sin(angle)
    along = (1.0 - c) * (d[0] * v[0] + d[1] * v[1] + d[2] * v[2])
    across = cross(d, v)
    return (
        c * v[0] + s * across[0] + along * d[0],
        c * v[1] + s * across[1] + along * d[1],
        c * v[2] + s * across[2] + along * d[2],
    )


@njit(cache=True)
def widen_heading(s: Floats, P: Floats, more: float) -> None:
    """Add to the variance about the vertical what the headings that sleep are turned by."""
    down = plumb_at(s[R], s[R + 1], s[R + 2])
    for i in range(3):
        for j in range(3):
            P[NAV * (6 + i) + 6 + j] += max(more, 0.0) * down[i] * down[j]


@njit(cache=True)
def circle_variance(count: int) -> float:
    """Mean square turn from one heading to all of ``count`` on the circle."""
    ends = 2.0 if count % 2 == 0 else -1.0
    return (2.0 * math.pi / count) ** 2 * (count**2 + ends) / 12.0


@njit(cache=True)
def write_output(core: Core, k: int, row: Floats) -> None:
    """One row: r, v, q, P of (r, v, psi), angular rate, biases and their variances.

    Where covariances wait (:func:`get_ready`), that of the heaviest goes on to the state's time in
    a copy; the others' differ from it as they did.
    """
    best = heaviest(core)
    mean = np.zeros(NAV)
    row[:] = 0.0
    row[OUT_HYPOTHESES] = spread(core, best, mean, row[OUT_P : OUT_P + NAV * NAV])
    row[OUT_STILL], row[OUT_RESTING] = core.shared[STILL], core.shared[RESTING]
    s = core.bank[best]
    if s[ELAPSED] > 0.0:
        core.ahead[:] = s
        s = core.ahead
        settle(core, s)
    m = core.target.size
    P = s[SLOW + m :]
    for i in range(3):
        row[i] = s[R + i] + mean[i]
        row[3 + i] = s[V + i] + mean[3 + i]
        row[OUT_RATE + i] = core.imu[k, i] - s[BIAS + i]
    row[6:10] = s[Q : Q + 4]
    for i in range(NAV):
        for j in range(NAV):
            row[OUT_P + NAV * i + j] += P[i * STRIDE + j]
    row[OUT_BIAS : OUT_BIAS + 6] = s[BIAS : BIAS + 6]
    for a in range(m):
        for b in range(m):
            t = core.target[a]
            if t < 6 and t == core.target[b]:
                row[OUT_BIAS_VARIANCE + t] += P[(NAV + a) * STRIDE + NAV + b]
