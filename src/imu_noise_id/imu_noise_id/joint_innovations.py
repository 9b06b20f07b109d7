"""Innovations model of several outputs: x' = A x + K e, y = C x + e, refined by likelihood.

What is minimised is ln det of the innovations' covariance, which is -2/n ln likelihood of the
steady recursion (it starts from x = 0 and, where samples are missing, predicts without correcting).
Levenberg and Marquardt over all entries of A, C and K; the directions that only change the
coordinates of the state have no curvature, and the damping leaves them alone.
"""

from __future__ import annotations

import numpy as np

from imu_noise_id.compiled import njit
from imu_noise_id.recording import Floats, Mask

BLOCK = 1024
STEP = 1e-6


def maximise(
    values: Floats, observed: Mask, A: Floats, C: Floats, K: Floats, iterations: int = 12
) -> tuple[Floats, Floats, Floats, Floats]:
    """Refine A (s, s), C (d, s), K (s, d) on values (n, d); return them and the covariance (d, d).

    A start that is not stable and invertible is returned as it is.
    """
    shapes = (A.shape, C.shape, K.shape)
    free = np.concatenate([part.ravel() for part in (A, C, K)])
    covariance = _covariance(values, observed, free, shapes)
    if not free.size or not _admissible(free, shapes):
        return A, C, K, covariance
    damping = 1e-3
    for _ in range(iterations):
        gradient, curvature = _normal_equations(values, observed, free, shapes, covariance)
        size = np.diag(curvature)
        gain = 0.0
        while damping < 1e6:
            scale = damping * (size + 1e-3 * size.max())
            trial = free - np.linalg.solve(curvature + np.diag(scale), gradient)
            if _admissible(trial, shapes):
                reached = _covariance(values, observed, trial, shapes)
                gain = np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(reached)[1]
                if gain > 0.0:
                    break
            damping *= 8.0
        if gain <= 0.0:
            break
        free, covariance, damping = trial, reached, max(0.2 * damping, 1e-9)
        if gain * observed.sum() < 1e-3:
            break
    return (*_parts(free, shapes), covariance)


def _parts(free: Floats, shapes: tuple[tuple[int, ...], ...]) -> tuple[Floats, Floats, Floats]:
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
    A, C, K = np.split(free, ends[:-1])
    return A.reshape(shapes[0]), C.reshape(shapes[1]), K.reshape(shapes[2])


def _admissible(free: Floats, shapes: tuple[tuple[int, ...], ...]) -> bool:
    """Whether the model is stable and its inverse, the filter, too."""
    A, C, K = _parts(free, shapes)
    return all(np.max(np.abs(np.linalg.eigvals(M))) < 1.0 - 1e-9 for M in (A, A - K @ C))


def _covariance(
    values: Floats, observed: Mask, free: Floats, shapes: tuple[tuple[int, ...], ...]
) -> Floats:
    A, C, K = (part[None] for part in _parts(free, shapes))
    identity = np.eye(values.shape[1])
    return np.asarray(_moments(values, observed, A, C, K, identity)[0] / observed.sum())


def _normal_equations(
    values: Floats,
    observed: Mask,
    free: Floats,
    shapes: tuple[tuple[int, ...], ...],
    covariance: Floats,
) -> tuple[Floats, Floats]:
    """Gradient and Gauss-Newton matrix of half of n ln det, innovations whitened."""
    points = np.vstack((free, free + STEP * np.eye(free.size)))
    A, C, K = (np.stack(side) for side in zip(*(_parts(p, shapes) for p in points), strict=True))
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    _, moments = _moments(values, observed, A, C, K, whiten)
    return moments[0, 1:] / STEP, moments[1:, 1:] / STEP**2


@njit(cache=True, nogil=True)
def _moments(values, observed, A, C, K, whiten):  # type: ignore[no-untyped-def]
    """Sum of v v' of the first filter; products of its whitened v and the others' differences."""
    filters, order = A.shape[0], A.shape[1]
    outputs = values.shape[1]
    x = np.zeros((filters, order))
    u = np.zeros((filters, BLOCK * outputs))
    square, moments = np.zeros((outputs, outputs)), np.zeros((filters, filters))
    for begin in range(0, values.shape[0], BLOCK):
        y = values[begin : begin + BLOCK]
        seen = observed[begin : begin + BLOCK]
        used = y.shape[0] * outputs
        for i in range(filters):
            _run(y, seen, A[i], C[i], K[i], x[i], u[i])
        for k in range(y.shape[0]):
            for i in range(outputs):
                for j in range(outputs):
                    square[i, j] += u[0, k * outputs + i] * u[0, k * outputs + j]
        for i in range(filters):
            _whiten(u[i], y.shape[0], whiten)
        for i in range(1, filters):
            u[i, :used] -= u[0, :used]
        part = u[:, :used].copy()
        moments += part @ part.T
    return square, moments


@njit(cache=True, nogil=True)
def _run(y, seen, A, C, K, x, u):  # type: ignore[no-untyped-def]
    """Innovations of one block into u (outputs fastest), updating x."""
    order, outputs = A.shape[0], C.shape[0]
    new, v = np.zeros(order), np.zeros(outputs)
    for k in range(y.shape[0]):
        for i in range(outputs):
            total = y[k, i]
            for j in range(order):
                total -= C[i, j] * x[j]
            v[i] = total if seen[k] else 0.0
            u[k * outputs + i] = v[i]
        for i in range(order):
            total = 0.0
            for j in range(order):
                total += A[i, j] * x[j]
            for j in range(outputs):
                total += K[i, j] * v[j]
            new[i] = total
        x[:] = new


@njit(cache=True, nogil=True)
def _whiten(u, rows, whiten):  # type: ignore[no-untyped-def]
    """Multiply every row of innovations by a lower triangular matrix, in place."""
    outputs = whiten.shape[0]
    for k in range(rows):
        for i in range(outputs - 1, -1, -1):
            total = 0.0
            for j in range(i + 1):
                total += whiten[i, j] * u[k * outputs + j]
            u[k * outputs + i] = total
