"""Stamps from a clock that ticks coarsely beside the samples' own period.

A stamp is ``q floor(t/q)``: the steps are whole ticks, and samples share a stamp or lie one tick
more apart, by turns, though they come evenly and none is lost.  Their count tells: less the line
``dt c_k`` through them the stamps stay within one tick, where losses at random on a clock of period
``q`` would let them wander.  A lost sample moves all that follow by ``dt`` for good; which of the
samples that share a stamp it was cannot be known.
"""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from imu_noise_id.phase import clock_cells, clock_period
from imu_noise_id.recording import Floats, Mask, Stamps

COARSE = 0.4
"""Ticks of a smaller part of the period pass for jitter."""
LEAST_SAMPLES = 256
LEAST_TURNS = 8
"""Steps of a tick more or less than most.  As many losses at random on a clock of the tick's period
looked as even in none of 1200 recordings of 6000 samples; five of them did in 4 of 200."""
_EXACT = 0.02
_EXACT_NS = 2000.0
_SEEN_STEPS = 1 << 14
_FINEST = 0.05
_LOCAL = 32
_BLOCK = 256
_TURNS_PER_BLOCK = 8.0
_BEND = 0.35
"""Periods by which the stamps may be off a straight line between blocks that lost nothing."""
_DRIFT = 1e-5
"""Change of the clock's rate from block to block."""
_LEAST, _LOUDEST = 0.15, 0.58
"""Ticks, standard deviation: 0.29 for rounding alone, twice that where the stamps jitter too."""
_NEIGHBOURS = 11
_LASTING = 0.75
_SELDOM = 0.005
"""Share of the samples about which the stamps may be off by more than that many ticks."""
_SEARCHED = (-0.01, 0.08)
"""Losses make a period that is too long of the first guess."""
_ENDS = 4
_ALL = 0.98


