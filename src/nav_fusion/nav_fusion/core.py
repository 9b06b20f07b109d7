"""The compiled filter loop: IMU samples and measurements in order of time, rewound when late.

Everything that depends on the past (states, covariances, counters, the detector of rest) lies in
the arrays that a checkpoint copies.  A late measurement restores the newest checkpoint before it
and repeats the steps since; the steps are a function of samples and measurements in order of
*time* alone, so the bits do not depend on the order of arrival or on the size of the blocks.

What happens at a sample's time, in this order: the interval that it ends, rest, publishing, a
checkpoint, and last the measurements that hold at just that time: they change the next row, and
one that comes with its sample or after it needs no rewind.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from imu_noise_id.compiled import njit
from numpy.typing import NDArray

from nav_fusion.earth import gravity_at
from nav_fusion.observe import (
    ALIGNED_S,
    KEPT_OUT,
    LOST,
    RESULT,
    RESULT_SIZE,
    UPDATE_SIZE,
    Sensing,
    Update,
    correct_by_field,
    correct_by_fix,
    correct_by_rates,
    correct_by_stop,
    correct_by_velocity,
    fixes_contradict,
    forget_rest,
    is_slow,
    may_rest,
    update_views,
)
from nav_fusion.state import (
    ALIVE,
    BIAS,
    ELAPSED,
    FORCE_SUM,
    GAP_VARIANCE,
    LOG_WEIGHT,
    NAV,
    SLOW,
    STRIDE,
    TURN_SUM,
    Layout,
    Q,
    R,
    SlowModel,
    V,
)
from nav_fusion.strapdown import (
    SCRATCH_SIZE,
    Nine,
    Three,
    mechanise,
    move_pairs,
    propagate_covariance,
    rotation_matrix,
    scratch_views,
    slow_step,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FIX, VELOCITY_KIND, FIELD = 0, 1, 2
"""Kinds of measurement, in the order in which equal stamps are taken."""

COVARIANCE_STEP_S = 0.01
"""At most about this long: 100 Hz is within 2e-4 of 1 kHz, and ten times cheaper."""
RESTING_STEP_S = 0.05
"""The same at rest, where attitude and force stay as they are: within 2e-4 of the other."""

Z_SIZE = 26
"""What the corrections need, and from ``OUTCOME`` on what became of a fix (``observe.RESULT``)."""
OUTCOME = 18
IMU_RING = 16384
MEASUREMENT_RING = 1024
CHECKPOINTS = 64
MOST_SAMPLES = 4096
REACH = IMU_RING - MOST_SAMPLES - 8

# shared: what all hypotheses have in common, rewound with them
BLOCK_START, BLOCK_COUNT, BLOCK_SUMS = 0, 1, 2
QUIET_BLOCKS, GAPS, GAP_S, FAST_BLOCKS, STILL = 10, 11, 12, 13, 14
SHAKE, SHAKE_BLOCKS, DENIED, RESTING, LAST_FORCE = 15, 16, 17, 18, 19
BLOCK_STEPS, SLOW_BLOCKS, QUIET_STEPS, LOUD_STEPS = 22, 24, 25, 28
"""Squared first differences (gyro, accelerometer), all axes summed: of the block that runs; and how
many, with their sums, in blocks of rest and in blocks that only the fixes show to be at rest."""
DENIED_AT = 31
"""Where the platform was (ECEF, 3) when it began to be watched for rest again."""
SHARED = 34

SETTLING_BLOCKS, WATCHED_BLOCKS = 120.0, 480.0
"""Quiet blocks (30 s and 2 minutes) after which rest that was contradicted is watched for again,
and so long it must hold."""

MOST_SHAKE_BLOCKS = 40.0
CHANGE_LIMIT = 14.0
"""Of white noise alone, two blocks' means differ by more once in 10^4: 2/3 of chi-square's 21."""
SHAKE_HZ = 2.0
"""Shaking of the platform at rest is taken to be this fast: v = a/(2 pi f)."""

# cursor: where the queues stand (int64)
SAMPLES, HEAD_MEASUREMENT, NEXT, FIRST_CHECKPOINT, LAST_CHECKPOINT, AHEAD = 0, 1, 2, 3, 4, 5
PUBLISH_DUE, CHECKPOINT_DUE = 6, 7
CURSOR = 16

LOST_NS = 14
"""Stamp of the fix at which the filter was found lost, or 0; it goes no further."""

# one row of output: r, v, q, then these
OUT_P, OUT_RATE, OUT_BIAS, OUT_BIAS_VARIANCE = 10, 91, 94, 100
OUT_HYPOTHESES, OUT_STILL, OUT_SIZE = 106, 107, 108

# the cursor's times, all of them ns, in the order of new_core's argument
START, CHECKPOINT_PERIOD, PUBLISH_PERIOD, GAP, WINDOW, FURTHEST = 8, 9, 10, 11, 12, 13

# constants
GYRO_PSD, ACCEL_PSD, UNKNOWN, QUIET, STILL_USE = 0, 3, 6, 10, 30

# work: some vectors, one matrix and the last step before the scratch of its users
MATRIX, LAST_DT, VECTORS = 48, 57, 64

ACCEPTED, LATE, TOO_LATE, DUPLICATE, FULL = 0, 1, 2, 3, 4
"""What became of a measurement."""


class Core(NamedTuple):
    """One filter with all its hypotheses, queues and checkpoints.

    Few arrays, the small ones packed: a compiled call costs by the array.
    """

    bank: Floats  # (K, size)
    shared: Floats  # (SHARED,)
    cursor: Ints  # (CURSOR,)
    imu_ns: Ints  # (IMU_RING,)
    imu: Floats  # (IMU_RING, 6): rate, force
    measurement_ns: Ints  # (MEASUREMENT_RING,), ascending from 0
    kind: Ints
    z: Floats  # (MEASUREMENT_RING, Z_SIZE)
    checkpoint_bank: Floats  # (CHECKPOINTS, K, size)
    checkpoint_shared: Floats
    checkpoint_sample: Ints  # (CHECKPOINTS,) number of samples taken when it was made
    target: Ints  # (m,)
    slow_table: Floats  # (4, m)
    constants: Floats  # (CONSTANTS,)
    work: Floats  # scratch


def new_core(
    layout: Layout, hypotheses: Floats, times: Ints, gap: Floats, quiet: Floats, sensing: Sensing
) -> Core:
    """Allocate a core that starts from ``hypotheses`` (K, size).

    ``times`` (6,) ns: start, checkpoint period, publish period, gap, window, furthest ahead;
    ``gap`` (4,): sigma and correlation time of unknown acceleration and rate; ``quiet`` (7,): see
    :func:`nav_fusion.starting.quiet_limits`.
    """
    count, size = hypotheses.shape
    cursor = np.zeros(CURSOR, dtype=np.int64)
    cursor[START : START + 6] = times
    slow = layout.slow
    return Core(
        hypotheses.copy(),
        np.zeros(SHARED),
        cursor,
        np.zeros(IMU_RING, dtype=np.int64),
        np.zeros((IMU_RING, 6)),
        np.zeros(MEASUREMENT_RING, dtype=np.int64),
        np.zeros(MEASUREMENT_RING, dtype=np.int64),
        np.zeros((MEASUREMENT_RING, Z_SIZE)),
        np.zeros((CHECKPOINTS, count, size)),
        np.zeros((CHECKPOINTS, SHARED)),
        np.zeros(CHECKPOINTS, dtype=np.int64),
        slow.target,
        np.stack([slow.rate, slow.psd, slow.variance, slow.spin]),
        np.concatenate([layout.gyro_psd, layout.accel_psd, gap, quiet, *sensing]),
        np.zeros(VECTORS + SCRATCH_SIZE + UPDATE_SIZE),
    )


@njit(cache=True)
def slow_of(core: Core) -> SlowModel:
    """Return the slow states' model."""
    t = core.slow_table
    return SlowModel(core.target, t[0], t[1], t[2], t[3])


