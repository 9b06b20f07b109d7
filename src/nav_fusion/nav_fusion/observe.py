"""Corrections of one hypothesis by a fix, a velocity or a heading, compiled.

Each forms an innovation y, the rows H and the covariance R, gates y' S^-1 y against a chi-square
quantile and corrects in Joseph's form.  All are functions of one hypothesis only, so that a
rewound measurement gives the same bits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from imu_noise_id.compiled import njit

from nav_fusion.correction import Floats, Update, apply_correction, innovation_covariance, whiten
from nav_fusion.earth import ecef_at, level_axes_at
from nav_fusion.state import (
    DRIFTS,
    HEADING,
    LOG_WEIGHT,
    NAV,
    POSITION,
    SLOW,
    SPANS,
    STRIDE,
    USED_BEFORE,
    VELOCITY,
    Q,
    R,
    SlowModel,
    V,
)
from nav_fusion.strapdown import rotation_matrix

USED, GATED, REPEATED, RECOVERED, NIS_SUM, DOF_SUM = 12, 13, 14, 15, 16, 17
STREAK, STREAK_START_S, LAST_FIX, HAS_FIX, LAST_NIS = 18, 19, 20, 23, 24
VELOCITY_USED, VELOCITY_GATED, HEADING_USED, HEADING_GATED, STILL_UPDATES = 25, 26, 27, 28, 29
RECENT_NIS, WHITE_COUNT, WHITE_SUM, WHITE_PAST, ALIGNED_S = 30, 31, 32, 37, 52
FIRST_FIX, VELOCITY_STREAK, RECENT_COUNT = 54, 57, 58
RESULT = 59
"""Newest fix: innovation (3), its sigma (3), NIS, what became of it (``TAKEN`` and so on)."""
LAG_ONE, SQUARES, DRIFT = 67, 70, 73
"""Of the whitened innovations, each axis: successive products, squares, a running mean."""
SLOW_DRIFT, VELOCITY_DRIFT = DRIFTS, DRIFTS + 3
"""The same over five times as many fixes, and of velocities."""
DRIFT_WEIGHT, SLOW_WEIGHT = 0.02, 0.004
"""Of the newest in those means."""
RESULT_SIZE = 8
TAKEN, KEPT_OUT, SAME_AGAIN, LOST = 1.0, 2.0, 3.0, 4.0
"""What became of a fix; lost is the filter that kept it out, and starts from nothing."""

TOTALS = (
    USED,
    GATED,
    REPEATED,
    RECOVERED,
    VELOCITY_USED,
    VELOCITY_GATED,
    HEADING_USED,
    HEADING_GATED,
    STILL_UPDATES,
)
"""Counters that go on when the filter is started anew."""

LAGS = 5
"""Lags at which the innovations' autocorrelation is kept."""

SPAN_FIXES = (10, 30, 100, 300)
"""Lengths of the blocks of fixes over which whitened innovations are summed; from ``SPANS`` on each
has the sum (3) of the block that runs and the sum of the squares, over the length, of those past:
what is wrong by little and slowly, like an IMU noisier than its model, shows in sums alone."""

REAL_FIX_M = 100.0
"""With a prior wider than this the first fix tests nothing, and is not counted in the NIS."""

FASTEST_M_S = 100.0
"""A velocity that fixes in error have made is forgotten to within this when the filter restarts."""

AGREEING_FIXES = 3.0
"""So many fixes must agree before one that does not is the one in error: the first may be."""

SECOND_GATE = 0.5
"""Of the gate, for the fix after the first: a speed that would need luck is an error likelier."""


class Sensing(NamedTuple):
    """What the corrections need beside the state; all float64.

    ``lever`` (3,) antenna in b, m; ``gate`` (4,) chi-square quantiles by degrees of freedom;
    ``recovery`` (2,) fixes and seconds of unbroken gating after which the filter starts anew
    from the fix; ``declination_rad`` (1,); ``still`` (4,): least sigma of velocity m/s, of angular
    rate rad/s, highest speed m/s, use or not.
    """

    lever: Floats
    gate: Floats
    recovery: Floats
    declination_rad: Floats
    still: Floats


