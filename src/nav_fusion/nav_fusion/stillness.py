"""Whether the platform rests: blocks of samples watched, and what rest tells all hypotheses."""

from __future__ import annotations

import math

from imu_noise_id.compiled import njit

from nav_fusion.arrays import (
    ACCEL_PSD,
    BLOCK_COUNT,
    BLOCK_START,
    BLOCK_STEPS,
    BLOCK_SUMS,
    DENIED,
    DENIED_AT,
    FAST_BLOCKS,
    GYRO_PSD,
    LAST_FORCE,
    LOUD_STEPS,
    NEXT,
    QUIET,
    QUIET_BLOCKS,
    QUIET_STEPS,
    REPOSE,
    RESTING,
    SHAKE,
    SHAKE_BLOCKS,
    SLOW_BLOCKS,
    START,
    STILL,
    STILL_USE,
    Core,
    Floats,
    sensing_of,
    slow_of,
    update_of,
)
from nav_fusion.circle import fall_asleep, wake
from nav_fusion.hypotheses import catch_up, heaviest, refresh_bias, settle_all
from nav_fusion.repose import end_repose, is_known_to_move
from nav_fusion.resting import (
    correct_by_rates,
    correct_by_stop,
    fixes_contradict,
    forget_rest,
    is_slow,
    may_rest,
)
from nav_fusion.state import ALIVE, SLOW, STRIDE, R

SETTLING_BLOCKS, WATCHED_BLOCKS = 120.0, 480.0
"""Quiet blocks (30 s and 2 minutes) after which rest that was contradicted is watched for again,
and so long it must hold."""

MOST_SHAKE_BLOCKS = 40.0
SLEEPY_BLOCKS = 8.0
"""So often, of quiet blocks, hypotheses are asked whether they may fall asleep."""
CHANGE_LIMIT = 14.0
"""Of white noise alone, two blocks' means differ by more once in 10^4: 2/3 of chi-square's 21."""
SHAKE_HZ = 2.0
"""Shaking of the platform at rest is taken to be this fast: v = a/(2 pi f)."""


@njit(cache=True)
def add_to_block(d: Floats, before: Floats, reading: Floats) -> None:
    """Sum a sample, and its difference from the one before, into the block watched for rest."""
    d[BLOCK_COUNT] += 1.0
    for i in range(3):
        w, f = reading[i], reading[3 + i]
        d[BLOCK_SUMS + i] += w
        d[BLOCK_SUMS + 3 + i] += f
        d[BLOCK_SUMS + 6] += w * w
        d[BLOCK_SUMS + 7] += f * f
        d[BLOCK_STEPS] += (w - before[i]) ** 2
        d[BLOCK_STEPS + 1] += (f - before[3 + i]) ** 2


@njit(cache=True)
def begin_block(core: Core, time_ns: int) -> None:
    """Begin to watch a new block after a sample's time."""
    core.shared[BLOCK_START : BLOCK_SUMS + 8] = 0.0
    core.shared[BLOCK_STEPS : BLOCK_STEPS + 2] = 0.0
    core.shared[BLOCK_START] = float(time_ns - core.cursor[START])


@njit(cache=True)
def block_due(core: Core) -> int:
    """Time at or after which a sample ends the block."""
    length = core.shared[BLOCK_START] + 1e9 * core.constants[QUIET + 2]
    return core.cursor[START] + int(length)


@njit(cache=True)
def close_block(core: Core, time_ns: int) -> None:
    """Decide whether the block was quiet; correct by rest after enough quiet blocks in a row."""
    catch_up(core)
    length_s = (float(time_ns - core.cursor[START]) - core.shared[BLOCK_START]) * 1e-9
    d, mean, k = core.shared, core.work[24:30], core.constants
    n = d[BLOCK_COUNT]
    rate2, force2, change2 = 0.0, 0.0, 0.0
    if d[LAST_FORCE] == d[LAST_FORCE + 1] == d[LAST_FORCE + 2] == 0.0:  # the first block of all
        for i in range(3):
            d[LAST_FORCE + i] = d[BLOCK_SUMS + 3 + i] / n
    for i in range(3):
        mean[i] = d[BLOCK_SUMS + i] / n
        mean[3 + i] = d[BLOCK_SUMS + 3 + i] / n
        rate2 += mean[i] ** 2
        force2 += mean[3 + i] ** 2
        change2 += (mean[3 + i] - d[LAST_FORCE + i]) ** 2
        d[LAST_FORCE + i] = mean[3 + i]
    shake = d[BLOCK_SUMS + 7] / n - force2
    quiet = d[BLOCK_SUMS + 6] / n - rate2 < k[QUIET + 1] and shake < k[QUIET]
    # a smooth start, or the turning point of a swing, is quiet; but its force changes
    white = k[ACCEL_PSD] + k[ACCEL_PSD + 1] + k[ACCEL_PSD + 2]
    quiet = quiet and change2 < CHANGE_LIMIT * white / length_s + k[QUIET + 6]
    if rate2 > k[QUIET + 4] ** 2:
        d[FAST_BLOCKS] += 1.0
    note_steps(core, quiet)
    begin_block(core, time_ns)
    if quiet:
        d[QUIET_BLOCKS] += 1.0
        d[SHAKE_BLOCKS] = min(d[SHAKE_BLOCKS] + 1.0, MOST_SHAKE_BLOCKS)
        d[SHAKE] += (shake * n / max(n - 1.0, 1.0) - d[SHAKE]) / d[SHAKE_BLOCKS]
    else:
        d[QUIET_BLOCKS] = 0.0
        end_repose(core)
        d[SHAKE : RESTING + 1] = 0.0
        wake(core)
    if d[REPOSE] == 1.0 and is_known_to_move(core):
        end_repose(core)
    d[STILL] = 1.0 if d[QUIET_BLOCKS] >= k[QUIET + 3] else 0.0
    if d[STILL] == 1.0 and k[STILL_USE] != 0.0:
        rest(core, mean, length_s, n)


