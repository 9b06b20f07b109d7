"""A channel on its grid."""

from dataclasses import replace

import numpy as np
import pytest
from imu_noise_id.recording import Channel
from imu_noise_id.series import to_series


@pytest.fixture
def channel():
    stamp_ns = 5_000_000 * np.arange(100, dtype=np.int64) + 1_000_000_000
    values = np.arange(100.0)
    return Channel("/t", "heading", "rad", stamp_ns, values, np.ones(100, dtype=bool), 200.0)


def test_a_whole_channel_is_its_values(channel):
    series = to_series(channel, 0)
    assert series.complete
    assert (series.start_s, series.sample_time_s) == (1.0, 0.005)
    np.testing.assert_array_equal(series.values, channel.values)
    assert np.shares_memory(series.values, channel.values)  # six of ten million samples are enough


def test_gaps_and_motion_are_not_observed_and_ends_are_cut(channel):
    there = np.ones(100, dtype=bool)
    there[40:50] = False
    still = np.ones(90, dtype=bool)
    still[:5] = still[60:70] = False
    part = replace(
        channel, stamp_ns=channel.stamp_ns[there], values=channel.values[there], still=still
    )
    series = to_series(part, 1_000_000_000)
    expected = np.ones(95, dtype=bool)
    expected[35:45] = expected[65:75] = False
    np.testing.assert_array_equal(series.observed, expected)
    np.testing.assert_array_equal(series.values[expected], np.arange(5.0, 100.0)[expected])
    assert series.start_s == pytest.approx(0.025)


def test_a_channel_that_never_stood_still_has_no_series(channel):
    with pytest.raises(ValueError, match="no still sample"):
        to_series(replace(channel, still=np.zeros(100, dtype=bool)), 0)
