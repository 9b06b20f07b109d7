"""Discrete and continuous transfer functions: Tustin, poles, zeros, step response, bandwidth.

A discrete one is (a0 + a1 z^-1 + ...)/(b0 + b1 z^-1 + ...), a continuous one has descending powers
of s and a denominator that begins with 1.  Tustin's substitution s = (2/Ts)(1 - z^-1)/(1 + z^-1)
takes one to the other (Alkan 2021, eqs. 70 to 79); at frequency omega the discrete response is the
continuous one at Omega = (2/Ts) tan(omega Ts/2).

Step response: y(t) of H(s) from its value just after the step, D, to H(0).  *Settling* is the last
time outside 2 % of that change (first order: ln 50/p), *rise* is from 10 to 90 % of it (ln 9/p).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from imu_noise_id.compiled import njit
from imu_noise_id.recording import Floats

Complexes = NDArray[np.complex128]

SETTLED = 0.02
"""Part of the step's change within which the response counts as settled."""


@dataclass(frozen=True)
class DiscreteTransfer:
    """H(z) = (a0 + a1 z^-1 + ...)/(b0 + b1 z^-1 + ...)."""

    numerator: Floats
    denominator: Floats
    sample_time_s: float

    @property
    def poles(self) -> Complexes:
        """Poles in z, as many as the order."""
        return _roots(_same_length(self.denominator, self.numerator))

    @property
    def zeros(self) -> Complexes:
        """Zeros in z, as many as the order."""
        return _roots(_same_length(self.numerator, self.denominator))

    @property
    def stable(self) -> bool:
        """Whether every pole lies within the unit circle."""
        return bool(np.all(np.abs(self.poles) < 1.0))

    @property
    def minimum_phase(self) -> bool:
        """Whether every zero lies within the unit circle."""
        return bool(np.all(np.abs(self.zeros) < 1.0))


@dataclass(frozen=True)
class ContinuousTransfer:
    """H(s) with descending powers of s; the denominator begins with 1."""

    numerator: Floats
    denominator: Floats

    @property
    def poles(self) -> Complexes:
        """Poles in rad/s."""
        return _roots(self.denominator)

    @property
    def zeros(self) -> Complexes:
        """Zeros in rad/s; those at infinity are left out."""
        return _roots(self.numerator)

    @property
    def stable(self) -> bool:
        """Whether every pole lies in the left half plane."""
        return bool(np.all(self.poles.real < 0.0))

    @property
    def minimum_phase(self) -> bool:
        """Whether every finite zero lies in the left half plane."""
        return bool(np.all(self.zeros.real < 0.0))


def to_continuous(transfer: DiscreteTransfer) -> ContinuousTransfer:
    """Tustin: sum a_k z^-k (1 + s Ts/2)^n = sum a_k (1 - s Ts/2)^k (1 + s Ts/2)^(n-k).

    First order: n1 = (a0 - a1)/(b0 - b1), n0 = k (a0 + a1)/(b0 - b1), p = k (b0 + b1)/(b0 - b1)
    with k = 2/Ts.

    Raises
    ------
    ValueError
        When the denominator is zero.
    """
    order = max(transfer.numerator.size, transfer.denominator.size) - 1
    half = 2.0 / transfer.sample_time_s
    numerator = _substitute(transfer.numerator, order, half)
    denominator = _substitute(transfer.denominator, order, half)
    return _monic(numerator, denominator)


def to_discrete(transfer: ContinuousTransfer, sample_time_s: float) -> DiscreteTransfer:
    """Tustin backwards; the denominator begins with 1."""
    order = max(transfer.numerator.size, transfer.denominator.size) - 1
    scaled = [
        _padded(side, order) * (2.0 / sample_time_s) ** np.arange(order, -1, -1.0)
        for side in (transfer.numerator, transfer.denominator)
    ]
    # s^(n-k) becomes (1 - x)^(n-k) (1 + x)^k with x = z^-1: ascending powers of x
    numerator, denominator = (_substitute(side[::-1], order, 1.0)[::-1] for side in scaled)
    return DiscreteTransfer(numerator / denominator[0], denominator / denominator[0], sample_time_s)


def frequency_response(
    transfer: DiscreteTransfer | ContinuousTransfer, frequency_hz: Floats
) -> Complexes:
    """H(e^{j omega Ts}) or H(j omega), for a Bode diagram, shape of ``frequency_hz``."""
    omega = 2.0 * np.pi * np.asarray(frequency_hz, dtype=np.float64)
    if isinstance(transfer, DiscreteTransfer):
        delay = np.exp(-1j * omega * transfer.sample_time_s)
        numerator, denominator = transfer.numerator[::-1], transfer.denominator[::-1]
    else:
        delay = 1j * omega
        numerator, denominator = transfer.numerator, transfer.denominator
    return np.asarray(np.polyval(numerator, delay) / np.polyval(denominator, delay))