@njit(cache=True)
def colour_columns(
    H: Floats, x: Floats, y: Floats, slow: SlowModel, base: int, k: int, scale: Floats
) -> None:
    """Enter the slow states of an aid: H gets their scale, y loses what they explain."""
    for s in range(slow.target.size):
        a = slow.target[s] - base
        if 0 <= a < k:
            H[a, NAV + s] = scale[a]
            y[a] -= scale[a] * x[s]


@njit(cache=True)
def turned_columns(H: Floats, k: int, T: Floats, arm: Floats) -> None:
    """H's attitude columns for a vector ``arm`` in e that turns with the body: -T [arm x]."""
    for a in range(k):
        H[a, 6] = -(T[a, 1] * arm[2] - T[a, 2] * arm[1])
        H[a, 7] = -(T[a, 2] * arm[0] - T[a, 0] * arm[2])
        H[a, 8] = -(T[a, 0] * arm[1] - T[a, 1] * arm[0])


@njit(cache=True)
def is_covariance(c: Floats) -> bool:
    """Whether a matrix (3, 3) has a Cholesky factor; false where it is not finite."""
    l00 = c[0, 0]
    if not 0.0 < l00 < math.inf:
        return False
    l00 = math.sqrt(l00)
    l10 = 0.5 * (c[1, 0] + c[0, 1]) / l00
    l20 = 0.5 * (c[2, 0] + c[0, 2]) / l00
    l11 = c[1, 1] - l10 * l10
    if not 0.0 < l11 < math.inf:
        return False
    l21 = (0.5 * (c[2, 1] + c[1, 2]) - l20 * l10) / math.sqrt(l11)
    l22 = c[2, 2] - l20 * l20 - l21 * l21
    return 0.0 < l22 < math.inf


@njit(cache=True)
def write_fix(
    z: Floats,
    latitude_deg: float,
    longitude_deg: float,
    altitude_m: float,
    claim: Floats,
    white: Floats,
    claimed: bool,
) -> None:
    """Numbers of a fix, as :func:`prepare_fix` wants them.

    R and the scale of the colour are the model's, or the model as a share of the claim (3, 3).
    """
    ecef_at(math.radians(latitude_deg), math.radians(longitude_deg), altitude_m, z)
    z[3], z[4], z[5] = latitude_deg, longitude_deg, altitude_m
    for i in range(3):
        z[15 + i] = math.sqrt(claim[i, i]) if claimed else 1.0
        for j in range(3):
            if claimed:
                z[6 + 3 * i + j] = claim[i, j] * white[i] * white[j]
            else:
                z[6 + 3 * i + j] = white[i] * white[i] if i == j else 0.0


@njit(cache=True)
def prepare_fix(s: Floats, slow: SlowModel, z: Floats, sensing: Sensing, u: Update) -> None:
    """Fix of the antenna: y = T (z - r - C l) - colour, H = [T, 0, -T [C l x], scale].

    ``z``: ECEF (0:3), latitude etc. as received (3:6), R in level axes (6:15), scales (15:18).
    """
    m = slow.target.size
    rotation_matrix(s[Q : Q + 4], u.C)
    level_axes_at(s[R : R + 3], u.T)
    arm = np.zeros(3)
    difference = np.zeros(3)
    for i in range(3):
        for j in range(3):
            arm[i] += u.C[i, j] * sensing.lever[j]
        difference[i] = z[i] - s[R + i] - arm[i]
    u.H[:, :] = 0.0
    for a in range(3):
        u.y[a] = 0.0
        for i in range(3):
            u.y[a] += u.T[a, i] * difference[i]
            u.H[a, i] = u.T[a, i]
            u.R[a, i] = z[6 + 3 * a + i]
    turned_columns(u.H, 3, u.T, arm)
    colour_columns(u.H, s[SLOW : SLOW + m], u.y, slow, POSITION, 3, z[15:18])