@njit(cache=True)
def sensing_of(core: Core) -> Sensing:
    """Return what the corrections need, as ``new_core`` packed it."""
    c = core.constants
    return Sensing(c[17:20], c[20:24], c[24:26], c[26:27], c[27:31])


@njit(cache=True)
def update_of(core: Core) -> Update:
    """Return the working arrays of a correction."""
    return update_views(core.work[VECTORS + SCRATCH_SIZE :])


@njit(cache=True)
def total_bias(s: Floats, slow: SlowModel, gyro: Floats, accel: Floats) -> None:
    """Summed slow terms of each inertial axis."""
    for i in range(3):
        gyro[i] = 0.0
        accel[i] = 0.0
    for k in range(slow.target.size):
        t = slow.target[k]
        if t < 3:
            gyro[t] += s[SLOW + k]
        elif t < 6:
            accel[t - 3] += s[SLOW + k]


@njit(cache=True)
def disturbance_psd(gap_s: float, sigma: float, correlation_s: float) -> float:
    """White spectrum that stands for unknown motion in a gap: 2 sigma^2 T min(1, (gap/T)^2).

    A straight line across a short gap errs little; across one longer than T it knows nothing.
    """
    ratio = min(1.0, gap_s / correlation_s)
    return 2.0 * sigma * sigma * correlation_s * ratio * ratio


@njit(cache=True)
def refresh_bias(s: Floats, slow: SlowModel) -> None:
    """Sum the slow terms of each inertial axis, after they have changed."""
    total_bias(s, slow, s[BIAS : BIAS + 3], s[BIAS + 3 : BIAS + 6])


@njit(cache=True)
def at_part(a: Floats, b: Floats, first: int, x: float, s: Floats, bias: int) -> Three:
    """Three readings at the part ``x`` of the way between two samples, less their biases."""
    return (
        a[first] + x * (b[first] - a[first]) - s[bias],
        a[first + 1] + x * (b[first + 1] - a[first + 1]) - s[bias + 1],
        a[first + 2] + x * (b[first + 2] - a[first + 2]) - s[bias + 2],
    )


