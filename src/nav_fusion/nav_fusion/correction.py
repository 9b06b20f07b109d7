"""The correction of one hypothesis by a prepared innovation: gain, Joseph's form, the turn of tilt.

An innovation y, its rows H and covariance R lie in :class:`Update`; all that is done with them is
written once, here, whatever was measured.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from imu_noise_id.compiled import njit
from numpy.typing import NDArray

from nav_fusion.earth import plumb_at
from nav_fusion.state import NAV, SLOW, STRIDE, TILT_AT, Q, R, V
from nav_fusion.strapdown import matrix_elements, rotate_left

Floats = NDArray[np.float64]


LEAST_TURN_RAD = 1e-4


class Update(NamedTuple):
    """Working arrays of a correction of up to three components."""

    y: Floats
    H: Floats
    R: Floats
    HP: Floats
    S: Floats
    K: Floats
    T: Floats
    C: Floats
    white: Floats


UPDATE_SIZE = 48 + 9 * STRIDE


@njit(cache=True)
def update_views(flat: Floats) -> Update:
    """Views of a flat array of ``UPDATE_SIZE`` as the working arrays."""
    a, b, c, d = 48, 48 + 3 * STRIDE, 48 + 6 * STRIDE, 48 + 9 * STRIDE
    return Update(
        flat[0:3],
        flat[a:b].reshape(3, STRIDE),
        flat[3:12].reshape(3, 3),
        flat[b:c].reshape(3, STRIDE),
        flat[12:21].reshape(3, 3),
        flat[c:d].reshape(3, STRIDE),
        flat[21:30].reshape(3, 3),
        flat[30:39].reshape(3, 3),
        flat[39:42],
    )


@njit(cache=True)
def times_covariance(P: Floats, n: int, k: int, u: Update) -> None:
    """HP = H P by the rows of P that H reaches, which are few."""
    for a in range(k):
        out = u.HP[a, :n]
        out[:] = 0.0
        for j in range(n):
            h = u.H[a, j]
            if h != 0.0:
                row = P[j * STRIDE : j * STRIDE + n]
                for i in range(n):
                    out[i] += h * row[i]


@njit(cache=True)
def innovation_covariance(P: Floats, n: int, k: int, u: Update) -> float:
    """HP = H P, S = H P H' + R; the lower Cholesky factor replaces S; returns log det S.

    -1 times infinity when S is not positive definite.
    """
    times_covariance(P, n, k, u)
    for a in range(k):
        for b in range(a + 1):
            total = 0.5 * (u.R[a, b] + u.R[b, a])
            for j in range(n):
                total += 0.5 * (u.H[a, j] * u.HP[b, j] + u.H[b, j] * u.HP[a, j])
            u.S[a, b] = total
    logarithm = 0.0
    for a in range(k):
        for b in range(a + 1):
            total = u.S[a, b]
            for c in range(b):
                total -= u.S[a, c] * u.S[b, c]
            if a == b:
                if not total > 0.0:
                    return -math.inf
                u.S[a, a] = math.sqrt(total)
                logarithm += math.log(total)
            else:
                u.S[a, b] = total / u.S[b, b]
    return logarithm


@njit(cache=True)
def whiten(k: int, u: Update) -> float:
    """Innovation times the inverse Cholesky factor into ``white``; returns the NIS, y' S^-1 y."""
    nis = 0.0
    for a in range(k):
        total = u.y[a]
        for b in range(a):
            total -= u.S[a, b] * u.white[b]
        u.white[a] = total / u.S[a, a]
        nis += u.white[a] * u.white[a]
    return nis


@njit(cache=True)
def gain(n: int, k: int, u: Update) -> None:
    """K' = S^-1 H P by the Cholesky factor of S."""
    for a in range(k):
        row = u.K[a, :n]
        row[:] = u.HP[a, :n]
        for b in range(a):
            row -= u.S[a, b] * u.K[b, :n]
        row /= u.S[a, a]
    for a in range(k - 1, -1, -1):
        row = u.K[a, :n]
        for b in range(a + 1, k):
            row -= u.S[b, a] * u.K[b, :n]
        row /= u.S[a, a]


@njit(cache=True)
def subtract_product(P: Floats, A: Floats, B: Floats, n: int, k: int) -> None:
    """P <- P - A' B of (k, n) matrices."""
    for a in range(k):
        b = B[a, :n]
        for i in range(n):
            c = A[a, i]
            row = P[i * STRIDE : i * STRIDE + n]
            for j in range(n):
                row[j] -= c * b[j]


@njit(cache=True)
def symmetrise(P: Floats, n: int) -> None:
    """Make P symmetric to the last bit."""
    for i in range(n):
        for j in range(i):
            mean = 0.5 * (P[i * STRIDE + j] + P[j * STRIDE + i])
            P[i * STRIDE + j] = mean
            P[j * STRIDE + i] = mean


@njit(cache=True)
def joseph(P: Floats, n: int, k: int, u: Update) -> None:
    """P <- (I - K H) P (I - K H)' + K R K' with any K' in ``u``, symmetric to the last bit.

    As two products of rank k: A = P - K H P, then A - (A H' - K R) K'.
    """
    subtract_product(P, u.K, u.HP, n, k)
    for a in range(k):
        out = u.HP[a, :n]
        out[:] = 0.0
        for j in range(n):
            h = u.H[a, j]
            if h != 0.0:  # by columns: A is not symmetric
                for i in range(n):
                    out[i] += P[i * STRIDE + j] * h
        for b in range(k):
            for i in range(n):
                out[i] -= u.K[b, i] * u.R[b, a]
    subtract_product(P, u.HP, u.K, n, k)
    symmetrise(P, n)


