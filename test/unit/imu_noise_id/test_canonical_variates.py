"""Lagged products of long records, and the factor made of them."""

import numpy as np
import pytest
from imu_noise_id.canonical_variates import DATA_ROWS, STRETCH, scan, warm_up

from imu_noise_id import canonical_variates

LAGS = 7


@pytest.mark.parametrize("size", [LAGS, STRETCH - 1, STRETCH, STRETCH + 3, 3 * STRETCH + 5])
def test_lagged_products_are_the_sums_over_the_whole_record(size: int) -> None:
    late, early = np.random.default_rng(size).standard_normal((2, size))
    found = canonical_variates._lagged_products(late, early, LAGS)
    expected = [late[lag:] @ early[: size - lag] for lag in range(LAGS)]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * size)


@pytest.mark.parametrize("channels", [1, 3])
def test_covariances_find_the_correlations_of_the_data_across_gaps(
    channels: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(1)
    values = np.zeros((2 * DATA_ROWS, channels))
    for k in range(1, values.shape[0]):
        values[k] = 0.7 * values[k - 1] + rng.standard_normal(channels)
    observed = np.arange(values.shape[0]) % 1000 != 3
    values[~observed] = 0.0
    by_covariances = scan(values, observed)[0]
    monkeypatch.setattr(canonical_variates, "DATA_ROWS", values.shape[0])
    by_data = scan(values, observed)[0]
    np.testing.assert_allclose(by_covariances.values[0], by_data.values[0], atol=2e-3)


def test_warm_up_runs() -> None:
    warm_up()
