"""Effects that are read from the samples: rounding, holds, clipping, outliers, bursts, steps."""

from __future__ import annotations

import numpy as np
import pytest
from imu_noise_id.effects.bias_step import BiasStep, step_scan
from imu_noise_id.effects.cross_axis import correlation, joint_drives
from imu_noise_id.effects.held_samples import HeldSamples, held_factor
from imu_noise_id.effects.outliers import Outliers, outlier_mask, outlier_parameters
from imu_noise_id.effects.output_rounding import OutputRounding, rounding_step
from imu_noise_id.effects.rate_ramp import RateRamp, ramp_slope
from imu_noise_id.effects.saturation import Saturation, one_sided_limit, saturation_limit
from imu_noise_id.effects.temperature import Temperature, temperature_coefficient
from imu_noise_id.effects.variance_change import VarianceChange, variance_scan

N, DT = 40_000, 0.005
TIME = np.arange(N) * DT


@pytest.fixture
def noise() -> np.ndarray:
    return np.random.default_rng(1).standard_normal(N)


@pytest.mark.parametrize("step", [0.05, 0.3, 1.0, 3.0])
@pytest.mark.parametrize("offset", [0.0, 9.80665])
def test_a_comb_gives_back_its_step(noise: np.ndarray, step: float, offset: float) -> None:
    values = np.floor(noise / step) * step + offset
    assert rounding_step(values) == pytest.approx(step, rel=1e-6)


def test_a_comb_with_outliers_off_it_is_still_seen(noise: np.ndarray) -> None:
    values = np.rint(noise / 0.3) * 0.3
    values[::1000] += 17.123456
    assert rounding_step(values) == pytest.approx(0.3, rel=1e-4)


def test_no_comb_is_seen_in_doubles_nor_in_floats(noise: np.ndarray) -> None:
    assert rounding_step(noise) is None
    assert rounding_step(noise.astype(np.float32).astype(float)) is None


def test_rounding_adds_a_twelfth_of_its_square(noise: np.ndarray) -> None:
    rounded = OutputRounding(0.5).apply(noise, TIME, DT, np.random.default_rng(0))
    assert np.var(rounded - noise) == pytest.approx(0.25 / 12.0, rel=0.02)
    assert OutputRounding(0.5).added_psd(DT) == pytest.approx(0.25 / 12.0 * DT)


@pytest.mark.parametrize("factor", [2.0, 3.0, 2.5, 10.0])
def test_a_hold_gives_back_its_factor(noise: np.ndarray, factor: float) -> None:
    _, index = HeldSamples(factor).transport(TIME, DT, np.random.default_rng(0))
    assert held_factor([noise[index]]) == pytest.approx(factor, rel=0.01)


def test_rounding_alone_is_no_hold(noise: np.ndarray) -> None:
    assert held_factor([np.rint(noise * 2.0)]) == pytest.approx(1.0, abs=0.02)


def test_a_hold_under_coarse_rounding_is_seen(noise: np.ndarray) -> None:
    _, index = HeldSamples(2.0).transport(TIME, DT, np.random.default_rng(0))
    assert held_factor([np.rint(noise * 2.0)[index]]) == 2.0


def test_clipping_is_seen_where_values_pile_up(noise: np.ndarray) -> None:
    clipped = Saturation(2.0).apply(noise, TIME, DT, np.random.default_rng(0))
    limit, count = saturation_limit(clipped)
    assert limit == 2.0
    assert count > 500
    assert saturation_limit(noise) == (None, 0)
    assert saturation_limit(np.rint(noise * 3.0)) == (None, 0)


@pytest.mark.parametrize("mean", [0.5, 9.8])
def test_what_is_clipped_on_one_side_has_a_full_scale_only_if_the_other_stays_within(
    noise: np.ndarray, mean: float
) -> None:
    low, high = mean + np.maximum(noise, -1.5), mean + np.minimum(noise, 1.5)
    assert saturation_limit(low) == (None, 0)
    assert one_sided_limit(low) == mean - 1.5
    beyond = np.abs(high).max() > mean + 1.5  # about zero, of 4 sigma the other way
    assert (saturation_limit(high)[0] is None) == beyond
    assert one_sided_limit(mean + noise) is None