@njit(cache=True)
def turn_tilt(s: Floats, m: int, psi: Floats) -> None:
    """P <- T P T' with T the turn of the attitude's states about the vertical by a correction.

    How the tilt is one with the accelerometer's bias is known by the body's axes: a correction of
    the heading takes those directions along.  Left as they were, a platform that departs from rest
    and finds its heading by a tenth of a radian would have measured one combination and believe
    another, and the fixes would seem to tell more than they do.
    """
    n, P = NAV + m, s[SLOW + m :]
    x, y, z = plumb_at(s[R], s[R + 1], s[R + 2])
    half = 0.5 * (psi[0] * x + psi[1] * y + psi[2] * z)
    k = math.sin(half)
    T = matrix_elements((math.cos(half), k * x, k * y, k * z))
    for j in range(n):
        a, b, c = P[6 * STRIDE + j], P[7 * STRIDE + j], P[8 * STRIDE + j]
        for i in range(3):
            P[(6 + i) * STRIDE + j] = T[3 * i] * a + T[3 * i + 1] * b + T[3 * i + 2] * c
    for i in range(6, 9):
        row = P[i * STRIDE : i * STRIDE + n]
        a, b, c = row[6], row[7], row[8]
        for j in range(3):
            row[6 + j] = T[3 * j] * a + T[3 * j + 1] * b + T[3 * j + 2] * c
    for i in range(6, 9):
        for j in range(n):
            if j < 6 or j > i:
                P[j * STRIDE + i] = P[i * STRIDE + j]


@njit(cache=True)
def turn_since(s: Floats, turn: Floats) -> float:
    """Vertical turn (3,) in e, rad, of the estimate since what P says of tilt was turned along.

    Returns its angle.
    """
    x, y, z = plumb_at(s[R], s[R + 1], s[R + 2])
    up = (-x, -y, -z)
    q, p = s[Q : Q + 4], s[TILT_AT : TILT_AT + 4]
    # q times the conjugate of p: its part about the vertical
    along = 0.0
    for i in range(3):
        a, b = 1 + (i + 1) % 3, 1 + (i + 2) % 3
        along += up[i] * (p[0] * q[1 + i] - q[0] * p[1 + i] - q[a] * p[b] + q[b] * p[a])
    w = q[0] * p[0] + q[1] * p[1] + q[2] * p[2] + q[3] * p[3]
    angle = 2.0 * math.atan2(along, w)
    for i in range(3):
        turn[i] = angle * up[i]
    return angle


@njit(cache=True)
def take_tilt_along(s: Floats, m: int) -> None:
    """Turn what P says of tilt as far as the estimate has turned about the vertical.

    Left until the turn is worth it: 0.1 mrad of a tilt of 5 mrad is a twentieth of what is known.
    """
    turn = np.empty(3)
    if abs(turn_since(s, turn)) < LEAST_TURN_RAD:
        return
    turn_tilt(s, m, turn)
    s[TILT_AT : TILT_AT + 4] = s[Q : Q + 4]


@njit(cache=True)
def shift_state(s: Floats, m: int, k: int, u: Update) -> None:
    """Add K y to the state of the hypothesis ``s``; what P says of tilt turns with the heading."""
    n = NAV + m
    x = np.zeros(n)
    for i in range(n):
        for a in range(k):
            x[i] += u.K[a, i] * u.y[a]
    for i in range(3):
        s[R + i] += x[i]
        s[V + i] += x[3 + i]
    rotate_left(s[Q : Q + 4], x[6], x[7], x[8])
    rotate_left(s[TILT_AT : TILT_AT + 4], x[6], x[7], x[8])
    turn_tilt(s, m, x[6:9])
    for i in range(m):
        s[SLOW + i] += x[NAV + i]


@njit(cache=True)
def keep_heading(s: Floats, k: int, u: Update) -> None:
    """Take the turn about the vertical out of the gain.

    At rest the heading is not observable, but every step that it is moved by turns the direction in
    which tilt and accelerometer bias cannot be told apart, and the accelerometer's noise lets a
    heading error act on the velocity: heading and tilt would become known from nothing (NEES of
    tilt 3.9 of 2 after 60 s with 0.1 rad of heading).  A gain that leaves the heading alone
    (Schmidt 1966) costs nothing there, and its covariance is true.
    """
    down = plumb_at(s[R], s[R + 1], s[R + 2])
    for a in range(k):
        along = down[0] * u.K[a, 6] + down[1] * u.K[a, 7] + down[2] * u.K[a, 8]
        for i in range(3):
            u.K[a, 6 + i] -= along * down[i]


@njit(cache=True)
def apply_correction(s: Floats, m: int, k: int, sees_heading: bool, u: Update) -> None:
    """Correct state and covariance of the hypothesis ``s`` by the prepared innovation."""
    gain(NAV + m, k, u)
    if not sees_heading:
        keep_heading(s, k, u)
    joseph(s[SLOW + m :], NAV + m, k, u)
    shift_state(s, m, k, u)
