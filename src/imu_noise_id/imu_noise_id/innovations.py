"""Exact likelihood of a first to few order innovations model, right across gaps, and its maximum.

    y_k + phi_1 y_{k-1} + ... = e_k + theta_1 e_{k-1} + ...,   e white with variance s^2

in state space x' = A x + K e, y = C x + e (A the companion of phi, C = [1 0 ...],
K = theta - phi).  The Kalman filter of that form starts from the stationary covariance and settles
on the steady recursion, leaves it where samples are missing and comes back: the likelihood is
exact.  s^2 is concentrated out; what is minimised is ln(mean u^2) + mean ln F with the innovations
v = u sqrt(F), a sum of squares, by Levenberg and Marquardt with derivatives from filters run side
by side.  The free parameters are the atanh of the partial autocorrelations of phi and of theta
(Monahan 1984), so that every step is stable and minimum phase and slow poles are steps in ln T_c.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from imu_noise_id.recording import Floats, Mask
from imu_noise_id.transfer_function import stationary_covariance

BLOCK = 4096
SETTLED = 1e-10
"""Predicted state variance, in units of s^2, below which the steady recursion takes over."""
STEP = 1e-6
CLOSE = 1e-2
"""Gain in deviance at which the climb ends, a tenth of a standard error or less from the top."""
LIMIT = 9.0
"""Largest free parameter: a memory of 3e7 samples."""


@dataclass(frozen=True)
class Innovations:
    """phi(z) y = theta(z) e, both polynomials beginning with 1, and the variance of e.

    ``deviance`` is -2 ln likelihood up to a constant; ``observed`` samples entered it.
    """

    phi: Floats
    theta: Floats
    variance: float
    deviance: float
    observed: int

    @property
    def order(self) -> int:
        """Number of states."""
        return self.phi.size - 1


def white(values: Floats, observed: Mask) -> Innovations:
    """Return the model of order zero."""
    count = int(observed.sum())
    variance = float(np.mean(values[observed] ** 2))
    deviance = count * np.log(max(variance, 1e-300))
    return Innovations(np.ones(1), np.ones(1), variance, deviance, count)


def evaluate(values: Floats, observed: Mask, phi: Floats, theta: Floats) -> Innovations:
    """Likelihood of a stable phi and a minimum-phase theta of one length, mean already removed."""
    if phi.size == 1:
        return white(values, observed)
    moments, logarithm, count = _moments(values, observed, *_filters(phi[None], theta[None]))
    variance = moments[0, 0] / count
    if not np.isfinite(variance + logarithm[0]):  # a record that no noise drives
        return Innovations(phi, theta, 0.0, np.inf, int(count))
    deviance = count * np.log(max(variance, 1e-300)) + logarithm[0]
    return Innovations(phi, theta, float(variance), float(deviance), int(count))


def maximise(
    values: Floats, observed: Mask, start: Innovations, iterations: int = 15
) -> Innovations:
    """Climb to the maximum of the likelihood from a start of the same order.

    Parameters
    ----------
    values : (n,) float64
        Mean removed; anything where not observed.
    observed : (n,) bool
    start : Innovations
        Its phi and theta; roots outside the unit circle are reflected.
    iterations : int

    Returns
    -------
    Innovations
    """
    free = np.concatenate((_to_free(start.phi), _to_free(start.theta)))
    best = evaluate(values, observed, *_from_free(free))
    damping = 1e-3
    for _ in range(iterations):
        gradient, curvature = _normal_equations(values, observed, free)
        improved = False
        if not np.all(np.isfinite(curvature)):
            break
        while damping < 1e8:
            scale = np.diag(curvature) + 1e-9 * np.trace(curvature) + 1e-12
            step = -np.linalg.solve(curvature + damping * np.diag(scale), gradient)
            step *= min(1.0, 2.0 / max(float(np.max(np.abs(step))), 1e-300))
            trial = np.clip(free + step, -LIMIT, LIMIT)
            model = evaluate(values, observed, *_from_free(trial))
            if model.deviance < best.deviance:
                improved = True
                break
            damping *= 8.0
        if not improved:
            break
        gain = best.deviance - model.deviance
        free, best, damping = trial, model, max(damping * 0.2, 1e-9)
        if gain < CLOSE:
            break
    return best


def residuals(values: Floats, observed: Mask, model: Innovations) -> Floats:
    """Innovations of a model, zero where not observed, shape (n,)."""
    if model.order == 0:
        return np.where(observed, values, 0.0)
    return np.asarray(_whiten(values, observed, *_filters(model.phi[None], model.theta[None])))


def warm_up() -> None:
    """Compile the kernels into numba's cache, for a build to call."""
    values, observed = np.sin(np.arange(100.0)), np.arange(100) % 9 != 0
    start = Innovations(np.array([1.0, -0.5]), np.array([1.0, 0.1]), 1.0, 0.0, 100)
    residuals(values, observed, maximise(values, observed, start, 1))


def stable(polynomial: Floats) -> Floats:
    """Reflect the roots outside the unit circle into it; begins with 1."""
    roots = np.roots(polynomial).astype(complex)
    outside = np.abs(roots) > 1.0
    roots[outside] = 1.0 / np.conj(roots[outside])
    return np.real(np.poly(roots)) if roots.size else np.ones(1)


def admissible(polynomial: Floats) -> Floats:
    """Nearest polynomial whose roots lie well enough within the unit circle to be filtered by."""
    return _polynomial(_to_free(polynomial))


def _companion(phi: Floats) -> Floats:
    A = np.eye(phi.size - 1, k=1)
    A[:, 0] = -phi[1:]
    return A


