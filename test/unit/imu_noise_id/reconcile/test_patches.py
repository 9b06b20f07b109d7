"""A band that is louder for a while is found, where the whole spectrum and the variance are not."""

import numpy as np
from imu_noise_id.reconcile.patches import band_gain, gain_of_fast, loudest_patch
from scipy import fft

DT, COUNT = 0.01, 32_000
HALF = slice(COUNT // 2, COUNT)


def rising_tone(rate_hz_s: float) -> np.ndarray:
    """A tone from half-way on, from 20 Hz upwards, a tenth of white noise's power."""
    t = np.arange(COUNT // 2) * DT
    tone = np.zeros(COUNT)
    tone[HALF] = np.sqrt(0.2) * np.sin(2.0 * np.pi * (20.0 * t + 0.5 * rate_hz_s * t**2))
    return tone


def test_a_tone_that_begins_half_way_and_drifts_is_a_patch_and_no_louder_noise():
    for seed in range(5):
        noise = np.random.default_rng(seed).standard_normal(COUNT)
        white = noise + rising_tone(0.03)
        patch = loudest_patch(white, DT)
        assert patch.net > 40.0
        assert patch.ratio > 1.5
        assert patch.low_hz > 18.0
        assert patch.high_hz < 27.0
        assert patch.first > 0.4 * COUNT
        whole, band = band_gain(white, HALF.start, HALF.stop)
        assert band > 2.0 * whole


def test_noise_that_is_louder_at_all_frequencies_is_louder_noise():
    for seed in range(5):
        white = np.random.default_rng(seed).standard_normal(COUNT)
        white[HALF] *= np.sqrt(1.1)
        whole, band = band_gain(white, HALF.start, HALF.stop)
        assert whole > band


def test_white_noise_has_patches_as_rare_as_their_price_says():
    rng = np.random.default_rng(1)
    net = [loudest_patch(rng.standard_normal(2_000), DT).net for _ in range(400)]
    # beyond the price a maximum's tail is that of one exponential: its mean excess is near 1
    start = np.quantile(net, 0.8)
    excess = np.array([v - start for v in net if v > start])
    assert 0.7 < excess.mean() < 1.6  # standard error 0.12


def test_the_side_outside_which_the_power_is_the_models_is_taken():
    white = np.random.default_rng(2).standard_normal(COUNT)
    white[: COUNT // 4] = np.random.default_rng(3).standard_normal(COUNT // 4)
    tone = rising_tone(0.0)
    early = loudest_patch((white + tone)[::-1], DT)
    late = loudest_patch(white + tone, DT)
    assert (early.first, late.last) == (0, COUNT)
    assert early.ratio > 1.0
    assert late.ratio > 1.0


def test_a_record_of_a_few_samples_has_a_patch():
    for count in (12, 32, 65, 300):
        patch = loudest_patch(np.random.default_rng(count).standard_normal(count), DT)
        assert np.isfinite(patch.net)
        assert 0 <= patch.first < patch.last <= count


def test_a_window_of_a_few_samples_has_no_bands():
    white = np.random.default_rng(4).standard_normal(300)
    for last in (1, 2, 3, 5, 31, 60, 295, 299):
        whole, band = band_gain(white, 0, last)
        assert np.isfinite(whole)
        assert band < 15.0


def test_louder_fast_noise_beneath_slow_noise_is_told_from_one_band():
    share = np.linspace(0.0, 1.0, COUNT) ** 2  # of the power that is fast
    for seed in range(5):
        rng = np.random.default_rng(seed)
        fast = fft.idct(np.sqrt(share) * rng.standard_normal(COUNT), norm="ortho")
        slow = fft.idct(np.sqrt(1.0 - share) * rng.standard_normal(COUNT), norm="ortho")
        fast[HALF] *= np.sqrt(1.3)
        _, band = band_gain(fast + slow, HALF.start, HALF.stop)
        assert gain_of_fast(fast + slow, HALF.start, HALF.stop, share) > band
        tone = rng.standard_normal(COUNT) + rising_tone(0.03)
        _, band = band_gain(tone, HALF.start, HALF.stop)
        assert gain_of_fast(tone, HALF.start, HALF.stop, share) < 0.5 * band
