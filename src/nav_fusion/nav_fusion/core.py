"""The compiled filter loop: IMU samples and measurements in order of time, rewound when late.

Everything that depends on the past lies in the arrays that a checkpoint copies
(:mod:`nav_fusion.arrays`).  A late measurement restores the newest checkpoint before it
and repeats the steps since; the steps are a function of samples and measurements in order of
*time* alone, so the bits do not depend on the order of arrival or on the size of the blocks.

What happens at a sample's time, in this order: the interval that it ends, rest, publishing, a
checkpoint, and last the measurements that hold at just that time: they change the next row, and
one that comes with its sample or after it needs no rewind.
"""

from __future__ import annotations

import math

import numpy as np
from imu_noise_id.compiled import njit

from nav_fusion.arrays import (
    AHEAD,
    CHECKPOINT_DUE,
    CHECKPOINT_PERIOD,
    CHECKPOINTS,
    FIRST_CHECKPOINT,
    FURTHEST,
    GAP,
    GAP_S,
    GAPS,
    HEAD_MEASUREMENT,
    IMU_RING,
    LAST_CHECKPOINT,
    LOST_NS,
    MEASUREMENT_RING,
    NEXT,
    PUBLISH_DUE,
    PUBLISH_PERIOD,
    QUIET_BLOCKS,
    REACH,
    SAMPLES,
    WINDOW,
    Core,
    Floats,
    Ints,
)
from nav_fusion.headings import correct, write_output
from nav_fusion.hypotheses import get_ready, glide_over, propagate
from nav_fusion.repose import end_repose
from nav_fusion.state import ALIVE
from nav_fusion.stillness import add_to_block, begin_block, block_due, close_block

ACCEPTED, LATE, TOO_LATE, DUPLICATE, FULL = 0, 1, 2, 3, 4
"""What became of a measurement."""


@njit(cache=True)
def coast(core: Core, first: int, last: int) -> None:
    """Take the filter over the whole intervals that end at samples ``first`` to ``last``-1.

    The same as :func:`advance` sample by sample where nothing happens at any of them.
    """
    if first == last:
        return
    glide_over(core, first, last)
    for sample in range(first, last):
        add_to_block(core.shared, core.imu[(sample - 1) % IMU_RING], core.imu[sample % IMU_RING])
    core.cursor[SAMPLES] = last


@njit(cache=True)
def save_checkpoint(core: Core) -> None:
    """Copy all that is rewound into the ring, over the oldest."""
    c = core.cursor
    c[LAST_CHECKPOINT] += 1
    if c[LAST_CHECKPOINT] - c[FIRST_CHECKPOINT] >= CHECKPOINTS:
        c[FIRST_CHECKPOINT] = c[LAST_CHECKPOINT] - CHECKPOINTS + 1
    k = c[LAST_CHECKPOINT] % CHECKPOINTS
    core.checkpoint_sample[k] = c[SAMPLES]
    c[CHECKPOINT_DUE] = checkpoint_ns(core, k) + c[CHECKPOINT_PERIOD]
    core.checkpoint_shared[k, :] = core.shared
    for h in range(core.bank.shape[0]):
        if core.bank[h, ALIVE] > 0.0:
            core.checkpoint_bank[k, h, :] = core.bank[h]
        else:
            core.checkpoint_bank[k, h, ALIVE] = core.bank[h, ALIVE]
    while core.checkpoint_sample[c[FIRST_CHECKPOINT] % CHECKPOINTS] < c[SAMPLES] - REACH:
        c[FIRST_CHECKPOINT] += 1


@njit(cache=True)
def checkpoint_ns(core: Core, k: int) -> int:
    """Time of checkpoint ``k``."""
    return core.imu_ns[(core.checkpoint_sample[k % CHECKPOINTS] - 1) % IMU_RING]


@njit(cache=True)
def advance(core: Core, sample: int) -> bool:
    """Take the filter over the interval that ends at ``sample`` (in the ring already).

    Returns whether a row is due.  Measurements at just the sample's time are left to
    :func:`apply_due`.
    """
    c = core.cursor
    start = core.imu_ns[(sample - 1) % IMU_RING]
    end = core.imu_ns[sample % IMU_RING]
    gap = end - start > c[GAP]
    now = start
    while c[NEXT] < c[HEAD_MEASUREMENT] and core.measurement_ns[c[NEXT]] < end:
        at = core.measurement_ns[c[NEXT]]
        if at > now:
            propagate(core, sample, now, at)
            now = at
        correct(core, c[NEXT], sample - 1)
        c[NEXT] += 1
        if c[LOST_NS] != 0:
            return False
    propagate(core, sample, now, end)
    c[SAMPLES] = sample + 1
    if gap:
        core.shared[GAPS] += 1.0
        core.shared[GAP_S] += float(end - start) * 1e-9
        core.shared[QUIET_BLOCKS] = 0.0
        end_repose(core)
        begin_block(core, end)
    else:
        add_to_block(core.shared, core.imu[(sample - 1) % IMU_RING], core.imu[sample % IMU_RING])
        if end >= block_due(core):
            close_block(core, end)
    due = end >= c[PUBLISH_DUE]
    if due:
        get_ready(core)
        c[PUBLISH_DUE] = next_publish(core, end)
    if end >= c[CHECKPOINT_DUE]:
        save_checkpoint(core)
    return due