@njit(cache=True)
def note_steps(core: Core, quiet: bool) -> None:
    """Keep the block's first differences where the platform rests: the IMU's noise is seen there.

    A platform that the fixes show to rest while its sensors are not quiet is kept apart: it may
    shake, or the IMU may be noisier than its model lets rest be told.
    """
    d, k = core.shared, core.constants
    best = core.bank[heaviest(core)]
    slow = is_slow(best, core.target.size, k[STILL_USE - 1])
    d[SLOW_BLOCKS] = d[SLOW_BLOCKS] + 1.0 if slow else 0.0
    if quiet and d[QUIET_BLOCKS] + 1.0 >= k[QUIET + 3]:
        steps = d[QUIET_STEPS : QUIET_STEPS + 3]
    elif d[SLOW_BLOCKS] >= k[QUIET + 3]:
        steps = d[LOUD_STEPS : LOUD_STEPS + 3]
    else:
        return
    steps[0] += d[BLOCK_COUNT]
    steps[1] += d[BLOCK_STEPS]
    steps[2] += d[BLOCK_STEPS + 1]


@njit(cache=True)
def shake_variance(core: Core, samples: float) -> float:
    """Variance of the platform's velocity at rest, by what its accelerometer shows beyond noise.

    The excess of the quiet blocks' mean variance over the model's white noise, where it is beyond
    two standard errors, at ``SHAKE_HZ``, and a least one.
    """
    d, k = core.shared, core.constants
    freedom = max(samples - 1.0, 1.0) * d[SHAKE_BLOCKS]
    # the three axes' white noise need not be alike: the loudest alone would have this error
    error = k[QUIET + 5] * math.sqrt(2.0 / freedom)
    excess = max(d[SHAKE] - k[QUIET + 5] - 2.0 * error, 0.0)
    return k[STILL_USE - 3] ** 2 + excess / (2.0 * math.pi * SHAKE_HZ) ** 2


@njit(cache=True)
def rest(core: Core, mean: Floats, length_s: float, samples: float) -> None:
    """Correct all hypotheses by rest, unless the heaviest or the fixes contradict it.

    One decision for all: those that used more data than others would seem likelier.
    """
    d = core.shared
    m = core.target.size
    slow, sensing, update = slow_of(core), sensing_of(core), update_of(core)
    settle_all(core)
    best = core.bank[heaviest(core)]
    if d[DENIED] > 0.0:
        watch_denied(core, best)
    elif d[RESTING] == 1.0 and fixes_contradict(best, slow):
        d[DENIED] = 1.0
        scale = core.z[max(core.cursor[NEXT] - 1, 0), 15:18]
        wake(core)
        for h in range(core.bank.shape[0]):
            forget_rest(core.bank[h], slow, scale, sensing.still[2], update)
    variance = shake_variance(core, samples)
    rests = d[DENIED] == 0.0 and may_rest(best, m, variance, sensing, update)
    d[RESTING] = 1.0 if rests else 0.0
    if not rests:
        wake(core)
        return
    gyro_psd = core.constants[GYRO_PSD : GYRO_PSD + 3]
    for h in range(core.bank.shape[0]):
        s = core.bank[h]
        if s[ALIVE] > 0.0:
            correct_by_rates(s, slow, mean, gyro_psd, length_s, sensing, update)
    end_repose(core)
    for h in range(core.bank.shape[0]):
        s = core.bank[h]
        if s[ALIVE] > 0.0:
            correct_by_stop(s, slow, variance, sensing, update)
            refresh_bias(s, slow)
    if d[QUIET_BLOCKS] % SLEEPY_BLOCKS == 0.0:
        fall_asleep(core)


@njit(cache=True)
def watch_denied(core: Core, best: Floats) -> None:
    """Believe in rest again when a contradicted platform has not moved for ``WATCHED_BLOCKS``.

    A chance contradicts rest now and then, and an even drive moves away meanwhile: by 3 sigma of
    the difference of two positions, which is less than 4 cm/s for fixes that are 1 m off.
    """
    d, P = core.shared, best[SLOW + core.target.size :]
    d[DENIED] += 1.0
    if d[DENIED] == SETTLING_BLOCKS:
        d[DENIED_AT : DENIED_AT + 3] = best[R : R + 3]
    if d[DENIED] < SETTLING_BLOCKS + WATCHED_BLOCKS:
        return
    moved2, widest = 0.0, 0.0
    for i in range(3):
        moved2 += (best[R + i] - d[DENIED_AT + i]) ** 2
        widest = max(widest, P[i * (STRIDE + 1)])
    d[DENIED] = 0.0 if moved2 < 9.0 * 2.0 * widest else SETTLING_BLOCKS - 1.0
