"""The newest messages in bounded memory."""

import numpy as np
from imu_noise_id.cdr import Decoded, decode_batch, encode
from imu_noise_id.columns import TopicColumns
from imu_noise_id.rolling import BLOCK, RollingColumns

from imu_noise_id import cdr


def batch(stamp_ns: np.ndarray) -> Decoded:
    members = {"temperature": np.arange(stamp_ns.size, dtype=float)}
    rows = encode(cdr.TEMPERATURE, stamp_ns, members, "imu")
    return decode_batch(cdr.TEMPERATURE, [row.tobytes() for row in rows])


def fill(rolling: RollingColumns, stamp_ns: np.ndarray, size: int) -> list[TopicColumns]:
    forgotten = []
    for begin in range(0, stamp_ns.size, size):
        part = stamp_ns[begin : begin + size]
        rolling.append(batch(part), part + 1)
        while rolling.full:
            forgotten.append(rolling.forget())
    return forgotten


def test_what_fits_is_kept_whole_and_in_order_whatever_the_batches() -> None:
    stamps = 10**18 + np.arange(5000) * 10**7
    for size in (1, 7, 600, 5000):
        rolling = RollingColumns("/t", cdr.TEMPERATURE, 60.0, 10**6)
        assert fill(rolling, stamps, size) == []
        kept = rolling.columns()
        assert np.array_equal(kept.stamp_ns, stamps)
        assert np.array_equal(kept.log_ns, stamps + 1)
        assert kept.frame_ids == {b"imu"}
        assert rolling.buffered_s == 49.99


def test_what_is_forgotten_and_what_is_kept_are_everything_once() -> None:
    stamps = 10**18 + np.arange(20_000) * 10**7
    rolling = RollingColumns("/t", cdr.TEMPERATURE, 60.0, 10**6)
    forgotten = fill(rolling, stamps, 100)
    parts = [*forgotten, rolling.columns()]
    assert np.array_equal(np.concatenate([p.stamp_ns for p in parts]), stamps)
    assert rolling.forgotten == sum(p.stamp_ns.size for p in forgotten)
    assert 60.0 <= rolling.buffered_s < 60.0 + 2 * BLOCK * 0.01


def test_stamps_that_stand_still_or_jump_cannot_fill_the_memory() -> None:
    frozen = RollingColumns("/t", cdr.TEMPERATURE, 60.0, 10_000)
    fill(frozen, np.full(50_000, 10**18), 100)
    assert frozen.size <= 10_000 + BLOCK
    looped = RollingColumns("/t", cdr.TEMPERATURE, 60.0, 10**6)
    fill(looped, np.tile(10**18 + np.arange(1000) * 10**7, 50), 100)
    assert 60.0 <= looped.buffered_s < 75.0


def test_zero_stamps_are_timed_by_reception() -> None:
    rolling = RollingColumns("/t", cdr.TEMPERATURE, 60.0, 10**6)
    zeros, log_ns = np.zeros(1000, np.int64), 10**18 + np.arange(1000) * 10**7
    rolling.append(batch(zeros), log_ns)
    assert rolling.buffered_s == 9.99


def test_a_clock_set_ahead_does_not_empty_the_buffer() -> None:
    rolling = RollingColumns("/t", cdr.TEMPERATURE, 60.0, 10**6)
    log_ns = 10**18 + np.arange(4000) * 10**7
    for begin in range(0, 4000, 100):
        part = log_ns[begin : begin + 100]
        rolling.append(batch(part + (3600 * 10**9 if begin >= 2000 else 0)), part)
    assert not rolling.full
    assert rolling.size == 4000