@njit(cache=True)
def glide(s: Floats, a: Floats, b: Floats, x0: float, x1: float, dt: float) -> None:
    """Take a hypothesis from part ``x0`` to ``x1`` between two samples, ``dt`` long.

    The covariance follows in steps of :func:`covariance_step` (:func:`settle`), for which
    specific force and attitude are summed.
    """
    w0, w1 = at_part(a, b, 0, x0, s, BIAS), at_part(a, b, 0, x1, s, BIAS)
    f0, f1 = at_part(a, b, 3, x0, s, BIAS + 3), at_part(a, b, 3, x1, s, BIAS + 3)
    force, C = mechanise(s, w0, w1, f0, f1, dt)
    s[ELAPSED] += dt
    for i in range(3):
        s[FORCE_SUM + i] += dt * force[i]
    for i in range(9):
        s[TURN_SUM + i] += dt * C[i]


@njit(cache=True)
def covariance_step(core: Core) -> float:
    """How much time may gather, s, before the covariances follow."""
    return RESTING_STEP_S if core.shared[RESTING] == 1.0 else COVARIANCE_STEP_S


@njit(cache=True)
def propagate(core: Core, sample: int, from_ns: int, to_ns: int) -> None:
    """Take every hypothesis from one time to another inside the interval that ends at a sample."""
    a, b = (sample - 1) % IMU_RING, sample % IMU_RING
    whole = float(core.imu_ns[b] - core.imu_ns[a])
    x0 = float(from_ns - core.imu_ns[a]) / whole
    x1 = float(to_ns - core.imu_ns[a]) / whole
    dt = float(to_ns - from_ns) * 1e-9
    k = core.constants
    gap = whole > core.cursor[GAP]
    longest = covariance_step(core)
    for h in range(core.bank.shape[0]):
        s = core.bank[h]
        if s[ALIVE] == 0.0:
            continue
        glide(s, core.imu[a], core.imu[b], x0, x1, dt)
        if gap:
            s[GAP_VARIANCE] += dt * disturbance_psd(1e-9 * whole, k[UNKNOWN], k[UNKNOWN + 1])
            s[GAP_VARIANCE + 1] += dt * disturbance_psd(
                1e-9 * whole, k[UNKNOWN + 2], k[UNKNOWN + 3]
            )
        if s[ELAPSED] + 0.5 * dt >= longest:
            settle(core, s)


@njit(cache=True)
def coast(core: Core, first: int, last: int) -> None:
    """Take every hypothesis over the whole intervals that end at samples ``first`` to ``last``-1.

    The same as :func:`advance` sample by sample where nothing happens at any of them.
    """
    if first == last:
        return
    longest = covariance_step(core)
    for h in range(core.bank.shape[0]):
        s = core.bank[h]
        if s[ALIVE] == 0.0:
            continue
        for sample in range(first, last):
            a, b = (sample - 1) % IMU_RING, sample % IMU_RING
            dt = float(core.imu_ns[b] - core.imu_ns[a]) * 1e-9
            glide(s, core.imu[a], core.imu[b], 0.0, 1.0, dt)
            if s[ELAPSED] + 0.5 * dt >= longest:
                settle(core, s)
    for sample in range(first, last):
        add_to_block(core.shared, core.imu[(sample - 1) % IMU_RING], core.imu[sample % IMU_RING])
    core.cursor[SAMPLES] = last


@njit(cache=True)
def settle(core: Core, s: Floats) -> None:
    """Bring covariance and slow states up to the state's time.

    With the mean specific force and the mean attitude of the samples since the last time, which
    are exact to second order in the step: the covariance does not depend on the IMU's rate.
    """
    dt = s[ELAPSED]
    if dt == 0.0:
        return
    m = core.target.size
    slow, work = slow_of(core), scratch_views(core.work[VECTORS:], m)
    if dt != core.work[LAST_DT]:
        slow_step(slow, dt, work.decay, work.mean, work.half_noise)
        core.work[LAST_DT] = dt
    k, x = core.constants, 1.0 / dt
    turn, force = x * s[GAP_VARIANCE + 1], x * s[GAP_VARIANCE]
    propagate_covariance(
        s[SLOW + m :],
        mean_attitude(s, x),
        mean_force(core, s, x),
        (s[R], s[R + 1], s[R + 2]),
        dt,
        slow,
        (k[GYRO_PSD] + turn, k[GYRO_PSD + 1] + turn, k[GYRO_PSD + 2] + turn),
        (k[ACCEL_PSD] + force, k[ACCEL_PSD + 1] + force, k[ACCEL_PSD + 2] + force),
        work,
    )
    for i in range(m):
        s[SLOW + i] *= work.decay[i]
    move_pairs(s[SLOW : SLOW + m], slow, dt)
    s[ELAPSED : GAP_VARIANCE + 2] = 0.0
    refresh_bias(s, slow)


