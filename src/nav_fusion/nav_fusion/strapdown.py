"""Strapdown mechanisation in ECEF and the propagation of its error covariance, compiled.

Errors are true minus estimate (Groves 2013, ch. 14.2, with the sign of that convention)::

    r' = v,   v' = G r - 2 W v - [f x] psi - C b_a,   psi' = -W psi - C b_g,   b' = -b/T + w

with f the specific force in e, W the Earth rate's cross product and G gravity's gradient.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from nav_fusion.earth import EARTH_RATE_RAD_S, normal_gravity
from nav_fusion.state import IMU_TARGETS, NAV, STRIDE, SlowModel

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


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
def mechanise(
    r: Floats,
    v: Floats,
    q: Floats,
    w0: Floats,
    w1: Floats,
    f0: Floats,
    f1: Floats,
    dt: float,
    C: Floats,
    f_e: Floats,
    g: Floats,
) -> None:
    """Advance position, velocity and attitude by ``dt`` between two samples, biases removed.

    Angular rate and specific force run straight from sample 0 to sample 1: coning to second order
    (w0 x w1 dt^2/12, Savage 1998), the specific force turned at the middle of the step, position
    by the trapezoid.  ``C`` becomes the attitude at the middle, ``f_e`` the specific force in e.
    """
    half = 0.5 * dt
    c = dt * dt / 12.0
    a0 = half * (w0[0] + w1[0]) + c * (w0[1] * w1[2] - w0[2] * w1[1])
    a1 = half * (w0[1] + w1[1]) + c * (w0[2] * w1[0] - w0[0] * w1[2])
    a2 = half * (w0[2] + w1[2]) + c * (w0[0] * w1[1] - w0[1] * w1[0])
    rotate_right(q, 0.5 * a0, 0.5 * a1, 0.5 * a2)
    rotate_left(q, 0.0, 0.0, -0.5 * EARTH_RATE_RAD_S * dt)
    rotation_matrix(q, C)
    # sculling: the slope of f meets the turn about the middle, dt^2/12 (w x (f1 - f0))
    s0, s1, s2 = f1[0] - f0[0], f1[1] - f0[1], f1[2] - f0[2]
    x = 0.5 * (f0[0] + f1[0]) + (a1 * s2 - a2 * s1) / 12.0
    y = 0.5 * (f0[1] + f1[1]) + (a2 * s0 - a0 * s2) / 12.0
    z = 0.5 * (f0[2] + f1[2]) + (a0 * s1 - a1 * s0) / 12.0
    # second order of the turn within the step: (w dt)^2/24 of f (Magnus)
    turn2 = (a0 * a0 + a1 * a1 + a2 * a2) / 24.0
    along = (a0 * x + a1 * y + a2 * z) / 24.0
    keep = 1.0 - turn2
    x, y, z = keep * x + a0 * along, keep * y + a1 * along, keep * z + a2 * along
    for i in range(3):
        f_e[i] = C[i, 0] * x + C[i, 1] * y + C[i, 2] * z
    normal_gravity(r, g)
    u0, u1, u2 = v[0], v[1], v[2]
    twice = 2.0 * EARTH_RATE_RAD_S
    v[0] = u0 + dt * (f_e[0] + g[0] + twice * u1)
    v[1] = u1 + dt * (f_e[1] + g[1] - twice * u0)
    v[2] = u2 + dt * (f_e[2] + g[2])
    r[0] += half * (u0 + v[0])
    r[1] += half * (u1 + v[1])
    r[2] += half * (u2 + v[2])
    rotate_right(q, 0.5 * a0, 0.5 * a1, 0.5 * a2)
    rotate_left(q, 0.0, 0.0, -0.5 * EARTH_RATE_RAD_S * dt)


@njit(cache=True)
def transition_rows(
    M: Floats,
    B: Floats,
    out: Floats,
    columns: int,
    f: Floats,
    u: tuple[float, float, float],
    k: float,
    dt: float,
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
def bias_rows(M: Floats, columns: int, weight: Floats, target: Ints, C: Floats, B: Floats) -> None:
    """Six rows of ``B``: the slow states of each inertial axis, with weights, turned into e."""
    for j in range(6 * STRIDE):
        B[j] = 0.0
    for s in range(target.size):
        t = target[s]
        if t >= IMU_TARGETS:
            break
        axis, to, source = t % 3, (t // 3) * 3 * STRIDE, (NAV + s) * STRIDE
        c0, c1, c2 = weight[s] * C[0, axis], weight[s] * C[1, axis], weight[s] * C[2, axis]
        for j in range(columns):
            x = M[source + j]
            B[to + j] += c0 * x
            B[to + STRIDE + j] += c1 * x
            B[to + 2 * STRIDE + j] += c2 * x


@njit(cache=True)
def add_half_noise(
    P: Floats, C: Floats, gyro_psd: Floats, accel_psd: Floats, half_noise: Floats, half_dt: float
) -> None:
    """Add half a step's process noise: white noise of the axes turned into e, and the slow states'.

    Half before and half after the transition integrates Phi Q Phi' by the trapezoid.
    """
    for i in range(3):
        for j in range(3):
            a = 0.0
            w = 0.0
            for k in range(3):
                product = C[i, k] * C[j, k]
                a += product * accel_psd[k]
                w += product * gyro_psd[k]
            P[(3 + i) * STRIDE + 3 + j] += half_dt * a
            P[(6 + i) * STRIDE + 6 + j] += half_dt * w
    for s in range(half_noise.size):
        P[(NAV + s) * (STRIDE + 1)] += half_noise[s]


@njit(cache=True)
def slow_step(slow: SlowModel, dt: float, decay: Floats, mean: Floats, half_noise: Floats) -> None:
    """Exact step of the slow states: decay e^-x, mean over the step (1 - e^-x)/x, half the noise.

    x = dt/T.  Half the noise is (q T/2) tanh x, so that half before and half after a decay leave
    the stationary variance exactly q T/2; q dt/2 for a walk.
    """
    for s in range(slow.rate.size):
        x = slow.rate[s] * dt
        if x == 0.0:
            decay[s] = 1.0
            mean[s] = 1.0
            half_noise[s] = 0.5 * slow.psd[s] * dt
        else:
            decay[s] = math.exp(-x)
            mean[s] = -math.expm1(-x) / x
            half_noise[s] = 0.5 * slow.psd[s] / slow.rate[s] * math.tanh(x)


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
    C: Floats,
    f_e: Floats,
    r: Floats,
    g: Floats,
    dt: float,
    slow: SlowModel,
    gyro_psd: Floats,
    accel_psd: Floats,
    work: Scratch,
) -> None:
    """P <- F P F' + Q in place, by the blocks that F has; P stays symmetric to the last bit.

    A = F P for the navigation rows, then F A' for their own block; what the slow states share with
    navigation is A's right part decayed, and their own block decays.
    """
    m = slow.target.size
    n = NAV + m
    add_half_noise(P, C, gyro_psd, accel_psd, work.half_noise, 0.5 * dt)
    radius = math.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    k = dt * math.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]) / radius
    up = (r[0] / radius, r[1] / radius, r[2] / radius)
    A, At, out = work.rows, work.turned, work.block
    bias_rows(P, n, work.mean, slow.target, C, work.bias)
    transition_rows(P, work.bias, A, n, f_e, up, k, dt)
    for i in range(NAV):
        for j in range(n):
            At[j * STRIDE + i] = A[i * STRIDE + j]
    bias_rows(At, NAV, work.mean, slow.target, C, work.bias)
    transition_rows(At, work.bias, out, NAV, f_e, up, k, dt)
    for i in range(NAV):
        for j in range(i + 1):
            P[i * STRIDE + j] = 0.5 * (out[i * STRIDE + j] + out[j * STRIDE + i])
            P[j * STRIDE + i] = P[i * STRIDE + j]
    for i in range(NAV):
        for s in range(m):
            P[i * STRIDE + NAV + s] = A[i * STRIDE + NAV + s] * work.decay[s]
    for s in range(m):
        row, d = (NAV + s) * STRIDE, work.decay[s]
        for i in range(NAV):
            P[row + i] = P[i * STRIDE + NAV + s]
        for j in range(m):
            P[row + NAV + j] *= d * work.decay[j]
    add_half_noise(P, C, gyro_psd, accel_psd, work.half_noise, 0.5 * dt)
