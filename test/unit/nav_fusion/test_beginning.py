"""nav_fusion.beginning: a filter that is fed the beginning again is in the state of the bag."""

from __future__ import annotations

import numpy as np
from imu_noise_id.cdr import LAYOUTS, Decoded
from nav_fusion.beginning import Beginning
from nav_fusion.engine import Engine
from nav_fusion.feeding import feed
from nav_fusion.fuse import run
from nav_fusion.noise import mems_defaults

from helpers.drive import Drive, drive
from imu_noise_id import cdr


def imu(d: Drive, part: slice) -> Decoded:
    values = np.zeros((len(LAYOUTS[cdr.IMU].columns), d.stamp_ns[part].size))
    values[:3], values[3:6] = d.rate[part].T, d.force[part].T
    return Decoded(d.stamp_ns[part], values, np.ones(values.shape[1], bool), frozenset())


def fix(d: Drive, k: int) -> Decoded:
    values = np.zeros((len(LAYOUTS[cdr.NAV_SAT_FIX].columns), 1))
    values[:3, 0] = d.fix[k]
    return Decoded(d.fix_ns[k : k + 1], values, np.ones(1, bool), frozenset())


def fed(d: Drive, beginning: Beginning, engine: Engine, fixes: range | None = None) -> None:
    """Batches of 20 samples, a fix behind each; of all fixes where none are named."""
    for k in fixes or range(d.fix_ns.size):
        part = slice(20 * k, 20 * (k + 1))
        log_ns = d.stamp_ns[part]
        for topic, kind, batch, came in (
            ("/imu/data", cdr.IMU, imu(d, part), log_ns),
            ("/gps/fix", cdr.NAV_SAT_FIX, fix(d, k), log_ns[-1:]),
        ):
            beginning.add(topic, kind, batch, came)
            feed(engine, kind, batch.stamp_ns, batch.values)


def test_a_replayed_engine_and_the_recording_are_in_the_state_of_the_live_one() -> None:
    beginning, live = Beginning(), Engine(mems_defaults())
    fed(drive(20.0), beginning, live)
    again, bag = Engine(mems_defaults()), Engine(mems_defaults())
    beginning.replay(again)
    run(bag, beginning.columns())
    assert live.running
    assert np.array_equal(live.state(), again.state())
    assert np.array_equal(live.state(), bag.state())


def test_what_came_during_a_replay_is_replayed_next_and_forgetting_leaves_nothing() -> None:
    d = drive(10.0)
    beginning, live, again = Beginning(), Engine(mems_defaults()), Engine(mems_defaults())
    half = d.fix_ns.size // 2
    fed(d, beginning, live, range(half))
    replayed = beginning.replay(again)
    fed(d, beginning, live, range(half, d.fix_ns.size))
    assert beginning.replay(again, replayed) == 2 * d.fix_ns.size
    assert live.running
    assert np.array_equal(live.state(), again.state())
    beginning.forget()
    assert beginning.replay(Engine(mems_defaults())) == 0


def test_what_is_longer_than_is_kept_is_forgotten_whole() -> None:
    beginning = Beginning(longest_s=5.0)
    fed(drive(10.0), beginning, Engine(mems_defaults()))
    assert not beginning.kept
    assert beginning.columns() == []
