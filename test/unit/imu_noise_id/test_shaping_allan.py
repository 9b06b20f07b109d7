"""The Allan curve of a shaping filter is that of its output."""

import numpy as np
import pytest
from imu_noise_id.shaping_allan import allan_deviation
from imu_noise_id.transfer_function import DiscreteTransfer


@pytest.mark.parametrize("pole", [0.0, 0.9, 0.9999])
def test_allan_deviation_of_a_model_is_the_closed_form(pole):
    m = np.array([1, 2, 7, 100, 5000])
    transfer = DiscreteTransfer(np.array([1.0, 0.0]), np.array([1.0, -pole]), 1.0)
    lag = np.arange(10_000)
    covariance = pole**lag / (1.0 - pole**2) if pole else np.eye(1, 10_000)[0]

    def variance_of_sum(m):
        return m * covariance[0] + 2.0 * np.sum((m - lag[1:m]) * covariance[1:m])

    expected = [np.sqrt((4 * variance_of_sum(k) - variance_of_sum(2 * k)) / 2) / k for k in m]
    np.testing.assert_allclose(allan_deviation(transfer, m), expected, rtol=1e-6)


def test_an_unstable_model_has_no_allan_curve():
    with pytest.raises(ValueError, match="unstable"):
        allan_deviation(DiscreteTransfer(np.ones(1), np.array([1.0, -1.5]), 1.0), np.array([1]))
