"""All hypotheses of a filter at once, moved: samples, gaps, and covariances that follow."""

from __future__ import annotations

from imu_noise_id.compiled import njit

from nav_fusion.arrays import (
    ACCEL_PSD,
    CIRCLE_HEADINGS,
    GAP,
    GYRO_PSD,
    IMU_RING,
    LAG,
    LAG_TURN,
    LAST_DT,
    REPOSE,
    RESTING,
    UNKNOWN,
    VECTORS,
    Core,
    Floats,
    circle_heading,
    slow_of,
)
from nav_fusion.correction import take_tilt_along
from nav_fusion.earth import gravity_at
from nav_fusion.observe import ALIGNED_S
from nav_fusion.state import (
    ALIVE,
    ASLEEP,
    BIAS,
    ELAPSED,
    FORCE_SUM,
    GAP_VARIANCE,
    LOG_WEIGHT,
    SLOW,
    TURN_SUM,
    R,
    SlowModel,
)
from nav_fusion.strapdown import (
    Nine,
    Three,
    mechanise,
    move_pairs,
    propagate_covariance,
    scratch_views,
    slow_step,
)

COVARIANCE_STEP_S = 0.01
"""At most about this long: 100 Hz is within 2e-4 of 1 kHz, and ten times cheaper."""
RESTING_STEP_S = 0.05
"""The same at rest, where attitude and force stay as they are: within 2e-4 of the other."""


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
def cross(a: Three, b: Three) -> Three:
    """Cross product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@njit(cache=True)
def step(s: Floats, w0: Three, w1: Three, f0: Three, f1: Three, dt: float) -> Nine:
    """Take a hypothesis over ``dt``; rate and force, biases removed, run straight from 0 to 1.

    Returns the attitude in the middle.
    The covariance follows in steps of :func:`covariance_step` (:func:`settle`), for which
    specific force and attitude are summed.
    """
    force, C = mechanise(s, w0, w1, f0, f1, dt)
    s[ELAPSED] += dt
    for i in range(3):
        s[FORCE_SUM + i] += dt * force[i]
    for i in range(9):
        s[TURN_SUM + i] += dt * C[i]
    return C


@njit(cache=True)
def glide(s: Floats, a: Floats, b: Floats, x0: float, x1: float, dt: float) -> None:
    """Take a hypothesis from part ``x0`` to ``x1`` between two samples, ``dt`` long."""
    w0, w1 = at_part(a, b, 0, x0, s, BIAS), at_part(a, b, 0, x1, s, BIAS)
    f0, f1 = at_part(a, b, 3, x0, s, BIAS + 3), at_part(a, b, 3, x1, s, BIAS + 3)
    step(s, w0, w1, f0, f1, dt)


@njit(cache=True)
def covariance_step(core: Core) -> float:
    """How much time may gather, s, before the covariances follow."""
    return RESTING_STEP_S if core.shared[RESTING] == 1.0 else COVARIANCE_STEP_S


@njit(cache=True)
def some_sleep(core: Core) -> bool:
    """Whether some hypotheses sleep; those of the circle's five never do."""
    return core.bank.shape[0] > 1 and core.bank[1, ALIVE] == ASLEEP


@njit(cache=True)
def heaviest(core: Core) -> int:
    """Index of the living hypothesis of largest weight; of the five alone where others sleep."""
    bank, best = core.bank, -1
    count = bank.shape[0]
    if some_sleep(core):
        for k in range(CIRCLE_HEADINGS):
            h = circle_heading(k, count)
            if best < 0 or bank[h, LOG_WEIGHT] > bank[best, LOG_WEIGHT]:
                best = h
        return best
    for h in range(count):
        if bank[h, ALIVE] > 0.0 and (best < 0 or bank[h, LOG_WEIGHT] > bank[best, LOG_WEIGHT]):
            best = h
    return best


@njit(cache=True)
def leader(core: Core) -> int:
    """Index of the heaviest hypothesis where it goes ahead and the others follow, or -1.

    At rest, while many live: of a platform that rests all headings tell the same, and what they
    differ by hardly changes.
    """
    if core.bank.shape[0] == 1 or core.shared[RESTING] != 1.0:
        return -1
    best = heaviest(core)
    return best if core.bank[best, ALIGNED_S] == 0.0 else -1


@njit(cache=True)
def lead(d: Floats, s: Floats, a: Floats, b: Floats, x0: float, x1: float, dt: float) -> bool:
    """Take the heaviest hypothesis, ``s``, over a part of an interval; gather it for the others.

    Returns whether covariances are due.  Not given the core: a call's price is its arrays.
    """
    gather(d, s, a, b, 0.5 * (x0 + x1), dt)
    glide(s, a, b, x0, x1, dt)
    return bool(s[ELAPSED] + 0.5 * dt >= RESTING_STEP_S)


@njit(cache=True)
def gather(d: Floats, s: Floats, a: Floats, b: Floats, x: float, dt: float) -> None:
    """Sum for those that lag, of readings less the heaviest's biases, in the axes at the beginning.

    The turn and, with what has turned so far (sculling), by how much the specific force has changed
    the velocity, and moved the place by that.
    """
    w, f, half = at_part(a, b, 0, x, s, BIAS), at_part(a, b, 3, x, s, BIAS + 3), 0.5 * dt
    t, v, r = LAG_TURN, LAG_TURN + 3, LAG_TURN + 6
    middle = (d[t] + half * w[0], d[t + 1] + half * w[1], d[t + 2] + half * w[2])
    across = cross(middle, f)
    more = (dt * (f[0] + across[0]), dt * (f[1] + across[1]), dt * (f[2] + across[2]))
    d[r] += dt * (d[v] + 0.5 * more[0])
    d[r + 1] += dt * (d[v + 1] + 0.5 * more[1])
    d[r + 2] += dt * (d[v + 2] + 0.5 * more[2])
    d[v], d[v + 1], d[v + 2] = d[v] + more[0], d[v + 1] + more[1], d[v + 2] + more[2]
    d[t], d[t + 1], d[t + 2] = d[t] + dt * w[0], d[t + 1] + dt * w[1], d[t + 2] + dt * w[2]
    d[LAG] += dt


