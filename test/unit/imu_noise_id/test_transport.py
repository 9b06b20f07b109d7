"""What acts on a topic as a whole, where its channels do not lie beside one another."""

import dataclasses

import numpy as np
import pytest
from imu_noise_id.assemble import to_recording
from imu_noise_id.cdr import IMU, LAYOUTS
from imu_noise_id.columns import TopicColumns
from imu_noise_id.transport import find_transport, without_repeats

PERIOD = 5_000_000
COUNT = 8000


@pytest.fixture
def columns():
    rng = np.random.default_rng(4)
    values = np.zeros((len(LAYOUTS[IMU].columns), COUNT))
    values[:6] = rng.normal(0.0, 0.01, (6, COUNT))
    values[5] += 9.8
    stamp_ns = 10**18 + PERIOD * np.arange(COUNT)
    return TopicColumns("/imu/data", IMU, stamp_ns, stamp_ns, values)


def test_held_samples_of_an_axis_with_nan_are_left_out_too(columns):
    held = columns.values[:, np.arange(COUNT) // 4 * 4].copy()
    held[1, 100:140] = np.nan
    group = to_recording([dataclasses.replace(columns, values=held)], "test").channels
    assert len({c.values.size for c in group}) == 2
    transport = find_transport(group)
    assert transport.factor == 4.0
    for channel in group:
        new = without_repeats(channel, group, transport.factor)
        assert new.rate_hz == pytest.approx(50.0)
        assert (np.diff(new.stamp_ns) % (4 * PERIOD) == 0).all()


def test_a_stall_is_no_dropout(columns):
    stamp_ns = columns.stamp_ns.copy()
    for at in range(500, COUNT, 500):
        stamp_ns[at : at + 60] = stamp_ns[at + 60] + 10_000 * np.arange(-60, 0)
    group = to_recording([dataclasses.replace(columns, stamp_ns=stamp_ns)], "test").channels
    assert "dropouts" not in {fitted.name for fitted in find_transport(group).effects}


def test_samples_read_in_batches_are_all_used(columns):
    batches = dataclasses.replace(columns, stamp_ns=np.repeat(columns.stamp_ns[9::10], 10))
    (channel, *_) = to_recording([batches], "test").channels
    assert channel.values.size == COUNT
    assert channel.rate_hz == pytest.approx(200.0)
    assert any("share one stamp, 10 at a time" in note for note in channel.quality.notes)


@pytest.mark.parametrize("tick_ns", [4_000_000, 8_000_000])
def test_stamps_of_a_coarse_clock_are_neither_dropouts_nor_jitter(columns, tick_ns):
    ticks = dataclasses.replace(columns, stamp_ns=columns.stamp_ns // tick_ns * tick_ns)
    group = to_recording([ticks], "test").channels
    assert find_transport(group).effects == ()
    assert group[0].values.size == COUNT
    assert group[0].rate_hz == pytest.approx(200.0, rel=1e-5)
    assert group[0].quality.missing == 0
    assert any("ticks" in note for note in group[0].quality.notes)
