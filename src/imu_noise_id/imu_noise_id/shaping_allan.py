"""Allan deviation of white noise through a shaping filter, and how far two curves are apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from imu_noise_id.canonical_variates import StateSpace
from imu_noise_id.recording import Floats
from imu_noise_id.transfer_function import DiscreteTransfer, stationary_covariance


def allan_deviation(transfer: DiscreteTransfer, averaging_factor: NDArray[np.int64]) -> Floats:
    """Allan deviation of the output of a stable H(z) driven by unit white noise, shape (t,).

    Raises
    ------
    ValueError
        When H(z) is not stable.
    """
    if not transfer.stable:
        raise ValueError("an unstable model has no Allan deviation")
    lead = transfer.denominator[0]
    size = max(transfer.numerator.size, transfer.denominator.size)
    b = np.pad(transfer.numerator, (0, size - transfer.numerator.size)) / lead
    phi = np.pad(transfer.denominator, (0, size - transfer.denominator.size)) / lead
    order = size - 1
    A = np.eye(order, k=1)
    A[:, :1] = -phi[1:, None]
    return _allan_of_output(
        A, (b[1:] - phi[1:] * b[0])[:, None], np.eye(1, order)[0], b[:1], averaging_factor
    )


def axis_allan_deviation(
    space: StateSpace, axis: int, averaging_factor: NDArray[np.int64]
) -> Floats:
    """Allan deviation of one output of a stable innovations model, shape (t,)."""
    root = np.linalg.cholesky(space.innovation_covariance)
    return _allan_of_output(space.A, space.K @ root, space.C[axis], root[axis], averaging_factor)


def _allan_of_output(
    A: Floats, B: Floats, c: Floats, d: Floats, averaging_factor: NDArray[np.int64]
) -> Floats:
    """Of y = c x + d w with x' = A x + B w and w white of unit variance each.

    With V(m) the variance of a sum of m samples, sigma^2 = (4 V(m) - V(2m))/(2 m^2).
    """
    if not A.size:
        return np.asarray(np.linalg.norm(d) / np.sqrt(averaging_factor))
    P = stationary_covariance(A, B @ B.T)
    direct, lagged = float(c @ P @ c + d @ d), A @ P @ c + B @ d
    # the last block column of chain^m sums the powers of A with weights m - 1, m - 2, ...
    one, none = np.eye(A.shape[0]), np.zeros(A.shape)
    chain = np.block([[A, one, none], [none, one, one], [none, none, one]])
    order = A.shape[0]

    def variance_of_sum(m: int) -> float:
        weights = np.linalg.matrix_power(chain, int(m))[:order, 2 * order :]
        return float(m * direct + 2.0 * (c @ weights @ lagged))

    variance = [
        (4 * variance_of_sum(m) - variance_of_sum(2 * m)) / (2.0 * m * m)
        for m in averaging_factor.tolist()
    ]
    return np.sqrt(np.maximum(variance, 0.0))


def allan_distance(measured: Floats, modelled: Floats, degrees_of_freedom: Floats) -> float | None:
    """Root mean square of ln(modelled/measured), weighted by degrees of freedom up to 100.

    0.01 is one per cent; None where nothing is measured.
    """
    usable = (measured > 0.0) & (modelled > 0.0)
    if not usable.any():
        return None
    weight = np.minimum(degrees_of_freedom[usable], 100.0)
    return float(
        np.sqrt(np.average(np.log(modelled[usable] / measured[usable]) ** 2, weights=weight))
    )