@njit(cache=True)
def mean_force(core: Core, s: Floats, x: float) -> Three:
    """Mean specific force in e since the last :func:`settle`; what bears gravity while at rest.

    Its noise would let a heading error act on the velocity, and every velocity of 0 would seem to
    say that there is none: at rest the heading would become known from nothing.  Beyond five sigma
    of that noise the platform has begun to move.
    """
    f = (x * s[FORCE_SUM], x * s[FORCE_SUM + 1], x * s[FORCE_SUM + 2])
    if core.shared[RESTING] == 1.0:
        g = gravity_at(s[R], s[R + 1], s[R + 2])
        beyond2 = (f[0] + g[0]) ** 2 + (f[1] + g[1]) ** 2 + (f[2] + g[2]) ** 2
        k = core.constants
        if beyond2 < 25.0 * x * (k[ACCEL_PSD] + k[ACCEL_PSD + 1] + k[ACCEL_PSD + 2]):
            return -g[0], -g[1], -g[2]
    return f


@njit(cache=True)
def mean_attitude(s: Floats, x: float) -> Nine:
    """Mean rotation matrix, by rows, of what was summed since the last :func:`settle`."""
    c = s[TURN_SUM : TURN_SUM + 9]
    return (
        x * c[0],
        x * c[1],
        x * c[2],
        x * c[3],
        x * c[4],
        x * c[5],
        x * c[6],
        x * c[7],
        x * c[8],
    )


@njit(cache=True)
def settle_all(core: Core) -> None:
    """Bring all living hypotheses up to the state's time."""
    for h in range(core.bank.shape[0]):
        if core.bank[h, ALIVE] > 0.0:
            settle(core, core.bank[h])


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
def heaviest(core: Core) -> int:
    """Index of the living hypothesis of largest weight."""
    best = -1
    for h in range(core.bank.shape[0]):
        if core.bank[h, ALIVE] > 0.0 and (
            best < 0 or core.bank[h, LOG_WEIGHT] > core.bank[best, LOG_WEIGHT]
        ):
            best = h
    return best


@njit(cache=True)
def wrap(angle: float) -> float:
    """Angle in [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@njit(cache=True)
def prune(core: Core, time_s: float) -> None:
    """End hypotheses that are 10^-6 as likely as the best, or that have become the same as it."""
    best = heaviest(core)
    if core.bank[best, ALIGNED_S] != 0.0:
        return
    m = core.target.size
    here = heading_of(core.bank[best], core)
    certain = heading_variance(core.bank[best], m)
    alive = 0
    for h in range(core.bank.shape[0]):
        s = core.bank[h]
        if s[ALIVE] == 0.0:
            continue
        behind = core.bank[best, LOG_WEIGHT] - s[LOG_WEIGHT]
        apart = wrap(heading_of(s, core) - here)
        same = certain < 0.01 and apart * apart < 0.25 * certain + 1e-6
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
    rate, rests = core.work[:3], core.shared[RESTING] == 1.0
    slow, sensing, update = slow_of(core), sensing_of(core), update_of(core)
    for h in range(core.bank.shape[0]):
        s = core.bank[h]
        if s[ALIVE] == 0.0:
            continue
        settle(core, s)
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
def add_to_block(d: Floats, before: Floats, reading: Floats) -> None:
    """Sum a sample, and its difference from the one before, into the block watched for rest."""
    d[BLOCK_COUNT] += 1.0
    for i in range(3):
        w, f = reading[i], reading[3 + i]
        d[BLOCK_SUMS + i] += w
        d[BLOCK_SUMS + 3 + i] += f
        d[BLOCK_SUMS + 6] += w * w
        d[BLOCK_SUMS + 7] += f * f
        d[BLOCK_STEPS] += (w - before[i]) ** 2
        d[BLOCK_STEPS + 1] += (f - before[3 + i]) ** 2


@njit(cache=True)
def begin_block(core: Core, time_ns: int) -> None:
    """Begin to watch a new block after a sample's time."""
    core.shared[BLOCK_START : BLOCK_SUMS + 8] = 0.0
    core.shared[BLOCK_STEPS : BLOCK_STEPS + 2] = 0.0
    core.shared[BLOCK_START] = float(time_ns - core.cursor[START])


@njit(cache=True)
def block_due(core: Core) -> int:
    """Time at or after which a sample ends the block."""
    length = core.shared[BLOCK_START] + 1e9 * core.constants[QUIET + 2]
    return core.cursor[START] + int(length)


@njit(cache=True)
def close_block(core: Core, time_ns: int) -> None:
    """Decide whether the block was quiet; correct by rest after enough quiet blocks in a row."""
    length_s = (float(time_ns - core.cursor[START]) - core.shared[BLOCK_START]) * 1e-9
    d, mean, k = core.shared, core.work[24:30], core.constants
    n = d[BLOCK_COUNT]
    rate2, force2, change2 = 0.0, 0.0, 0.0
    for i in range(3):
        mean[i] = d[BLOCK_SUMS + i] / n
        mean[3 + i] = d[BLOCK_SUMS + 3 + i] / n
        rate2 += mean[i] ** 2
        force2 += mean[3 + i] ** 2
        change2 += (mean[3 + i] - d[LAST_FORCE + i]) ** 2
        d[LAST_FORCE + i] = mean[3 + i]
    shake = d[BLOCK_SUMS + 7] / n - force2
    quiet = d[BLOCK_SUMS + 6] / n - rate2 < k[QUIET + 1] and shake < k[QUIET]
    # a smooth start, or the turning point of a swing, is quiet; but its force changes
    white = k[ACCEL_PSD] + k[ACCEL_PSD + 1] + k[ACCEL_PSD + 2]
    quiet = quiet and change2 < CHANGE_LIMIT * white / length_s + k[QUIET + 6]
    if rate2 > k[QUIET + 4] ** 2:
        d[FAST_BLOCKS] += 1.0
    note_steps(core, quiet)
    begin_block(core, time_ns)
    if quiet:
        d[QUIET_BLOCKS] += 1.0
        d[SHAKE_BLOCKS] = min(d[SHAKE_BLOCKS] + 1.0, MOST_SHAKE_BLOCKS)
        d[SHAKE] += (shake * n / max(n - 1.0, 1.0) - d[SHAKE]) / d[SHAKE_BLOCKS]
    else:
        d[QUIET_BLOCKS] = 0.0
        d[SHAKE : RESTING + 1] = 0.0
    d[STILL] = 1.0 if d[QUIET_BLOCKS] >= k[QUIET + 3] else 0.0
    if d[STILL] == 1.0 and k[STILL_USE] != 0.0:
        rest(core, mean, length_s, n)


