"""What the stamps of a topic say: which samples are in order, at what rate, with which gaps.

A stamp is ``t_k = t_0 + dt c_k + jitter``, with whole numbers ``c_k``, the *cells* of a uniform
grid.  A gap is a jump of ``c_k`` by more than one that lasts; jitter is a jump that comes back at
once, and a stall of the sender (samples stamped late, then in a burst) one that comes back within
seconds.
Clock steps (a stamp that jumps back by more than half a second and goes on from there, ahead by
more than a day, or ahead by half a second and twice as far as the time of reception) are no passage
of time: what follows a step is put one missing sample behind what precedes it, and a note says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imu_noise_id.recording import Floats, Mask, Stamps

Cells = NDArray[np.int64]

STEP_BACK_NS = 500_000_000
STEP_AHEAD_NS = 86_400_000_000_000
STRAY_SAMPLES = 3
"""As many samples with stamps far off, between samples that join up, are strays, not a step."""
GRID_CELLS_PER_SAMPLE = 4
GRID_CELLS = 1 << 22
"""A grid has no more than this many cells (and `GRID_CELLS_PER_SAMPLE` for each sample)."""
_WINDOW = 11
_LONGEST_WINDOW = 1001
_AROUND = 200
_MINUTE_NS = 60_000_000_000
_PARTS = 16
_LEAST_PART = 64
_OTHER_PARTS = 3
_RATE_CHANGE = 1.25
"""Ratio of sample periods of parts of a recording that losses do not explain."""
_BATCHED = 0.9
"""Of the messages, twice the share that has the stamp of the one before: all in batches of two."""
_LONGEST_STALL_NS = 10_000_000_000
_MOST_STALLED = 10_000
_STALL = 2.5
"""Periods between neighbours that may be a stall."""
_BLOCK = 256
_MOST_STEPS = 200_000
_MOST_BLOCKS = 2000
_STRETCH = 1 << 19


@dataclass(frozen=True)
class Timing:
    """The stamps of a topic, put in order.

    Attributes
    ----------
    kept : (m,) bool
        Which of the m messages are in order; the n are those.
    stamp_ns : (n,) int64
        Strictly increasing; behind a clock step shifted by a constant.
    rate_hz : float
        0.0 for fewer than two samples.
    jitter_s : float
    gaps, missing, duplicates, out_of_order : int
        As in `recording.Quality`.
    notes : tuple of str
    """

    kept: Mask
    stamp_ns: Stamps
    rate_hz: float
    jitter_s: float
    gaps: int
    missing: int
    duplicates: int
    out_of_order: int
    notes: tuple[str, ...] = ()


def examine(stamp_ns: Stamps, log_ns: Stamps | None = None) -> Timing:
    """Put stamps in order and describe them.

    Parameters
    ----------
    stamp_ns : (m,) int64
        In the order of reception.
    log_ns : (m,) int64, optional
        Times of reception, which tell a clock set ahead from a gap.

    Returns
    -------
    Timing
    """
    joined, stray, notes = join_clock_steps(stamp_ns, log_ns)
    if joined.size == 0 < stamp_ns.size:
        kept = np.zeros(stamp_ns.size, dtype=bool)
        return Timing(kept, joined, 0.0, 0.0, 0, 0, 0, stamp_ns.size, tuple(notes))
    kept, duplicates = _advancing(joined, stray)
    late = int(kept.size - kept.sum()) - duplicates
    ordered = joined if kept.all() else joined[kept]
    if ordered.size < 2:
        return Timing(kept, ordered, 0.0, 0.0, 0, 0, duplicates, late, tuple(notes))
    period_ns = sample_period_ns(ordered)
    cell = cells(ordered, period_ns)
    limit = GRID_CELLS + GRID_CELLS_PER_SAMPLE * ordered.size
    if cell[-1] > limit:
        ordered = _shorten_gaps(ordered, cell, period_ns, limit)
        notes.append("gaps far longer than the recording are shortened")
        cell = cells(ordered, period_ns)
    gaps = int(np.count_nonzero(cell[1:] - cell[:-1] > 1))
    notes += _rate_changes(ordered)
    return Timing(
        kept,
        ordered,
        1e9 / period_ns,
        _jitter_ns(ordered, cell, period_ns) * 1e-9,
        gaps,
        int(cell[-1]) + 1 - cell.size,
        duplicates,
        late,
        tuple(notes),
    )


def spread_batches(stamp_ns: Stamps, fresh: Mask) -> tuple[Stamps, tuple[str, ...]]:
    """Stamps of their own for samples that a driver reads in batches and stamps once a batch.

    A batch's last sample keeps its stamp; those before it are spread evenly between the batch
    before, or as much time as a batch takes, and it.  Stamps of which fewer than half are shared
    stay as they are, and so do those of messages that came twice.

    Parameters
    ----------
    stamp_ns : (n,) int64
        In the order of reception.
    fresh : (n,) bool
        Whether a sample's values differ from those of the sample before.

    Returns
    -------
    stamps : (n,) int64
    notes : tuple of str
    """
    shared = (stamp_ns[1:] == stamp_ns[:-1]) & fresh[1:]
    size = stamp_ns.size
    if 2 * np.count_nonzero(shared) < _BATCHED * size:
        return stamp_ns, ()
    first = np.concatenate(([0], np.flatnonzero(stamp_ns[1:] != stamp_ns[:-1]) + 1))
    count = np.diff(np.append(first, size))
    steps = np.diff(stamp_ns[first])
    if first.size < 3 or not (steps > 0).any():
        return stamp_ns, ()
    ahead = steps > 0
    period = float(np.median(steps[ahead] / count[1:][ahead]))
    most = np.rint(count * period).astype(np.int64)
    span = most.copy()
    span[1:] = np.where(ahead, np.minimum(steps, most[1:]), most[1:])
    place = np.arange(size) - np.repeat(first, count) + 1  # 1 to the batch's size
    back = np.repeat(span / count, count) * (np.repeat(count, count) - place)
    note = f"messages share one stamp, {np.median(count):g} at a time: spread between the stamps"
    return stamp_ns - np.rint(back).astype(np.int64), (note,)


def _rate_changes(stamp_ns: Stamps) -> list[str]:
    """Say so where the median step of one part of the recording is not that of another."""
    size = stamp_ns.size // _PARTS
    if size < _LEAST_PART:
        return []
    parts = stamp_ns[: size * _PARTS].reshape(_PARTS, size)
    lag = size // 8  # over many samples: bursts and jitter are no other rate
    steps = np.median(parts[:, lag:] - parts[:, :-lag], axis=1) / lag
    ratio = steps / np.median(steps)
    other = (ratio > _RATE_CHANGE) | (ratio < 1.0 / _RATE_CHANGE)
    if np.count_nonzero(other) < _OTHER_PARTS:  # one or two may have a stall
        return []
    low, high = 1e9 / steps.max(), 1e9 / steps.min()
    return [
        f"the rate changes between {low:.4g} and {high:.4g} Hz: identify the parts of one rate by "
        "themselves (--last)"
    ]


def join_clock_steps(
    stamp_ns: Stamps, log_ns: Stamps | None = None
) -> tuple[Stamps, Mask | None, list[str]]:
    """Stamps without clock steps, which samples are strays, and notes.

    Neighbours more than half a second apart divide the stamps into runs; a run of a few samples
    whose neighbours join up without it is stray.  No stamps are returned where the clock is set so
    often that they are no times.
    """
    steps = np.diff(stamp_ns)
    far = (steps < -STEP_BACK_NS) | (steps > STEP_BACK_NS)
    places = np.flatnonzero(far)
    pace = np.inf if log_ns is None or not places.size else max(_pace(stamp_ns, log_ns), 1.0)
    if log_ns is None or np.isinf(pace):
        log_ns, pace = stamp_ns, 1.0  # no time of its own: a jump ahead is a gap
    passed: Floats = pace * (log_ns[places + 1] - log_ns[places]).astype(np.float64)
    if not _is_step(steps[places], passed).any():
        return stamp_ns, None, []
    begin = np.concatenate(([0], np.flatnonzero(far) + 1))
    end = np.append(begin[1:], stamp_ns.size)
    good = _without_strays(stamp_ns, begin, end)
    stray = np.zeros(stamp_ns.size, dtype=bool)
    for k in np.flatnonzero(~good).tolist():
        stray[begin[k] : end[k]] = True
    begin, end = begin[good], end[good]
    jump = stamp_ns[begin[1:]] - stamp_ns[end[:-1] - 1]
    passed = pace * _passed(stamp_ns, log_ns, end[:-1] - 1, begin[1:]).astype(np.float64)
    stepped = _is_step(jump, passed)
    count = int(stepped.sum())
    if count > 10 + stamp_ns.size // 100:
        return stamp_ns[:0], None, [f"the stamps jump {count} times: they are no times"]
    step = np.where(stepped, 2 * _typical_step_ns(steps), jump)
    length = stamp_ns[end - 1] - stamp_ns[begin]
    place = stamp_ns[begin[0]] + np.concatenate(([0], np.cumsum(length[:-1] + step)))
    joined = stamp_ns.copy()
    for k in np.flatnonzero(place != stamp_ns[begin]).tolist():
        joined[begin[k] : end[k]] += place[k] - stamp_ns[begin[k]]
    notes = []
    if count:
        largest = jump[stepped][np.argmax(np.abs(jump[stepped]))] * 1e-9
        times = "once" if count == 1 else f"{count} times"
        notes.append(
            f"the clock was set {times}, by up to {largest:+.6g} s; what follows is joined to what "
            "precedes"
        )
    return joined, stray, notes


def onward(steps: Stamps, passed: Stamps) -> Stamps:
    """Steps from stamp to stamp that are passage of time; 0 for those that are not.

    Steps back are not, nor steps of a day, nor of a minute while hardly any time passed (a
    recording may be played a hundred times as fast).

    Parameters
    ----------
    steps, passed : (n,) int64
        Of the stamps, and of the times of reception.
    """
    jumps = (steps > STEP_AHEAD_NS) | ((steps > _MINUTE_NS) & (passed < steps // 100))
    time: Stamps = np.where((steps > 0) & ~jumps, steps, 0)
    return time


def _pace(stamp_ns: Stamps, log_ns: Stamps) -> float:
    """How much faster the stamps run than reception: a recording may be played at any rate."""
    lag = max(min(100, stamp_ns.size // 4), 1)
    received = float(np.median(log_ns[lag:] - log_ns[:-lag]))
    sent = float(np.median(stamp_ns[lag:] - stamp_ns[:-lag]))
    return sent / received if received > 0 else np.inf


def _passed(stamp_ns: Stamps, log_ns: Stamps, last: Cells, first: Cells) -> Stamps:
    """Time between the least delayed messages about each jump, as if they were its neighbours.

    The neighbours themselves may have been delayed, and received together in the end.
    """
    passed = log_ns[first] - log_ns[last]
    delay = log_ns - stamp_ns
    jump = stamp_ns[first] - stamp_ns[last]
    for k in np.flatnonzero((jump > 0) & (passed < jump // 2)).tolist():
        before = delay[max(int(last[k]) + 1 - _AROUND, 0) : int(last[k]) + 1].min()
        passed[k] = jump[k] + delay[first[k] : first[k] + _AROUND].min() - before
    return passed


def _is_step(jump: Stamps, passed: Stamps | Floats) -> Mask:
    """Whether jumps of the stamps are the clock's, given how much time passed meanwhile."""
    ahead = (jump > STEP_AHEAD_NS) | ((jump > STEP_BACK_NS) & (passed < jump // 2))
    found: Mask = (jump < 0) | ahead
    return found


def _without_strays(stamp_ns: Stamps, begin: Cells, end: Cells) -> Mask:
    """Which runs to keep."""
    good = np.ones(begin.size, dtype=bool)
    last = int(stamp_ns[end[0] - 1])
    for k in range(1, begin.size - 1):
        here, after = int(stamp_ns[begin[k]]), int(stamp_ns[begin[k + 1]])
        goes_on = 0 < after - last <= STEP_AHEAD_NS
        astray = here < last or here > after
        if end[k] - begin[k] <= STRAY_SAMPLES and goes_on and astray:
            good[k] = False
        else:
            last = int(stamp_ns[end[k] - 1])
    return good


def _typical_step_ns(steps: Stamps) -> int:
    ahead = steps[(steps > 0) & (steps < STEP_AHEAD_NS)]
    return int(np.median(ahead)) if ahead.size else 1


def _advancing(stamp_ns: Stamps, stray: Mask | None) -> tuple[Mask, int]:
    """Samples stamped later than all before them, and how many of the others repeat a stamp."""
    kept = np.ones(stamp_ns.size, dtype=bool)
    if stray is not None:
        kept &= ~stray
    if stray is None and (stamp_ns[1:] > stamp_ns[:-1]).all():
        return kept, 0
    usable = np.flatnonzero(kept)
    newest = np.maximum.accumulate(stamp_ns[usable])
    kept[usable[1:]] = stamp_ns[usable[1:]] > newest[:-1]
    left_out = stamp_ns[~kept]
    return kept, int(np.isin(left_out, stamp_ns[kept]).sum())


def sample_period_ns(stamp_ns: Stamps) -> float:
    """Time between neighbouring samples where none is missing.

    The shortest steps give the first guess where all are multiples of them, else the median step;
    where the samples come in bursts, the mean step.  The slope
    of the stamps over their cells, fitted within gapless stretches, gives the value; where samples
    are lost among jittering stamps, which would bias it, the clock that the stamps keep does.
    """
    every = 1 + stamp_ns.size // _MOST_STEPS
    steps = stamp_ns[1::every] - stamp_ns[:-1:every]
    period = float(np.quantile(steps, 0.1))
    if np.mean(np.abs(steps / period - np.rint(steps / period)) < 0.1) < 0.9:
        period = float(np.median(steps))
        near = np.abs(steps - period) < 0.5 * period  # not across a loss
        period = float(np.median(steps[near])) if near.any() else period
        if _smoothing_samples(steps, period) == _WINDOW and np.mean(steps > 1.5 * period) > 0.01:
            from imu_noise_id.phase import clock_period  # seldom needed

            if (clocked := clock_period(stamp_ns, period)) is not None:
                return clocked
    lost = np.rint(steps / period)
    if np.mean(lost > 1.5) > 0.02 and lost.sum() > 3.0 * steps.size:
        period = float(np.mean(steps[steps <= np.quantile(steps, 0.999)]))
    for _ in range(2):
        period = _slope_ns(stamp_ns, cells(stamp_ns, period), period)
    return period


def cells(stamp_ns: Stamps, period_ns: float) -> Cells:
    """Cell of each sample on the uniform grid, the first in cell 0, strictly increasing.

    About a step that is not within half a period of one period, whole multiples count as they are;
    else the lag of the stamps behind the count of samples decides.  Its median over 11 samples
    jumps by whole periods at a gap and not at jitter; the smallest sum of such jumps in the coming
    seconds grows at a gap and not at a stall, after which the samples catch up.
    """
    cell = np.arange(stamp_ns.size)
    odd = _odd_steps(stamp_ns, period_ns)
    if odd.size == 0:
        return cell
    window = _smoothing_samples(np.diff(stamp_ns), period_ns)
    ahead = _samples_ahead(period_ns) + window
    for begin, end in _neighbourhoods(odd, stamp_ns.size, 2 * window, ahead + window):
        lost = _lost(stamp_ns[begin:end], period_ns, window, ahead)
        cell[begin + 1 : end] += np.cumsum(lost)
        cell[end:] += int(lost.sum())
    return cell


def _odd_steps(stamp_ns: Stamps, period_ns: float) -> Cells:
    """Where the step to the next sample is not within half a period of one period."""
    parts = []
    for begin in range(0, stamp_ns.size, _STRETCH):
        steps = np.diff(stamp_ns[begin : begin + _STRETCH + 1])
        parts.append(begin + np.flatnonzero(np.abs(steps - period_ns) > 0.5 * period_ns))
    return np.concatenate(parts)


def _lost(stamp_ns: Stamps, period_ns: float, window: int, ahead: int) -> Cells:
    """Cells without a sample before each sample but the first."""
    ratio = np.diff(stamp_ns) / period_ns
    whole = np.rint(ratio)
    if (np.abs(ratio - whole) < 0.2).all() and (whole >= 1).all():
        return whole.astype(np.int64) - 1
    from scipy.ndimage import median_filter, minimum_filter1d  # slow to import, seldom needed

    from imu_noise_id.phase import clock_cells, whole_jumps

    position = (stamp_ns - stamp_ns[0]) / period_ns
    if (clocked := clock_cells(position)) is not None:
        return np.diff(clocked) - 1
    lag = position - np.arange(stamp_ns.size)
    smooth = median_filter(lag, window, mode="nearest") if lag.size > 2 else lag
    behind = whole_jumps(smooth)
    lasting = minimum_filter1d(behind, ahead, mode="nearest", origin=-(ahead // 2))
    return np.maximum(np.diff(lasting), 0)


def _smoothing_samples(steps: Stamps, period_ns: float) -> int:
    """Samples of the median that tells gaps from jitter: as many as four bursts have, if any."""
    tight = int(np.count_nonzero(steps < 0.25 * period_ns))
    if tight < 0.3 * steps.size:
        return _WINDOW
    burst = steps.size // max(steps.size - tight, 1) + 1
    return min(4 * burst + 1, _LONGEST_WINDOW)


def _neighbourhoods(odd: Cells, size: int, back: int, ahead: int) -> list[tuple[int, int]]:
    """Stretches of samples about the odd steps, none touching another."""
    split = np.flatnonzero(np.diff(odd) > back + ahead) + 1
    first = odd[np.concatenate(([0], split))] - back
    last = odd[np.concatenate((split - 1, [odd.size - 1]))] + ahead + 2
    return list(zip(np.maximum(first, 0).tolist(), np.minimum(last, size).tolist(), strict=True))


def _slope_ns(stamp_ns: Stamps, cell: Cells, period_ns: float) -> float:
    """Least-squares period within gapless stretches; the guess where there is none.

    Stretches end at the latest after `_STRETCH` samples, which bounds the memory for them.
    """
    weight = slope = 0.0
    for begin in range(0, stamp_ns.size, _STRETCH):
        part = slice(begin, begin + _STRETCH)
        w, s = _slope_sums(stamp_ns[part], cell[part], period_ns)
        weight, slope = weight + w, slope + s
    period = period_ns + slope / weight if weight > 0 else period_ns
    return period if 0.5 * period_ns < period < 2.0 * period_ns else period_ns


def _slope_sums(stamp_ns: Stamps, cell: Cells, period_ns: float) -> tuple[float, float]:
    """Sums of (c - mean c)^2 and of (c - mean c)(t - dt c), means within each gapless stretch."""
    residual = _residual_ns(stamp_ns, cell, period_ns)
    stretch = np.concatenate(([0], np.cumsum(np.diff(cell) > 1)))
    if (np.diff(stamp_ns) > _STALL * period_ns).any():
        prompt = ~_stalled(residual, period_ns)
        cell, residual, stretch = cell[prompt], residual[prompt], stretch[prompt]
    edge = np.flatnonzero(np.diff(stretch, prepend=-1))
    count = np.diff(np.append(edge, stretch.size))
    x = cell - np.repeat(np.add.reduceat(cell, edge) / count, count)
    y = residual - np.repeat(np.add.reduceat(residual, edge) / count, count)
    return float(x @ x), float(x @ y)


def _stalled(residual: Floats, period_ns: float) -> Mask:
    """Which samples are stamped periods later than those that come after them."""
    from scipy.ndimage import minimum_filter1d  # slow to import, seldom needed

    ahead = _samples_ahead(period_ns)
    late = residual - minimum_filter1d(residual, ahead, mode="nearest", origin=-(ahead // 2))
    # the median is what a wrong period makes of all samples
    found: Mask = late > 2.0 * np.median(late) + _STALL * period_ns
    return found


def _samples_ahead(period_ns: float) -> int:
    """Samples in which a sender that stalled has caught up."""
    return int(min(_LONGEST_STALL_NS / period_ns, _MOST_STALLED)) + _WINDOW


def _residual_ns(stamp_ns: Stamps, cell: Cells, period_ns: float) -> Floats:
    """How much later than its cell each sample is, the first not at all."""
    return (stamp_ns - stamp_ns[0]) - (cell - cell[0]) * period_ns


def _jitter_ns(stamp_ns: Stamps, cell: Cells, period_ns: float) -> float:
    """Standard deviation of the stamps about straight lines through blocks of 256 samples.

    The lines follow a clock that drifts.  Of a long recording some blocks are taken, evenly spread.
    """
    size = min(_BLOCK, stamp_ns.size)
    if size < 3:
        return 0.0
    count = stamp_ns.size // size
    some = slice(None, None, 1 + count // _MOST_BLOCKS)
    first = np.arange(count)[some] * size
    samples = first[:, np.newaxis] + np.arange(size)
    stamps, cells_ = stamp_ns[samples], cell[samples]
    blocks = (stamps - stamps[:, :1]) - (cells_ - cells_[:, :1]) * period_ns
    x = np.arange(size) - (size - 1) / 2.0
    blocks = blocks - blocks.mean(axis=1, keepdims=True)
    blocks = blocks - np.outer(blocks @ x / (x @ x), x)
    return float(np.sqrt(np.median((blocks**2).sum(axis=1)) / (size - 2)))


def _shorten_gaps(stamp_ns: Stamps, cell: Cells, period_ns: float, limit: int) -> Stamps:
    """Cut the longest gaps to one length so that the grid has `limit` cells."""
    lost = np.diff(cell) - 1
    longest = np.sort(lost)[::-1]
    room = limit - cell.size
    total = np.cumsum(longest)
    rest = int(lost.sum()) - total
    count = np.arange(1, longest.size + 1)
    length = (room - rest) // count
    fitting = np.flatnonzero((length >= 0) & (length <= longest))
    cut = int(length[fitting[0]]) if fitting.size else 0
    excess = np.where(lost > cut, lost - cut, 0)
    return stamp_ns - np.concatenate(([0], np.cumsum(np.rint(excess * period_ns)))).astype(np.int64)
