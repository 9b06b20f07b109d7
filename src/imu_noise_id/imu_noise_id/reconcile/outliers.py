"""Whether samples are hit, and as many and as hard as the given model says.

Hits are sought in samples less what the others say of them (``impulses.py``), under a fit that no
hits have spoilt; what was hit is drawn anew as the noise has it between the others.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.special import gammaincc, ndtr, pdtr

from imu_noise_id.effects.base import Parameter
from imu_noise_id.effects.outliers import THRESHOLD, Outliers
from imu_noise_id.effects.variance_change import variance_scan
from imu_noise_id.model import Estimate, FittedEffect
from imu_noise_id.reconcile.battery import BURST_BLOCKS
from imu_noise_id.reconcile.compare import Finding
from imu_noise_id.reconcile.contamination import (
    Change,
    Hits,
    find_hits,
    finding_of,
    hit_effect,
    tails_log_p,
)
from imu_noise_id.reconcile.filling import filled
from imu_noise_id.reconcile.impulses import Impulses, impulses, rest_of
from imu_noise_id.reconcile.null import log_p_of, z_of
from imu_noise_id.reconcile.result import ADD, REFIT, REMOVE, Where
from imu_noise_id.reconcile.state import State, analyse
from imu_noise_id.reconcile.unrounded import Steps
from imu_noise_id.reconcile.work import GIVEN_LOG_P, TYPED_SIZE_ERROR, Work, drafted
from imu_noise_id.recording import Floats

STRETCHES = 32
CLUSTERED_LOG_P = -9.0
TAILS_LOG_P = -14.0
MOST_HITS, MOST_TOLD_APART, TOLD_APART = 0.02, 0.05, 20.0
"""Share of hits, also where a mixture is so many nats likelier than any law of long tails."""
OTHER_LAW = 0.1
"""Error of a logarithm that is read by the catalogue's law, of hits that have another."""


def answer_hits(work: Work, rng: np.random.Generator) -> Work:
    """Mask and mend outliers, and say so where the model does not have as many."""
    given = next((f for f in work.model.effects if isinstance(f.effect, Outliers)), None)
    single = _single_samples(work)
    white = single.unit
    hits = _hits_of(single, work.state)
    if given is None and (_by_chance(hits) or clustered(white, hits.mask)):
        return work
    tails = tails_log_p(white, hits.answer.best)
    most = MOST_TOLD_APART if hits.answer.tails < -TOLD_APART else MOST_HITS
    if given is None and (tails < TAILS_LOG_P or hits.answer.rate > most or _lopsided(white, hits)):
        return work  # not a few hits but another distribution
    change = _hit_change(work, given, hits, single)
    mask = hits.drawn(rng)
    if mask.any() and not (change is not None and change.action == REMOVE):
        values = _mended(work, mask, single, rng)
        place = Where("amplitude", 2.5, 5.0, "sigma", 1.0)
        after = replace(
            work,
            skip=work.skip | {"extreme", "kurtosis"},
            lasting=(*work.lasting, Finding("tails", tails, z_of(tails), place)),
            steps=without_hits(work, mask, values),
        ).analysed(work.state.with_values(values))
    else:
        after = work
    if change is None:
        return after
    before = replace(work, unmet=(*work.unmet, finding_of(change)))
    done = drafted(before, after, change.action, change.effect, finding_of(change))
    last = replace(done.drafts[-1], log_errors=hits.errors)
    return replace(done, drafts=(*done.drafts[:-1], last))


def _single_samples(work: Work) -> Impulses:
    """Samples less what others say of them, under a fit that no hits have spoilt."""
    single = impulses(work.found)
    mask = _hits_of(single, work.state).mask
    if not mask.any():
        return single
    hit = np.where(mask, single.samples, 0.0)
    found = analyse(work.state.with_values(work.state.values - hit))
    return impulses(found, rest_of(found) + hit)


def _hits_of(single: Impulses, state: State) -> Hits:
    return find_hits(single.unit, state.rounding_step / single.expected)