@njit(cache=True)
def note_steps(core: Core, quiet: bool) -> None:
    """Keep the block's first differences where the platform rests: the IMU's noise is seen there.

    A platform that the fixes show to rest while its sensors are not quiet is kept apart: it may
    shake, or the IMU may be noisier than its model lets rest be told.
    """
    d, k = core.shared, core.constants
    best = core.bank[heaviest(core)]
    slow = is_slow(best, core.target.size, k[STILL_USE - 1])
    d[SLOW_BLOCKS] = d[SLOW_BLOCKS] + 1.0 if slow else 0.0
    if quiet and d[QUIET_BLOCKS] + 1.0 >= k[QUIET + 3]:
        steps = d[QUIET_STEPS : QUIET_STEPS + 3]
    elif d[SLOW_BLOCKS] >= k[QUIET + 3]:
        steps = d[LOUD_STEPS : LOUD_STEPS + 3]
    else:
        return
    steps[0] += d[BLOCK_COUNT]
    steps[1] += d[BLOCK_STEPS]
    steps[2] += d[BLOCK_STEPS + 1]


@njit(cache=True)
def shake_variance(core: Core, samples: float) -> float:
    """Variance of the platform's velocity at rest, by what its accelerometer shows beyond noise.

    The excess of the quiet blocks' mean variance over the model's white noise, where it is beyond
    two standard errors, at ``SHAKE_HZ``, and a least one.
    """
    d, k = core.shared, core.constants
    freedom = max(samples - 1.0, 1.0) * d[SHAKE_BLOCKS]
    # the three axes' white noise need not be alike: the loudest alone would have this error
    error = k[QUIET + 5] * math.sqrt(2.0 / freedom)
    excess = max(d[SHAKE] - k[QUIET + 5] - 2.0 * error, 0.0)
    return k[STILL_USE - 3] ** 2 + excess / (2.0 * math.pi * SHAKE_HZ) ** 2


@njit(cache=True)
def rest(core: Core, mean: Floats, length_s: float, samples: float) -> None:
    """Correct all hypotheses by rest, unless the heaviest or the fixes contradict it.

    One decision for all: those that used more data than others would seem likelier.
    """
    d = core.shared
    m = core.target.size
    slow, sensing, update = slow_of(core), sensing_of(core), update_of(core)
    settle_all(core)
    best = core.bank[heaviest(core)]
    if d[DENIED] > 0.0:
        watch_denied(core, best)
    elif d[RESTING] == 1.0 and fixes_contradict(best, slow):
        d[DENIED] = 1.0
        scale = core.z[max(core.cursor[NEXT] - 1, 0), 15:18]
        for h in range(core.bank.shape[0]):
            forget_rest(core.bank[h], slow, scale, sensing.still[2], update)
    variance = shake_variance(core, samples)
    d[RESTING] = 0.0
    if d[DENIED] > 0.0 or not may_rest(best, m, variance, sensing, update):
        return
    d[RESTING] = 1.0
    gyro_psd = core.constants[GYRO_PSD : GYRO_PSD + 3]
    for h in range(core.bank.shape[0]):
        s = core.bank[h]
        if s[ALIVE] > 0.0:
            correct_by_rates(s, slow, mean, gyro_psd, length_s, sensing, update)
            correct_by_stop(s, slow, variance, sensing, update)
            refresh_bias(s, slow)


@njit(cache=True)
def watch_denied(core: Core, best: Floats) -> None:
    """Believe in rest again when a contradicted platform has not moved for ``WATCHED_BLOCKS``.

    A chance contradicts rest now and then, and an even drive moves away meanwhile: by 3 sigma of
    the difference of two positions, which is less than 4 cm/s for fixes that are 1 m off.
    """
    d, P = core.shared, best[SLOW + core.target.size :]
    d[DENIED] += 1.0
    if d[DENIED] == SETTLING_BLOCKS:
        d[DENIED_AT : DENIED_AT + 3] = best[R : R + 3]
    if d[DENIED] < SETTLING_BLOCKS + WATCHED_BLOCKS:
        return
    moved2, widest = 0.0, 0.0
    for i in range(3):
        moved2 += (best[R + i] - d[DENIED_AT + i]) ** 2
        widest = max(widest, P[i * (STRIDE + 1)])
    d[DENIED] = 0.0 if moved2 < 9.0 * 2.0 * widest else SETTLING_BLOCKS - 1.0


