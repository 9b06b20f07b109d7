"""A live run: its buffer as a bag would be, and what the buffer forgot in block averages."""

import numpy as np
import pytest
from imu_noise_id.assemble import to_recording
from imu_noise_id.cdr import LAYOUTS
from imu_noise_id.columns import TopicColumns
from imu_noise_id.identify import identify_recording
from imu_noise_id.live import SLOW_BLOCKS, findings, identify_columns
from imu_noise_id.longrun import LongRun

from imu_noise_id import cdr

RATE_HZ = 10
WHITE, WALK = 1e-3, 2e-5


def run(duration_s: float, rng: np.random.Generator) -> TopicColumns:
    """A magnetometer with white noise (per root Hz) and a walk (per second and root Hz)."""
    n = round(duration_s * RATE_HZ)
    stamp_ns = 10**18 + np.arange(n) * (10**9 // RATE_HZ)
    values = np.zeros((len(LAYOUTS[cdr.MAGNETIC_FIELD].columns), n))
    white = WHITE * np.sqrt(RATE_HZ) * rng.normal(size=(3, n))
    values[:3] = white + WALK / np.sqrt(RATE_HZ) * np.cumsum(rng.normal(size=(3, n)), axis=1)
    return TopicColumns("/imu/mag", cdr.MAGNETIC_FIELD, stamp_ns, stamp_ns, values)


def part(columns: TopicColumns, begin: int, end: int) -> TopicColumns:
    cut = slice(begin, end)
    return TopicColumns(
        columns.topic,
        columns.type,
        columns.stamp_ns[cut],
        columns.log_ns[cut],
        columns.values[:, cut],
    )


def test_a_run_that_fits_the_buffer_is_identified_as_its_recording() -> None:
    whole = run(200.0, np.random.default_rng(1))
    offline = findings(identify_recording(to_recording([whole], "live")), "")
    live = identify_columns([whole], before=[LongRun(whole.topic, whole.type)])
    assert live.model == offline.model
    assert live.span == offline.span


def test_beyond_the_buffer_the_slow_effects_are_those_of_the_whole_run() -> None:
    whole = run(20_000.0, np.random.default_rng(2))
    cut = whole.stamp_ns.size - 300 * RATE_HZ
    before = LongRun(whole.topic, whole.type)
    before.feed(part(whole, 0, cut))
    found = identify_columns([part(whole, cut, whole.stamp_ns.size)], before=[before])
    assert found.span.from_s == pytest.approx(-19_700.0, abs=1.0)
    assert found.span.to_s == pytest.approx(300.0, abs=0.2)
    for channel, model in zip(found.channels, found.model.channels, strict=True):
        fitted = {effect.name: effect for effect in model.effects}
        walk = fitted["rate_random_walk"].estimates[0]
        white = fitted["white_noise"].estimates[0]
        assert walk.value == pytest.approx(WALK, rel=0.15)
        assert walk.lower < WALK * 1.05
        assert white.value == pytest.approx(WHITE, rel=0.1)
        assert channel.allan is not None
        assert channel.allan.tau_s[-1] > 5000.0
        assert np.all(np.diff(channel.allan.tau_s) > 0)
        slow = channel.allan.tau_s > SLOW_BLOCKS
        law = np.sqrt(WHITE**2 / channel.allan.tau_s + WALK**2 * channel.allan.tau_s / 3)
        inside = (channel.allan.lower < law) & (law < channel.allan.upper)
        assert inside[slow].mean() > 0.7


def test_the_last_seconds_leave_out_what_was_before() -> None:
    whole = run(600.0, np.random.default_rng(3))
    before = LongRun(whole.topic, whole.type)
    before.feed(part(whole, 0, 3000))
    rest = part(whole, 3000, 6000)
    found = identify_columns([rest], last_s=100.0, before=[before])
    assert found.span.to_s == pytest.approx(100.0, abs=0.2)
    assert found.span.from_s == 0.0


def test_an_axis_that_lost_samples_of_its_own_does_not_lose_the_others() -> None:
    rng = np.random.default_rng(4)
    stamp_ns = 10**18 + np.arange(6000) * 10**7
    values = rng.normal(size=(6, 6000))
    values[2, rng.random(6000) < 0.01] = np.nan
    found = identify_columns([TopicColumns("/imu/data", cdr.IMU, stamp_ns, stamp_ns, values)])
    assert len(found.model.channels) == 6
    assert all(channel.effects for channel in found.model.channels)
