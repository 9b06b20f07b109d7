"""Strapdown mechanisation in ECEF and the propagation of its error covariance, compiled.

Errors are true minus estimate (Groves 2013, ch. 14.2, with the sign of that convention)::

    r' = v,   v' = G r - 2 W v - [f x] psi - C b_a,   psi' = -W psi - C b_g,   b' = -b/T + w

with f the specific force in e, W the Earth rate's cross product and G gravity's gradient.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from imu_noise_id.compiled import njit
from numpy.typing import NDArray

from nav_fusion.earth import EARTH_RATE_RAD_S, gravity_at
from nav_fusion.noise_terms import pair_step
from nav_fusion.state import IMU_TARGETS, NAV, STRIDE, Q, R, SlowModel, V

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
Nine = tuple[float, float, float, float, float, float, float, float, float]


@njit(cache=True)
def rotation_matrix(q: Floats, C: Floats) -> None:
    """Rotation matrix of the unit quaternion ``q`` (w, x, y, z) into ``C`` (3, 3)."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    C[0, 0] = 1 - 2 * (y * y + z * z)
    C[0, 1] = 2 * (x * y - w * z)
    C[0, 2] = 2 * (x * z + w * y)
    C[1, 0] = 2 * (x * y + w * z)
    C[1, 1] = 1 - 2 * (x * x + z * z)
    C[1, 2] = 2 * (y * z - w * x)
    C[2, 0] = 2 * (x * z - w * y)
    C[2, 1] = 2 * (y * z + w * x)
    C[2, 2] = 1 - 2 * (x * x + y * y)


@njit(cache=True)
def rotate_right(q: Floats, a: float, b: float, c: float) -> None:
    """q <- q * exp([a b c]/2), a rotation vector in body axes."""
    angle2 = a * a + b * b + c * c
    if angle2 < 1e-6:
        cosine = 1.0 - angle2 / 8.0 + angle2 * angle2 / 384.0
        sine = 0.5 - angle2 / 48.0 + angle2 * angle2 / 3840.0
    else:
        angle = math.sqrt(angle2)
        cosine = math.cos(0.5 * angle)
        sine = math.sin(0.5 * angle) / angle
    x, y, z = sine * a, sine * b, sine * c
    w0, x0, y0, z0 = q[0], q[1], q[2], q[3]
    q[0] = w0 * cosine - x0 * x - y0 * y - z0 * z
    q[1] = w0 * x + x0 * cosine + y0 * z - z0 * y
    q[2] = w0 * y - x0 * z + y0 * cosine + z0 * x
    q[3] = w0 * z + x0 * y - y0 * x + z0 * cosine


@njit(cache=True)
def rotate_left(q: Floats, a: float, b: float, c: float) -> None:
    """q <- exp([a b c]/2) * q, a rotation vector in ECEF axes; and normalise."""
    q[1], q[2], q[3] = -q[1], -q[2], -q[3]
    rotate_right(q, -a, -b, -c)
    q[1], q[2], q[3] = -q[1], -q[2], -q[3]
    scale = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    for i in range(4):
        q[i] *= scale


@njit(cache=True)
def turn_between(w0: Three, w1: Three, dt: float) -> Three:
    """Rotation vector of a rate that runs straight from w0 to w1: coning to second order.

    dt (w0 + w1)/2 + dt^2/12 w0 x w1 (Savage 1998).
    """
    half, c = 0.5 * dt, dt * dt / 12.0
    return (
        half * (w0[0] + w1[0]) + c * (w0[1] * w1[2] - w0[2] * w1[1]),
        half * (w0[1] + w1[1]) + c * (w0[2] * w1[0] - w0[0] * w1[2]),
        half * (w0[2] + w1[2]) + c * (w0[0] * w1[1] - w0[1] * w1[0]),
    )