def _mended(work: Work, mask: np.ndarray, single: Impulses, rng: np.random.Generator) -> Floats:
    """Values with the masked ones drawn as the noise has them between the others."""
    dt = work.state.sample_time_s
    inverse = single.inverse.copy()
    inverse[0] = inverse[1]
    louder = single.sigma**2 * dt * float(np.mean(single.inverse))
    drawn = filled(single.rest, mask, louder / inverse, dt, rng)
    return np.asarray(work.state.values + np.where(mask, drawn - single.rest, 0.0))


def without_hits(work: Work, mask: np.ndarray, mended: Floats) -> Steps | None:
    """The steps of a record without its hits, the values mended there."""
    steps = work.steps
    if steps is None or not work.drawable:
        return steps
    return replace(steps, missing=steps.missing | mask, drawn=mended)


def _hit_change(
    work: Work, given: FittedEffect | None, hits: Hits, single: Impulses
) -> Change | None:
    """What the hits change: added, of another rate or size than given, or fewer than any."""
    white, sigma = single.unit, single.sigma
    place = Where("amplitude", 5.0, max(float(np.abs(white).max()), 5.0), "sigma", 1.0)
    if given is None:
        return Change(ADD, hit_effect(hits, sigma), hits.log_p, place)
    said = given.effect
    assert isinstance(said, Outliers)
    if _by_chance(hits):
        far = 2.0 * ndtr(-THRESHOLD / np.hypot(1.0, said.scale / sigma))
        least = float(given.estimates[0].lower or said.rate)
        log_p = float(np.log(max(pdtr(hits.mask.sum(), least * white.size * far), 1e-300)))
        return Change(REMOVE, said, log_p, place) if log_p < GIVEN_LOG_P else None
    seen = hit_effect(hits, sigma)
    pairs = zip(said.parameters, given.estimates, hits.errors.values(), strict=True)
    z = max((_apart(said, seen, *pair) for pair in pairs), key=abs)
    return Change(REFIT, seen, log_p_of(z), place) if log_p_of(z) < GIVEN_LOG_P else None


def _apart(
    given: Outliers, seen: Outliers, parameter: Parameter, said: Estimate, error: float
) -> float:
    """Deviation of one parameter of hits, in standard errors of its logarithm.

    The law of the hits is not the catalogue's to the letter: ``OTHER_LAW`` of what is read by it.
    """
    first, second = (float(getattr(e, parameter.name)) for e in (given, seen))
    known = (said.std_error or TYPED_SIZE_ERROR * first) / first
    return float(np.log(second / first) / np.sqrt(error**2 + known**2 + OTHER_LAW**2))


def _by_chance(hits: Hits) -> bool:
    """Whether a clean record has samples as far out, or as many, often enough to say nothing."""
    return bool(hits.log_p > GIVEN_LOG_P)


def _lopsided(white: Floats, hits: Hits) -> bool:
    """Whether hits have one sign more often than chance has it."""
    count = int(hits.mask.sum())
    return count >= 12 and abs(float(np.sign(white[hits.mask]).sum())) > 4.0 * np.sqrt(count)


def clustered(white: Floats, mask: np.ndarray) -> bool:
    """Whether hits come in a burst: then they are a change of variance, not outliers."""
    count = int(mask.sum())
    if count < 6:
        return False
    position = np.flatnonzero(mask) / mask.size
    # Kolmogorov's distance from evenness
    steps = np.arange(1, count + 1) / count
    distance = float(
        np.max(np.maximum(np.abs(steps - position), np.abs(steps - 1 / count - position)))
    )
    if -2.0 * count * distance**2 + np.log(2.0) < CLUSTERED_LOG_P:
        return True
    per_stretch = np.bincount((position * STRETCHES).astype(int), minlength=STRETCHES)
    dispersion = float(np.sum((per_stretch - count / STRETCHES) ** 2) / (count / STRETCHES))
    if (
        float(np.log(max(gammaincc((STRETCHES - 1) / 2.0, dispersion / 2.0), 1e-300)))
        < CLUSTERED_LOG_P
    ):
        return True
    quiet = np.where(mask, 0.0, white)
    first, last, _, gain, _ = variance_scan(quiet, BURST_BLOCKS)
    inside = np.mean(mask[first:last]) if last > first else 0.0
    return gain > 15.0 and inside > 4.0 * np.mean(mask)
