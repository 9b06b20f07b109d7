"""The axes of a sensor together: states that they share are found once."""

import numpy as np
import pytest
from imu_noise_id.joint_cca import joint
from imu_noise_id.series import Series
from scipy.signal import lfilter


def series_of(values, observed=None, sample_time_s=1e-3):
    observed = np.ones(values.size, dtype=bool) if observed is None else observed
    return Series(np.where(observed, values, 0.0), observed, sample_time_s)


def test_three_axes_share_one_slow_state():
    rng = np.random.default_rng(12)
    size, pole = 60_000, 0.98
    slow = lfilter([1.0], [1.0, -pole], rng.standard_normal(size))
    shares = np.array([0.3, -0.2, 0.1])
    mixing = np.array([[1.0, 0, 0], [0.5, 1.0, 0], [0, 0.2, 2.0]])
    values = slow[:, None] * shares + rng.standard_normal((size, 3)) @ mixing.T
    found = joint(tuple(series_of(column, sample_time_s=0.01) for column in values.T))
    assert found.significant
    assert found.order == 1
    space = found.state_space
    expected = pole**found.block
    assert space.A[0, 0] == pytest.approx(expected, abs=0.02 if found.block == 1 else 0.05)
    direction = space.C[:, 0] / np.linalg.norm(space.C[:, 0])
    np.testing.assert_allclose(abs(direction @ shares) / np.linalg.norm(shares), 1.0, atol=0.02)
    assert np.max(np.abs(np.linalg.eigvals(space.A - space.K @ space.C))) < 1.0


def test_three_white_axes_share_nothing():
    rng = np.random.default_rng(13)
    values = rng.standard_normal((20_000, 3))
    values[:, 1] += 0.8 * values[:, 0]
    found = joint(tuple(series_of(column) for column in values.T))
    assert not found.significant
    assert found.order == 0
    expected = np.cov(values.T)
    np.testing.assert_allclose(found.state_space.innovation_covariance, expected, atol=0.05)


@pytest.mark.parametrize("values", [np.zeros(1000), np.full(1000, 9.81), np.arange(5.0)])
def test_what_cannot_be_had_is_refused_with_a_reason(values):
    with pytest.raises(ValueError, match=r"constant|too few"):
        joint((series_of(values), series_of(values)))
