"""Laws of an exponentially forgotten signal, r(h) = Re(a^|h|)."""

from __future__ import annotations

import numpy as np

from imu_noise_id.recording import Floats


def lorentzian(offset_hz: Floats, decay: float, sample_time_s: float) -> tuple[Floats, ...]:
    """PSD of an AR(1) of unit variance about a centre, and its derivatives.

    With rho = exp(-decay), L(g) = dt (1 - rho^2) / ((1 - rho)^2 + 4 rho sin^2(pi g dt)); the sum
    over all aliases of the continuous Lorentzian.

    Parameters
    ----------
    offset_hz : (n,) float64
        g, distance from the centre.
    decay : float
        dt over the correlation time.
    sample_time_s : float

    Returns
    -------
    L, dL/d(log decay), dL/dg : (n,) float64 each
    """
    rho = np.exp(-decay)
    gap = -np.expm1(-decay)
    sine = np.sin(np.pi * sample_time_s * offset_hz)
    denominator = gap**2 + 4.0 * rho * sine**2
    numerator = -np.expm1(-2.0 * decay)
    law = sample_time_s * numerator / denominator
    d_numerator = 2.0 * rho**2
    d_denominator = 2.0 * gap * rho - 4.0 * rho * sine**2
    by_decay = decay * (
        sample_time_s * d_numerator / denominator - law * d_denominator / denominator
    )
    cosine = np.cos(np.pi * sample_time_s * offset_hz)
    by_offset = -law * 8.0 * rho * np.pi * sample_time_s * sine * cosine / denominator
    return law, by_decay, by_offset


def allan_of_geometric(log_pole: complex, m: Floats) -> Floats:
    """Allan variance over m samples of a process with r(h) = Re(exp(log_pole |h|)).

    Sums of m samples have variance V = m (1+a)/(1-a) - 2a (1-a^m)/(1-a)^2, neighbouring sums
    covariance C = a (1-a^m)^2/(1-a)^2, and the Allan variance is Re(V - C)/m^2.  Where m samples
    are under a hundredth of the memory, the series of the same in m |log_pole|.
    """
    a = np.exp(log_pole)
    gap = -np.expm1(log_pole)
    end = -np.expm1(log_pole * m)
    exact = (m * (1.0 + a) / gap - a * end * (2.0 + end) / gap**2) / m**2
    x = -log_pole * m
    series = (2.0 / 3.0) * x * (1.0 + 0.5 / m**2) - x**2 / 2.0 + 7.0 * x**3 / 30.0
    return np.asarray(np.where(np.abs(x) < 0.01, series.real, exact.real))