@njit(cache=True)
def note_innovation(s: Floats, nis: float, u: Update) -> None:
    """Keep what the consistency tests need: NIS, and the whitened innovations' lag products."""
    s[NIS_SUM] += nis
    s[DOF_SUM] += 3.0
    s[LAST_NIS] = nis
    s[RECENT_COUNT] += 1.0
    s[RECENT_NIS] += (nis - s[RECENT_NIS]) / min(s[RECENT_COUNT], 100.0)
    for a in range(3):
        s[LAG_ONE + a] += u.white[a] * s[WHITE_PAST + a]
        s[SQUARES + a] += u.white[a] * u.white[a]
        s[DRIFT + a] += DRIFT_WEIGHT * (u.white[a] - s[DRIFT + a])
        s[SLOW_DRIFT + a] += SLOW_WEIGHT * (u.white[a] - s[SLOW_DRIFT + a])
    for lag in range(LAGS):
        if s[WHITE_COUNT] > lag:
            for a in range(3):
                s[WHITE_SUM + lag] += u.white[a] * s[WHITE_PAST + 3 * lag + a]
    for i in range(3 * LAGS - 1, 2, -1):
        s[WHITE_PAST + i] = s[WHITE_PAST + i - 3]
    for a in range(3):
        s[WHITE_PAST + a] = u.white[a]
    s[WHITE_COUNT] += 1.0
    add_to_spans(s, u)


@njit(cache=True)
def add_to_spans(s: Floats, u: Update) -> None:
    """Sum the whitened innovation into the block of each length, and end those that are full."""
    for i, length in enumerate(SPAN_FIXES):
        block = s[SPANS + 4 * i : SPANS + 4 * i + 4]
        for a in range(3):
            block[a] += u.white[a]
        if int(s[WHITE_COUNT]) % length == 0:
            for a in range(3):
                block[3] += block[a] * block[a] / length
                block[a] = 0.0


@njit(cache=True)
def note_result(s: Floats, nis: float, outcome: float, u: Update) -> None:
    """Keep the newest fix's innovation and its sigma, from the Cholesky factor of S."""
    for a in range(3):
        variance = 0.0
        for b in range(a + 1):
            variance += u.S[a, b] * u.S[a, b]  # S = L L'
        s[RESULT + a] = u.y[a]
        s[RESULT + 3 + a] = math.sqrt(variance)
    s[RESULT + 6] = nis
    s[RESULT + 7] = outcome


@njit(cache=True)
def is_repeated(s: Floats, z: Floats) -> bool:
    """Whether the receiver repeats its last fix to the last bit: frozen, no new information."""
    same = s[HAS_FIX] > 0.0
    for i in range(3):
        same = same and s[LAST_FIX + i] == z[3 + i]
        s[LAST_FIX + i] = z[3 + i]
    s[HAS_FIX] = 1.0
    return same


@njit(cache=True)
def set_apart(P: Floats, first: int, variance: float, n: int) -> None:
    """Give three states a variance of their own, and no correlation with any other."""
    for i in range(first, first + 3):
        for j in range(n):
            P[i * STRIDE + j] = 0.0
            P[j * STRIDE + i] = 0.0
        P[i * (STRIDE + 1)] = variance


@njit(cache=True)
def distance2(u: Update) -> float:
    """Square of how far a fix is off, m^2."""
    return u.y[0] * u.y[0] + u.y[1] * u.y[1] + u.y[2] * u.y[2]


@njit(cache=True)
def place_anew(P: Floats, n: int, position2: float, speed2: float) -> None:
    """Forget position and velocity to within variances, each axis.

    What they had in common with attitude and biases is forgotten too: by it a fix kilometres away,
    taken in error before or now, would turn the attitude over.
    """
    set_apart(P, 0, position2, n)
    set_apart(P, 3, speed2, n)
    for i in range(6, 9):
        P[i * (STRIDE + 1)] += 1e-4


@njit(cache=True)
def begin_again(s: Floats, m: int, u: Update) -> None:
    """Take a fix for the first: it contradicts those so far, too few to be believed against it.

    Should many do so, the platform is faster than was thought.
    """
    P = s[SLOW + m :]
    many = s[GATED] >= 2.0 * AGREEING_FIXES
    speed2 = max(FASTEST_M_S**2, 4.0 * P[3 * (STRIDE + 1)]) if many else FASTEST_M_S**2
    place_anew(P, NAV + m, distance2(u) + REAL_FIX_M**2, speed2)
    s[V : V + 3] = 0.0
    s[GATED] += s[USED]
    s[USED] = 0.0


