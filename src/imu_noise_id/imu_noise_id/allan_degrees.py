"""Degrees of freedom of an Allan curve, from the record's own spectrum.

Greenhall and Riley's are those of power laws.  Where a resonance carries the curve, far fewer
squared differences are independent, and the interval for a power law is too short (a band of 4/T:
0.78 covered in place of 0.95).  The Allan variance is a weighted sum of spectral ordinates,

    sigma^2(tau) ~ sum nu_k S_k K_k,   K = sin^4(pi f tau)/sin^2(pi f dt),

each S_k times chi-square over its degrees of freedom, so that

    edf = (sum nu S K)^2 / sum nu S^2 K^2,

with P_k for S_k and P_k^2/(1 + 2/nu_k), which is S_k^2 on average, for its square.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy import special

from imu_noise_id.allan import AllanCurve
from imu_noise_id.ordinates import Ordinates
from imu_noise_id.recording import Floats

_FOURTH = np.array((3.0, -4.0, 1.0)) / 8.0
_EIGHTH = np.array((35.0, -56.0, 28.0, -8.0, 1.0)) / 128.0
"""sin^4 x and sin^8 x as cosines of 2 j x."""


def with_spectrum(curve: AllanCurve, ordinates: Ordinates) -> AllanCurve:
    """Return the curve with intervals as wide as its spectrum asks, never shorter.

    Parameters
    ----------
    curve : AllanCurve
    ordinates : Ordinates
        Of the same record; averaging times under its sample time are left as they are.
    """
    seen = np.array([_spectral_edf(ordinates, tau) for tau in curve.tau_s])
    left = np.maximum(1.0 - 2.0 * curve.tau_s / ordinates.duration_s, 0.0)
    spectral = np.where(curve.tau_s >= 0.999 * ordinates.sample_time_s, left * seen, np.inf)
    edf = np.maximum(np.minimum(spectral, curve.degrees_of_freedom), 1.0)
    tail = 0.5 * (1.0 - curve.confidence)
    return dataclasses.replace(
        curve,
        degrees_of_freedom=edf,
        lower=curve.deviation * np.sqrt(edf / special.chdtri(edf, tail)),
        upper=curve.deviation * np.sqrt(edf / special.chdtri(edf, 1.0 - tail)),
    )


def _spectral_edf(ordinates: Ordinates, tau_s: float) -> float:
    """Return (sum nu S K)^2/sum nu S^2 K^2; the sines averaged over each bin."""
    nu, power = ordinates.dof, ordinates.power
    angle = np.pi * tau_s * ordinates.frequency_hz
    half_bin = np.pi * tau_s * 0.25 * np.maximum(nu - 1.0, 0.0) / ordinates.duration_s
    pole = np.sin(np.pi * ordinates.sample_time_s * ordinates.frequency_hz) ** 2
    once = _averaged(_FOURTH, angle, half_bin) / pole
    twice = _averaged(_EIGHTH, angle, half_bin) / pole**2
    mean = float(np.sum(nu * power * once))
    square = float(np.sum(nu * power**2 / (1.0 + 2.0 / np.maximum(nu, 1e-9)) * twice))
    return mean * mean / square if square > 0.0 else np.inf


def _averaged(series: Floats, angle: Floats, half_bin: Floats) -> Floats:
    """Mean of sum_j series_j cos(2 j x) over x = angle -+ half_bin, at least 0."""
    total = np.full_like(angle, series[0])
    for j, factor in enumerate(series[1:], 1):
        total += factor * np.cos(2.0 * j * angle) * np.sinc(2.0 * j * half_bin / np.pi)
    return np.maximum(total, 0.0)
