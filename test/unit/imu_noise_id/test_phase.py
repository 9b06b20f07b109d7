"""Whole jumps of a phase, told from its drift and its jitter."""

import numpy as np
import pytest
from imu_noise_id.phase import whole_jumps


def test_jumps_up_and_down_are_counted_where_they_are():
    jumps = np.zeros(1000, np.int64)
    jumps[300:] += 3
    jumps[700:] -= 5
    np.testing.assert_array_equal(whole_jumps(jumps.astype(float)), jumps)


@pytest.mark.parametrize("drift", [-2e-3, 2e-3])
def test_a_drift_is_no_jump(drift):
    noise = np.random.default_rng(0).normal(0.0, 0.05, 5000)
    assert not whole_jumps(drift * np.arange(5000) + noise).any()


def test_a_fall_one_by_one_is_followed_to_its_end():
    phase = np.concatenate((np.zeros(100), np.arange(60.0, 0.0, -1.0), np.zeros(100)))
    np.testing.assert_array_equal(whole_jumps(phase), phase)


def test_nothing_has_no_jumps():
    assert whole_jumps(np.empty(0)).size == 0