@njit(cache=True)
def start_anew(s: Floats, m: int, time_s: float, u: Update) -> None:
    """After unbroken gating forget position and velocity to what the fix says, and go on."""
    P = s[SLOW + m :]
    seconds = max(time_s - s[STREAK_START_S], 1.0)
    speed2 = min(distance2(u) / seconds**2, FASTEST_M_S**2)
    speed2 += max(P[3 * (STRIDE + 1)], P[4 * (STRIDE + 1)], P[5 * (STRIDE + 1)])
    place_anew(P, NAV + m, distance2(u) + REAL_FIX_M**2, speed2)
    s[RECOVERED] += 1.0
    s[USED_BEFORE] = s[USED]


@njit(cache=True)
def keep_out(s: Floats, nis: float, time_s: float, sensing: Sensing, u: Update) -> float:
    """Count a fix beyond the gate; returns whether it is kept out, taken all the same, or ``LOST``.

    The first few contradict each other and the newest is taken; later ones are kept out, until
    they have been for long.  A filter that is far off, and has agreed with few since the last time,
    is lost; one that is near may do as well as it can with fixes worse than their covariance.
    """
    if s[STREAK] == 0.0:
        s[STREAK_START_S] = time_s
    s[STREAK] += 1.0
    s[LAST_NIS] = nis
    if s[USED] < AGREEING_FIXES:
        return TAKEN
    unbroken = s[STREAK] >= sensing.recovery[0]
    if unbroken and time_s - s[STREAK_START_S] >= sensing.recovery[1]:
        settled = s[USED] - s[USED_BEFORE] >= sensing.recovery[0]
        return TAKEN if settled or distance2(u) < REAL_FIX_M**2 else LOST
    return KEPT_OUT


@njit(cache=True)
def correct_by_fix(
    s: Floats,
    slow: SlowModel,
    z: Floats,
    time_s: float,
    rests: bool,
    sensing: Sensing,
    u: Update,
) -> None:
    """Gate a fix and correct by it; count it, and keep the hypothesis's log-likelihood."""
    m = slow.target.size
    n = NAV + m
    if is_repeated(s, z):
        s[REPEATED] += 1.0
        s[RESULT : RESULT + RESULT_SIZE] = 0.0
        s[RESULT + 7] = SAME_AGAIN
        return
    prepare_fix(s, slow, z, sensing, u)
    P = s[SLOW + m :]
    wide = P[0] + P[STRIDE + 1] + P[2 * STRIDE + 2] > REAL_FIX_M**2
    logarithm = innovation_covariance(P, n, 3, u)
    nis = whiten(3, u)
    gate = SECOND_GATE * sensing.gate[3] if s[USED] == 1.0 else sensing.gate[3]
    if nis > gate and s[USED] > 0.0:
        outcome = keep_out(s, nis, time_s, sensing, u)
        if outcome != TAKEN:
            note_result(s, nis, outcome, u)
            s[GATED] += 1.0
            s[LOG_WEIGHT] -= 0.5 * (sensing.gate[3] + logarithm)
            return
        if s[USED] < AGREEING_FIXES:
            begin_again(s, m, u)
        else:
            start_anew(s, m, time_s, u)
        logarithm = innovation_covariance(P, n, 3, u)
        nis = whiten(3, u)
        wide = True
    s[STREAK] = 0.0
    s[LOG_WEIGHT] -= 0.5 * (min(nis, sensing.gate[3]) + logarithm)
    if not wide:
        note_innovation(s, nis, u)
    if s[FIRST_FIX] == s[FIRST_FIX + 1] == s[FIRST_FIX + 2] == 0.0:  # of the origin, for good
        for i in range(3):
            s[FIRST_FIX + i] = z[i]
    s[USED] += 1.0
    note_result(s, nis, TAKEN, u)
    apply_correction(s, m, 3, not rests, u)