def evened(stamp_ns: Stamps, fresh: Mask) -> tuple[Stamps, tuple[str, ...]]:
    """Stamps put back on the even grid that a coarse clock rounded them from.

    Other stamps stay as they are, and so do those that run backwards somewhere.

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
    tick = tick_ns(stamp_ns)
    if tick is None or (stamp_ns[1:] < stamp_ns[:-1]).any():
        return stamp_ns, ()
    new = np.ones(stamp_ns.size, dtype=bool)  # and not the same message again
    new[1:] = fresh[1:] | (stamp_ns[1:] != stamp_ns[:-1])
    even = _on_even_grid(stamp_ns if new.all() else stamp_ns[new], tick)
    if even is None:
        return stamp_ns, ()
    note = (
        f"the stamps come in ticks of {tick * 1e-6:.4g} ms, coarse beside the time between "
        "samples: put back on an even grid"
    )
    return even[np.cumsum(new) - 1], (note,)


def tick_ns(stamp_ns: Stamps) -> float | None:
    """Largest time of which 99 % of the steps are whole multiples, None where there is none."""
    first = max(stamp_ns.size - _SEEN_STEPS, 0) // 2
    steps = np.diff(stamp_ns[first : first + _SEEN_STEPS]).astype(np.float64)
    steps = steps[steps > 0]
    if steps.size < LEAST_SAMPLES:
        return None
    least, tick = _FINEST * float(steps.mean()), float(steps.min())
    while tick > least:
        over = np.abs(steps - tick * np.rint(steps / tick))
        off = over > max(_EXACT_NS, _EXACT * tick)
        if np.mean(off) < 0.01:
            count = np.rint(steps[~off] / tick)
            return float(count @ steps[~off] / (count @ count))
        tick = float(over[off].min())
    return None


def _on_even_grid(stamp_ns: Stamps, tick: float) -> Stamps | None:
    """Times of the samples whose stamps a coarse clock gives; None where it does not explain them.

    First as if none were lost, then by the cells of the clock that the stamps keep.
    """
    turns = _turns(stamp_ns, tick)
    if turns < LEAST_TURNS:
        return None
    elapsed = (stamp_ns - stamp_ns[0]).astype(np.float64)
    period = _local_period(elapsed, tick)
    if tick < COARSE * period or _in_batches(stamp_ns):
        return None
    block = max(_BLOCK, round(_TURNS_PER_BLOCK * stamp_ns.size / turns))
    even, bend = _even(elapsed, np.arange(elapsed.size), block)
    if bend > _BEND + _DRIFT * block or not _explained((elapsed - even) / tick):
        cell = _cells_with_losses(stamp_ns, period)
        if cell is None:
            return None
        even, _ = _even(elapsed, cell, block)
        if not _explained((elapsed - even) / tick):
            return None
    placed: Stamps = stamp_ns[0] + np.rint(even).astype(np.int64)
    return placed if (placed[1:] > placed[:-1]).all() else None


def _turns(stamp_ns: Stamps, tick: float) -> int:
    """How many steps are a tick more or less than most; in parts, for most clocks have none."""
    parts = range(0, stamp_ns.size - 1, _SEEN_STEPS)
    counts: Counter[float] = Counter()
    for first in parts:
        steps = np.rint(np.diff(stamp_ns[first : first + _SEEN_STEPS + 1]) / tick)
        values, times = np.unique(steps, return_counts=True)
        counts.update(dict(zip(values.tolist(), times.tolist(), strict=True)))
    return stamp_ns.size - 1 - max(counts.values())


def _in_batches(stamp_ns: Stamps) -> bool:
    """Whether as many samples share each stamp, as where a driver reads so many at a time."""
    first = np.flatnonzero(np.diff(stamp_ns, prepend=stamp_ns[0] - 1))
    size = np.diff(first)
    usual = np.median(size)
    return bool(usual >= 2 and np.mean(size == usual) > _ALL)


def _local_period(elapsed: Floats, tick: float) -> float:
    """Time a sample in the stretches of 32 samples that are most alike: those without a loss."""
    took = elapsed[_LOCAL:] - elapsed[:-_LOCAL]
    usual = np.partition(took, took.size // 2)[took.size // 2]  # one that is there
    alike = np.abs(took - usual) < 1.01 * tick
    return float(np.mean(took[alike])) / _LOCAL


def _even(elapsed: Floats, cell: NDArray[np.int64], block: int) -> tuple[Floats, float]:
    """Times of the cells on a clock that drifts slowly, and its sharpest bend in periods.

    They lie on straight lines between the means of blocks, where the lines bend.
    """
    x = cell - cell.mean()
    period = float(x @ elapsed / (x @ x))
    lag = elapsed - period * cell
    edges = np.linspace(0, lag.size, max(lag.size // block, 1) + 1).astype(np.int64)
    level = np.add.reduceat(lag, edges[:-1]) / np.diff(edges)
    middle = np.add.reduceat(cell, edges[:-1]) / np.diff(edges)
    bend = float(np.abs(np.diff(level, 2)).max(initial=0.0)) / period
    return period * cell + np.interp(cell, middle, level), bend


def _explained(off: Floats) -> bool:
    """Whether the stamps are off the even grid (in ticks) by their rounding and hardly by more."""
    from scipy.ndimage import uniform_filter1d  # slow to import, seldom needed

    lasting = np.abs(uniform_filter1d(off, _NEIGHBOURS)) > _LASTING
    return _LEAST < float(np.std(off)) < _LOUDEST and float(np.mean(lasting)) < _SELDOM


def _cells_with_losses(stamp_ns: Stamps, guess_ns: float) -> NDArray[np.int64] | None:
    """Cells of the clock whose spectral line the rounded stamps keep; None where they keep none.

    They keep none where a tick lasts a whole number of periods.
    """
    period = clock_period(stamp_ns, guess_ns, _SEARCHED)
    if period is None or (cell := clock_cells((stamp_ns - stamp_ns[0]) / period)) is None:
        return None
    count = np.arange(cell.size)
    lost = cell - count
    lost = np.clip(lost, lost[_ENDS], lost[-1 - _ENDS])  # nothing lies beyond to average rounding
    return np.asarray(count + lost - lost[0])
