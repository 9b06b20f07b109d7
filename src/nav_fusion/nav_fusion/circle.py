"""Headings all around a platform that rests: five are followed, and tell of the others.

At rest whatever the heading decides (the Earth's rate in the body's axes, where the base lies
beside the antenna, how the fixes' axes lie to the body's) goes by its cosine and sine, and what is
of second order by those of twice the heading.  So five hypotheses on the circle give every other by
trigonometric interpolation, exact but for what is of third order.  The others fall asleep after
they have been found where the five tell them to be, and wake when the platform moves or the five
begin to differ in likelihood.

What is interpolated is a hypothesis turned back to the heading 0 about its antenna: there most of
it is the same for all.
"""

from __future__ import annotations

import math

import numpy as np
from imu_noise_id.compiled import njit

from nav_fusion.arrays import (
    CIRCLE,
    CIRCLE_HEADINGS,
    Core,
    Floats,
    circle_heading,
    sensing_of,
    slow_of,
)
from nav_fusion.correction import turn_tilt
from nav_fusion.earth import plumb_at
from nav_fusion.hypotheses import heaviest, refresh_bias, settle_all, some_sleep
from nav_fusion.observe import ALIGNED_S
from nav_fusion.resting import finds_north
from nav_fusion.state import ALIVE, ASLEEP, LOG_WEIGHT, NAV, SLOW, STRIDE, TILT_AT, Q, R
from nav_fusion.strapdown import rotate_left, rotation_matrix

STATE_APART, COVARIANCE_APART, WEIGHT_APART = 0.05, 0.02, 0.1
"""What a hypothesis may differ by from what the five tell, to fall asleep: sigma, share of the
sigmas of both states, and nats of log-likelihood."""
AWAKENING = 3.0
"""Nats by which the five may differ before all are followed again."""


@njit(cache=True)
def stand_at_antenna(s: Floats, m: int, lever: Floats, sign: float) -> None:
    """Let place and its covariance be the antenna's, or (``sign`` -1) the base's again.

    a = r + C l, and of small errors da = dr - (C l) x psi.
    """
    n, P = NAV + m, s[SLOW + m :]
    C = np.empty((3, 3))
    rotation_matrix(s[Q : Q + 4], C)
    arm = np.zeros(3)
    for i in range(3):
        for j in range(3):
            arm[i] += sign * C[i, j] * lever[j]
        s[R + i] += arm[i]
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        for j in range(n):
            P[i * STRIDE + j] += arm[b] * P[(6 + a) * STRIDE + j] - arm[a] * P[(6 + b) * STRIDE + j]
    for j in range(n):
        row = P[j * STRIDE : j * STRIDE + n]
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            row[i] += arm[b] * row[6 + a] - arm[a] * row[6 + b]


@njit(cache=True)
def turn_about_up(s: Floats, m: int, angle: float) -> None:
    """Turn attitude, and what its covariance says of tilt, about the vertical."""
    x, y, z = plumb_at(s[R], s[R + 1], s[R + 2])
    psi = np.array([-angle * x, -angle * y, -angle * z])
    rotate_left(s[Q : Q + 4], psi[0], psi[1], psi[2])
    turn_tilt(s, m, psi)


@njit(cache=True)
def turn_back_five(core: Core, five: Floats) -> None:
    """Copy the hypotheses that are followed into ``five``, turned back to the heading 0."""
    count, m = core.bank.shape[0], core.target.size
    lever = sensing_of(core).lever
    for k in range(CIRCLE_HEADINGS):
        h = circle_heading(k, count)
        s = five[k]
        s[:] = core.bank[h]
        stand_at_antenna(s, m, lever, 1.0)
        turn_about_up(s, m, -2.0 * math.pi * h / count)
        same = 0.0
        for i in range(4):
            same += s[Q + i] * five[0, Q + i]
        if same < 0.0:  # q and -q are one attitude
            for i in range(4):
                s[Q + i] = -s[Q + i]


