"""Intervals of fitted parameters: inverse information, or the profile where that is no parabola."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from imu_noise_id.likelihood_bias import second_order_bias
from imu_noise_id.model import Estimate, FittedEffect
from imu_noise_id.recording import Floats
from imu_noise_id.whittle import Fit, fit, log_covariance, parameter_vector, with_parameters

QUANTILE = float(ndtri(0.975))
DROP = 0.5 * QUANTILE**2
ONE_SIDED_DROP = 0.5 * float(ndtri(0.95)) ** 2
PROFILE_FROM = 0.15
LONGEST = 14.0
MOST_PROFILED = 6
"""Effects beyond which a profile costs more than it tells."""


def estimates(fitted: Fit, unit: str) -> tuple[tuple[FittedEffect, ...], Floats]:
    """Effects with 95 % intervals, and the covariance of their log parameters.

    The second-order bias of the likelihood is taken off values and ends alike.

    Parameters
    ----------
    fitted : Fit
    unit : str
        Unit of the channel.
    """
    covariance = log_covariance(fitted)
    theta = parameter_vector(fitted.effects)
    bias = second_order_bias(fitted, covariance)
    out, index = [], 0
    for effect in with_parameters(fitted.effects, theta - bias):
        free = effect.free()
        row = []
        for parameter in effect.parameters:
            value = getattr(effect, parameter.name)
            if parameter.name not in free:
                row.append(Estimate(value, None, None, None, parameter.unit_for(unit)))
                continue
            error = float(np.sqrt(covariance[index, index]))
            ends = _interval(fitted, theta, index, error)
            lower, upper = (None if e is None else e * float(np.exp(-bias[index])) for e in ends)
            row.append(Estimate(value, error * value, lower, upper, parameter.unit_for(unit)))
            index += 1
        out.append(FittedEffect(effect, tuple(row)))
    return tuple(out), covariance


def _interval(
    fitted: Fit, theta: Floats, index: int, error: float
) -> tuple[float | None, float | None]:
    simple = error < PROFILE_FROM and not fitted.at_limit[index]
    if simple or len(fitted.effects) > MOST_PROFILED:
        return (
            float(np.exp(theta[index] - min(QUANTILE * error, LONGEST))),
            float(np.exp(theta[index] + min(QUANTILE * error, LONGEST))),
        )
    ends = [_profile_end(fitted, theta, index, sign * max(error, 0.05)) for sign in (-1.0, 1.0)]
    return ends[0], ends[1]


def upper_end(fitted: Fit, log_strength: float) -> float | None:
    """Upper 95 % limit of the first parameter of the last effect, by the profile."""
    index = parameter_vector(fitted.effects).size - len(fitted.effects[-1].free())
    theta = parameter_vector(fitted.effects)
    theta[index] = log_strength
    return _profile_end(fitted, theta, index, 0.3, ONE_SIDED_DROP)


def _profile_end(
    fitted: Fit, theta: Floats, index: int, step: float, allowed: float = DROP
) -> float | None:
    """Where the profile likelihood has dropped by ``allowed``, in the direction of ``step``.

    None where it never does within a factor of 1e6: the data leave that side open.
    """

    def drop(at: float, start: Floats) -> tuple[float, Floats]:
        moved = start.copy()
        moved[index] = at
        effects = with_parameters(fitted.effects, moved)
        trial = fit(effects, fitted.ordinates, fitted.floor, (index,), rough=True)
        return fitted.log_likelihood - trial.log_likelihood - allowed, parameter_vector(
            trial.effects
        )

    near, near_drop, start = theta[index], -allowed, theta
    step = float(np.clip(step, -1.0, 1.0))
    far = near + step
    far_drop, far_start = drop(far, start)
    while far_drop < 0.0:
        near, near_drop, start = far, far_drop, far_start
        step *= 1.6
        far += step
        if abs(far - theta[index]) > LONGEST:
            return None
        far_drop, far_start = drop(far, start)
    for _ in range(6):
        share = np.clip(near_drop / (near_drop - far_drop), 0.1, 0.9)
        middle = near + share * (far - near)
        value, start = drop(middle, start)
        if abs(value) < 0.02:
            return float(np.exp(middle))
        if value < 0.0:
            near, near_drop = middle, value
        else:
            far, far_drop = middle, value
    return float(np.exp(near + near_drop / (near_drop - far_drop) * (far - near)))
