"""Cells of a clock: whole jumps of a phase told from drift and jitter, and a clock among losses."""

import numpy as np
import pytest
from imu_noise_id.phase import clock_cells, clock_period, whole_jumps


@pytest.fixture
def rng():
    return np.random.default_rng(3)


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


def lossy(rng, jitter, lost=0.1, count=20_000):
    """Return stamps in ns of a 1 kHz clock, and their cells; the stamps are sent in order."""
    stamp_ns = np.sort(np.rint(1e6 * (np.arange(count) + rng.normal(0.0, jitter, count))))
    kept = rng.random(count) > lost
    return stamp_ns[kept].astype(np.int64), np.flatnonzero(kept)


@pytest.mark.parametrize("lost", [0.03, 0.1, 0.2])
@pytest.mark.parametrize("jitter", [0.1, 0.2, 0.25])
def test_the_clock_of_jittering_stamps_is_found_whatever_is_lost(rng, jitter, lost):
    stamp_ns, cell = lossy(rng, jitter, lost)
    period_ns = clock_period(stamp_ns, 1.05e6)
    assert period_ns == pytest.approx(1e6, rel=1e-5)
    counted = clock_cells((stamp_ns - stamp_ns[0]) / period_ns)
    assert counted[-1] == cell[-1] - cell[0]
    assert np.abs(counted - (cell - cell[0])).max() <= 2


def test_stamps_without_a_clock_have_no_period(rng):
    waits = 1e6 * (1.0 + 0.2 * rng.standard_normal(20_000))  # each begins where the last one ended
    stamp_ns = np.cumsum(waits).astype(np.int64)
    assert clock_period(stamp_ns, 1e6) is None
    assert clock_cells(stamp_ns / 1e6) is None


def test_a_clock_that_drifts_is_followed(rng):
    cell = np.arange(50_000)
    position = cell + 3.0 * np.sin(cell / 8000.0) + rng.normal(0.0, 0.2, cell.size)
    np.testing.assert_array_equal(clock_cells(np.sort(position)), cell)


def test_a_sender_that_stalls_keeps_no_clock():
    position = np.arange(4000.0)
    position[1000:1400] = 1400.0 + 0.001 * np.arange(400)
    assert clock_cells(position) is None
