"""Stamps in order, rates and gaps, on streams whose truth is known."""

import numpy as np
import pytest

from imu_noise_id import stamps

START = 1_700_000_000_000_000_000
PERIOD = 5_000_000
COUNT = 20_000
SECOND = 1_000_000_000


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture
def even():
    return START + PERIOD * np.arange(COUNT, dtype=np.int64)


def test_a_perfect_clock(even):
    timing = stamps.examine(even)
    assert timing.rate_hz == pytest.approx(200.0, rel=1e-12)
    assert (timing.gaps, timing.missing, timing.duplicates, timing.out_of_order) == (0, 0, 0, 0)
    assert timing.jitter_s == pytest.approx(0.0, abs=1e-12)
    assert timing.stamp_ns is even


@pytest.mark.parametrize("rate_hz", [1690.0, 99.21, 0.5])
def test_the_rate_is_that_of_the_stamps_whatever_the_data_sheet_says(rng, rate_hz):
    count = 4000
    jitter = rng.normal(0.0, 0.05 / rate_hz, count)
    timing = stamps.examine(
        START + np.rint(1e9 * (np.arange(count) / rate_hz + jitter)).astype(int)
    )
    # slope error of a least-squares line: sigma sqrt(12 / n^3)
    assert timing.rate_hz == pytest.approx(rate_hz, rel=5 * 0.05 * np.sqrt(12.0 / count**3))
    assert timing.jitter_s == pytest.approx(0.05 / rate_hz, rel=0.05)
    assert timing.gaps == 0


def test_jitter_of_two_fifths_of_a_period_opens_no_gap(rng, even):
    timing = stamps.examine(even + rng.uniform(-0.4 * PERIOD, 0.4 * PERIOD, COUNT).astype(np.int64))
    assert (timing.gaps, timing.missing, timing.out_of_order) == (0, 0, 0)


@pytest.mark.parametrize("jitter", [0.0, 0.1])
def test_gaps_are_found_where_they_are(rng, even, jitter):
    present = np.ones(COUNT, dtype=bool)
    present[5000:5010] = present[15_000] = False
    noisy = even + (rng.normal(0.0, jitter, COUNT) * PERIOD).astype(np.int64)
    timing = stamps.examine(noisy[present])
    assert (timing.gaps, timing.missing) == (2, 11)
    np.testing.assert_array_equal(stamps.cells(noisy[present], PERIOD), np.flatnonzero(present))


@pytest.mark.parametrize("lost", [0.01, 0.5])
def test_random_losses_are_counted_exactly(rng, even, lost):
    present = rng.random(COUNT) > lost
    present[[0, -1]] = True
    timing = stamps.examine(even[present])
    assert timing.missing == np.count_nonzero(~present)
    assert timing.rate_hz == pytest.approx(200.0, rel=1e-9)


def test_a_clock_that_drifts_opens_no_gap():
    timing = stamps.examine(
        START + np.rint(np.arange(COUNT) * PERIOD * (1 + 5e-5)).astype(np.int64)
    )
    assert timing.missing == 0
    assert timing.rate_hz == pytest.approx(200.0 / (1 + 5e-5), rel=1e-9)