@njit(cache=True)
def catch_up(core: Core) -> None:
    """Let the hypotheses that lag follow to the state's time, in one step, without covariances."""
    d = core.shared
    dt = d[LAG]
    if dt == 0.0:
        return
    best = heaviest(core)
    for h in range(core.bank.shape[0]):
        if h != best and core.bank[h, ALIVE] > 0.0:
            follow(core.bank[h], core.bank[best], d, dt)
    d[LAG : LAG_TURN + 9] = 0.0


@njit(cache=True)
def follow(s: Floats, best: Floats, d: Floats, dt: float) -> None:
    """Take a hypothesis over the time that it lags: the mean readings, its own biases removed.

    The change of velocity is turned into the axes of the middle, where :func:`step` has its force;
    the place has moved by other than half of it.
    """
    t, v, shift = lag_views(d)
    back = cross((-0.5 * t[0], -0.5 * t[1], -0.5 * t[2]), (v[0], v[1], v[2]))
    g, a = BIAS, BIAS + 3
    w = (
        t[0] / dt + best[g] - s[g],
        t[1] / dt + best[g + 1] - s[g + 1],
        t[2] / dt + best[g + 2] - s[g + 2],
    )
    f = (
        (v[0] + back[0]) / dt + best[a] - s[a],
        (v[1] + back[1]) / dt + best[a + 1] - s[a + 1],
        (v[2] + back[2]) / dt + best[a + 2] - s[a + 2],
    )
    C, h = step(s, w, w, f, f, dt), 0.5 * dt
    x, y, z = shift[0] - h * v[0], shift[1] - h * v[1], shift[2] - h * v[2]
    s[R] += C[0] * x + C[1] * y + C[2] * z
    s[R + 1] += C[3] * x + C[4] * y + C[5] * z
    s[R + 2] += C[6] * x + C[7] * y + C[8] * z


@njit(cache=True)
def lag_views(d: Floats) -> tuple[Floats, Floats, Floats]:
    """Turn, change of velocity and of place that were gathered."""
    a = LAG_TURN
    return d[a : a + 3], d[a + 3 : a + 6], d[a + 6 : a + 9]


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
    best = leader(core)
    if best >= 0 and not gap:
        s = core.bank[best]
        if lead(core.shared, s, core.imu[a], core.imu[b], x0, x1, dt):
            settle_all(core)
        return
    catch_up(core)
    longest = covariance_step(core)
    for h in range(core.bank.shape[0]):
        s = core.bank[h]
        if s[ALIVE] <= 0.0:
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
def glide_over(core: Core, first: int, last: int) -> None:
    """Take every hypothesis over the whole intervals that end at samples ``first`` to ``last``-1.

    The same as :func:`propagate` interval by interval where nothing happens at any of them.
    """
    best = leader(core)
    if best >= 0:
        s = core.bank[best]
        for sample in range(first, last):
            a, b = (sample - 1) % IMU_RING, sample % IMU_RING
            dt = float(core.imu_ns[b] - core.imu_ns[a]) * 1e-9
            if lead(core.shared, s, core.imu[a], core.imu[b], 0.0, 1.0, dt):
                settle_all(core)
        return
    longest = covariance_step(core)
    for h in range(core.bank.shape[0]):
        s = core.bank[h]
        if s[ALIVE] <= 0.0:
            continue
        for sample in range(first, last):
            a, b = (sample - 1) % IMU_RING, sample % IMU_RING
            dt = float(core.imu_ns[b] - core.imu_ns[a]) * 1e-9
            glide(s, core.imu[a], core.imu[b], 0.0, 1.0, dt)
            if s[ELAPSED] + 0.5 * dt >= longest:
                settle(core, s)


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
    if core.shared[REPOSE] == 1.0:
        take_tilt_along(s, m)
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
    """Mean specific force in e since the last :func:`settle`; what bears gravity while it rests.

    Its noise would let a heading error act on the velocity, and every velocity of 0 would seem to
    say that there is none: at rest the heading would become known from nothing.  Beyond five sigma
    of that noise the platform has begun to move.
    """
    f = (x * s[FORCE_SUM], x * s[FORCE_SUM + 1], x * s[FORCE_SUM + 2])
    if core.shared[RESTING] == 1.0 or core.shared[REPOSE] == 1.0:
        g = gravity_at(s[R], s[R + 1], s[R + 2])
        beyond2 = (f[0] + g[0]) ** 2 + (f[1] + g[1]) ** 2 + (f[2] + g[2]) ** 2
        k = core.constants
        if core.shared[REPOSE] == 1.0 or beyond2 < 25.0 * x * (
            k[ACCEL_PSD] + k[ACCEL_PSD + 1] + k[ACCEL_PSD + 2]
        ):
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
    """Bring all living hypotheses, and their covariances, up to the state's time."""
    catch_up(core)
    for h in range(core.bank.shape[0]):
        if core.bank[h, ALIVE] > 0.0:
            settle(core, core.bank[h])


@njit(cache=True)
def get_ready(core: Core) -> None:
    """Bring up to the state's time what a row is made of.

    Covariances of hypotheses that follow wait: how often rows are due changes no likelihood.
    """
    if leader(core) >= 0:
        catch_up(core)
    else:
        settle_all(core)
