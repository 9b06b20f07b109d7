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
CLOSE = 1e-2
"""Gain in deviance at which the refinement ends."""
EDGE = 1.0 - 1e-9
"""Largest modulus of a pole or zero."""


def maximise(
    values: Floats, observed: Mask, A: Floats, C: Floats, K: Floats, iterations: int = 12
) -> tuple[Floats, Floats, Floats, Floats]:
    """Refine A (s, s), C (d, s), K (s, d) on values (n, d); return them and the covariance (d, d).

    A start that is not stable and invertible is returned as it is.
    """
    shapes = (A.shape, C.shape, K.shape)
    free = np.concatenate([part.ravel() for part in (A, C, K)])
    covariance = _covariance(values, observed, free, shapes)
    if not free.size or not stable_both_ways(*_parts(free, shapes)):
        return A, C, K, covariance
    damping = 1e-3
    for _ in range(iterations):
        gradient, curvature = _normal_equations(values, observed, free, shapes, covariance)
        size = np.diag(curvature)
        gain = 0.0
        while damping < 1e6:
            scale = damping * (size + 1e-3 * size.max())
            trial = free - np.linalg.solve(curvature + np.diag(scale), gradient)
            trial = _remembering(trial, shapes, 1.0 - 1.0 / observed.sum())
            if stable_both_ways(*_parts(trial, shapes)):
                reached = _covariance(values, observed, trial, shapes)
                gain = np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(reached)[1]
                if gain > 0.0:
                    break
            damping *= 8.0
        if gain <= 0.0:
            break
        free, covariance, damping = trial, reached, max(0.2 * damping, 1e-9)
        if gain * observed.sum() < CLOSE:
            break
    return (*_parts(free, shapes), covariance)


def residuals(values: Floats, observed: Mask, A: Floats, C: Floats, K: Floats) -> Floats:
    """Innovations of a model, zero where not observed, shape (n, d)."""
    u, x, new = np.empty((*values.shape, 1)), np.zeros((A.shape[0], 1)), np.zeros((A.shape[0], 1))
    _run(values, observed, A[..., None], C[..., None], K[..., None], x, new, u)
    return u[..., 0]


def stable_both_ways(A: Floats, C: Floats, K: Floats) -> bool:
    """Whether the model is stable and its inverse, the filter, too."""
    return all(np.max(np.abs(np.linalg.eigvals(M)), initial=0.0) < EDGE for M in (A, A - K @ C))


def _parts(free: Floats, shapes: tuple[tuple[int, ...], ...]) -> tuple[Floats, Floats, Floats]:
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
    A, C, K = np.split(free, ends[:-1])
    return A.reshape(shapes[0]), C.reshape(shapes[1]), K.reshape(shapes[2])


def _remembering(free: Floats, shapes: tuple[tuple[int, ...], ...], most: float) -> Floats:
    """Parameters with no pole beyond a modulus.

    The recursion starts from x = 0: nothing in it holds a memory longer than the record, nor the
    variance that goes with it.
    """
    A, C, K = _parts(free, shapes)
    poles, vectors = np.linalg.eig(A)
    size = np.abs(poles)
    if np.all(size <= most) or np.linalg.cond(vectors) > 1e12:
        return free
    poles = poles * np.minimum(1.0, most / np.maximum(size, most))
    A = np.real(vectors @ np.diag(poles) @ np.linalg.inv(vectors))
    return np.concatenate([part.ravel() for part in (A, C, K)])


def _covariance(
    values: Floats, observed: Mask, free: Floats, shapes: tuple[tuple[int, ...], ...]
) -> Floats:
    A, C, K = (part[..., None] for part in _parts(free, shapes))
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
    parts = [_parts(point, shapes) for point in points]
    A, C, K = (np.stack(side, axis=-1) for side in zip(*parts, strict=True))
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    _, moments = _moments(values, observed, A, C, K, whiten)
    return moments[0, 1:] / STEP, moments[1:, 1:] / STEP**2


@njit(cache=True, nogil=True)
def _moments(values, observed, A, C, K, whiten):  # type: ignore[no-untyped-def]
    """Sum of v v' of the first filter; products of its whitened v and the others' differences."""
    order, outputs, filters = K.shape
    x, new = np.zeros((order, filters)), np.zeros((order, filters))
    u = np.zeros((BLOCK, outputs, filters))
    square, moments = np.zeros((outputs, outputs)), np.zeros((filters, filters))
    for begin in range(0, values.shape[0], BLOCK):
        y = values[begin : begin + BLOCK]
        rows = y.shape[0]
        _run(y, observed[begin : begin + BLOCK], A, C, K, x, new, u)
        for k in range(rows):
            for i in range(outputs):
                for j in range(outputs):
                    square[i, j] += u[k, i, 0] * u[k, j, 0]
        _whiten(u[:rows], whiten)
        part = u[:rows].reshape(rows * outputs, filters)
        for k in range(rows * outputs):
            for f in range(1, filters):
                part[k, f] -= part[k, 0]
        moments += part.T @ part
    return square, moments


@njit(cache=True, nogil=True)
def _run(y, seen, A, C, K, x, new, u):  # type: ignore[no-untyped-def]
    """Innovations of filters side by side into u, updating x; filters are innermost everywhere."""
    for k in range(y.shape[0]):
        v = u[k]
        v[:] = 0.0
        if seen[k]:
            for i in range(v.shape[0]):
                v[i] += y[k, i]
            _add(v, C, x, -1.0)
        new[:] = 0.0
        _add(new, A, x, 1.0)
        _add(new, K, v, 1.0)
        x[:] = new


@njit(cache=True, nogil=True)
def _add(total, matrices, vectors, sign):  # type: ignore[no-untyped-def]
    """Add sign times one matrix times one vector for each filter."""
    rows, columns, filters = matrices.shape
    for i in range(rows):
        for j in range(columns):
            for f in range(filters):
                total[i, f] += sign * matrices[i, j, f] * vectors[j, f]


@njit(cache=True, nogil=True)
def _whiten(u, whiten):  # type: ignore[no-untyped-def]
    """Multiply every row of innovations by a lower triangular matrix, in place."""
    rows, outputs, filters = u.shape
    for k in range(rows):
        for i in range(outputs - 1, -1, -1):
            for f in range(filters):
                u[k, i, f] *= whiten[i, i]
            for j in range(i):
                for f in range(filters):
                    u[k, i, f] += whiten[i, j] * u[k, j, f]