def test_samples_in_bursts_have_the_mean_rate():
    k = np.arange(COUNT)
    timing = stamps.examine(START + (k // 10) * 10 * PERIOD + (k % 10) * 100_000)
    assert timing.rate_hz == pytest.approx(200.0, rel=1e-3)


def test_duplicates_are_left_out(even):
    timing = stamps.examine(np.sort(np.concatenate((even, even[::100]))))
    assert timing.duplicates == COUNT // 100
    assert timing.out_of_order == 0
    np.testing.assert_array_equal(timing.stamp_ns, even)


def test_late_samples_are_left_out_and_counted(even):
    swapped = even.copy()
    swapped[100], swapped[101] = even[101], even[100]
    timing = stamps.examine(swapped)
    assert (timing.out_of_order, timing.missing) == (1, 1)
    assert not timing.kept[101]


def test_a_clock_set_back_an_hour_is_noted_and_what_follows_is_joined(even):
    even[COUNT // 2 :] -= 3600 * SECOND
    timing = stamps.examine(even)
    assert timing.kept.all()
    assert (timing.gaps, timing.missing, timing.out_of_order) == (1, 1, 0)
    assert (np.diff(timing.stamp_ns) > 0).all()
    assert "the clock was set once, by up to -3600 s" in timing.notes[0]


def test_a_clock_set_ahead_by_years_is_no_gap(even):
    even[3:] += 50 * 365 * 86400 * SECOND
    timing = stamps.examine(even)
    assert timing.missing == 1
    assert "the clock was set once" in timing.notes[0]


def test_an_hour_without_samples_is_a_gap(even):
    even[COUNT // 2 :] += 3600 * SECOND
    timing = stamps.examine(even)
    assert (timing.gaps, timing.missing, timing.notes) == (1, 720_000, ())


def test_gaps_beyond_the_grid_are_shortened_and_noted():
    parts = [START + 72_000 * SECOND * k + 10_000_000 * np.arange(100) for k in range(20)]
    timing = stamps.examine(np.concatenate(parts))
    assert timing.gaps == 19
    assert timing.missing <= stamps.GRID_CELLS + stamps.GRID_CELLS_PER_SAMPLE * 2000
    assert "shortened" in timing.notes[0]


@pytest.mark.parametrize("offset_s", [-400, 400])
def test_a_stray_stamp_is_left_out(even, offset_s):
    even[COUNT // 2] += offset_s * SECOND
    timing = stamps.examine(even)
    assert (timing.out_of_order, timing.missing, timing.notes) == (1, 1, ())


def test_stamps_without_sense_are_no_times(rng):
    timing = stamps.examine(rng.integers(0, 2**62, 5000))
    assert timing.stamp_ns.size == 0
    assert "they are no times" in timing.notes[0]


@pytest.mark.parametrize("count", [0, 1])
def test_too_few_samples_have_no_rate(even, count):
    assert stamps.examine(even[:count]).rate_hz == 0.0


def test_frozen_stamps_leave_one_sample():
    timing = stamps.examine(np.full(100, START))
    assert (timing.stamp_ns.size, timing.duplicates) == (1, 99)


def stalled(rng, even, jitter, speed):
    """Stamps of reception of a sender that stalls three times and then catches up."""
    time = even + (rng.normal(0.0, jitter, COUNT) * PERIOD).astype(np.int64)
    for at, length in ((4000, 60), (10_000, 200), (16_000, 400)):
        late = even[at + length] + (np.arange(COUNT - at) * (PERIOD / speed)).astype(np.int64)
        time[at:] = np.maximum(time[at:], late)
    return np.sort(time) + np.arange(COUNT)


@pytest.mark.parametrize("jitter", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("speed", [2.0, 50.0])
def test_a_stall_of_the_sender_is_no_loss(rng, even, jitter, speed):
    timing = stamps.examine(stalled(rng, even, jitter, speed))
    assert timing.missing <= 3 * (jitter == 0.3)
    assert timing.rate_hz == pytest.approx(200.0, rel=1e-3)


@pytest.mark.parametrize("jitter", [0.0, 0.1])
def test_what_is_lost_in_a_stall_is_counted(rng, even, jitter):
    present = np.ones(COUNT, dtype=bool)
    present[10_050:10_070] = False
    timing = stamps.examine(stalled(rng, even, jitter, 50.0)[present])
    assert (timing.gaps, timing.missing) == (1, 20)


@pytest.mark.parametrize("lost", [0.001, 0.01])
@pytest.mark.parametrize("jitter", [0.1, 0.2, 0.3])
def test_losses_among_jittering_stamps_do_not_change_the_rate(rng, even, lost, jitter):
    present = rng.random(COUNT) > lost
    present[[0, -1]] = True
    noisy = np.sort(even + (rng.normal(0.0, jitter, COUNT) * PERIOD).astype(np.int64))
    timing = stamps.examine(noisy[present])
    assert timing.rate_hz == pytest.approx(200.0, rel=5e-4)
    assert timing.missing == pytest.approx(np.count_nonzero(~present), abs=10 * (jitter > 0.2) + 1)


@pytest.mark.parametrize("lost", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("jitter", [0.05, 0.2, 0.25])
def test_heavy_losses_among_jittering_stamps_are_all_counted(rng, even, lost, jitter):
    present = rng.random(COUNT) > lost
    present[[0, -1]] = True
    noisy = np.sort(even + (rng.normal(0.0, jitter, COUNT) * PERIOD).astype(np.int64))
    timing = stamps.examine(noisy[present])
    assert timing.rate_hz == pytest.approx(200.0, rel=1e-5)
    assert timing.missing == pytest.approx(np.count_nonzero(~present), abs=1)


@pytest.mark.parametrize("size", [2, 10, 32])
def test_samples_that_share_a_stamp_are_spread_over_the_time_of_their_batch(even, size):
    last = even[size - 1 :: size][: COUNT // size]
    spread, notes = stamps.spread_batches(np.repeat(last, size), np.ones(last.size * size, bool))
    np.testing.assert_array_equal(spread, even[: spread.size])
    assert f"{size} at a time" in notes[0]


def test_a_batch_that_is_lost_leaves_its_gap(even):
    last = np.delete(even[9::10], 500)
    spread, _ = stamps.spread_batches(np.repeat(last, 10), np.ones(last.size * 10, bool))
    np.testing.assert_array_equal(spread, np.delete(even, np.arange(5000, 5010)))


def test_messages_that_came_twice_and_stamps_that_froze_are_not_spread(even):
    twice = np.repeat(even, 2)
    fresh = np.tile([True, False], COUNT)
    assert stamps.spread_batches(twice, fresh) == (pytest.approx(twice), ())
    frozen = even.copy()
    frozen[5000:6000] = frozen[5000]
    assert stamps.spread_batches(frozen, np.ones(COUNT, bool))[1] == ()


@pytest.mark.parametrize("seconds", [1, 3600])
def test_a_clock_set_ahead_is_told_from_a_gap_by_the_time_of_reception(even, seconds):
    received = even.copy()
    even[COUNT // 2 :] += seconds * SECOND
    timing = stamps.examine(even, received)
    assert (timing.gaps, timing.missing) == (1, 1)
    assert f"by up to +{seconds}" in timing.notes[0]
    assert stamps.examine(even, even).missing == 200 * seconds


def test_what_a_stalled_link_lost_is_a_gap_and_no_step_of_the_clock(even):
    present = np.ones(COUNT, dtype=bool)
    present[10_000:10_200] = False  # lost in the middle of a second's stall
    received = even.copy()
    received[9900:10_300] = even[10_300]
    timing = stamps.examine(even[present], received[present])
    assert (timing.gaps, timing.missing, timing.notes) == (1, 200, ())


@pytest.mark.parametrize("rate", [0.5, 20.0])
def test_a_recording_played_faster_or_slower_has_no_steps(even, rate):
    present = np.ones(COUNT, dtype=bool)
    present[9000:9400] = False
    slow = START + SECOND * np.arange(500)
    for stamp_ns, missing in ((even[present], 400), (slow, 0)):
        received = START + ((stamp_ns - START) / rate).astype(np.int64)
        timing = stamps.examine(stamp_ns, received)
        assert (timing.missing, timing.notes) == (missing, ())


def test_steps_of_the_clock_are_no_passage_of_time():
    steps = np.array((5, -3600, 3600, 3600, 90_000)) * SECOND
    passed = np.array((5, 1, 1, 180, 90_000)) * SECOND
    np.testing.assert_array_equal(stamps.onward(steps, passed) // SECOND, (5, 0, 0, 3600, 0))