def test_outliers_give_back_rate_and_scale(noise: np.ndarray) -> None:
    hit = Outliers(2e-3, 12.0).apply(noise, TIME, DT, np.random.default_rng(2))
    mask = outlier_mask(hit)
    rate, scale = outlier_parameters(hit[mask], N, 1.0)
    assert rate == pytest.approx(2e-3, rel=0.35)
    assert scale == pytest.approx(12.0, rel=0.3)
    assert not outlier_mask(noise).any()


def test_a_burst_gives_back_window_and_ratio(noise: np.ndarray) -> None:
    loud = VarianceChange(50.0, 80.0, 2.0).apply(noise, TIME, DT, np.random.default_rng(0))
    first, last, ratio, gain, _ = variance_scan(loud)
    assert first * DT == pytest.approx(50.0, abs=2.0)
    assert last * DT == pytest.approx(80.0, abs=2.0)
    assert ratio == pytest.approx(2.0, rel=0.1)
    assert gain > 300.0
    assert variance_scan(noise)[3] < 15.0


def test_a_step_gives_back_time_and_height(noise: np.ndarray) -> None:
    index, height, score = step_scan(noise + BiasStep(60.0, 0.3).course(TIME, None))
    assert index * DT == pytest.approx(60.0, abs=1.0)
    assert height == pytest.approx(0.3, abs=0.04)
    assert score > 10.0
    assert step_scan(noise)[2] < 5.0


def test_slopes_on_time_and_temperature_are_read(noise: np.ndarray) -> None:
    degc = 20.0 + 5.0 * (1.0 - np.exp(-TIME / 60.0))
    assert ramp_slope(TIME, noise + RateRamp(0.01).course(TIME, None)) == pytest.approx(
        0.01, abs=3e-4
    )
    warm = noise + Temperature(-0.4).course(TIME, degc)
    assert temperature_coefficient(warm, degc) == pytest.approx(-0.4, abs=0.02)
    assert np.all(Temperature(-0.4).course(TIME, None) == 0.0)


def test_joint_drives_have_unit_variance_and_the_correlations() -> None:
    wanted = np.array([[1.0, 0.6, 0.0], [0.6, 1.0, -0.3], [0.0, -0.3, 1.0]])
    drives = joint_drives(wanted, N, np.random.default_rng(3))
    np.testing.assert_allclose(np.cov(drives), wanted, atol=0.03)
    value, error = correlation(drives[0], drives[1])
    assert value == pytest.approx(0.6, abs=4.0 * error)


def test_correlations_that_no_channels_can_have_are_replaced_by_near_ones() -> None:
    impossible = np.array([[1.0, 0.9, -0.9], [0.9, 1.0, 0.9], [-0.9, 0.9, 1.0]])
    drives = joint_drives(impossible, N, np.random.default_rng(3))
    np.testing.assert_allclose(drives.var(axis=1), 1.0, atol=0.05)


def wander(seed: int) -> list[np.ndarray]:
    """Three positions at 5 Hz: white noise of centimetres on courses of decimetres in minutes."""
    rng = np.random.default_rng(seed)
    steps = rng.standard_normal((3, 18_000)) * 0.02
    keep = np.exp(-np.arange(1_500) / 150.0)
    slow = [np.convolve(s, keep)[: s.size] for s in steps]
    return [s + w for s, w in zip(slow, 0.012 * rng.standard_normal((3, 18_000)), strict=True)]


@pytest.mark.parametrize("step", [0.02, 0.05, 0.1, 0.2])
def test_a_slow_course_that_is_rounded_is_no_hold(step: float) -> None:
    for seed in range(3):
        assert held_factor([step * np.rint(v / step) for v in wander(seed)]) == 1.0


@pytest.mark.parametrize("factor", [2, 3, 5])
def test_a_slow_course_that_is_rounded_and_held_gives_back_the_factor(factor: int) -> None:
    index = np.arange(18_000) // factor * factor
    assert held_factor([0.03 * np.rint(v[index] / 0.03) for v in wander(4)]) == factor


def test_a_comb_is_seen_through_the_conversion_of_a_frame() -> None:
    east, north = (0.05 * np.rint(v / 0.05) for v in wander(5)[:2])
    turned = (east + 1e-8 * north + 4.5e6) - 4.5e6  # another axis' nanometres, lost digits
    assert np.unique(turned).size > 2 * np.unique(east).size
    assert rounding_step(turned) == pytest.approx(0.05, rel=1e-6)