@njit(cache=True)
def save_checkpoint(core: Core) -> None:
    """Copy all that is rewound into the ring, over the oldest."""
    c = core.cursor
    c[LAST_CHECKPOINT] += 1
    if c[LAST_CHECKPOINT] - c[FIRST_CHECKPOINT] >= CHECKPOINTS:
        c[FIRST_CHECKPOINT] = c[LAST_CHECKPOINT] - CHECKPOINTS + 1
    k = c[LAST_CHECKPOINT] % CHECKPOINTS
    core.checkpoint_sample[k] = c[SAMPLES]
    c[CHECKPOINT_DUE] = checkpoint_ns(core, k) + c[CHECKPOINT_PERIOD]
    core.checkpoint_shared[k, :] = core.shared
    for h in range(core.bank.shape[0]):
        if core.bank[h, ALIVE] > 0.0:
            core.checkpoint_bank[k, h, :] = core.bank[h]
        else:
            core.checkpoint_bank[k, h, ALIVE] = 0.0
    while core.checkpoint_sample[c[FIRST_CHECKPOINT] % CHECKPOINTS] < c[SAMPLES] - REACH:
        c[FIRST_CHECKPOINT] += 1


@njit(cache=True)
def checkpoint_ns(core: Core, k: int) -> int:
    """Time of checkpoint ``k``."""
    return core.imu_ns[(core.checkpoint_sample[k % CHECKPOINTS] - 1) % IMU_RING]


@njit(cache=True)
def advance(core: Core, sample: int) -> bool:
    """Take the filter over the interval that ends at ``sample`` (in the ring already).

    Returns whether a row is due.  Measurements at just the sample's time are left to
    :func:`apply_due`.
    """
    c = core.cursor
    start = core.imu_ns[(sample - 1) % IMU_RING]
    end = core.imu_ns[sample % IMU_RING]
    gap = end - start > c[GAP]
    now = start
    while c[NEXT] < c[HEAD_MEASUREMENT] and core.measurement_ns[c[NEXT]] < end:
        at = core.measurement_ns[c[NEXT]]
        if at > now:
            propagate(core, sample, now, at)
            now = at
        correct(core, c[NEXT], sample - 1)
        c[NEXT] += 1
        if c[LOST_NS] != 0:
            return False
    propagate(core, sample, now, end)
    c[SAMPLES] = sample + 1
    if gap:
        core.shared[GAPS] += 1.0
        core.shared[GAP_S] += float(end - start) * 1e-9
        core.shared[QUIET_BLOCKS] = 0.0
        begin_block(core, end)
    else:
        add_to_block(core.shared, core.imu[(sample - 1) % IMU_RING], core.imu[sample % IMU_RING])
        if end >= block_due(core):
            close_block(core, end)
    due = end >= c[PUBLISH_DUE]
    if due:
        settle_all(core)
        c[PUBLISH_DUE] = next_publish(core, end)
    if end >= c[CHECKPOINT_DUE]:
        save_checkpoint(core)
    return due