@njit(cache=True)
def correct_by_velocity(
    s: Floats,
    slow: SlowModel,
    z: Floats,
    rate: Floats,
    rests: bool,
    sensing: Sensing,
    u: Update,
) -> None:
    """Velocity of the antenna, level axes: y = z - T (v + C (w x l)) - colour.

    ``z``: velocity (0:3), R (6:15), scales (15:18); ``rate`` (3,) the body's rate to the Earth.
    """
    m = slow.target.size
    rotation_matrix(s[Q : Q + 4], u.C)
    level_axes_at(s[R : R + 3], u.T)
    arm = sensing.lever
    swing = np.zeros(3)
    cross = (
        rate[1] * arm[2] - rate[2] * arm[1],
        rate[2] * arm[0] - rate[0] * arm[2],
        rate[0] * arm[1] - rate[1] * arm[0],
    )
    for i in range(3):
        swing[i] = u.C[i, 0] * cross[0] + u.C[i, 1] * cross[1] + u.C[i, 2] * cross[2]
    u.H[:, :] = 0.0
    for a in range(3):
        u.y[a] = z[a]
        for i in range(3):
            u.y[a] -= u.T[a, i] * (s[V + i] + swing[i])
            u.H[a, 3 + i] = u.T[a, i]
            u.R[a, i] = z[6 + 3 * a + i]
    turned_columns(u.H, 3, u.T, swing)
    colour_columns(u.H, s[SLOW : SLOW + m], u.y, slow, VELOCITY, 3, z[15:18])
    logarithm = innovation_covariance(s[SLOW + m :], NAV + m, 3, u)
    nis = whiten(3, u)
    if nis > sensing.gate[3] and s[VELOCITY_STREAK] < 50.0:
        s[VELOCITY_STREAK] += 1.0
        s[VELOCITY_GATED] += 1.0
        s[LOG_WEIGHT] -= 0.5 * (sensing.gate[3] + logarithm)
        return
    s[VELOCITY_STREAK] = 0.0
    s[LOG_WEIGHT] -= 0.5 * (min(nis, sensing.gate[3]) + logarithm)
    s[VELOCITY_USED] += 1.0
    for a in range(3):
        s[VELOCITY_DRIFT + a] += DRIFT_WEIGHT * (u.white[a] - s[VELOCITY_DRIFT + a])
    apply_correction(s, m, 3, not rests, u)


@njit(cache=True)
def correct_by_field(s: Floats, slow: SlowModel, z: Floats, sensing: Sensing, u: Update) -> None:
    """Magnetic field in b (calibrated): its azimuth in level axes is the declination.

    With f = T C z the field in level axes, azimuth = atan2(f_e, f_n), y = declination - azimuth
    - colour; a small turn psi moves f by psi x f.  ``z``: field (0:3), variance (6), scale (15).
    """
    m = slow.target.size
    rotation_matrix(s[Q : Q + 4], u.C)
    level_axes_at(s[R : R + 3], u.T)
    f = np.zeros(3)
    for a in range(3):
        for i in range(3):
            for j in range(3):
                f[a] += u.T[a, i] * u.C[i, j] * z[j]
    level2 = f[0] * f[0] + f[1] * f[1]
    if level2 < 0.01 * (level2 + f[2] * f[2]):
        return
    turn = sensing.declination_rad[0] - math.atan2(f[0], f[1])
    u.H[:, :] = 0.0
    # d azimuth / d psi in level axes: (f_n df_e - f_e df_n)/|f_h|^2 with df = psi x f
    by_east = f[0] * f[2] / level2
    by_north = f[1] * f[2] / level2
    for i in range(3):
        u.H[0, 6 + i] = by_east * u.T[0, i] + by_north * u.T[1, i] - u.T[2, i]
    u.R[0, 0] = z[6]
    u.y[0] = turn
    colour_columns(u.H, s[SLOW : SLOW + m], u.y, slow, HEADING, 1, z[15:16])
    u.y[0] -= 2.0 * math.pi * math.floor((u.y[0] + math.pi) / (2.0 * math.pi))
    logarithm = innovation_covariance(s[SLOW + m :], NAV + m, 1, u)
    nis = whiten(1, u)
    if nis > sensing.gate[1]:
        s[HEADING_GATED] += 1.0
        s[LOG_WEIGHT] -= 0.5 * (sensing.gate[1] + logarithm)
        return
    s[LOG_WEIGHT] -= 0.5 * (nis + logarithm)
    s[HEADING_USED] += 1.0
    apply_correction(s, m, 1, True, u)
