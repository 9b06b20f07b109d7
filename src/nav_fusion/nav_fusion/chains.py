"""Chapter 6: accelerometer with GNSS to position and velocity, gyro with magnetometer to heading.

From transfer functions, as the thesis has them, or from identified noise (``nav_fusion.noise``).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_fusion.discretize import Step, exact
from nav_fusion.noise import AidNoise, AxisNoise
from nav_fusion.schedule import Chain
from nav_fusion.state import UNSEEN, rows_of

Floats = NDArray[np.float64]
Discretisation = Callable[[Floats, Floats, float], Step]

STANDARD_GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True)
class SampledModel:
    """H(z) = (a0 + a1 z^-1)/(b0 + b1 z^-1) on white noise of unit variance a sample."""

    a0: float
    a1: float
    b0: float
    b1: float
    sample_time_s: float

    @property
    def pole(self) -> float:
        """-b1/b0."""
        return -self.b1 / self.b0

    def continuous(self) -> tuple[float, float, float]:
        """(n1, n0, p) of (n1 s + n0)/(s + p) by Tustin's rule (thesis (70)-(79))."""
        k = 2.0 / self.sample_time_s
        below = self.b0 - self.b1
        return (
            (self.a0 - self.a1) / below,
            k * (self.a0 + self.a1) / below,
            k * (self.b0 + self.b1) / below,
        )


@dataclass(frozen=True)
class ContinuousModel:
    """H(s) = n1 + c/(s + p) on white noise of spectrum ``sample_time_s``."""

    n1: float
    n0: float
    p: float
    sample_time_s: float

    @property
    def c(self) -> float:
        """n0 - n1 p."""
        return self.n0 - self.n1 * self.p


def position_chain(
    sensor: ContinuousModel,
    aid: SampledModel,
    discretisation: Discretisation = exact,
    fast_rate_hz: float = 1000.0,
    initial_error_m: float = 5.0,
    scale: float = STANDARD_GRAVITY_M_S2,
) -> Chain:
    """x = [position, velocity, x1, x2]: an accelerometer (in g) with a position aid in metres."""
    A = np.zeros((4, 4))
    A[0, 1] = 1.0
    A[1, 2] = scale * sensor.c
    A[2, 2] = -sensor.p
    B = np.array([0.0, scale * sensor.n1, 1.0, 0.0])
    P0 = np.diag([initial_error_m**2, 0.0, _stationary(sensor), 0.0])
    return _chain(
        A,
        B,
        sensor,
        aid,
        discretisation,
        fast_rate_hz,
        P0,
        ("position", "velocity", "sensor", "aid"),
    )


def heading_chain(
    sensor: ContinuousModel,
    aid: SampledModel,
    discretisation: Discretisation = exact,
    fast_rate_hz: float = 1000.0,
    initial_error: float = math.radians(5.0),
    scale: float = math.radians(1.0),
) -> Chain:
    """x = [heading, x1, x2]: a gyro (in deg/s, ``scale`` to rad/s) with a heading aid in rad."""
    A = np.zeros((3, 3))
    A[0, 1] = scale * sensor.c
    A[1, 1] = -sensor.p
    B = np.array([scale * sensor.n1, 1.0, 0.0])
    P0 = np.diag([initial_error**2, _stationary(sensor), 0.0])
    return _chain(A, B, sensor, aid, discretisation, fast_rate_hz, P0, ("heading", "sensor", "aid"))


def _stationary(sensor: ContinuousModel) -> float:
    return sensor.sample_time_s / (2.0 * sensor.p)


def _chain(
    A: Floats,
    B: Floats,
    sensor: ContinuousModel,
    aid: SampledModel,
    discretisation: Discretisation,
    fast_rate_hz: float,
    P0: Floats,
    names: tuple[str, ...],
) -> Chain:
    """Join an inertial model with an aid at its own rate.

    The aid's error is d w_k + h s_k, s_{k+1} = phi s_k + w_k with d = a0/b0 and
    h = a1/b0 + d phi: its state moves by the input that the measurement shows.
    """
    n = A.shape[0]
    spectrum = np.outer(B, B) * sensor.sample_time_s
    step = discretisation(A, spectrum, 1.0 / fast_rate_hz)
    phi, d = aid.pole, aid.a0 / aid.b0
    H = np.zeros((1, n))
    H[0, 0], H[0, -1] = 1.0, aid.a1 / aid.b0 + d * phi
    aid_F, aid_Q, M = np.eye(n), np.zeros((n, n)), np.zeros((n, 1))
    aid_F[-1, -1], aid_Q[-1, -1], M[-1, 0] = phi, 1.0, d
    P0[-1, -1] = 1.0 / (1.0 - phi * phi)
    ratio = round(aid.sample_time_s * fast_rate_hz)
    return Chain(step, ratio, H, np.array([[d * d]]), aid_F, aid_Q, M, P0, names)


def identified_chain(
    axis: AxisNoise,
    aid: AidNoise,
    integrations: int,
    initial_error: float,
    rate_hz: float = 1000.0,
    aid_rate_hz: float = 10.0,
    discretisation: Discretisation = exact,
) -> Chain:
    """Chain of identified noises: ``integrations`` 2 for position by acceleration, 1 for heading.

    States: the integrals, the sensor's slow terms, the aid's slow terms.
    """
    own = [row for term in axis.terms for row in rows_of(0, term)]
    rows = own + [row for term in aid.terms for row in rows_of(1, term)]
    n = integrations + len(rows)
    A, spectrum = np.zeros((n, n)), np.zeros((n, n))
    if integrations == 2:
        A[0, 1] = 1.0
    last = integrations - 1
    spectrum[last, last] = axis.white_density**2
    H = np.zeros((1, n))
    H[0, 0] = 1.0
    P0 = np.zeros((n, n))
    P0[0, 0] = initial_error**2
    for k, (target, rate, psd, variance, spin, _) in enumerate(rows, start=integrations):
        A[k, k], spectrum[k, k], P0[k, k] = -rate, psd, variance
        if spin != 0.0:
            A[k, k + 1], A[k + 1, k] = -spin, spin
        if target == 0:
            A[last, k] = 1.0
        elif target != UNSEEN:
            H[0, k] = 1.0
    step = discretisation(A, spectrum, 1.0 / rate_hz)
    names = ("position", "velocity") if integrations == 2 else ("heading",)
    return Chain(
        step,
        round(rate_hz / aid_rate_hz),
        H,
        np.array([[aid.white_sigma**2]]),
        np.eye(n),
        np.zeros((n, n)),
        np.zeros((n, 1)),
        P0,
        names + tuple(row[5] for row in rows),
    )
