"""The spread of Gaussian samples is known through rounding as coarse as they are."""

import numpy as np
import pytest
from imu_noise_id.estimation import estimate_series
from imu_noise_id.rounded import rounded_noise
from imu_noise_id.series import Series

SAMPLES, RECORDS = 20_000, 16


def rounded(coarse, place, seed):
    """Samples of unit deviation, rounded in steps of ``coarse``, the mean ``place`` steps off."""
    samples = np.random.default_rng([71, seed]).standard_normal(SAMPLES)
    return coarse * np.rint(samples / coarse + place)


def test_fine_rounding_is_left_to_bennett():
    assert rounded_noise(rounded(1.4, 0.3, 0), 1.4) is None


@pytest.mark.parametrize("place", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("coarse", [2.0, 3.0, 4.0])
def test_the_frequencies_of_the_values_say_the_spread(coarse, place):
    found = [rounded_noise(rounded(coarse, place, k), coarse) for k in range(RECORDS)]
    z = [np.log(f.sigma) / f.relative_error for f in found]
    assert abs(np.mean(z)) < 3.5 / np.sqrt(RECORDS)
    assert 0.5 < np.std(z) < 1.6
    for k, f in enumerate(found):
        variance = np.var(rounded(coarse, place, k))
        assert f.added == pytest.approx(variance - f.sigma**2, abs=0.03 * variance)
        assert f.worth <= 1.0


def test_a_mean_that_wanders_over_the_steps_costs_no_bias():
    walk = np.cumsum(np.random.default_rng(72).standard_normal(SAMPLES)) * 0.01
    values = 2.5 * np.rint((np.random.default_rng(73).standard_normal(SAMPLES) + walk) / 2.5)
    noise = rounded_noise(values, 2.5)
    # 128 samples of the walk have a variance of 128/6 of a step's about their mean
    assert noise.sigma == pytest.approx(np.sqrt(1.0 + 1e-4 * 128 / 6), rel=0.03)


@pytest.mark.parametrize("coarse", [0.1, 1.0, 2.0, 3.0, 4.0])
def test_white_noise_is_that_before_rounding(coarse):
    inside = 0
    for k in range(RECORDS):
        values = rounded(coarse, k / RECORDS, k)
        series = Series(values, np.ones(SAMPLES, dtype=bool), 0.01)
        found = estimate_series(series, "u", np.random.default_rng(k))
        assert [e.name for e in found.effects] == ["white_noise", "output_rounding"]
        density = found.effects[0].estimates[0]
        assert density.value == pytest.approx(0.1, rel=0.12)
        inside += density.lower < 0.1 < density.upper
    assert inside >= RECORDS - 3


def test_what_is_hidden_is_said_to_be_at_most():
    series = Series(rounded(6.0, 0.5, 0), np.ones(SAMPLES, dtype=bool), 0.01)
    (note,) = estimate_series(series, "u", np.random.default_rng(0)).notes
    assert float(note.split("at most ")[1].split()[0]) > 0.1


def test_steps_may_lie_halfway_between_the_multiples():
    places = [rounded(3.0, 0.2, 1), rounded(3.0, 0.2, 1) + 1.5]
    here, halfway = (rounded_noise(values, 3.0) for values in places)
    assert halfway.sigma == pytest.approx(here.sigma, rel=1e-6)
