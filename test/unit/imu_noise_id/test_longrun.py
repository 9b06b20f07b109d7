"""Block averages of a run of any length."""

import numpy as np
from imu_noise_id.columns import TopicColumns
from imu_noise_id.longrun import LongRun

from imu_noise_id import cdr


def columns(stamp_ns: np.ndarray, values: np.ndarray) -> TopicColumns:
    return TopicColumns("/t", cdr.TEMPERATURE, stamp_ns, stamp_ns, values[np.newaxis])


def fed(stamp_ns: np.ndarray, values: np.ndarray, size: int, most: int = 1 << 17) -> LongRun:
    run = LongRun("/t", cdr.TEMPERATURE, most=most)
    for begin in range(0, stamp_ns.size, size):
        part = slice(begin, begin + size)
        run.feed(columns(stamp_ns[part], values[part]))
    return run


def test_a_block_is_the_mean_of_its_samples_whatever_the_batches() -> None:
    rng = np.random.default_rng(1)
    stamps = 10**18 + np.arange(10_000) * 10**7
    values = 20.0 + rng.normal(size=10_000)
    expected = values[:9900].reshape(-1, 100).mean(axis=1)
    for size in (1, 33, 512, 10_000):
        found = fed(stamps, values, size).columns()
        assert np.allclose(found.values[0], expected, rtol=0, atol=1e-13)
        assert np.array_equal(np.diff(found.stamp_ns), np.full(98, 10**9))
        assert found.stamp_ns[0] == 10**18 + 5 * 10**8


def test_memory_is_bounded_and_no_sample_is_lost_when_blocks_are_merged() -> None:
    rng = np.random.default_rng(1)
    stamps = 10**18 + np.arange(100_000) * 10**8
    values = rng.normal(size=100_000)
    run = fed(stamps, values, 1000, most=256)
    assert run.counts.size <= 256
    assert run.block_s == 64.0
    assert run.counts.sum() == 100_000
    found = run.columns()
    expected = values[: found.stamp_ns.size * 640].reshape(-1, 640).mean(axis=1)
    assert np.allclose(found.values[0], expected, rtol=0, atol=1e-13)


def test_gaps_clock_steps_and_what_is_not_finite_leave_no_trace() -> None:
    stamps = 10**18 + np.arange(3000) * 10**7
    stamps[1500:] -= 3600 * 10**9
    values = np.ones(3000)
    values[700:900] = np.nan
    found = fed(stamps, values, 100).columns()
    assert np.array_equal(np.unique(found.values), [1.0])
    assert found.stamp_ns.size == 27
    assert np.all(np.diff(found.stamp_ns) > 0)