@njit(cache=True)
def next_publish(core: Core, time_ns: int) -> int:
    """First multiple of the publishing period after a time."""
    period = core.cursor[PUBLISH_PERIOD]
    return (time_ns // period + 1) * period


@njit(cache=True)
def apply_due(core: Core) -> None:
    """Apply the measurements that hold at the newest sample's time."""
    c = core.cursor
    now = core.imu_ns[(c[SAMPLES] - 1) % IMU_RING]
    while c[NEXT] < c[HEAD_MEASUREMENT] and core.measurement_ns[c[NEXT]] <= now:
        if c[LOST_NS] != 0:
            return
        correct(core, c[NEXT], c[SAMPLES] - 1)
        c[NEXT] += 1


@njit(cache=True)
def eventless_until(core: Core, last: int) -> int:
    """First sample from the next one on, or ``last``, at which anything but motion happens."""
    c = core.cursor
    due = min(c[PUBLISH_DUE], c[CHECKPOINT_DUE], block_due(core))
    if c[NEXT] < c[HEAD_MEASUREMENT]:
        due = min(due, core.measurement_ns[c[NEXT]])
    sample = c[SAMPLES]
    before = core.imu_ns[(sample - 1) % IMU_RING]
    while sample < last:
        time = core.imu_ns[sample % IMU_RING]
        if time >= due or time - before > c[GAP]:
            break
        before = time
        sample += 1
    return sample


@njit(cache=True)
def rewind(core: Core, before_ns: int) -> None:
    """Restore the newest checkpoint not after a time and repeat the samples since."""
    c = core.cursor
    head = c[SAMPLES]
    while checkpoint_ns(core, c[LAST_CHECKPOINT]) > before_ns:
        c[LAST_CHECKPOINT] -= 1
    k = c[LAST_CHECKPOINT] % CHECKPOINTS
    core.shared[:] = core.checkpoint_shared[k]
    for h in range(core.bank.shape[0]):
        if core.checkpoint_bank[k, h, ALIVE] > 0.0:
            core.bank[h, :] = core.checkpoint_bank[k, h]
        else:
            core.bank[h, ALIVE] = 0.0
    c[SAMPLES] = core.checkpoint_sample[k]
    time = checkpoint_ns(core, k)
    c[CHECKPOINT_DUE] = time + c[CHECKPOINT_PERIOD]
    c[PUBLISH_DUE] = next_publish(core, time)
    c[NEXT] = 0
    while c[NEXT] < c[HEAD_MEASUREMENT] and core.measurement_ns[c[NEXT]] < time:
        c[NEXT] += 1
    apply_due(core)
    while c[SAMPLES] < head and c[LOST_NS] == 0:
        coast(core, c[SAMPLES], eventless_until(core, head))
        if c[SAMPLES] < head:
            advance(core, c[SAMPLES])
            apply_due(core)


@njit(cache=True)
def settled(core: Core) -> int:
    """How many measurements no rewind can reach any more."""
    oldest = checkpoint_ns(core, core.cursor[FIRST_CHECKPOINT])
    count = 0
    while count < core.cursor[NEXT] and core.measurement_ns[count] <= oldest:
        count += 1
    return count


@njit(cache=True)
def forget(core: Core, drop: int) -> None:
    """Drop the first measurements."""
    c = core.cursor
    for i in range(drop, c[HEAD_MEASUREMENT]):
        core.measurement_ns[i - drop] = core.measurement_ns[i]
        core.kind[i - drop] = core.kind[i]
        core.z[i - drop, :] = core.z[i]
    c[HEAD_MEASUREMENT] -= drop
    c[NEXT] -= drop


@njit(cache=True)
def place_for(core: Core, time_ns: int, kind: int) -> int:
    """Where a measurement belongs in the queue, or -1 when one of its kind and stamp is there."""
    place = core.cursor[HEAD_MEASUREMENT]
    while place > 0 and (
        core.measurement_ns[place - 1] > time_ns
        or (core.measurement_ns[place - 1] == time_ns and core.kind[place - 1] > kind)
    ):
        place -= 1
    if place > 0 and core.measurement_ns[place - 1] == time_ns and core.kind[place - 1] == kind:
        return -1
    return place


@njit(cache=True, nogil=True)
def insert(core: Core, time_ns: int, kind: int, z: Floats) -> int:
    """Put a measurement in its place in time; rewind and repeat when the filter has passed it."""
    c = core.cursor
    now = core.imu_ns[(c[SAMPLES] - 1) % IMU_RING]
    if time_ns < now - core.cursor[WINDOW] or time_ns <= checkpoint_ns(core, c[FIRST_CHECKPOINT]):
        return TOO_LATE
    if c[HEAD_MEASUREMENT] == MEASUREMENT_RING:
        return FULL
    place = place_for(core, time_ns, kind)
    if place < 0:
        return DUPLICATE
    for i in range(c[HEAD_MEASUREMENT], place, -1):
        core.measurement_ns[i] = core.measurement_ns[i - 1]
        core.kind[i] = core.kind[i - 1]
        core.z[i, :] = core.z[i - 1]
    core.measurement_ns[place] = time_ns
    core.kind[place] = kind
    core.z[place, :] = z
    c[HEAD_MEASUREMENT] += 1
    if time_ns > now:
        return ACCEPTED
    if time_ns == now and place == c[NEXT]:
        apply_due(core)
        return ACCEPTED
    rewind(core, time_ns)
    return LATE


@njit(cache=True)
def drop_ahead(core: Core, end: int) -> None:
    """Drop measurements whose stamps lie far ahead of the IMU's clock while it is running."""
    c = core.cursor
    while (
        c[HEAD_MEASUREMENT] > c[NEXT]
        and core.measurement_ns[c[HEAD_MEASUREMENT] - 1] > end + core.cursor[FURTHEST]
    ):
        c[HEAD_MEASUREMENT] -= 1
        c[AHEAD] += 1


@njit(cache=True)
def is_plain(last_ns: int, longest_ns: int, stamp_ns: Ints, rate: Floats, force: Floats) -> bool:
    """Whether a block has nothing to leave out: stamps ascend without a jump, all is finite."""
    before = last_ns
    for i in range(stamp_ns.size):
        if not 0 < stamp_ns[i] - before <= longest_ns:
            return False
        before = stamp_ns[i]
        for j in range(3):
            if not math.isfinite(rate[i, j] + force[i, j]):
                return False
    return True


@njit(cache=True, nogil=True)
def feed(core: Core, stamp_ns: Ints, rate: Floats, force: Floats, out_ns: Ints, out: Floats) -> int:
    """Take a block of samples (stamps ascending); returns how many rows of output became due.

    Ends early where the filter is lost.  No more than ``MOST_SAMPLES`` at a time: rewinding needs
    those before.
    """
    c = core.cursor
    first = c[SAMPLES]
    last = first + stamp_ns.size
    for i in range(stamp_ns.size):
        k = (first + i) % IMU_RING
        core.imu_ns[k] = stamp_ns[i]
        core.imu[k, 0:3] = rate[i]
        core.imu[k, 3:6] = force[i]
    if stamp_ns.size > 0:
        drop_ahead(core, stamp_ns[0])
    rows = 0
    while c[SAMPLES] < last and c[LOST_NS] == 0:
        coast(core, c[SAMPLES], eventless_until(core, last))
        if c[SAMPLES] == last:
            break
        sample = c[SAMPLES]
        if advance(core, sample):
            out_ns[rows] = core.imu_ns[sample % IMU_RING]
            write_output(core, sample % IMU_RING, out[rows])
            rows += 1
        apply_due(core)
    return rows


def samples_after(core: Core, time_ns: int, head: int) -> tuple[Ints, Floats, Floats]:
    """Stamps, rates and forces of the samples after a time; ``head`` were fed in all."""
    first = head
    while first > 0 and core.imu_ns[(first - 1) % IMU_RING] > time_ns:
        first -= 1
    ring = np.arange(first, head) % IMU_RING
    return core.imu_ns[ring], core.imu[ring, :3], core.imu[ring, 3:]


def measurements_after(core: Core, time_ns: int) -> list[tuple[int, int, Floats]]:
    """Stamp, kind and numbers of the measurements after a time, in order of time."""
    return [
        (int(core.measurement_ns[i]), int(core.kind[i]), core.z[i].copy())
        for i in range(int(core.cursor[HEAD_MEASUREMENT]))
        if core.measurement_ns[i] > time_ns
    ]


@njit(cache=True)
def begin(core: Core, stamp_ns: int, rate: Floats, force: Floats) -> None:
    """Put the first sample in the ring: the hypotheses hold at its stamp."""
    core.imu_ns[0] = stamp_ns
    core.imu[0, 0:3] = rate
    core.imu[0, 3:6] = force
    core.cursor[SAMPLES] = 1
    core.cursor[FIRST_CHECKPOINT] = 0
    core.cursor[LAST_CHECKPOINT] = -1
    core.cursor[PUBLISH_DUE] = next_publish(core, stamp_ns)
    begin_block(core, stamp_ns)
    save_checkpoint(core)


@njit(cache=True)
def mixture(core: Core, best: int, mean: Floats, P: Floats) -> int:
    """Mean (9,) about the heaviest hypothesis and covariance (81,) of all; returns how many live.

    The attitude that is published is the heaviest's, so its spread is about that one.
    """
    m = core.target.size
    s = core.bank[best]
    if s[ALIGNED_S] != 0.0:
        own = s[SLOW + m :]
        for i in range(NAV):
            P[NAV * i : NAV * i + NAV] = own[i * STRIDE : i * STRIDE + NAV]
        return 1
    here = heading_of(s, core)
    radius = math.sqrt(s[R] ** 2 + s[R + 1] ** 2 + s[R + 2] ** 2)
    difference = np.zeros(NAV)
    total = 0.0
    alive = 0
    for h in range(core.bank.shape[0]):
        other = core.bank[h]
        if other[ALIVE] == 0.0:
            continue
        alive += 1
        weight = math.exp(other[LOG_WEIGHT] - s[LOG_WEIGHT])
        total += weight
        turn = wrap(heading_of(other, core) - here) if h != best else 0.0
        for i in range(3):
            difference[i] = other[R + i] - s[R + i]
            difference[3 + i] = other[V + i] - s[V + i]
            difference[6 + i] = turn * s[R + i] / radius
        own = other[SLOW + m :]
        for i in range(NAV):
            mean[i] += weight * difference[i]
            for j in range(NAV):
                P[NAV * i + j] += weight * (own[i * STRIDE + j] + difference[i] * difference[j])
    mean /= total
    for i in range(NAV):
        for j in range(NAV):
            P[NAV * i + j] /= total
            if i < 6 or j < 6:  # place and velocity are published at their mean, attitude is not
                P[NAV * i + j] -= mean[i] * mean[j]
    mean[6:] = 0.0
    return alive


@njit(cache=True)
def write_output(core: Core, k: int, row: Floats) -> None:
    """One row: r, v, q, P of (r, v, psi), angular rate, biases and their variances."""
    best = heaviest(core)
    s = core.bank[best]
    mean = np.zeros(NAV)
    row[:] = 0.0
    row[OUT_HYPOTHESES] = mixture(core, best, mean, row[OUT_P : OUT_P + NAV * NAV])
    row[OUT_STILL] = core.shared[STILL]
    for i in range(3):
        row[i] = s[R + i] + mean[i]
        row[3 + i] = s[V + i] + mean[3 + i]
    row[6:10] = s[Q : Q + 4]
    m = core.target.size
    for i in range(3):
        row[OUT_RATE + i] = core.imu[k, i] - s[BIAS + i]
    row[OUT_BIAS : OUT_BIAS + 6] = s[BIAS : BIAS + 6]
    P = s[SLOW + m :]
    for a in range(m):
        for b in range(m):
            t = core.target[a]
            if t < 6 and t == core.target[b]:
                row[OUT_BIAS_VARIANCE + t] += P[(NAV + a) * STRIDE + NAV + b]