@njit(cache=True)
def tell(core: Core, five: Floats, h: int, s: Floats) -> None:
    """Let ``s`` be hypothesis ``h`` as the five tell it; what is counted is the heaviest's."""
    count, m = core.bank.shape[0], core.target.size
    shares = core.constants[CIRCLE + CIRCLE_HEADINGS * h : CIRCLE + CIRCLE_HEADINGS * (h + 1)]
    s[:] = core.bank[heaviest(core)]
    s[R : Q + 4] = 0.0
    s[LOG_WEIGHT] = 0.0
    s[SLOW:] = 0.0
    for k in range(CIRCLE_HEADINGS):
        part, share = five[k], shares[k]
        for i in range(R, Q + 4):
            s[i] += share * part[i]
        s[LOG_WEIGHT] += share * part[LOG_WEIGHT]
        for i in range(SLOW, s.size):
            s[i] += share * part[i]
    turn_about_up(s, m, 2.0 * math.pi * h / count)
    stand_at_antenna(s, m, sensing_of(core).lever, -1.0)
    s[TILT_AT : TILT_AT + 4] = s[Q : Q + 4]
    refresh_bias(s, slow_of(core))


@njit(cache=True)
def is_alike(s: Floats, told: Floats, m: int) -> bool:
    """Whether a hypothesis is where it was told to be."""
    n, P, other = NAV + m, s[SLOW + m :], told[SLOW + m :]
    sigma = np.empty(n)
    for i in range(n):
        sigma[i] = math.sqrt(max(P[i * (STRIDE + 1)], 0.0))
    for i in range(6):
        if abs(s[i] - told[i]) > STATE_APART * sigma[i]:
            return False
    for i in range(m):
        if abs(s[SLOW + i] - told[SLOW + i]) > STATE_APART * sigma[NAV + i]:
            return False
    tilt = min(sigma[6], sigma[7], sigma[8])
    same = 0.0
    for i in range(4):
        same += s[Q + i] * told[Q + i]
    if 2.0 * math.sqrt(max(2.0 - 2.0 * abs(same), 0.0)) > STATE_APART * tilt:
        return False
    for i in range(n):
        for j in range(n):
            apart = abs(P[i * STRIDE + j] - other[i * STRIDE + j])
            if apart > COVARIANCE_APART * sigma[i] * sigma[j]:
                return False
    return abs(s[LOG_WEIGHT] - told[LOG_WEIGHT]) < WEIGHT_APART


@njit(cache=True)
def fall_asleep(core: Core) -> None:
    """Follow only five of the headings on the circle from now on, if they tell the others.

    Not where the gyro finds north: there the headings become different.
    """
    count, m = core.bank.shape[0], core.target.size
    slow = slow_of(core)
    if core.constants.size == CIRCLE or core.bank[heaviest(core), ALIGNED_S] != 0.0:
        return
    for h in range(count):
        if core.bank[h, ALIVE] != 1.0:
            return
    if finds_north(slow):
        return
    settle_all(core)
    five, s = np.empty((CIRCLE_HEADINGS, core.bank.shape[1])), np.empty(core.bank.shape[1])
    turn_back_five(core, five)
    for h in range(count):
        tell(core, five, h, s)
        if not is_alike(core.bank[h], s, m):
            return
    core.bank[:, ALIVE] = ASLEEP
    for k in range(CIRCLE_HEADINGS):
        core.bank[circle_heading(k, count), ALIVE] = 1.0


@njit(cache=True)
def wake(core: Core) -> None:
    """Follow all headings again, those that slept from where the five tell them to be."""
    if not some_sleep(core):
        return
    settle_all(core)
    five = np.empty((CIRCLE_HEADINGS, core.bank.shape[1]))
    turn_back_five(core, five)
    for h in range(core.bank.shape[0]):
        if core.bank[h, ALIVE] == ASLEEP:
            tell(core, five, h, core.bank[h])
