"""What is wrong with a stream is counted, whatever the batches that it comes in."""

import numpy as np
import pytest
from imu_noise_id.cdr import Decoded
from imu_noise_id.watch import StreamWatch

START_NS = 10**18


def watched(stamp_ns: np.ndarray, size: int, values: np.ndarray | None = None) -> StreamWatch:
    watch = StreamWatch()
    values = np.zeros((1, stamp_ns.size)) if values is None else values
    for begin in range(0, stamp_ns.size, size):
        part = slice(begin, begin + size)
        count = stamp_ns[part].size
        decoded = Decoded(stamp_ns[part], values[:, part], np.ones(count, dtype=bool), frozenset())
        watch.feed(decoded, START_NS + np.arange(begin, begin + count) * 10**7)
    return watch


@pytest.mark.parametrize("size", [1, 50, 1000])
def test_a_clean_stream_has_nothing_to_be_said(size: int) -> None:
    watch = watched(START_NS + np.arange(1000) * 10**7, size)
    assert watch.received == 1000
    assert (watch.gaps, watch.missing, watch.duplicates, watch.out_of_order) == (0, 0, 0, 0)
    assert (watch.clock_steps, watch.rate_changes, watch.frozen) == (0, 0, False)


def test_the_rate_is_that_of_reception() -> None:
    watch = watched(START_NS + np.arange(1000) * 10**6, 10)
    assert watch.rate_at(watch.newest_log_ns) == pytest.approx(100.0, rel=0.1)
    assert watch.rate_at(watch.newest_log_ns + 10**10) == 0.0


@pytest.mark.parametrize("size", [1, 50, 1000])
def test_gaps_repeats_and_disorder_are_counted(size: int) -> None:
    stamps = START_NS + np.arange(1000) * 10**7
    stamps[500:] += 5 * 10**7
    stamps[700] = stamps[699]
    stamps[[800, 801]] = stamps[[801, 800]]
    watch = watched(stamps, size)
    assert watch.duplicates == 1
    assert watch.out_of_order == 1
    assert watch.gaps >= 1
    assert watch.missing >= 5


def test_a_clock_that_is_set_is_told_with_its_step() -> None:
    stamps = START_NS + np.arange(1000) * 10**7
    stamps[500:] -= 3600 * 10**9
    watch = watched(stamps, 50)
    assert watch.clock_steps == 1
    assert watch.largest_step_s == pytest.approx(-3599.99)
    assert watch.out_of_order == 0


def test_stamps_that_stand_still_are_seen_after_half_a_second() -> None:
    stamps = START_NS + np.arange(1000) * 10**7
    stamps[500:] = stamps[500]
    assert watched(stamps, 50).frozen
    assert not watched(stamps[:510], 50).frozen


def test_another_rate_is_noticed_once() -> None:
    steps = np.repeat([10**7, 5 * 10**6], 500)
    assert watched(START_NS + np.cumsum(steps), 50).rate_changes == 1


def test_what_is_not_finite_is_counted() -> None:
    values = np.zeros((3, 100))
    values[1, 7] = np.nan
    values[:, 8] = np.inf
    assert watched(START_NS + np.arange(100) * 10**7, 10, values).non_finite == 2