def drive(transfer: DiscreteTransfer, samples: Floats) -> Floats:
    """Output of H(z) for the given input, at rest before it, shape (n,)."""
    lead = transfer.denominator[0]
    numerator = _same_length(transfer.numerator, transfer.denominator) / lead
    denominator = _same_length(transfer.denominator, transfer.numerator) / lead
    return np.asarray(_recursion(numerator, denominator, np.asarray(samples, dtype=np.float64)))


def warm_up() -> None:
    """Compile the recursion into numba's cache, for a build to call."""
    drive(DiscreteTransfer(np.ones(1), np.array([1.0, -0.5]), 1.0), np.ones(3))


@njit(cache=True, nogil=True)
def _recursion(b, a, samples):  # type: ignore[no-untyped-def]
    """Transposed direct form, a[0] = 1; scipy.signal has it but takes a second to import."""
    order = a.size - 1
    state, out = np.zeros(order + 1), np.empty(samples.size)
    for k in range(samples.size):
        out[k] = b[0] * samples[k] + state[0]
        for i in range(order):
            state[i] = b[i + 1] * samples[k] + state[i + 1] - a[i + 1] * out[k]
    return out


def output_sigma(transfer: DiscreteTransfer) -> float | None:
    """Stationary standard deviation of the output for unit white input; None when unstable."""
    if not transfer.stable:
        return None
    order = max(transfer.numerator.size, transfer.denominator.size) - 1
    b = _padded_behind(transfer.numerator, order) / transfer.denominator[0]
    a = _padded_behind(transfer.denominator, order) / transfer.denominator[0]
    if order == 0:
        return float(abs(b[0]))
    A = np.eye(order, k=1)
    A[:, 0] = -a[1:]
    B = (b[1:] - a[1:] * b[0])[:, None]
    P = stationary_covariance(A, B @ B.T)
    sigma = float(np.sqrt(P[0, 0] + b[0] ** 2))
    return sigma if np.isfinite(sigma) else None


def stationary_covariance(A: Floats, Q: Floats) -> Floats:
    """Solve P = A P A' + Q for a stable A by doubling, which poles next to 1 do not upset.

    Infinite throughout where a pole is 1 to double precision, so that there is no such P.
    """
    P, power = Q, A
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(64):
            step = power @ P @ power.T
            P, power = P + step, power @ power
            if not np.isfinite(P).all():
                return np.full_like(P, np.inf)
            if np.abs(step).max(initial=0.0) <= 1e-15 * np.abs(P).max(initial=0.0):
                break
    return P


def random_walk(transfer: DiscreteTransfer) -> float | None:
    """Density |H(1)| sqrt(Ts) of the output at low frequency for unit white input.

    None for a pole at z = 1.
    """
    below = transfer.denominator.sum()
    if below == 0.0:
        return None
    return float(abs(transfer.numerator.sum() / below) * np.sqrt(transfer.sample_time_s))


def step_response(transfer: ContinuousTransfer, time_s: Floats) -> Floats:
    """Response of a stable H(s) to the unit step at the given times, shape of ``time_s``."""
    return _final(transfer) + _transient(transfer)(np.asarray(time_s, dtype=np.float64))


def settling_time_s(transfer: ContinuousTransfer) -> float | None:
    """Last time outside 2 % of the step's change; None when unstable, 0 when it never leaves."""
    return _last_crossing(transfer, SETTLED)


def rise_time_s(transfer: ContinuousTransfer) -> float | None:
    """Time from 10 to 90 % of the step's change (first passages); None without a change."""
    grid = _grid(transfer)
    if grid is None:
        return None
    transient = _transient(transfer)
    change = -transient(np.zeros(1))[0]
    if abs(change) <= 1e-12 * max(abs(_final(transfer)), 1e-300):
        return None

    def done(t: Floats) -> Floats:
        return 1.0 + transient(t) / change

    passages = [_bisect(lambda t, at=at: done(t) - at, grid, first=True) for at in (0.1, 0.9)]
    return None if None in passages else float(passages[1] - passages[0])  # type: ignore[operator]


def bandwidth_3db_hz(transfer: ContinuousTransfer) -> float | None:
    """Lowest frequency at which |H| falls through |H(0)|/sqrt(2); None when it never does."""
    gain = _final(transfer)
    if not np.isfinite(gain) or gain == 0.0:
        return None
    above = np.polysub(_squared(transfer.numerator), 0.5 * gain**2 * _squared(transfer.denominator))
    roots = np.roots(above)
    real = np.abs(roots.imag) <= 1e-9 * np.abs(roots)
    squares = np.sort(roots.real[real & (roots.real > 0)])
    falling = [w for w in squares if np.polyval(np.polyder(above), w) < 0.0]
    return float(np.sqrt(falling[0]) / (2.0 * np.pi)) if falling else None


