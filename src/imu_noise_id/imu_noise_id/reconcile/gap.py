"""The gap between recording and model as one number, on a part that no fit has seen.

The score is a fourth-power mean of about 170 standard deviates: powers of groups of ordinates,
energies of stretches of time, and the battery's statistics through their null.  The fourth power
lets one frequency or one moment that is far off show among many that are right; 1 is what the
model's own simulations score on average.

Held out is the second half, with everything fitted on the first; of a line the phase is read anew,
and its slow wander (``lines.py``) is taken out with the course of the whole record.
What is local in time (a step, a burst, a ramp, what follows the temperature) cannot be fitted on
one half and be seen in the other: its size comes from the even samples, and from the given model
where that has it, and is judged on the odd ones, under the spectrum of the whole record.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import fft
from scipy.special import chdtr, chdtrc, ndtri

from imu_noise_id.ordinates import ordinates
from imu_noise_id.reconcile.battery import Whitened, battery, deviance
from imu_noise_id.reconcile.null import Null, z_of
from imu_noise_id.reconcile.prior import within_intervals
from imu_noise_id.reconcile.state import (
    Analysis,
    Column,
    State,
    analyse,
    generalised_least_squares,
    inverse_psd,
    rounding_kurtosis,
    whiten,
)
from imu_noise_id.recording import Floats
from imu_noise_id.whittle import spectrum_of

GROUPS = 100
STRETCHES = 64
LOCAL = frozenset({"bias_step", "rate_ramp", "temperature", "variance_change"})


def whole_score(
    found: Analysis, null: Null, skip: frozenset[str], extras: tuple[float, ...] = ()
) -> float:
    """Score of the whole record under its own fit."""
    found = _within_intervals(found)
    return _score(found.white, _spread(found), null, skip, extras)


def held_out_score(
    state: State,
    found: Analysis,
    null: Null,
    skip: frozenset[str],
    extras: tuple[float, ...] = (),
    local: bool = False,
) -> float:
    """Score of the part that the fit has not seen.

    Parameters
    ----------
    state : State
    found : Analysis
        Of the whole record.
    null : Null
    skip : frozenset of str
        Statistics that an effect of the model explains in a way that whitening does not undo.
    extras : tuple of float
        Deviates of what is not in the whitened record (comb, repeats, other axes, timing).
    local : bool
        Whether to split by odd and even samples.
    """
    split = _odd_samples(state, _within_intervals(found)) if local else _second_half(state)
    white, spread = split
    return _score(white, spread, null, skip, extras)


def _within_intervals(found: Analysis) -> Analysis:
    """The fit no farther from the given model than that leaves open: beyond is a gap."""
    state, prior = found.state, found.state.prior
    effects = within_intervals(found.fit.effects, prior)
    if effects == found.fit.effects:
        return found
    f, dt = found.ordinates.frequency_hz, found.ordinates.sample_time_s
    covariance = found.fit.covariance.copy()
    if prior.drift is not None:
        rows = [prior.centre.size, prior.centre.size + 1]
        covariance[rows], covariance[:, rows] = 0.0, 0.0
    spectrum = spectrum_of(effects, f, dt, state.floor)
    fit = replace(found.fit, effects=effects, spectrum=spectrum, covariance=covariance)
    return replace(found, fit=fit)


def _score(
    white: Whitened,
    spread: Floats,
    null: Null,
    skip: frozenset[str],
    extras: tuple[float, ...],
) -> float:
    z = [*_spectral(white, spread), *_energies(white), *extras]
    z += [z_of(null.log_p(s.name, s.nats)) for s in battery(white) if s.name not in skip]
    deviates = np.array(z)
    mean = float(np.mean((deviates / 3.0**0.25) ** 4))
    return mean**0.25 / (1.0 - 1.0 / deviates.size)


def _spread(found: Analysis) -> Floats:
    """Variance of the log of the fitted spectrum at each bin."""
    tangent = found.fit.spectrum.tangent
    return np.asarray(np.einsum("pb,pq,qb->b", tangent, found.fit.covariance, tangent))


def _spectral(white: Whitened, spread: Floats) -> Floats:
    """Deviates of the powers of about ``GROUPS`` groups of bins, equal in log frequency."""
    position = np.log(white.frequency_hz / white.frequency_hz[0])
    group = np.floor(position / max(float(position[-1]), 1e-9) * (GROUPS - 1e-6))
    first = np.flatnonzero(np.diff(group, prepend=-1.0))
    dof = np.add.reduceat(white.dof, first)
    ratio = np.add.reduceat(white.ratio * white.dof, first) / dof
    extra = np.add.reduceat(spread * white.dof, first) / dof
    return deviates_of_power(ratio, dof) / np.sqrt(1.0 + 0.5 * dof * extra)


def _energies(white: Whitened) -> Floats:
    size = max(white.samples.size // STRETCHES, 4)
    count = white.samples.size // size
    square = np.mean(white.samples[: count * size].reshape(count, size) ** 2, axis=1)
    mean = float(square.mean())
    return deviates_of_power(square / mean, np.full(count, float(size)))


def deviates_of_power(ratio: Floats, dof: Floats) -> Floats:
    """Normal deviates of chi-square means: exact quantiles, the likelihood's root far out."""
    upper, lower = chdtrc(dof, dof * ratio), chdtr(dof, dof * ratio)
    with np.errstate(divide="ignore"):
        z = np.where(ratio > 1.0, -ndtri(upper), ndtri(lower))
    far = np.sign(ratio - 1.0) * np.sqrt(2.0 * deviance(ratio, dof))
    return np.where(np.minimum(upper, lower) > 1e-250, z, far)


