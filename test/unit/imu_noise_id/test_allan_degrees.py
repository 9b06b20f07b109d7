"""Intervals of an Allan curve from the spectrum of its record."""

import numpy as np
import pytest
from imu_noise_id.allan import allan
from imu_noise_id.allan_degrees import with_spectrum
from imu_noise_id.ordinates import cosine_coefficients, ordinates
from imu_noise_id.series import Series
from scipy.signal import lfilter

DT = 0.01
COUNT = 4000


@pytest.fixture
def rng():
    return np.random.default_rng(20)


def curves(y):
    """Return the curve of a record as a power law's, and as its spectrum asks."""
    plain = allan(Series(y, np.ones(y.size, dtype=bool), DT))
    return plain, with_spectrum(plain, ordinates(cosine_coefficients(y), DT))


def band(rng, centre_hz=0.5, width_hz=0.1):
    """Return narrow-band noise of unit variance by its recursion."""
    pole = np.exp((-np.pi * width_hz + 2j * np.pi * centre_hz) * DT)
    drive = rng.standard_normal(COUNT + 5000) + 1j * rng.standard_normal(COUNT + 5000)
    noise = lfilter([1.0], [1.0, -pole], drive * np.sqrt(1.0 - abs(pole) ** 2))
    return noise.real[5000:]


def band_deviation(tau_s, centre_hz=0.5, width_hz=0.1):
    """Allan deviation of the band by its autocovariance."""
    out = []
    for m in np.rint(tau_s / DT).astype(int):
        lag = np.arange(-2 * m, 2 * m + 1)
        r = np.exp(-np.pi * width_hz * np.abs(lag) * DT) * np.cos(2 * np.pi * centre_hz * lag * DT)
        box = np.concatenate((-np.ones(m), np.ones(m))) / m
        weight = np.correlate(box, box, "full")
        out.append(np.sqrt(0.5 * weight @ r[1:-1]))
    return np.array(out)


def share_covered(records, truth):
    """Return the shares of averaging times covered by the plain and by the wider intervals."""
    covered = [[], []]
    for y in records:
        for kept, curve in zip(covered, curves(y), strict=True):
            at = truth(curve.tau_s)
            kept.append(np.mean((curve.lower <= at) & (at <= curve.upper)))
    return [float(np.mean(c)) for c in covered]


def test_a_resonance_is_covered_as_often_as_is_said(rng):
    plain, wide = share_covered([band(rng) for _ in range(200)], band_deviation)
    assert plain < 0.8
    assert wide == pytest.approx(0.94, abs=0.04)


def test_white_noise_keeps_its_intervals(rng):
    plain, wide = share_covered(rng.standard_normal((60, COUNT)), lambda t: np.sqrt(DT / t))
    assert wide == pytest.approx(plain, abs=0.02)


def test_no_interval_becomes_shorter(rng):
    for y in (band(rng), np.cumsum(rng.standard_normal(COUNT)), rng.standard_normal(COUNT)):
        plain, wide = curves(y)
        assert np.all(wide.lower <= plain.lower * (1 + 1e-12))
        assert np.all(wide.upper >= plain.upper * (1 - 1e-12))