def _to_free(polynomial: Floats) -> Floats:
    """Atanh of the partial autocorrelations (Levinson's recursion backwards)."""
    a = stable(polynomial)[1:]
    partial = np.zeros(a.size)
    for k in range(a.size, 0, -1):
        r = np.clip(a[k - 1], -np.tanh(LIMIT), np.tanh(LIMIT))
        partial[k - 1] = r
        head = a[: k - 1]
        a = (head - r * head[::-1]) / (1.0 - r * r)
    return np.arctanh(partial)


def _from_free(free: Floats) -> tuple[Floats, Floats]:
    """Return phi and theta."""
    half = free.size // 2
    return _polynomial(free[:half]), _polynomial(free[half:])


def _polynomial(free: Floats) -> Floats:
    a = np.zeros(0)
    for r in np.tanh(free):
        a = np.append(a + r * a[::-1], r)
    return np.append(1.0, a)


def _filters(phi: Floats, theta: Floats) -> tuple[Floats, Floats, Floats]:
    """phi, gain and initial covariance of filters to run side by side."""
    gain = (theta - phi)[:, 1:].copy()
    start = [
        stationary_covariance(_companion(a), np.outer(k, k)) for a, k in zip(phi, gain, strict=True)
    ]
    return phi[:, 1:].copy(), gain, np.stack(start)


def _normal_equations(values: Floats, observed: Mask, free: Floats) -> tuple[Floats, Floats]:
    """Gradient and Gauss-Newton matrix of half the deviance."""
    points = np.vstack((free, free + STEP * np.eye(free.size)))
    phi, theta = (np.stack(side) for side in zip(*(_from_free(p) for p in points), strict=True))
    moments, logarithm, count = _moments(values, observed, *_filters(phi, theta))
    slope = (logarithm[1:] - logarithm[0]) / (2.0 * count * STEP)
    square = moments[0, 0]
    cross = moments[0, 1:] / STEP
    inner = moments[1:, 1:] / STEP**2
    gradient = cross + slope * square
    curvature = inner + np.outer(slope, cross) + np.outer(cross, slope)
    curvature += np.outer(slope, slope) * square
    return gradient * count / square, curvature * count / square


@numba.njit(cache=True)
def _moments(values, observed, phi, gain, start):  # type: ignore[no-untyped-def]
    """Products of u of the first filter and of the others' differences from it; sum of ln F."""
    filters, order = phi.shape
    x, P = np.zeros((filters, order)), start.copy()
    scratch = np.zeros(2 * order)
    u = np.zeros((filters, BLOCK))
    moments, logarithm = np.zeros((filters, filters)), np.zeros(filters)
    count = 0
    for begin in range(0, values.size, BLOCK):
        y = values[begin : begin + BLOCK]
        seen = observed[begin : begin + BLOCK]
        for i in range(filters):
            logarithm[i] += _run(y, seen, phi[i], gain[i], x[i], P[i], scratch, u[i])
        part = u[:, : y.size].copy()
        part[1:] -= part[0]
        moments += part @ part.T
        count += seen.sum()
    return moments, logarithm, count


@numba.njit(cache=True)
def _whiten(values, observed, phi, gain, start):  # type: ignore[no-untyped-def]
    """Standardised innovations of the first filter."""
    order = phi.shape[1]
    x, P, scratch = np.zeros(order), start[0].copy(), np.zeros(2 * order)
    u = np.zeros(values.size)
    _run(values, observed, phi[0], gain[0], x, P, scratch, u)
    return u


@numba.njit(cache=True)
def _run(y, seen, phi, gain, x, P, scratch, u):  # type: ignore[no-untyped-def]
    """Kalman filter over a block, updating x and P; standardised innovations in u."""
    order = phi.size
    logarithm = 0.0
    steady = _largest(P) < SETTLED
    for k in range(y.size):
        first = x[0]
        v = y[k] - first if seen[k] else 0.0
        if steady and seen[k]:
            for i in range(order - 1):
                x[i] = x[i + 1] - phi[i] * first + gain[i] * v
            x[order - 1] = gain[order - 1] * v - phi[order - 1] * first
            u[k] = v
            continue
        F = P[0, 0] + 1.0
        K = scratch[:order]
        for i in range(order):
            ahead = P[i + 1, 0] if i + 1 < order else 0.0
            K[i] = (ahead - phi[i] * P[0, 0] + gain[i]) / F if seen[k] else 0.0
        for i in range(order):
            ahead = x[i + 1] if i + 1 < order else 0.0
            x[i] = ahead - phi[i] * first + K[i] * v
        _propagate(phi, gain, K, F, P)
        steady = _largest(P) < SETTLED
        if seen[k]:
            logarithm += np.log(F)
            u[k] = v / np.sqrt(F)
        else:
            u[k] = 0.0
    return logarithm


@numba.njit(cache=True)
def _propagate(phi, gain, K, F, P):  # type: ignore[no-untyped-def]
    """P = A P A' + gain gain' - K F K', A the companion of phi."""
    order = phi.size
    new = np.empty((order, order))
    for i in range(order):
        for j in range(order):
            both = P[i + 1, j + 1] if i + 1 < order and j + 1 < order else 0.0
            left = P[i + 1, 0] if i + 1 < order else 0.0
            right = P[0, j + 1] if j + 1 < order else 0.0
            new[i, j] = both - phi[j] * left - phi[i] * right + phi[i] * phi[j] * P[0, 0]
            new[i, j] += gain[i] * gain[j] - K[i] * F * K[j]
    P[:] = new


@numba.njit(cache=True)
def _largest(P):  # type: ignore[no-untyped-def]
    largest = 0.0
    for i in range(P.shape[0]):
        largest = max(largest, P[i, i])
    return largest
