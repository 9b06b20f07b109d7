"""The displayed spectrum has the right level, its intervals cover, and gaps do not stop it."""

import numpy as np
import pytest
from imu_noise_id.series import Series
from imu_noise_id.spectrum import block_means, bridged, spectrum
from scipy import signal


def series_of(values, observed=None, sample_time_s=0.01):
    observed = np.ones(values.size, dtype=bool) if observed is None else observed
    return Series(np.where(observed, values, 0.0), observed, sample_time_s)


def test_is_half_of_scipys_one_sided_density():
    values = np.random.default_rng(1).standard_normal(60_000) + 9.81
    found = spectrum(series_of(values))
    frequency_hz, one_sided = signal.welch(values, 100.0, nperseg=4096)
    high = (found.frequency_hz > 5.0) & (found.frequency_hz < 45.0)
    expected = np.mean(one_sided[(frequency_hz > 5.0) & (frequency_hz < 45.0)]) / 2.0
    weight = found.degrees_of_freedom[high]
    assert np.average(found.psd[high], weights=weight) == pytest.approx(expected, rel=0.02)


def test_follows_an_autoregression_over_four_decades_and_covers_it():
    rng = np.random.default_rng(2)
    pole = np.exp(-0.01 / 2.0)
    inside = []
    for _ in range(6):
        values = signal.lfilter([1.0], [1.0, -pole], rng.standard_normal(400_000))
        found = spectrum(series_of(values))
        z = np.exp(-2j * np.pi * found.frequency_hz * 0.01)
        truth = 0.01 / np.abs(1.0 - pole * z) ** 2
        inside.append((found.lower < truth) & (truth < found.upper))
    assert found.frequency_hz[0] < 4e-3
    assert found.frequency_hz[-1] > 45.0
    assert np.all(np.diff(found.frequency_hz) > 0)
    assert 0.90 < np.mean(inside) < 0.985


def test_intervals_cover_white_noise():
    rng = np.random.default_rng(3)
    inside = []
    for _ in range(100):
        found = spectrum(series_of(rng.standard_normal(4000)))
        inside.append((found.lower < 0.01) & (found.upper > 0.01))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.015)


def test_gaps_leave_the_level():
    rng = np.random.default_rng(4)
    values = rng.standard_normal(100_000)
    observed = rng.random(100_000) > 0.03
    observed[30_000:45_000] = False
    found = spectrum(series_of(values, observed))
    weight = found.degrees_of_freedom
    assert np.average(found.psd, weights=weight) == pytest.approx(0.01, rel=0.06)


@pytest.mark.parametrize("size", [0, 1, 40])
def test_too_short_is_empty_and_says_so(size):
    found = spectrum(series_of(np.zeros(size)))
    assert found.psd.size == 0
    assert "too short" in found.note


def test_block_means_use_what_was_observed():
    observed = np.ones(12, dtype=bool)
    observed[[1, 4, 5]] = False
    found = block_means(series_of(np.arange(12.0) + 1e6, observed, 0.5), 4)
    np.testing.assert_array_equal(found.observed, [True, False, True])
    np.testing.assert_allclose(found.values[[0, 2]], [1e6 + 5 / 3, 1e6 + 9.5])
    assert found.sample_time_s == 2.0


def test_bridging_is_straight():
    observed = np.array([True, False, False, True])
    np.testing.assert_allclose(bridged(np.array([0.0, 7, 7, 3.0]), observed), [0, 1, 2, 3])
