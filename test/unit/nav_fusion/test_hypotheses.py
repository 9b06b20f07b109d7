"""nav_fusion.hypotheses: at rest the heaviest goes ahead, and those that follow lose nothing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from nav_fusion.arrays import LAG, RESTING, Core
from nav_fusion.engine import Engine
from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.parameters import Parameters
from nav_fusion.state import LOG_WEIGHT, NAV, SLOW, STRIDE

from helpers.drive import Drive, drive, play
from nav_fusion import circle, core

GYRO = AxisNoise(1e-4, (SlowTerm(0.005, float("inf"), 1e-6, "rate_random_walk"),))
ACCEL = AxisNoise(2e-3, (SlowTerm(0.05, float("inf"), 1e-5, "rate_random_walk"),))
NOISE = NavigationNoise(
    (GYRO,) * 3, (ACCEL,) * 3, (AidNoise(0.3),) * 3, (AidNoise(0.1),) * 3, AidNoise(0.05)
)
UNKNOWN = Parameters(use_magnetometer=False, use_velocity=False, publish_rate_hz=20.0)
STANDING = drive(seconds=40.0, rest_s=100.0, seed=11)


def standing(parameters: Parameters = UNKNOWN, **how: object) -> Engine:
    engine = Engine(NOISE, parameters)
    play(engine, STANDING, **how)  # type: ignore[arg-type]
    return engine


def alone(whole: Core, h: int) -> Core:
    """Return a filter of one hypothesis, in the state that it has among the others."""
    parts = {name: np.copy(value) for name, value in whole._asdict().items()}
    parts["bank"] = whole.bank[h : h + 1].copy()
    parts["checkpoint_bank"] = whole.checkpoint_bank[:, h : h + 1].copy()
    return Core(**parts)


def fed(running: Core, d: Drive, measurements: Iterator[tuple[int, int, np.ndarray]]) -> None:
    """Feed samples after those that the filter has, and measurements in between."""
    room = np.zeros(d.stamp_ns.size, np.int64), np.zeros((d.stamp_ns.size, 108))
    begin = int(np.searchsorted(d.stamp_ns, running.imu_ns.max(), side="right"))
    for stamp_ns, kind, z in measurements:
        end = int(np.searchsorted(d.stamp_ns, stamp_ns, side="right"))
        core.feed(running, d.stamp_ns[begin:end], d.rate[begin:end], d.force[begin:end], *room)
        core.insert(running, stamp_ns, kind, z)
        begin = max(begin, end)


def test_hypotheses_that_follow_end_where_filters_of_their_own_end() -> None:
    d = STANDING
    early = replace(d, stamp_ns=d.stamp_ns[:2000], rate=d.rate[:2000], force=d.force[:2000])
    early = replace(early, fix_ns=d.fix_ns[:100], fix=d.fix[:100])
    begun, complete = Engine(NOISE, UNKNOWN), standing()
    play(begun, early)
    together, all_of_it = begun._core, complete._core
    assert together is not None
    assert all_of_it is not None
    assert together.shared[RESTING] == 1.0
    circle.wake(together)
    later = core.measurements_after(all_of_it, int(d.fix_ns[99]))
    assert len(later) == 100
    own = [alone(together, h) for h in range(0, 32, 5)]
    for one in own:
        fed(one, d, iter(later))
    fed(together, d, iter(later))
    circle.wake(together)
    for h, one in zip(range(0, 32, 5), own, strict=True):
        s, expected = together.bank[h], one.bank[0]
        n = NAV + together.target.size
        P = expected[expected.size - n * STRIDE :].reshape(n, STRIDE)[:, :n]
        sigma = np.sqrt(np.diag(P))
        apart = (s - expected)[[*range(6), *range(SLOW, SLOW + n - NAV)]]
        assert np.all(np.abs(apart) < 2e-3 * sigma[[*range(6), *range(NAV, n)]])
    weights = together.bank[0:32:5, LOG_WEIGHT] - [one.bank[0, LOG_WEIGHT] for one in own]
    assert np.ptp(weights) < 5e-3


@pytest.mark.parametrize("how", [{"block": 1}, {"block": 7}, {"late_s": 0.23}])
def test_neither_blocks_nor_late_fixes_change_a_bit_of_those_that_follow(how: dict) -> None:
    expected, found = standing()._core, standing(**how)._core
    assert expected is not None
    assert found is not None
    assert expected.shared[LAG] == found.shared[LAG]
    assert np.array_equal(expected.bank, found.bank)


def test_how_often_rows_are_due_does_not_make_a_heading_likelier() -> None:
    often, seldom = standing(replace(UNKNOWN, publish_rate_hz=100.0))._core, standing()._core
    assert often is not None
    assert seldom is not None
    circle.wake(often)
    circle.wake(seldom)
    apart = often.bank[:, LOG_WEIGHT] - seldom.bank[:, LOG_WEIGHT]
    assert np.ptp(apart) < 1e-4
