"""Whose lattice values lie on: the output's, or an angle's before it was differenced.

Rounding the output adds a white error of variance q^2/12.  A sensor that counts rounded increments
of an angle (or of a velocity) gives values on a lattice too, of step q = (angle's step)/dt, but the
error is a difference of white ones: S(f) = (4 Q^2/dt) sin^2(pi f dt) with Q = q dt/sqrt(12) (IEEE
Std 952, quantization), nothing of which is left at low frequencies.
"""

from __future__ import annotations

import numpy as np

from imu_noise_id.effects.output_rounding import OutputRounding
from imu_noise_id.effects.quantization import Quantization
from imu_noise_id.ordinates import cosine_coefficients
from imu_noise_id.recording import Floats

LOWEST = 0.05
"""Frequency, as a part of the rate, from which on spectra are compared: slow noise lies below."""
BINS, LEAST_ORDINATES = 64, 8
MEDIAN = 0.4549364231195728
"""Of a chi-square of one degree: a line in a bin leaves a median where it was."""
EFFICIENCY = 0.368
"""Information on its scale in the median of a chi-square of one degree, of that in the mean."""
CERTAIN, TOLD_APART = 15.0, 5.0
"""Nats for an angle's lattice, which few sensors give while many spectra rise a little; between two
values of Q."""
LEVELS = (1e-4, 2.0, 300)
"""White levels that are tried, of the mean."""
MOST = 2.0
"""Factor by which Q may be off for it to be seen that it is."""
SAME = 0.1
"""Part by which Q may differ from the lattice's: rounding errors are white to a few per cent."""


def of_an_angle(values: Floats, step: float, sample_time_s: float) -> bool:
    """Whether values lie on the lattice of an angle that was rounded, then differenced.

    Nothing but white noise is assumed beneath, of any density.

    Parameters
    ----------
    values : (n,) float64
    step : float
        Of the lattice, in the values' unit.
    sample_time_s : float
    """
    frequency_hz, power, dof = _medians(values, sample_time_s)
    if frequency_hz.size < 8:
        return False
    flat = np.ones(frequency_hz.size)
    floor = OutputRounding(step).added_psd(sample_time_s)
    coefficient = step * sample_time_s / np.sqrt(12.0)
    rising = coefficient**2 * Quantization.law(frequency_hz, sample_time_s)

    mean = float(dof @ power / dof.sum())
    white = float(_loss(max(mean, floor) * flat, power, dof))
    levels = mean * np.geomspace(*LEVELS)[:, np.newaxis]
    known = float(_loss(levels + rising, power, dof).min())
    if known > white - CERTAIN:
        return False
    others = np.geomspace(1.0 / MOST, MOST, 41)
    losses = np.array([_loss(levels + x**2 * rising, power, dof).min() for x in others])
    likeliest = float(np.abs(np.log(others[np.argmin(losses)])))
    return bool(likeliest < SAME or known - losses.min() < TOLD_APART)


def _loss(psd: Floats, power: Floats, dof: Floats) -> Floats:
    """Whittle's negative log-likelihood of each row."""
    return np.asarray(0.5 * (np.log(psd) + power / psd) @ dof)


def angle_note(step: float, sample_time_s: float, unit: str) -> str:
    """What a reader should know of such a lattice."""
    return (
        f"values lie on a lattice of {step:.3g} {unit}: its integral was rounded to "
        f"{step * sample_time_s:.3g} {unit} s, and the output was not"
    )


def _medians(values: Floats, sample_time_s: float) -> tuple[Floats, Floats, Floats]:
    """Middles, powers and degrees of freedom of even bins of ordinates above ``LOWEST``."""
    C = cosine_coefficients(values - values.mean())
    first = int(np.ceil(2.0 * LOWEST * C.size))
    size = max((C.size - first) // BINS, LEAST_ORDINATES)
    count = (C.size - first) // size
    square = C[first : first + count * size].reshape(count, size) ** 2
    middle = first + size * (np.arange(count) + 0.5) - 0.5
    power = np.median(square, axis=1) * sample_time_s / MEDIAN
    frequency_hz = middle / (2.0 * C.size * sample_time_s)
    return np.asarray(frequency_hz), power, np.full(count, EFFICIENCY * size, dtype=np.float64)
