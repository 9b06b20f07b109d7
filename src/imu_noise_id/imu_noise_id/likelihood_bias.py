"""Bias of maximum likelihood to second order, to be taken off the estimates.

With eta = log S and each ordinate S times chi-square over nu, the expansion of Cox and Snell (1968)
for the maximum of l(theta) becomes

    E[theta_hat - theta] = -J^-1 sum_k (nu_k/4) deta_k (tr(J^-1 H_k) + deta_k' J^-1 deta_k),

H_k the second derivatives of eta at ordinate k.  The standard deviation of a Gauss-Markov term
that is twelve correlation times long comes out too small by 0.31 of its error, corrected by 0.17,
at no cost in the error (``docs/study_identify.md``).
"""

from __future__ import annotations

import numpy as np

from imu_noise_id.recording import Floats
from imu_noise_id.whittle import Fit, log_covariance, parameter_vector, spectrum_of, with_parameters

STEP = 1e-2
LARGEST_ERROR = 1.0
LARGEST_SHARE = 0.5
"""Standard error of a log parameter, and its share in the bias, up to which the series is used."""


def second_order_bias(fitted: Fit, covariance: Floats | None = None) -> Floats:
    """Bias of the log parameters, (p,); zeros where the expansion cannot be trusted.

    That is where a parameter ended at a limit, or is known so badly that the second term of the
    series is no small one.

    Parameters
    ----------
    fitted : Fit
    covariance : (p, p) float64, optional
        Of the log parameters, where it is at hand.
    """
    C = log_covariance(fitted) if covariance is None else covariance
    error = np.sqrt(np.diag(C))
    if np.any(fitted.at_limit) or np.any(error > LARGEST_ERROR):
        return np.zeros(error.size)
    tangent, dof = fitted.spectrum.tangent, fitted.ordinates.dof
    leverage = np.einsum("ib,ib->b", tangent, C @ tangent)
    bias = -C @ (tangent @ (0.25 * dof * (_curvature(fitted, C) + leverage)))
    small = np.all(np.abs(bias) < LARGEST_SHARE * error)
    return np.asarray(bias if small else np.zeros(error.size))


def _curvature(fitted: Fit, C: Floats) -> Floats:
    """tr(C H_k) for each ordinate, by central differences along the axes of C."""
    grid = fitted.ordinates
    theta = parameter_vector(fitted.effects)

    def tangent(at: Floats) -> Floats:
        effects = with_parameters(fitted.effects, at)
        return spectrum_of(effects, grid.frequency_hz, grid.sample_time_s, fitted.floor).tangent

    total = np.zeros(grid.frequency_hz.size)
    variances, axes = np.linalg.eigh(C)
    for variance, axis in zip(variances, axes.T, strict=True):
        slope = tangent(theta + STEP * axis) - tangent(theta - STEP * axis)
        total += max(variance, 0.0) * (axis @ slope) / (2.0 * STEP)
    return total
