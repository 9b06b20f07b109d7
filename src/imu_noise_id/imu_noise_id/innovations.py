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

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imu_noise_id.compiled import njit
from imu_noise_id.recording import Floats, Mask
from imu_noise_id.transfer_function import stationary_covariance

BLOCK = 4096
LARGE = 1e100
SETTLED = 1e-10
"""Predicted state variance, in units of s^2, below which the steady recursion takes over."""
STEP = 1e-6
CLOSE = 1e-2
"""Gain in deviance at which the climb ends, a tenth of a standard error or less from the top."""
HOPELESS = 5.0
"""Steps as good as the next one that a climb with a goal may still be short of it."""
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
    seen = values if observed.all() else values[observed]
    count = seen.size
    variance = float(seen @ seen) / max(count, 1)
    deviance = count * np.log(max(variance, 1e-300))
    return Innovations(np.ones(1), np.ones(1), variance, deviance, count)


def evaluate(values: Floats, observed: Mask, phi: Floats, theta: Floats) -> Innovations:
    """Likelihood of a stable phi and a minimum-phase theta of one length, mean already removed."""
    return evaluate_all(values, observed, [(phi, theta)])[0]


def evaluate_all(
    values: Floats, observed: Mask, models: Sequence[tuple[Floats, Floats]]
) -> list[Innovations]:
    """Likelihoods of pairs of phi and theta of one order, side by side."""
    if not models:
        return []
    if models[0][0].size == 1:
        return [white(values, observed)] * len(models)
    phi, theta = (np.stack(side) for side in zip(*models, strict=True))
    moments, logarithm, count = _moments(values, observed, *_filters(phi, theta))
    squares = moments[0, 0] + 2.0 * moments[0] + np.diag(moments)
    squares[0] = moments[0, 0]  # the other rows are differences from the first
    return [
        _innovations(*model, float(squares[i]), float(logarithm[i]), int(count))
        for i, model in enumerate(models)
    ]


def _innovations(
    phi: Floats, theta: Floats, square: float, logarithm: float, count: int
) -> Innovations:
    """Model whose standardised innovations have that sum of squares, and sum of ln F."""
    variance = square / count
    if not np.isfinite(variance + logarithm):  # a record that no noise drives
        return Innovations(phi, theta, 0.0, np.inf, count)
    deviance = count * np.log(max(variance, 1e-300)) + logarithm
    return Innovations(phi, theta, variance, deviance, count)


