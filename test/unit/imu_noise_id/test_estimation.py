"""imu_noise_id.estimation: what missing samples do to names and intervals."""

from __future__ import annotations

import numpy as np
import pytest
from imu_noise_id.estimation import SeriesModel, estimate_series
from imu_noise_id.series import Series
from scipy.signal import butter, lfilter

RATE_HZ, DENSITY, SAMPLES, RECORDS = 100.0, 0.1, 2000, 8


def white_with_losses(share: float, together: int, seed: int) -> SeriesModel:
    """White noise of which a share is lost, so many samples together."""
    rng = np.random.default_rng([41, seed])
    values = DENSITY * np.sqrt(RATE_HZ) * rng.standard_normal(SAMPLES)
    observed = np.repeat(rng.random(SAMPLES // together) > share, together)
    values[~observed] = 0.0
    return estimate_series(Series(values, observed, 1.0 / RATE_HZ), "u", rng)


@pytest.mark.parametrize("together", [1, 100])
def test_white_noise_of_which_two_fifths_are_lost_is_white_noise(together: int) -> None:
    inside = 0
    for seed in range(RECORDS):
        (only,) = white_with_losses(0.4, together, seed).effects
        assert only.name == "white_noise"
        (density,) = only.estimates
        assert density.lower is not None
        assert density.upper is not None
        inside += density.lower <= DENSITY <= density.upper
    assert inside >= RECORDS - 2


def test_an_interval_is_wider_by_what_lost_samples_cost() -> None:
    def relative(share: float) -> float:
        (density,) = white_with_losses(share, 1, 0).effects[0].estimates
        assert density.std_error is not None
        return density.std_error / float(density.value)

    whole = relative(0.0)
    assert whole == pytest.approx(np.sqrt(0.5 / SAMPLES), rel=0.02)
    # seen samples alone: 1/sqrt(0.9); with the scatter of what is drawn somewhat more
    assert 1.06 < relative(0.1) / whole < 1.3


@pytest.mark.parametrize("share", [0.003, 0.05, 0.2])
@pytest.mark.parametrize(("order", "corner"), [(1, 0.2), (2, 0.1)])
def test_a_digital_low_pass_is_found_though_samples_are_lost(
    share: float, order: int, corner: float
) -> None:
    rng = np.random.default_rng([42, order])
    drive = rng.standard_normal(32_000)
    values = lfilter(*butter(order, corner, fs=1.0), drive)[2000:]
    observed = rng.random(values.size) > share
    series = Series(np.where(observed, values, 0.0), observed, 1.0 / RATE_HZ)
    white, limit = estimate_series(series, "u", rng).effects
    assert (white.name, limit.name) == ("white_noise", "bandwidth_limit")
    assert float(white.estimates[0].value) == pytest.approx(RATE_HZ**-0.5, rel=0.05)
    if share < 0.2:  # a fifth lost leaves first order's corner a wide place
        assert float(limit.estimates[0].value) == pytest.approx(corner * RATE_HZ, rel=0.03)
