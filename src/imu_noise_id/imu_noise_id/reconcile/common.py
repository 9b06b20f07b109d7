"""Whether two recordings whose slow noise was told apart may have one after all.

A model that was identified from a simulator's recording has the slow term that this recording
showed, and of the terms that it might as well have had, or of one that a longer recording would
have shown, it says nothing.  What is asked of the two recordings themselves, by their low
ordinates, is the gain in likelihood of a law each over one law for both, twice which has about a
chi-square distribution where one is true, with as many degrees of freedom as parameters are saved
(Wilks 1938).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import chdtri

from imu_noise_id.effects.base import Effect
from imu_noise_id.effects.bias_instability import BiasInstability
from imu_noise_id.effects.rate_random_walk import RateRandomWalk
from imu_noise_id.ordinates import Ordinates
from imu_noise_id.reconcile.prior import SLOW, Prior, UnseenDrift, map_fit
from imu_noise_id.reconcile.work import Work

SLOW_STEPS = frozenset({*SLOW, "rate_ramp"})
LOW = 0.05
"""Cycles per sample up to which the ordinates are asked: there the rates of both do not matter."""
COMMON_NOISE = (
    "its slow noise is not what was identified from the simulation, but one and the same noise "
    "fits both recordings: no difference"
)


def only_slow(changed: Work) -> bool:
    """Whether all that was changed on a channel is slow noise."""
    return bool(changed.drafts) and all(d.effect.name in SLOW_STEPS for d in changed.drafts)


def of_one_noise(changed: Work, opened: Work, simulated: Work, log_level: float) -> bool:
    """Whether one law explains the slow noise of both as well as a law each.

    Parameters
    ----------
    changed, opened : Work
        A channel of the recording with its steps, and before them.
    simulated : Work
        Of the simulator's recording, under the model identified from it.
    log_level : float
        Logarithm of the chance at which the two are told apart.
    """
    most_hz = LOW / max(w.state.sample_time_s for w in (changed, simulated))
    mended, given = _effects(changed), _effects(simulated)
    own, seen, other = (_low(w, most_hz) for w in (changed, opened, simulated))
    apart = _likelihood(mended, own, changed) + _likelihood(given, other, simulated)
    ramps = sum(d.effect.name == "rate_ramp" for d in changed.drafts)
    both = _joined(seen, other)
    level = np.exp(log_level)
    return any(
        apart - _likelihood(law, both, opened)
        < 0.5 * chdtri(max(_count(mended) + ramps + _count(given) - _count(law), 1), level)
        for law in _laws(mended, given)
    )


def _effects(work: Work) -> tuple[Effect, ...]:
    return tuple(e for e in work.found.fit.effects if not isinstance(e, UnseenDrift))


def _laws(mended: tuple[Effect, ...], given: tuple[Effect, ...]) -> list[tuple[Effect, ...]]:
    """What both may have: either list, or the given one with a walk or a flicker."""
    density = max((float(getattr(e, "density", 0.0)) for e in given), default=0.0) or 1e-6
    laws = [mended, given]
    if not any(e.name in SLOW for e in given):
        laws += [(*given, RateRandomWalk(0.01 * density)), (*given, BiasInstability(0.1 * density))]
    return laws


def _count(effects: tuple[Effect, ...]) -> int:
    return sum(len(e.free()) for e in effects)


def _low(work: Work, most_hz: float) -> Ordinates:
    bins = work.found.ordinates
    low = bins.frequency_hz < most_hz
    return replace(
        bins, frequency_hz=bins.frequency_hz[low], power=bins.power[low], dof=bins.dof[low]
    )


def _joined(first: Ordinates, second: Ordinates) -> Ordinates:
    pairs = ((getattr(first, n), getattr(second, n)) for n in ("frequency_hz", "power", "dof"))
    frequency_hz, power, dof = (np.concatenate(pair) for pair in pairs)
    duration_s = max(first.duration_s, second.duration_s)
    return Ordinates(frequency_hz, power, dof, first.sample_time_s, duration_s)


def _likelihood(effects: tuple[Effect, ...], bins: Ordinates, work: Work) -> float:
    return map_fit(effects, bins, Prior.none(), work.state.floor).likelihood