def maximise(
    values: Floats,
    observed: Mask,
    start: Innovations,
    iterations: int = 15,
    reach: float = np.inf,
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
    reach : float
        Deviance that the climb is for: it ends where ``HOPELESS`` steps as good as the next one
        promises to be would not reach it.

    Returns
    -------
    Innovations
    """
    free = np.concatenate((_to_free(start.phi), _to_free(start.theta)))
    best = _climb(values, observed, free)
    damping = 1e-3
    for _ in range(iterations):
        improved = False
        if not np.all(np.isfinite(best.curvature)):
            break
        while damping < 1e8:
            scale = np.diag(best.curvature) + 1e-9 * np.trace(best.curvature) + 1e-12
            step = -np.linalg.solve(best.curvature + damping * np.diag(scale), best.gradient)
            if best.model.deviance + HOPELESS * float(best.gradient @ step) > reach:
                return best.model
            step *= min(1.0, 2.0 / max(float(np.max(np.abs(step))), 1e-300))
            trial = _climb(values, observed, np.clip(best.free + step, -LIMIT, LIMIT))
            if trial.model.deviance < best.model.deviance:
                improved = True
                break
            damping *= 8.0
        if not improved:
            break
        gain = best.model.deviance - trial.model.deviance
        best, damping = trial, max(damping * 0.2, 1e-9)
        if gain < CLOSE:
            break
    return best.model


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
    return phi[:, 1:].copy(), gain, np.pad(np.stack(start), ((0, 0), (0, 1), (0, 1)))


@dataclass(frozen=True)
class _Point:
    """A model, and gradient and Gauss-Newton matrix of half its deviance, by the free ones."""

    free: Floats
    model: Innovations
    gradient: Floats
    curvature: Floats


def _climb(values: Floats, observed: Mask, free: Floats) -> _Point:
    """Likelihood and its derivatives from filters at the point and a step away from it."""
    points = np.vstack((free, free + STEP * np.eye(free.size)))
    phi, theta = (np.stack(side) for side in zip(*(_from_free(p) for p in points), strict=True))
    moments, logarithm, count = _moments(values, observed, *_filters(phi, theta))
    square = float(moments[0, 0])
    model = _innovations(phi[0], theta[0], square, float(logarithm[0]), int(count))
    if not np.isfinite(model.deviance) or square == 0.0:
        nothing = np.full((free.size, free.size), np.nan)
        return _Point(free, model, nothing[0], nothing)
    slope = (logarithm[1:] - logarithm[0]) / (2.0 * count * STEP)
    cross = moments[0, 1:] / STEP
    inner = moments[1:, 1:] / STEP**2
    gradient = cross + slope * square
    curvature = inner + np.outer(slope, cross) + np.outer(cross, slope)
    curvature += np.outer(slope, slope) * square
    return _Point(free, model, gradient * count / square, curvature * count / square)


@njit(cache=True, nogil=True)
def _moments(values, observed, phi, gain, start):  # type: ignore[no-untyped-def]
    """Products of u of the first filter and of the others' differences from it; sum of ln F."""
    filters, order = phi.shape
    x, P = np.zeros((filters, order + 1)), start.copy()
    u = np.zeros((filters, BLOCK))
    moments, logarithm = np.zeros((filters, filters)), np.zeros(filters)
    count = 0
    for begin in range(0, values.size, BLOCK):
        y = values[begin : begin + BLOCK]
        seen = observed[begin : begin + BLOCK]
        for i in range(filters):
            logarithm[i] += _run(y, seen, phi[i], gain[i], x[i], P[i], u[i])
        u[:, y.size :] = 0.0
        for i in range(1, filters):
            for k in range(y.size):
                u[i, k] -= u[0, k]
        moments += u @ u.T
        count += seen.sum()
    return moments, logarithm, count


@njit(cache=True, nogil=True)
def _whiten(values, observed, phi, gain, start):  # type: ignore[no-untyped-def]
    """Standardised innovations of the first filter."""
    x, P, u = np.zeros(phi.shape[1] + 1), start[0].copy(), np.zeros(values.size)
    _run(values, observed, phi[0], gain[0], x, P, u)
    return u


@njit(cache=True, nogil=True)
def _run(y, seen, phi, gain, x, P, u):  # type: ignore[no-untyped-def]
    """Kalman filter over a block, updating x and P; standardised innovations in u, sum of ln F.

    x and P end in a row of zeros, the state behind the last one.
    """
    theta = phi + gain
    logarithm, k = 0.0, 0
    while k < y.size:
        if _largest(P) < SETTLED:
            k = _steady(y, seen, theta, gain, x, u, k)
        if k < y.size:
            k, more = _settling(y, seen, phi, gain, x, P, u, k)
            logarithm += more
    return logarithm


@njit(cache=True, nogil=True, fastmath={"contract"})
def _steady(y, seen, theta, gain, x, u, k):  # type: ignore[no-untyped-def]
    """Settled filter from sample k to the next one missing: x' = (A - K C) x + K y."""
    first = x[0]
    while k < y.size and seen[k]:
        u[k] = y[k] - first
        ahead = x[1] + gain[0] * y[k] - theta[0] * first
        for i in range(1, theta.size):
            x[i] = x[i + 1] + gain[i] * y[k] - theta[i] * first
        first = ahead
        k += 1
    x[0] = first
    return k


@njit(cache=True, nogil=True, fastmath={"contract"})
def _settling(y, seen, phi, gain, x, P, u, k):  # type: ignore[no-untyped-def]
    """Filter from sample k until its covariance has settled: the next sample, and sum of ln F.

    P = A P A' + gain gain' - b b'/F, b = A P C' + gain and A the companion of phi; b = 0 if not
    seen.  Of P the lower half is kept.
    """
    order = phi.size
    column, a, b = np.empty(order), np.empty(order), np.empty(order)
    logarithm, product = 0.0, 1.0
    unsettled = True
    while unsettled and k < y.size:
        first, F = x[0], P[0, 0] + 1.0
        inverse = 1.0 / F if seen[k] else 0.0
        v = y[k] - first if seen[k] else 0.0
        for i in range(order):
            column[i] = P[i + 1, 0]
            a[i] = column[i] - phi[i] * P[0, 0]
            b[i] = a[i] + gain[i]
            x[i] = x[i + 1] - phi[i] * first + b[i] * (v * inverse)
        for i in range(order):
            for j in range(i + 1):
                moved = P[i + 1, j + 1] - phi[j] * column[i] - phi[i] * a[j]
                P[i, j] = moved + gain[i] * gain[j] - b[i] * b[j] * inverse
        u[k] = v / np.sqrt(F)
        if seen[k]:
            product *= F
            if product > LARGE:  # a logarithm costs as much as all the rest
                logarithm += np.log(product)
                product = 1.0
        unsettled = _largest(P) >= SETTLED
        k += 1
    return k, logarithm + np.log(product)


@njit(cache=True, nogil=True)
def _largest(P):  # type: ignore[no-untyped-def]
    largest = 0.0
    for i in range(P.shape[0]):
        largest = max(largest, P[i, i])
    return largest