@njit(cache=True)
def force_between(f0: Three, f1: Three, a: Three) -> Three:
    """Mean specific force in the axes of the middle of a step that turns by ``a``.

    Sculling: the slope of f meets the turn about the middle, a x (f1 - f0)/12; and the second
    order of the turn within the step, |a|^2/24 of f (Magnus).
    """
    s0, s1, s2 = f1[0] - f0[0], f1[1] - f0[1], f1[2] - f0[2]
    x = 0.5 * (f0[0] + f1[0]) + (a[1] * s2 - a[2] * s1) / 12.0
    y = 0.5 * (f0[1] + f1[1]) + (a[2] * s0 - a[0] * s2) / 12.0
    z = 0.5 * (f0[2] + f1[2]) + (a[0] * s1 - a[1] * s0) / 12.0
    keep = 1.0 - (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]) / 24.0
    along = (a[0] * x + a[1] * y + a[2] * z) / 24.0
    return keep * x + a[0] * along, keep * y + a[1] * along, keep * z + a[2] * along


@njit(cache=True)
def half_turn(a: Three) -> Four:
    """Quaternion of half a rotation vector: cos |a|/4, a/|a| sin |a|/4."""
    x = 0.0625 * (a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    if x < 1e-3:
        cosine = 1.0 - x * (0.5 - x * (1.0 / 24.0 - x / 720.0))
        sine = 0.25 * (1.0 - x * (1.0 / 6.0 - x * (1.0 / 120.0 - x / 5040.0)))
    else:
        quarter = math.sqrt(x)
        cosine = math.cos(quarter)
        sine = 0.25 * math.sin(quarter) / quarter
    return cosine, sine * a[0], sine * a[1], sine * a[2]


@njit(cache=True)
def turned_both(q: Four, h: Four, e: float) -> Four:
    """exp(-e z) q h, with z the Earth's axis: the Earth turns under the body that turns by h."""
    w = q[0] * h[0] - q[1] * h[1] - q[2] * h[2] - q[3] * h[3]
    x = q[0] * h[1] + q[1] * h[0] + q[2] * h[3] - q[3] * h[2]
    y = q[0] * h[2] - q[1] * h[3] + q[2] * h[0] + q[3] * h[1]
    z = q[0] * h[3] + q[1] * h[2] - q[2] * h[1] + q[3] * h[0]
    c = 1.0 - 0.5 * e * e
    return c * w + e * z, c * x + e * y, c * y - e * x, c * z - e * w


@njit(cache=True)
def matrix_elements(q: Four) -> Nine:
    """Rotation matrix of a unit quaternion (w, x, y, z), by rows."""
    w, x, y, z = q
    return (
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    )


@njit(cache=True)
def mechanise(
    s: Floats, w0: Three, w1: Three, f0: Three, f1: Three, dt: float
) -> tuple[Three, Nine]:
    """Advance position, velocity and attitude, the first ten of ``s``, by ``dt``.

    Angular rate and specific force, biases removed, run straight from sample 0 to sample 1; the
    specific force is turned at the middle of the step, position goes by the trapezoid.  Returns
    the specific force in e and the attitude at the middle.
    """
    a = turn_between(w0, w1, dt)
    h, e = half_turn(a), 0.25 * EARTH_RATE_RAD_S * dt
    middle = turned_both((s[Q], s[Q + 1], s[Q + 2], s[Q + 3]), h, e)
    C = matrix_elements(middle)
    x, y, z = force_between(f0, f1, a)
    f = (
        C[0] * x + C[1] * y + C[2] * z,
        C[3] * x + C[4] * y + C[5] * z,
        C[6] * x + C[7] * y + C[8] * z,
    )
    g = gravity_at(s[R], s[R + 1], s[R + 2])
    v0, v1, v2 = s[V], s[V + 1], s[V + 2]
    twice, half = 2.0 * EARTH_RATE_RAD_S, 0.5 * dt
    n0 = v0 + dt * (f[0] + g[0] + twice * v1)
    n1 = v1 + dt * (f[1] + g[1] - twice * v0)
    n2 = v2 + dt * (f[2] + g[2])
    s[R] += half * (v0 + n0)
    s[R + 1] += half * (v1 + n1)
    s[R + 2] += half * (v2 + n2)
    s[V], s[V + 1], s[V + 2] = n0, n1, n2
    q = turned_both(middle, h, e)
    # one Newton step towards length 1, from which rounding alone has led away
    scale = 1.5 - 0.5 * (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    s[Q], s[Q + 1], s[Q + 2], s[Q + 3] = scale * q[0], scale * q[1], scale * q[2], scale * q[3]
    return f, C


@njit(cache=True)
def transition_rows(
    M: Floats, B: Floats, out: Floats, columns: int, f: Three, u: Three, k: float, dt: float
) -> None:
    """F_nav applied to the nine navigation rows of ``M`` and the six bias rows ``B``, into ``out``.

    All three are flat with rows ``STRIDE`` apart: a stride known to the compiler lets it see that
    rows do not overlap, and use vector instructions (four times faster).  ``B`` holds C b_g and
    C b_a in e.  psi goes by one step, v by the middle psi, r by the trapezoid of v: the map that
    :func:`mechanise` makes of a small error, exact to third order in dt.  ``k`` is dt g/|r| and
    ``u`` the unit vector up: dt G = -k (I - 3 u u').
    """
    turn = EARTH_RATE_RAD_S * dt
    fx, fy, fz = dt * f[0], dt * f[1], dt * f[2]
    ux, uy, uz = u[0], u[1], u[2]
    h = 0.5 * dt
    for j in range(columns):
        p0, p1, p2 = M[6 * STRIDE + j], M[7 * STRIDE + j], M[8 * STRIDE + j]
        g0, g1, g2 = B[j], B[STRIDE + j], B[2 * STRIDE + j]
        m0, m1, m2 = p0 - h * g0, p1 - h * g1, p2 - h * g2
        out[6 * STRIDE + j] = p0 + turn * p1 - dt * g0
        out[7 * STRIDE + j] = p1 - turn * p0 - dt * g1
        out[8 * STRIDE + j] = p2 - dt * g2
        r0, r1, r2 = M[j], M[STRIDE + j], M[2 * STRIDE + j]
        v0, v1, v2 = M[3 * STRIDE + j], M[4 * STRIDE + j], M[5 * STRIDE + j]
        a0, a1, a2 = B[3 * STRIDE + j], B[4 * STRIDE + j], B[5 * STRIDE + j]
        along = 3.0 * (ux * r0 + uy * r1 + uz * r2)
        n0 = v0 + k * (ux * along - r0) + 2 * turn * v1 - (fy * m2 - fz * m1) - dt * a0
        n1 = v1 + k * (uy * along - r1) - 2 * turn * v0 - (fz * m0 - fx * m2) - dt * a1
        n2 = v2 + k * (uz * along - r2) - (fx * m1 - fy * m0) - dt * a2
        out[3 * STRIDE + j], out[4 * STRIDE + j], out[5 * STRIDE + j] = n0, n1, n2
        out[j] = r0 + h * (v0 + n0)
        out[STRIDE + j] = r1 + h * (v1 + n1)
        out[2 * STRIDE + j] = r2 + h * (v2 + n2)


@njit(cache=True)
def bias_rows(M: Floats, columns: int, mean: Floats, target: Ints, C: Nine, B: Floats) -> None:
    """Six rows of ``B``: the slow states of each inertial axis, with weights, turned into e."""
    for k in range(6):
        for j in range(columns):
            B[k * STRIDE + j] = 0.0
    for s in range(target.size):
        t = target[s]
        if t >= IMU_TARGETS:
            break
        first, to, k = (NAV + s) * STRIDE, (t // 3) * 3 * STRIDE, t % 3
        x, y, z = mean[s] * C[k], mean[s] * C[3 + k], mean[s] * C[6 + k]
        for j in range(columns):
            row = M[first + j]
            B[to + j] += x * row
            B[to + STRIDE + j] += y * row
            B[to + 2 * STRIDE + j] += z * row


@njit(cache=True)
def white_block(C: Nine, psd: Three, half_dt: float) -> Nine:
    """Half a step's white noise of three axes turned into e: half_dt C diag(psd) C', by rows."""
    a, b, c = half_dt * psd[0], half_dt * psd[1], half_dt * psd[2]
    xx = a * C[0] * C[0] + b * C[1] * C[1] + c * C[2] * C[2]
    xy = a * C[0] * C[3] + b * C[1] * C[4] + c * C[2] * C[5]
    xz = a * C[0] * C[6] + b * C[1] * C[7] + c * C[2] * C[8]
    yy = a * C[3] * C[3] + b * C[4] * C[4] + c * C[5] * C[5]
    yz = a * C[3] * C[6] + b * C[4] * C[7] + c * C[5] * C[8]
    zz = a * C[6] * C[6] + b * C[7] * C[7] + c * C[8] * C[8]
    return xx, xy, xz, xy, yy, yz, xz, yz, zz


@njit(cache=True)
def add_half_noise(P: Floats, force: Nine, turn: Nine, half_noise: Floats) -> None:
    """Add half a step's process noise: white noise of the axes in e, and the slow states'.

    Half before and half after the transition integrates Phi Q Phi' by the trapezoid.
    """
    for i in range(3):
        for j in range(3):
            P[(3 + i) * STRIDE + 3 + j] += force[3 * i + j]
            P[(6 + i) * STRIDE + 6 + j] += turn[3 * i + j]
    for s in range(half_noise.size):
        P[(NAV + s) * (STRIDE + 1)] += half_noise[s]


@njit(cache=True)
def slow_step(slow: SlowModel, dt: float, decay: Floats, mean: Floats, half_noise: Floats) -> None:
    """Exact step of the slow states: decay e^-x, mean over the step (1 - e^-x)/x, half the noise.

    x = dt/T.  Half the noise is (q T/2) tanh x, so that half before and half after a decay leave
    the stationary variance exactly q T/2; q dt/2 for a walk.  Below x = 1e-3 by their series,
    exact to the last bit there and cheap where every step has another length.  Pairs keep still:
    :func:`turn_pairs` moves them.
    """
    for s in range(slow.rate.size):
        if slow.spin[s] != 0.0 or (s > 0 and slow.spin[s - 1] != 0.0):
            decay[s], mean[s], half_noise[s] = 1.0, 1.0, 0.0
            continue
        x = slow.rate[s] * dt
        if x < 1e-3:
            decay[s] = 1.0 - x * (1.0 - x * (0.5 - x * (1.0 / 6.0 - x / 24.0)))
            mean[s] = 1.0 - x * (0.5 - x * (1.0 / 6.0 - x * (1.0 / 24.0 - x / 120.0)))
            half_noise[s] = 0.5 * slow.psd[s] * dt * (1.0 - x * x * (1.0 / 3.0 - x * x / 7.5))
        else:
            decay[s] = math.exp(-x)
            mean[s] = -math.expm1(-x) / x
            half_noise[s] = 0.5 * slow.psd[s] / slow.rate[s] * math.tanh(x)


@njit(cache=True)
def turn_pairs(P: Floats, slow: SlowModel, dt: float) -> None:
    """P <- Phi P Phi' + sigma^2 (I - Phi Phi') for each pair of states, stationary as it is."""
    n = NAV + slow.target.size
    for k in range(slow.target.size):
        if slow.spin[k] == 0.0:
            continue
        a, b, c, d = pair_step(slow.rate[k], slow.rate[k + 1], slow.spin[k], dt)
        p, q, v = (NAV + k) * STRIDE, (NAV + k + 1) * STRIDE, slow.variance[k]
        i, j = NAV + k, NAV + k + 1
        x, y, z = P[p + i] - v, P[p + j], P[q + j] - v
        for h in range(n):
            top, low = P[p + h], P[q + h]
            P[p + h], P[q + h] = a * top + b * low, c * top + d * low
            P[h * STRIDE + i], P[h * STRIDE + j] = P[p + h], P[q + h]
        P[p + i] = v + a * a * x + 2.0 * a * b * y + b * b * z
        P[q + j] = v + c * c * x + 2.0 * c * d * y + d * d * z
        P[p + j] = a * c * x + (a * d + b * c) * y + b * d * z
        P[q + i] = P[p + j]


@njit(cache=True)
def move_pairs(x: Floats, slow: SlowModel, dt: float) -> None:
    """Take the pairs among the slow states ``x`` (m,) over a step."""
    for k in range(slow.target.size):
        if slow.spin[k] != 0.0:
            a, b, c, d = pair_step(slow.rate[k], slow.rate[k + 1], slow.spin[k], dt)
            x[k], x[k + 1] = a * x[k] + b * x[k + 1], c * x[k] + d * x[k + 1]


class Scratch(NamedTuple):
    """Working arrays of a step, allocated once: flat rows ``STRIDE`` apart."""

    bias: Floats
    rows: Floats
    turned: Floats
    block: Floats
    decay: Floats
    mean: Floats
    half_noise: Floats


SCRATCH_SIZE = (6 + NAV + STRIDE + NAV + 3) * STRIDE


@njit(cache=True)
def scratch_views(flat: Floats, m: int) -> Scratch:
    """Views of a flat array of ``SCRATCH_SIZE`` as the scratch of ``m`` slow states."""
    a = 6 * STRIDE
    b = a + NAV * STRIDE
    c = b + STRIDE * STRIDE
    d = c + NAV * STRIDE
    e, f = d + STRIDE, d + 2 * STRIDE
    return Scratch(
        flat[:a], flat[a:b], flat[b:c], flat[c:d], flat[d : d + m], flat[e : e + m], flat[f : f + m]
    )


@njit(cache=True)
def propagate_covariance(
    P: Floats,
    C: Nine,
    f: Three,
    r: Three,
    dt: float,
    slow: SlowModel,
    gyro_psd: Three,
    accel_psd: Three,
    work: Scratch,
) -> None:
    """P <- F P F' + Q in place, by the blocks that F has; P stays symmetric to the last bit.

    A = F P for the navigation rows, then F A' for their own block; what the slow states share with
    navigation is A's right part decayed, and their own block decays.
    """
    n = NAV + slow.target.size
    force, turn = white_block(C, accel_psd, 0.5 * dt), white_block(C, gyro_psd, 0.5 * dt)
    add_half_noise(P, force, turn, work.half_noise)
    g = gravity_at(r[0], r[1], r[2])
    radius2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    k = dt * math.sqrt((g[0] * g[0] + g[1] * g[1] + g[2] * g[2]) / radius2)
    scale = 1.0 / math.sqrt(radius2)
    up = (scale * r[0], scale * r[1], scale * r[2])
    bias_rows(P, n, work.mean, slow.target, C, work.bias)
    transition_rows(P, work.bias, work.rows, n, f, up, k, dt)
    for j in range(n):
        for i in range(NAV):
            work.turned[j * STRIDE + i] = work.rows[i * STRIDE + j]
    bias_rows(work.turned, NAV, work.mean, slow.target, C, work.bias)
    transition_rows(work.turned, work.bias, work.block, NAV, f, up, k, dt)
    put_back(P, slow.target.size, work)
    turn_pairs(P, slow, dt)
    add_half_noise(P, force, turn, work.half_noise)


@njit(cache=True)
def put_back(P: Floats, m: int, work: Scratch) -> None:
    """Write the blocks of F P F' into P, both halves of it alike."""
    A, out, decay = work.rows, work.block, work.decay
    for i in range(NAV):
        for j in range(i + 1):
            P[i * STRIDE + j] = 0.5 * (out[i * STRIDE + j] + out[j * STRIDE + i])
            P[j * STRIDE + i] = P[i * STRIDE + j]
        for s in range(m):
            P[i * STRIDE + NAV + s] = A[i * STRIDE + NAV + s] * decay[s]
    for s in range(m):
        row, d = (NAV + s) * STRIDE, decay[s]
        for i in range(NAV):
            P[row + i] = P[i * STRIDE + NAV + s]
        for j in range(m):
            P[row + NAV + j] *= d * decay[j]
