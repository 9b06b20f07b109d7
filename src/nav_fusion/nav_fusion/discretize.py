"""Continuous noise models to steps: exactly, and as the thesis does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Step:
    """x <- F x + w over ``dt_s``, E[w w'] = Q."""

    F: Floats
    Q: Floats
    dt_s: float


def exact(A: Floats, spectrum: Floats, dt_s: float) -> Step:
    """x' = A x + u with white u of two-sided spectrum (n, n): F = e^{A dt} (Van Loan 1978).

    exp([-A S; 0 A'] dt) = [. F^-1 Q; 0 F'].
    """
    n = A.shape[0]
    block = np.zeros((2 * n, 2 * n))
    block[:n, :n], block[:n, n:], block[n:, n:] = -A, spectrum, A.T
    exponential = expm(block * dt_s)
    F = exponential[n:, n:].T
    Q = F @ exponential[:n, n:]
    return Step(F, 0.5 * (Q + Q.T), dt_s)


def first_order(A: Floats, spectrum: Floats, dt_s: float) -> Step:
    """F = I + A dt and Q = S dt: the thesis's, kept to be compared with."""
    return Step(np.eye(A.shape[0]) + A * dt_s, spectrum * dt_s, dt_s)


def repeated(step: Step, count: int) -> Step:
    """The same step ``count`` times, as one."""
    F, Q = np.eye(step.F.shape[0]), np.zeros_like(step.Q)
    for _ in range(count):
        F, Q = step.F @ F, step.F @ Q @ step.F.T + step.Q
    return Step(F, 0.5 * (Q + Q.T), count * step.dt_s)
