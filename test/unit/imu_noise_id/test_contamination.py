"""Outliers and rounding are seen in the samples; clean noise has neither."""

import numpy as np
import pytest
from imu_noise_id.contamination import deviation_from_medians, find_contamination
from imu_noise_id.series import Series

from helpers.noise_records import series, walk, white

N = 60000


def test_clean_noise_has_none():
    rng = np.random.default_rng(51)
    for _ in range(20):
        found = find_contamination(series(white(N, rng) + walk(N, rng, 1.0)), "u")
        assert found.effects == ()
        assert found.observed.all()


def test_outliers_are_masked_and_counted():
    rng = np.random.default_rng(52)
    values = white(N, rng)
    hit = rng.random(N) < 1e-3
    values[hit] += 200.0 * rng.standard_normal(hit.sum())
    found = find_contamination(series(values), "u")
    (effect,) = found.effects
    rate, scale = effect.estimates
    assert rate.lower < 1e-3 < rate.upper
    assert scale.lower * 0.9 < 200.0 < scale.upper * 1.1
    assert not found.observed[np.abs(values) > 51.0].any()


def test_a_louder_stretch_is_no_outlier():
    rng = np.random.default_rng(53)
    values = white(N, rng)
    values[20000:20400] *= 6.0
    found = find_contamination(series(values), "u")
    assert found.observed.all()


def test_a_fifth_of_the_record_that_is_three_times_as_loud_is_no_outlier():
    rng = np.random.default_rng(55)
    values = white(N, rng)
    values[20000:32000] *= 3.0
    found = find_contamination(series(values), "u")
    assert found.observed.all()
    assert found.effects == ()
    assert any("louder" in note for note in found.notes)


def test_a_driver_that_glitches_for_a_while_gives_outliers():
    rng = np.random.default_rng(57)
    values = white(N, rng)
    hit = np.flatnonzero(rng.random(N // 4) < 2e-3)
    values[hit] += 200.0 * rng.standard_normal(hit.size)
    found = find_contamination(series(values), "u")
    assert [e.name for e in found.effects] == ["outliers"]
    assert not found.observed[np.abs(values) > 51.0].any()


def test_a_wide_tail_is_no_outlier():
    rng = np.random.default_rng(56)
    found = find_contamination(series(rng.laplace(size=N)), "u")
    assert found.effects == ()
    assert found.observed.all()


@pytest.mark.parametrize("law", ["student", "laplace"])
def test_heavy_tails_are_said_to_be_that_and_are_no_outliers(law):
    rng = np.random.default_rng(60)
    values = rng.standard_t(8, N) if law == "student" else rng.laplace(size=N)
    found = find_contamination(series(values), "u")
    assert found.effects == ()
    assert found.observed.all()
    (note,) = found.notes
    assert "heavy-tailed" in note
    said = float(note.split("kurtosis ")[1].split(",")[0])
    assert said == pytest.approx(np.mean(values**4) / np.mean(values**2) ** 2, rel=0.03)


def test_one_sample_of_an_hour_at_ten_hertz_is_no_evidence_at_5_7_sigma():
    """A median of 20 samples is drawn to its own: what is left looks 6 % quieter than it is."""
    for seed in range(10):
        values = np.random.default_rng([61, seed]).standard_normal(36_000)
        values[20_005] = 5.7
        slow = Series(values, np.ones(36_000, dtype=bool), 0.1)
        assert find_contamination(slow, "u").effects == ()


@pytest.mark.parametrize("law", ["normal", "hollow", "uniform", "fixed"])
def test_rate_and_scale_of_hits_are_in_their_intervals_whatever_the_law(law):
    rng = np.random.default_rng([62, len(law)])
    rate, sign = 0.004, rng.choice([-1.0, 1.0], N)
    sizes = {
        "normal": 6.0 * rng.standard_normal(N),
        "hollow": sign * rng.uniform(3.5, 7.0, N),
        "uniform": sign * rng.uniform(0.0, 25.0, N),
        "fixed": sign * 8.0,
    }[law]
    hit = rng.random(N) < rate
    noise = rng.standard_normal(N) + 0.1 * np.cumsum(rng.standard_normal(N))
    found = find_contamination(series(noise + hit * sizes), "u")
    (effect,) = found.effects
    for said, true in zip(effect.estimates, (rate, np.sqrt(np.mean(sizes**2))), strict=True):
        assert said.lower < true < said.upper
        assert said.upper < 2.5 * said.lower
    both = found.observed[1:] & found.observed[:-1]
    steps = np.diff(noise + hit * sizes)[both]
    assert steps.var() == pytest.approx(np.diff(noise).var(), rel=0.01)


@pytest.mark.parametrize("step", [2.0, 5.0])
def test_hits_beyond_a_coarse_rounding_have_their_rate_and_scale(step):
    rng = np.random.default_rng([63, round(step)])
    hit = rng.random(N) < 0.005
    values = rng.standard_normal(N) + hit * 30.0 * rng.standard_normal(N)
    found = find_contamination(series(step * np.rint(values / step)), "u")
    effect = found.effects[0]
    assert effect.name == "outliers"
    for said, true in zip(effect.estimates, (0.005, 30.0), strict=True):
        assert said.lower < true < said.upper
        assert said.value == pytest.approx(true, rel=0.3)


def test_rounding_is_seen_and_its_error_subtracted():
    rng = np.random.default_rng(54)
    found = find_contamination(series(4.0 * np.rint(white(N, rng) / 4.0)), "u")
    assert found.effects[0].effect.values() == (4.0,)
    assert np.isclose(found.floor, 16.0 / 12.0 * 0.01)


@pytest.mark.parametrize("size", [200, 201])
def test_the_course_of_the_medians_is_straight_between_the_middles_of_the_blocks(size: int) -> None:
    values = np.cumsum(np.random.default_rng(5).standard_normal(5 * size + 17))
    medians = np.median(values[: 5 * size].reshape(5, size), axis=1)
    middles = (np.arange(5) + 0.5) * size - 0.5
    course = np.interp(np.arange(values.size), middles, medians)
    np.testing.assert_allclose(deviation_from_medians(values, 2.0 / size), values - course)


@pytest.mark.parametrize("steps", [0.4, 0.5, 0.7, 1.0, 1.4])
def test_rounded_noise_has_no_outliers(steps):
    for seed in range(8):
        rng = np.random.default_rng([58, seed])
        sigma = np.std(white(N, rng))
        values = steps * sigma * np.rint(white(N, rng) / (steps * sigma) + seed / 8)
        found = find_contamination(series(values), "u")
        assert [e.name for e in found.effects] == ["output_rounding"]
        assert found.observed.all()


def test_a_median_between_two_steps_hides_no_rounding():
    rng = np.random.default_rng(59)
    half = np.abs(np.rint(white(N // 2, rng) / 10.0)) + 0.0
    values = rng.permutation(np.concatenate((half + 1.0, -half)))  # as many above a half as beneath
    assert np.median(values) == 0.5
    found = find_contamination(series(values), "u")
    assert "output_rounding" in [e.name for e in found.effects]
