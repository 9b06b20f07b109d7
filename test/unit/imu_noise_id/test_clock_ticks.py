"""Stamps of coarse clocks: even samples rounded to ticks here, and found again."""

import numpy as np
import pytest
from imu_noise_id.clock_ticks import evened, tick_ns
from imu_noise_id.stamps import cells, examine

START = 1_700_000_000_000_000_000
COUNT = 20_000


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def ticking(rng, period_ns, tick_ns, lost=0.0, jitter=0.0):
    """Stamps rounded down to ticks, and the cells of the samples that were not lost."""
    time_ns = period_ns * (np.arange(COUNT) + rng.random() + jitter * rng.standard_normal(COUNT))
    kept = rng.random(COUNT) >= lost
    ticks = np.floor(np.sort(time_ns)[kept] / tick_ns)
    return START + np.floor(tick_ns * ticks).astype(np.int64), np.flatnonzero(kept)


def fresh(stamp_ns):
    return np.ones(stamp_ns.size, dtype=bool)


@pytest.mark.parametrize("jitter", [0.0, 0.1])
@pytest.mark.parametrize(
    ("period_ns", "tick"),
    [(5e6, 4e6), (5.0031e6, 4e6), (5e6, 8e6), (4.997e6, 8e6), (5e6, 1e9 / 64), (1.003e6, 1e6)],
)
def test_even_samples_are_found_beneath_the_ticks(rng, period_ns, tick, jitter):
    stamp_ns, _ = ticking(rng, period_ns, tick, jitter=jitter)
    even, notes = evened(stamp_ns, fresh(stamp_ns))
    timing = examine(even)
    assert (timing.missing, timing.duplicates) == (0, 0)
    assert timing.rate_hz * period_ns == pytest.approx(1e9, rel=1e-5)
    assert timing.jitter_s < 0.01e-9 * period_ns
    # that they are rounded down, by half a tick in the mean, cannot be known
    reach = 4.5 * jitter * period_ns  # of the largest of so many
    assert np.abs(even - stamp_ns).max() < 0.6 * tick + reach
    assert f"ticks of {tick * 1e-6:.4g} ms" in notes[0]


@pytest.mark.parametrize(("tick", "lost", "beside"), [(4e6, 0.01, 2), (8e6, 0.01, 12)])
def test_losses_beneath_the_ticks_are_counted_and_lie_where_they_are(rng, tick, lost, beside):
    stamp_ns, cell = ticking(rng, 5.0031e6, tick, lost)
    timing = examine(evened(stamp_ns, fresh(stamp_ns))[0])
    assert timing.missing == pytest.approx(COUNT - cell.size, abs=2)
    assert timing.duplicates == 0
    found = cells(timing.stamp_ns, 1e9 / timing.rate_hz)
    astray = np.diff(found) != np.diff(cell)
    # two samples that share a stamp do not say which of them follows a loss
    assert astray.sum() < beside * lost * COUNT / 4
    assert np.abs(found - (cell - cell[0])).max() <= 2


@pytest.mark.parametrize("lost", [0.0005, 0.01, 0.2, 0.5])
def test_losses_of_a_clock_as_fine_as_its_samples_stay_losses(rng, lost):
    stamp_ns, _ = ticking(rng, 4e6, 4e6, lost)
    even, notes = evened(stamp_ns, fresh(stamp_ns))
    assert even is stamp_ns
    assert notes == ()


def test_jitter_is_no_tick(rng):
    stamp_ns = START + np.sort(5e6 * (np.arange(COUNT) + 0.2 * rng.standard_normal(COUNT))).astype(
        np.int64
    )
    assert tick_ns(stamp_ns) is None
    assert evened(stamp_ns, fresh(stamp_ns))[0] is stamp_ns


def test_a_message_that_came_twice_keeps_the_place_of_the_first(rng):
    stamp_ns, _ = ticking(rng, 5e6, 4e6)
    twice = np.sort(np.concatenate((np.arange(COUNT), [700, 9000])))
    new = np.diff(twice, prepend=-1) > 0
    timing = examine(evened(stamp_ns[twice], new)[0])
    assert (timing.duplicates, timing.missing) == (2, 0)


def test_equal_batches_are_left_to_those_who_know_that_the_last_sample_is_stamped(rng):
    stamp_ns = np.repeat(START + 50_000_000 * np.arange(COUNT // 10), 10)
    assert evened(stamp_ns, fresh(stamp_ns))[0] is stamp_ns


def test_a_rate_that_changes_in_the_middle_is_no_clock_with_ticks():
    half = np.concatenate(
        [np.arange(3016) * 1_000_000, 3_016_000_000 + np.arange(3016) * 1_600_000]
    )
    stamp_ns = START + half.astype(np.int64)
    found, notes = evened(stamp_ns, fresh(stamp_ns))
    assert np.array_equal(found, stamp_ns)
    assert notes == ()
