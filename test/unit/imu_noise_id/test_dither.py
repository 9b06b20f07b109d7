"""A record whose spectrum ends in a zero gets a floor; others stay as they are."""

import numpy as np
import pytest
from imu_noise_id.dither import dithered
from imu_noise_id.effects.bandwidth_limit import DigitalBandwidthLimit
from imu_noise_id.ordinates import cosine_coefficients, ordinates
from scipy import signal

from helpers.noise_records import DT, walk, white

N = 60000


def test_records_that_reach_half_the_rate_stay_as_they_are() -> None:
    rng = np.random.default_rng(1)
    slow = signal.lfilter(*signal.butter(2, 1.0, fs=2000.0), rng.standard_normal(20 * N))[::20]
    for values in (white(N, rng), white(32, rng), walk(N, rng, 1.0), slow):
        same, coefficients, psd = dithered(values, DT, rng)
        assert same is values
        np.testing.assert_array_equal(coefficients, cosine_coefficients(values))
        assert psd == 0.0


@pytest.mark.parametrize("n", [6000, 60000])
@pytest.mark.parametrize("corner_hz", [10.0, 20.0, 40.0])
def test_every_ordinate_of_a_digital_filter_is_what_its_law_says(n: int, corner_hz: float) -> None:
    """Without the floor the last bin holds more than its law: ends of the record, width."""
    rng = np.random.default_rng(2)
    ratio, bare = [], []
    for _ in range(20):
        drive = white(n + 500, rng)
        x = signal.lfilter(*signal.butter(2, corner_hz, fs=1 / DT), drive)[500:]
        _, coefficients, floor = dithered(x, DT, rng)
        bins = ordinates(coefficients, DT)
        law = DigitalBandwidthLimit(corner_hz, 2).power_response(bins.frequency_hz, DT)
        ratio.append(bins.power / (law + floor))
        bare.append(ordinates(cosine_coefficients(x), DT).power / law)
    last = slice(-20, None)
    error = np.sqrt(2.0 / (20 * bins.dof[last]))
    assert np.all(np.abs(np.mean(ratio, axis=0)[last] - 1.0) < 5.0 * error)
    assert np.mean(bare, axis=0)[-1] > 1.2