@njit(cache=True)
def next_publish(core: Core, time_ns: int) -> int:
    """First multiple of the publishing period after a time."""
    period = core.cursor[PUBLISH_PERIOD]
    return (time_ns // period + 1) * period


@njit(cache=True)
def apply_due(core: Core) -> None:
    """Apply the measurements that hold at the newest sample's time."""
    c = core.cursor
    now = core.imu_ns[(c[SAMPLES] - 1) % IMU_RING]
    while c[NEXT] < c[HEAD_MEASUREMENT] and core.measurement_ns[c[NEXT]] <= now:
        if c[LOST_NS] != 0:
            return
        correct(core, c[NEXT], c[SAMPLES] - 1)
        c[NEXT] += 1


@njit(cache=True)
def eventless_until(core: Core, last: int) -> int:
    """First sample from the next one on, or ``last``, at which anything but motion happens."""
    c = core.cursor
    due = min(c[PUBLISH_DUE], c[CHECKPOINT_DUE], block_due(core))
    if c[NEXT] < c[HEAD_MEASUREMENT]:
        due = min(due, core.measurement_ns[c[NEXT]])
    sample = c[SAMPLES]
    before = core.imu_ns[(sample - 1) % IMU_RING]
    while sample < last:
        time = core.imu_ns[sample % IMU_RING]
        if time >= due or time - before > c[GAP]:
            break
        before = time
        sample += 1
    return sample


@njit(cache=True)
def rewind(core: Core, before_ns: int) -> None:
    """Restore the newest checkpoint not after a time and repeat the samples since."""
    c = core.cursor
    head = c[SAMPLES]
    while checkpoint_ns(core, c[LAST_CHECKPOINT]) > before_ns:
        c[LAST_CHECKPOINT] -= 1
    k = c[LAST_CHECKPOINT] % CHECKPOINTS
    core.shared[:] = core.checkpoint_shared[k]
    for h in range(core.bank.shape[0]):
        if core.checkpoint_bank[k, h, ALIVE] > 0.0:
            core.bank[h, :] = core.checkpoint_bank[k, h]
        else:
            core.bank[h, ALIVE] = core.checkpoint_bank[k, h, ALIVE]
    c[SAMPLES] = core.checkpoint_sample[k]
    time = checkpoint_ns(core, k)
    c[CHECKPOINT_DUE] = time + c[CHECKPOINT_PERIOD]
    c[PUBLISH_DUE] = next_publish(core, time)
    c[NEXT] = 0
    while c[NEXT] < c[HEAD_MEASUREMENT] and core.measurement_ns[c[NEXT]] < time:
        c[NEXT] += 1
    apply_due(core)
    while c[SAMPLES] < head and c[LOST_NS] == 0:
        coast(core, c[SAMPLES], eventless_until(core, head))
        if c[SAMPLES] < head:
            advance(core, c[SAMPLES])
            apply_due(core)


@njit(cache=True)
def settled(core: Core) -> int:
    """How many measurements no rewind can reach any more."""
    oldest = checkpoint_ns(core, core.cursor[FIRST_CHECKPOINT])
    count = 0
    while count < core.cursor[NEXT] and core.measurement_ns[count] <= oldest:
        count += 1
    return count


@njit(cache=True)
def forget(core: Core, drop: int) -> None:
    """Drop the first measurements."""
    c = core.cursor
    for i in range(drop, c[HEAD_MEASUREMENT]):
        core.measurement_ns[i - drop] = core.measurement_ns[i]
        core.kind[i - drop] = core.kind[i]
        core.z[i - drop, :] = core.z[i]
    c[HEAD_MEASUREMENT] -= drop
    c[NEXT] -= drop


@njit(cache=True)
def place_for(core: Core, time_ns: int, kind: int) -> int:
    """Where a measurement belongs in the queue, or -1 when one of its kind and stamp is there."""
    place = core.cursor[HEAD_MEASUREMENT]
    while place > 0 and (
        core.measurement_ns[place - 1] > time_ns
        or (core.measurement_ns[place - 1] == time_ns and core.kind[place - 1] > kind)
    ):
        place -= 1
    if place > 0 and core.measurement_ns[place - 1] == time_ns and core.kind[place - 1] == kind:
        return -1
    return place


@njit(cache=True, nogil=True)
def insert(core: Core, time_ns: int, kind: int, z: Floats) -> int:
    """Put a measurement in its place in time; rewind and repeat when the filter has passed it."""
    c = core.cursor
    now = core.imu_ns[(c[SAMPLES] - 1) % IMU_RING]
    if time_ns < now - core.cursor[WINDOW] or time_ns <= checkpoint_ns(core, c[FIRST_CHECKPOINT]):
        return TOO_LATE
    if c[HEAD_MEASUREMENT] == MEASUREMENT_RING:
        return FULL
    place = place_for(core, time_ns, kind)
    if place < 0:
        return DUPLICATE
    for i in range(c[HEAD_MEASUREMENT], place, -1):
        core.measurement_ns[i] = core.measurement_ns[i - 1]
        core.kind[i] = core.kind[i - 1]
        core.z[i, :] = core.z[i - 1]
    core.measurement_ns[place] = time_ns
    core.kind[place] = kind
    core.z[place, :] = z
    c[HEAD_MEASUREMENT] += 1
    if time_ns > now:
        return ACCEPTED
    if time_ns == now and place == c[NEXT]:
        apply_due(core)
        return ACCEPTED
    rewind(core, time_ns)
    return LATE


@njit(cache=True)
def drop_ahead(core: Core, end: int) -> None:
    """Drop measurements whose stamps lie far ahead of the IMU's clock while it is running."""
    c = core.cursor
    while (
        c[HEAD_MEASUREMENT] > c[NEXT]
        and core.measurement_ns[c[HEAD_MEASUREMENT] - 1] > end + core.cursor[FURTHEST]
    ):
        c[HEAD_MEASUREMENT] -= 1
        c[AHEAD] += 1


@njit(cache=True)
def is_plain(last_ns: int, longest_ns: int, stamp_ns: Ints, rate: Floats, force: Floats) -> bool:
    """Whether a block has nothing to leave out: stamps ascend without a jump, all is finite."""
    before = last_ns
    for i in range(stamp_ns.size):
        if not 0 < stamp_ns[i] - before <= longest_ns:
            return False
        before = stamp_ns[i]
        for j in range(3):
            if not math.isfinite(rate[i, j] + force[i, j]):
                return False
    return True


@njit(cache=True, nogil=True)
def feed(core: Core, stamp_ns: Ints, rate: Floats, force: Floats, out_ns: Ints, out: Floats) -> int:
    """Take a block of samples (stamps ascending); returns how many rows of output became due.

    Ends early where the filter is lost.  No more than ``MOST_SAMPLES`` at a time: rewinding needs
    those before.
    """
    c = core.cursor
    first = c[SAMPLES]
    last = first + stamp_ns.size
    for i in range(stamp_ns.size):
        k = (first + i) % IMU_RING
        core.imu_ns[k] = stamp_ns[i]
        core.imu[k, 0:3] = rate[i]
        core.imu[k, 3:6] = force[i]
    if stamp_ns.size > 0:
        drop_ahead(core, stamp_ns[0])
    rows = 0
    while c[SAMPLES] < last and c[LOST_NS] == 0:
        coast(core, c[SAMPLES], eventless_until(core, last))
        if c[SAMPLES] == last:
            break
        sample = c[SAMPLES]
        if advance(core, sample):
            out_ns[rows] = core.imu_ns[sample % IMU_RING]
            write_output(core, sample % IMU_RING, out[rows])
            rows += 1
        apply_due(core)
    return rows


def samples_after(core: Core, time_ns: int, head: int) -> tuple[Ints, Floats, Floats]:
    """Stamps, rates and forces of the samples after a time; ``head`` were fed in all."""
    first = head
    while first > 0 and core.imu_ns[(first - 1) % IMU_RING] > time_ns:
        first -= 1
    ring = np.arange(first, head) % IMU_RING
    return core.imu_ns[ring], core.imu[ring, :3], core.imu[ring, 3:]


def measurements_after(core: Core, time_ns: int) -> list[tuple[int, int, Floats]]:
    """Stamp, kind and numbers of the measurements after a time, in order of time."""
    return [
        (int(core.measurement_ns[i]), int(core.kind[i]), core.z[i].copy())
        for i in range(int(core.cursor[HEAD_MEASUREMENT]))
        if core.measurement_ns[i] > time_ns
    ]


@njit(cache=True)
def begin(core: Core, stamp_ns: int, rate: Floats, force: Floats) -> None:
    """Put the first sample in the ring: the hypotheses hold at its stamp."""
    core.imu_ns[0] = stamp_ns
    core.imu[0, 0:3] = rate
    core.imu[0, 3:6] = force
    core.cursor[SAMPLES] = 1
    core.cursor[FIRST_CHECKPOINT] = 0
    core.cursor[LAST_CHECKPOINT] = -1
    core.cursor[PUBLISH_DUE] = next_publish(core, stamp_ns)
    begin_block(core, stamp_ns)
    save_checkpoint(core)