def _part(state: State, where: slice) -> State:
    columns = tuple(replace(c, shape=c.shape[where]) for c in state.columns)
    temperature = None if state.temperature is None else state.temperature[where]
    start = state.start_s + (where.start or 0) * state.sample_time_s
    return replace(
        state,
        values=state.values[where],
        columns=columns,
        temperature=temperature,
        start_s=start,
    )


def _second_half(state: State) -> tuple[Whitened, Floats]:
    half = state.values.size // 2
    first, second = _part(state, slice(0, half)), _part(state, slice(half, 2 * half))
    fitted = _within_intervals(analyse(first))
    values = second.values - second.values[0]
    sizes = _phases_anew(second.columns, fitted.sizes, values)
    for size, column in zip(sizes, second.columns, strict=True):
        values = values - size * column.shape
    coefficients = fft.dct(values, norm="ortho")
    bins = ordinates(coefficients, state.sample_time_s)
    inverse = inverse_psd(fitted.fit.effects, half, state.sample_time_s, state.floor)
    white = whiten(coefficients, bins, fitted.fit.spectrum.psd, inverse, second)
    return replace(white, flattest=fitted.white.flattest), _spread(fitted)


def _phases_anew(columns: tuple[Column, ...], sizes: Floats, values: Floats) -> Floats:
    """Sizes with the phase of every line read from ``values`` and its amplitude kept."""
    out = sizes.copy()
    lines = [i for i, c in enumerate(columns) if c.effect.name == "periodic"]
    for i, j in zip(lines[::2], lines[1::2], strict=True):
        pair = np.stack((columns[i].shape, columns[j].shape))
        fresh = np.linalg.lstsq(pair.T, values - values.mean(), rcond=None)[0]
        length = float(np.hypot(*fresh))
        if length > 0.0:
            out[[i, j]] = fresh * float(np.hypot(sizes[i], sizes[j])) / length
    return out


def _odd_samples(state: State, found: Analysis) -> tuple[Whitened, Floats]:
    n = state.values.size // 2
    dt = 2.0 * state.sample_time_s
    inverse = _folded_inverse(found, state, n)
    even, odd = _part(state, slice(0, 2 * n, 2)), _part(state, slice(1, 2 * n, 2))
    sizes = found.sizes
    if state.columns:
        C = np.asarray(fft.dct(even.values - even.values[0], norm="ortho"))
        sizes, _ = generalised_least_squares(replace(even, sample_time_s=dt), C, inverse)
    values = odd.values - odd.values[0]
    for size, column in zip(sizes, odd.columns, strict=True):
        values = values - size * column.shape
    coefficients = np.asarray(fft.dct(values, norm="ortho"))
    bins = ordinates(coefficients, dt)
    k = np.rint(bins.frequency_hz * 2.0 * n * dt).astype(np.int64)
    part = replace(odd, sample_time_s=dt)
    white = whiten(coefficients, bins, 1.0 / inverse[k], inverse, part)
    one = np.ones(1)  # of the two rounding errors in an odd sample no other odd one has any
    gain = np.sqrt(inverse * dt)
    flattest = rounding_kurtosis(found.fit.effects, state.sample_time_s, gain, (one, -one))
    white = replace(white, flattest=flattest)
    spread = np.interp(bins.frequency_hz, found.ordinates.frequency_hz, _spread(found))
    return white, spread


def _folded_inverse(found: Analysis, state: State, n: int) -> Floats:
    """1/S of every second sample: the upper half of the spectrum folds onto the lower."""
    m = state.values.size
    k = np.arange(m, dtype=float)
    psd = 1.0 / np.maximum(found.inverse_psd[1:], 1e-300)
    index = np.arange(n) * (m / (2.0 * n))
    low = np.interp(index, k[1:], psd)
    high = np.interp(m - index, k[1:], psd)
    inverse = 1.0 / (low + high)
    inverse[0] = 0.0
    return np.asarray(inverse)