def _final(transfer: ContinuousTransfer) -> float:
    below = transfer.denominator[-1]
    return float(transfer.numerator[-1] / below) if below != 0.0 else np.inf


def _transient(transfer: ContinuousTransfer) -> Callable[[Floats], Floats]:
    """y(t) - y(inf) = C A^-1 e^(A t) B as a function of t, times in units that keep A near one."""
    order = transfer.denominator.size - 1
    if order == 0:
        return lambda time_s: np.zeros(time_s.shape)
    scale = float(np.max(np.abs(transfer.poles)))
    powers = scale ** np.arange(order, -1, -1.0)
    a = transfer.denominator * powers / powers[0]
    b = _padded(transfer.numerator, order) * powers / powers[0]
    A = np.eye(order, k=1)
    A[:, 0] = -a[1:]
    B = b[1:] - a[1:] * b[0]
    row = np.linalg.solve(A.T, np.eye(1, order)[0])
    values, vectors = np.linalg.eig(A)
    if np.linalg.cond(vectors) < 1e8:
        weights = (row @ vectors) * np.linalg.solve(vectors, B.astype(complex))
        return lambda time_s: np.asarray((np.exp(np.outer(time_s * scale, values)) @ weights).real)
    return lambda time_s: np.array([row @ linalg.expm(A * (t * scale)) @ B for t in time_s])


def _grid(transfer: ContinuousTransfer) -> Floats | None:
    """Times that resolve every mode until it is gone; None where some mode never goes."""
    poles = transfer.poles
    if not poles.size or not transfer.stable:
        return None
    parts = [np.zeros(1)]
    for pole in poles:
        points = int(np.clip(24.0 * abs(pole) / abs(pole.real), 200, 50_000))
        parts.append(np.linspace(0.0, 14.0 / abs(pole.real), points))
    return np.unique(np.concatenate(parts))


def _last_crossing(transfer: ContinuousTransfer, part: float) -> float | None:
    if transfer.denominator.size == 1:
        return 0.0
    grid = _grid(transfer)
    if grid is None:
        return None
    transient = _transient(transfer)
    limit = part * abs(transient(np.zeros(1))[0])
    if limit == 0.0:
        return 0.0
    return _bisect(lambda t: limit - np.abs(transient(t)), grid, first=False)


def _bisect(function, grid: Floats, *, first: bool) -> float | None:  # type: ignore[no-untyped-def]
    """Where ``function`` rises through zero, for the first or the last time on the grid."""
    positive = function(grid) >= 0.0
    rises = np.flatnonzero(~positive[:-1] & positive[1:])
    if not rises.size:
        return None
    at = rises[0] if first else rises[-1]
    low, high = grid[at], grid[at + 1]
    for _ in range(60):
        middle = 0.5 * (low + high)
        if function(np.array([middle]))[0] >= 0.0:
            high = middle
        else:
            low = middle
    return float(high)


def _squared(polynomial: Floats) -> Floats:
    """|P(j omega)|^2 as a polynomial in omega^2, descending."""
    degree = polynomial.size - 1
    mirrored = polynomial * (-1.0) ** np.arange(degree, -1, -1)
    product = np.polymul(polynomial, mirrored)[::2]  # even powers of s
    return np.asarray(product * (-1.0) ** np.arange(product.size - 1, -1, -1))


def _substitute(coefficients: Floats, order: int, half: float) -> Floats:
    """Sum a_k (1 - x)^k (1 + x)^(n-k) with x = s/half, descending powers of s."""
    total = np.zeros(order + 1)
    for k, a in enumerate(coefficients):
        total += a * np.poly(np.r_[np.ones(k), -np.ones(order - k)]) * (-1.0) ** k
    return np.asarray(total / half ** np.arange(order, -1, -1.0))


def _monic(numerator: Floats, denominator: Floats) -> ContinuousTransfer:
    """Drop leading zeros of the denominator and make it begin with 1."""
    size = np.abs(denominator)
    if not size.any():
        raise ValueError("the denominator is zero")
    lead = int(np.argmax(size > 0.0))
    denominator = denominator[lead:]
    if not np.any(numerator[:lead]):
        numerator = numerator[lead:]
    return ContinuousTransfer(numerator / denominator[0], denominator / denominator[0])


def _padded(polynomial: Floats, order: int) -> Floats:
    return np.concatenate((np.zeros(order + 1 - polynomial.size), polynomial))


def _padded_behind(polynomial: Floats, order: int) -> Floats:
    return np.concatenate((polynomial, np.zeros(order + 1 - polynomial.size)))


def _same_length(polynomial: Floats, other: Floats) -> Floats:
    return _padded_behind(polynomial, max(polynomial.size, other.size) - 1)


def _roots(polynomial: Floats) -> Complexes:
    return np.roots(polynomial).astype(np.complex128)
