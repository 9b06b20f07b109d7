"""What the data do not settle: names that fit equally, and bounds on terms that do not show."""

from __future__ import annotations

import dataclasses

import numpy as np

from imu_noise_id.effects.base import Effect, StochasticEffect
from imu_noise_id.effects.bias_instability import BiasInstability
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.effects.quantization import Quantization
from imu_noise_id.effects.rate_random_walk import RateRandomWalk
from imu_noise_id.intervals import upper_end
from imu_noise_id.model import UpperBound
from imu_noise_id.ordinates import Ordinates
from imu_noise_id.recording import Floats
from imu_noise_id.selection import MOST, SLOW
from imu_noise_id.whittle import Fit, fit

CLEAR = 5.0
"""Expected difference in log-likelihood from which one name is said alone."""

BOUNDED: tuple[type[StochasticEffect], ...] = (RateRandomWalk, BiasInstability, Quantization)


def expected_difference(psd: Floats, other: Floats, ordinates: Ordinates) -> float:
    """Mean log-likelihood ratio of the true ``psd`` over ``other``, nats."""
    ratio = psd / other
    return float(0.5 * ordinates.dof @ (ratio - 1.0 - np.log(ratio)))


def equal_names(fitted: Fit, rivals: tuple[str, ...] = ()) -> tuple[str, ...]:
    """For each effect, a sentence on which other name fits as well, or an empty string.

    ``rivals`` are courses that fit as well as the slow terms.
    """
    return tuple(
        _equal_name(fitted, i, rivals) if isinstance(effect, SLOW) else ""
        for i, effect in enumerate(fitted.effects)
    )


def _equal_name(fitted: Fit, index: int, rivals: tuple[str, ...]) -> str:
    effect = fitted.effects[index]
    rest = fitted.effects[:index] + fitted.effects[index + 1 :]
    expected = dataclasses.replace(fitted.ordinates, power=fitted.spectrum.psd)
    has_source = any(isinstance(e, StochasticEffect) for e in rest)
    without = fit(rest, expected, fitted.floor) if has_source else None
    equal = []
    for kind in SLOW:
        there = sum(isinstance(e, kind) for e in rest)
        if isinstance(effect, kind) or there >= MOST.get(kind.name, 1):
            continue
        starts = _starts(kind, effect, without)
        trials = [fit((*rest, start), expected, fitted.floor) for start in starts]
        if trials and min(_distance(fitted, t) for t in trials) < CLEAR:
            equal.append(kind.name)
    equal += rivals
    if not equal:
        return ""
    unseen = GaussMarkov.name in equal or isinstance(effect, GaussMarkov)
    span = f"{fitted.ordinates.duration_s:.0f} s"
    reason = f"; a correlation time is not observable in {span}" if unseen else ""
    names = " and ".join([effect.name, *equal])
    return f"between {names}: they fit this record equally{reason}"


def _distance(fitted: Fit, other: Fit) -> float:
    return expected_difference(fitted.spectrum.psd, other.spectrum.psd, fitted.ordinates)


def _starts(
    kind: type[StochasticEffect], effect: Effect, without: Fit | None
) -> tuple[StochasticEffect, ...]:
    """Starting values of a kind in place of an effect."""
    if isinstance(effect, RateRandomWalk) and kind is GaussMarkov and without is not None:
        memory = 3.0 * without.ordinates.duration_s
        return (GaussMarkov(effect.coefficient * float(np.sqrt(0.5 * memory)), memory),)
    return kind.starts(without.residual) if without is not None else ()


def upper_bounds(fitted: Fit, unit: str) -> tuple[UpperBound, ...]:
    """Largest values (95 %) of the terms that the model has not.

    Parameters
    ----------
    fitted : Fit
    unit : str
        Unit of the channel.
    """
    bounds = []
    for kind in BOUNDED:
        if any(isinstance(e, kind) for e in fitted.effects):
            continue
        upper = _upper_bound(fitted, kind)
        if upper is None:
            continue
        parameter = kind.parameters[0]
        span = f"{fitted.ordinates.duration_s:.0f} s do not show it"
        bounds.append(UpperBound(kind.name, parameter.name, parameter.unit_for(unit), upper, span))
    return tuple(bounds)


def _upper_bound(fitted: Fit, kind: type[StochasticEffect]) -> float | None:
    """Strength of an added term at which the profile likelihood has dropped by 1.35."""
    f, dt = fitted.ordinates.frequency_hz, fitted.ordinates.sample_time_s
    shape = kind(1.0).psd(f, dt)  # type: ignore[call-arg]
    relative = shape / fitted.spectrum.psd
    error = 1.0 / np.sqrt(0.5 * fitted.ordinates.dof @ relative**2)
    start = kind(float(np.sqrt(0.3 * error)))  # type: ignore[call-arg]
    whole = fit((*fitted.effects, start), fitted.ordinates, fitted.floor)
    if whole.log_likelihood < fitted.log_likelihood:
        whole = dataclasses.replace(whole, log_likelihood=fitted.log_likelihood)
    strength = max(getattr(whole.effects[-1], kind.parameters[0].name), float(np.sqrt(0.1 * error)))
    return upper_end(whole, float(np.log(strength)))
