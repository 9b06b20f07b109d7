"""Single samples far off, under any spectrum: each sample less what all the others say of it.

Whitening spreads a hit on noise that is slow at the sampling rate over a doublet or more: its
parts gather, have both signs alike and are no mixture of clean samples and hits.  A sample less its
mean given all the others, ``(V^-1 x)_t/(V^-1)_tt``, has the whole hit in it, and the least noise
beside it that any linear filter leaves (Kolmogorov 1941); the parts of it that others have are gone
once the doubtful ones say nothing of others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from imu_noise_id.effects.outliers import outlier_mask
from imu_noise_id.leave_one_out import less_others
from imu_noise_id.reconcile.prior import given_effects
from imu_noise_id.reconcile.state import Analysis, inverse_psd
from imu_noise_id.reconcile.steps import step_scores
from imu_noise_id.recording import Floats, Mask

ROUNDS = 4
"""How often it is asked anew which samples are doubtful."""
ITERATIONS, SETTLED = 40, 1e-3
LEFT_BY_A_STEP = 0.25
"""Of what a hit explains, the part that it must explain beside a step in its place: on a walk a
step in the place of a hit explains half, and hits on both sides of a step two thirds of it.
"""


@dataclass(frozen=True)
class Impulses:
    """A record's samples less what the others say of them.

    Attributes
    ----------
    samples : (n,) float64
        In the channel's unit; zero where a level jumps.
    sigma : float
        Robust deviation.
    expected : float
        Deviation under the fit.
    rest : (n,) float64
        Record without its columns.
    inverse : (n,) float64
        1/S at the DCT ordinates under which that is so.
    """

    samples: Floats
    sigma: float
    expected: float
    rest: Floats
    inverse: Floats

    @property
    def unit(self) -> Floats:
        """In deviations under the fit."""
        return np.asarray(self.samples / self.expected)


def impulses(found: Analysis, rest: Floats | None = None) -> Impulses:
    """Samples of a record less what the others say of them.

    Hits spoil a fit, and a model may be another recording's: of the spectra of both, the one that
    leaves less is nearer to the noise's own.

    Parameters
    ----------
    found : Analysis
    rest : (n,) float64, optional
        Record without its columns, if it is not the one that was fitted.
    """
    state = found.state
    if rest is None:
        rest = rest_of(found)
    n, dt = rest.size, state.sample_time_s
    given = given_effects(found.fit.effects, state.prior)
    inverses = (found.inverse_psd, inverse_psd(given, n, dt, state.floor))
    tried = [(robust_sigma(_weighted(rest, inverse)), inverse) for inverse in inverses]
    _, inverse = min(tried, key=lambda t: t[0])
    doubtful = np.zeros(n, dtype=bool)
    for _ in range(ROUNDS):
        samples, clean = _less_the_undoubted(rest, inverse, doubtful)
        before, doubtful = doubtful, outlier_mask(samples)
        if np.array_equal(before, doubtful):
            break
    samples = np.where(_jumps(rest, clean, samples, before, inverse), 0.0, samples)
    expected = 1.0 / np.sqrt(dt * float(np.mean(found.inverse_psd)))
    return Impulses(samples, robust_sigma(samples), expected, rest, inverse)


def rest_of(found: Analysis) -> Floats:
    """A record without its columns, (n,)."""
    return np.asarray(fft.idct(found.coefficients, norm="ortho"))


def robust_sigma(samples: Floats) -> float:
    """1.4826 times the median absolute deviation."""
    return max(1.4826 * float(np.median(np.abs(samples - np.median(samples)))), 1e-300)


def _weighted(values: Floats, inverse: Floats) -> Floats:
    return less_others(np.asarray(fft.dct(values, norm="ortho")), inverse)


def _less_the_undoubted(values: Floats, inverse: Floats, doubtful: Mask) -> tuple[Floats, Floats]:
    """Each sample less its mean given the others that are not doubtful, and the record of means.

    With Q = V^-1 the mean of the doubtful ones D is x_D - (Q_DD)^-1 (Q x)_D, by conjugate
    gradients: single ones far apart have a diagonal Q_DD.
    """
    weighted = _weighted(values, inverse)
    if not doubtful.any():
        return weighted, values
    right = weighted[doubtful]
    off, residual = np.zeros(right.size), right.copy()
    way, power = residual.copy(), float(residual @ residual)
    target = power * SETTLED**2
    for _ in range(ITERATIONS):
        if power <= target:
            break
        turned = _weighted(_spread(way, doubtful), inverse)[doubtful]
        step = power / float(way @ turned)
        off += step * way
        residual -= step * turned
        before, power = power, float(residual @ residual)
        way = residual + power / before * way
    hits = _spread(off, doubtful)
    clean = values - hits
    out = _weighted(clean, inverse)
    out[doubtful] = off
    return out, clean


def _spread(some: Floats, mask: Mask) -> Floats:
    out = np.zeros(mask.size)
    out[mask] = some
    return out


def _jumps(values: Floats, clean: Floats, samples: Floats, doubtful: Mask, inverse: Floats) -> Mask:
    """Doubtful samples in whose place a step of the level explains as much, (n,)."""
    out = np.zeros(values.size, dtype=bool)
    edges = np.flatnonzero(np.diff(np.concatenate(([0], doubtful.view(np.int8), [0]))))
    if not edges.size:
        return out
    # what hits explain, of each doubtful sample: x_D' Q x_D less the same of the record of means
    explained = _weighted(values, inverse)[doubtful] * samples[doubtful]
    total = np.cumsum(np.concatenate(([0.0], _spread(explained, doubtful)))) * np.mean(inverse)
    with_hits, without = (
        step_scores(np.asarray(fft.dct(v, norm="ortho")), inverse, 1.0)[0] ** 2
        for v in (values, clean)
    )
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        near = slice(max(first - 1, 0), min(last, without.size))
        by_a_step = float(np.max(with_hits[near] - without[near], initial=0.0))
        by_hits = total[last] - total[first]
        out[first:last] = by_hits - by_a_step < LEFT_BY_A_STEP * by_hits
    return out
