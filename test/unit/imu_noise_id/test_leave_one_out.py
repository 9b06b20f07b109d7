"""What a sample is less what the others say of it: a hit whole, and the least noise there is."""

import numpy as np
import pytest
from imu_noise_id.leave_one_out import misfits
from scipy.signal import lfilter

N = 40_000


def coloured(name: str, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Noise, and the deviation of a sample from its mean given all the others."""
    w = rng.standard_normal(N)
    if name == "white":
        return w, 1.0
    if name == "autoregressive":  # x_t given both neighbours: 1/(1 + a^2)
        return lfilter([1.0], [1.0, -0.8], w), float(1.0 / np.sqrt(1.64))
    walk = np.cumsum(rng.standard_normal(N))  # harmonic mean of 1 + 1/(2 - 2 cos w): sqrt(0.2)
    return w + walk, float(np.sqrt(1.0 / (1.0 - np.sqrt(0.2))))


@pytest.mark.parametrize("name", ["white", "autoregressive", "walk"])
def test_what_is_left_is_gaussian_with_the_least_deviation_of_any_filter(name: str) -> None:
    noise, least = coloured(name, np.random.default_rng(1))
    left = misfits(noise, np.zeros(N, dtype=bool))
    assert left.std() == pytest.approx(least, rel=0.02)
    assert np.mean(left**4) / np.mean(left**2) ** 2 == pytest.approx(3.0, abs=0.12)


@pytest.mark.parametrize("name", ["white", "autoregressive", "walk"])
def test_a_hit_is_left_whole_and_beside_it_nothing(name: str) -> None:
    noise, least = coloured(name, np.random.default_rng(2))
    doubtful = np.zeros(N, dtype=bool)
    doubtful[500::1000] = True
    hit = noise + 50.0 * doubtful
    left = misfits(hit, doubtful)
    assert left[doubtful].mean() == pytest.approx(50.0, abs=4.0 * least / np.sqrt(40.0))
    beside = np.roll(doubtful, 1)
    assert np.abs(left[beside]).max() < 4.5 * least


def test_what_a_low_pass_took_is_no_exact_knowledge() -> None:
    """But near the ends, which every finite record has."""
    rng = np.random.default_rng(3)
    smooth = np.convolve(rng.standard_normal(N + 400), np.hanning(41), mode="valid")[:N]
    left = misfits(smooth, np.zeros(N, dtype=bool))[256:-256]
    assert np.abs(left).max() < 5.5 * left.std()


def test_a_hit_on_noise_that_was_filtered_leaves_its_neighbours_alone() -> None:
    rng = np.random.default_rng(4)
    smooth = np.convolve(rng.standard_normal(N + 400), np.hanning(7), mode="valid")[:N]
    doubtful = np.zeros(N, dtype=bool)
    doubtful[500::1000] = True
    clean = misfits(smooth, np.zeros(N, dtype=bool))
    left = misfits(smooth + 20.0 * doubtful, doubtful)
    near = np.abs(np.arange(N) % 1000 - 500) < 20
    assert np.abs(left[near & ~doubtful]).max() < 6.0 * clean[256:-256].std()
    assert left[doubtful].mean() == pytest.approx(20.0, abs=0.05)
