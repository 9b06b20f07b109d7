"""Sums of squared window differences at every averaging factor, in one pass and O(log n) memory.

Level ``l`` holds block sums of ``2**l`` samples.  An averaging factor ``m = k 2**l`` is the
difference of two windows of ``k`` blocks, taken at every block: every sample starts a difference up
to ``m = 31``, every ``m/k`` samples beyond, with ``k`` from 16 on (from 32 on where ``m >= 512``,
which costs little there).  Strides of m/16 keep more than 0.995 of the equivalent degrees of
freedom of white noise, flicker and random walk and make a long ``m`` nearly free: some 26
differences a sample serve all averaging factors together.  Beyond level 0 ``k`` is even: a line at
a multiple of half the block rate, which such a stride would see at one phase only, then sums to
nothing within a window.

The samples are worked in chunks of ``CHUNK`` that stay in cache through all levels, so a record is
read from memory once; a stream and an array go through the same code and give the same bits,
whatever the size of the batches.

Gaps.  A window is the mean of its observed samples and counts if at least ``WHOLE`` of its samples
were observed; a difference counts if both of its windows do.  A window mean of ``c`` of ``m``
samples scatters more than that of all ``m``, by ``(1/c - 1/m) s^2`` where the loss is independent
of the signal (sampling without replacement; ``s^2`` is the variance within the window).  The sum of
that excess is kept beside the sum of squares, to be subtracted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from imu_noise_id.compiled import njit
from imu_noise_id.recording import Floats, Mask

CHUNK = 4096
LEVELS = 32
WHOLE = 0.75
PER_OCTAVE = 6
WIDEST = 62
"""Largest number of blocks in a window; a level remembers ``2 * WIDEST - 1`` blocks."""
TAIL = 2 * WIDEST - 1
FINE_LEVEL = 4
"""From this level on windows have 32 to 62 blocks, so that a curve can end near n/3."""

_FAST = {"reassoc", "contract", "nsz", "arcp"}


def window_table() -> NDArray[np.bool_]:
    """Which ``k`` each level accumulates, shape (LEVELS, WIDEST + 1)."""
    grid = np.rint(2.0 ** (np.arange(5 * PER_OCTAVE) / PER_OCTAVE)).astype(int)
    table = np.zeros((LEVELS, WIDEST + 1), dtype=bool)
    table[0, grid[grid < 32]] = True
    table[1 : FINE_LEVEL + 1, [16, 18, 20, 22, 26, 28]] = True
    table[FINE_LEVEL:, 32::2] = True
    return table


WINDOWS = window_table()


@dataclass(frozen=True)
class Pyramid:
    """What is remembered of the samples fed so far.

    Attributes
    ----------
    fed : int
        Samples seen, unobserved ones included.
    centre : float or None
        First observed sample; it is subtracted from every value to keep digits.
    pending, pending_observed : (p,) float64, (p,) bool
        The last samples, fewer than ``CHUNK``, that await a whole chunk.
    tails : (3, LEVELS, TAIL) float64
        Sum, count and sum of squares of the last blocks of each level.
    odd : (3, LEVELS) float64
        The block of each level that awaits its partner.
    blocks : (LEVELS,) int64
        Blocks completed at each level.
    totals : (3, LEVELS, WIDEST + 1) float64
        Sum of squared differences of window means, of their excess, and number of differences.
    """

    fed: int
    centre: float | None
    pending: Floats
    pending_observed: Mask
    tails: Floats
    odd: Floats
    blocks: NDArray[np.int64]
    totals: Floats


def empty_pyramid() -> Pyramid:
    """Return the pyramid of no samples."""
    return Pyramid(
        fed=0,
        centre=None,
        pending=np.empty(0),
        pending_observed=np.empty(0, dtype=bool),
        tails=np.zeros((3, LEVELS, TAIL)),
        odd=np.zeros((3, LEVELS)),
        blocks=np.zeros(LEVELS, dtype=np.int64),
        totals=np.zeros((3, LEVELS, WIDEST + 1)),
    )


def feed(pyramid: Pyramid, values: Floats, observed: Mask | None = None) -> Pyramid:
    """Return the pyramid with a batch appended; the argument is left as it was.

    Parameters
    ----------
    pyramid : Pyramid
    values : (b,) float64
        The next samples on the uniform grid.
    observed : (b,) bool, optional
        False where a sample is absent.  None: all were observed.
    """
    values = np.ascontiguousarray(values, dtype=np.float64)
    if observed is None:
        observed = np.ones(values.size, dtype=bool)
    fed = pyramid.fed + values.size
    centre = pyramid.centre
    if centre is None and observed.any():
        centre = float(values[np.argmax(observed)])
    if pyramid.pending.size:
        values = np.concatenate((pyramid.pending, values))
        observed = np.concatenate((pyramid.pending_observed, observed))
    whole = values.size - values.size % CHUNK
    grown = replace(
        pyramid,
        fed=fed,
        centre=centre,
        pending=values[whole:].copy(),
        pending_observed=observed[whole:].copy(),
    )
    return _advanced(grown, values[:whole], observed[:whole])


def totals(pyramid: Pyramid) -> Floats:
    """Return ``Pyramid.totals`` with the pending samples counted in, shape (3, LEVELS, k)."""
    return _advanced(pyramid, pyramid.pending, pyramid.pending_observed).totals


def warm_up() -> None:
    """Compile the kernels into numba's cache, for a build to call."""
    observed = np.arange(2 * CHUNK) % 7 != 0
    observed[:CHUNK] = True
    totals(feed(empty_pyramid(), np.zeros(2 * CHUNK), observed))


def _advanced(pyramid: Pyramid, values: Floats, observed: Mask) -> Pyramid:
    """Return the pyramid with the samples worked through all levels."""
    if not values.size:
        return pyramid
    grown = replace(
        pyramid,
        tails=pyramid.tails.copy(),
        odd=pyramid.odd.copy(),
        blocks=pyramid.blocks.copy(),
        totals=pyramid.totals.copy(),
    )
    _work(
        values,
        np.ascontiguousarray(observed),
        pyramid.centre or 0.0,
        WINDOWS,
        grown.tails,
        grown.odd,
        grown.blocks,
        grown.totals,
    )
    return grown


@njit(cache=True, nogil=True)
def _work(
    values: Floats,
    observed: Mask,
    centre: float,
    windows: Mask,
    tails: Floats,
    odd: Floats,
    blocks: NDArray[np.int64],
    sums: Floats,
) -> None:
    """Take the samples chunk by chunk through all levels, updating the last four arrays."""
    buffer, spare = np.empty((3, TAIL + CHUNK)), np.empty((3, TAIL + CHUNK))
    prefix = np.empty((3, TAIL + CHUNK + 1))
    for start in range(0, values.size, CHUNK):
        size = min(CHUNK, values.size - start)
        _fill(values[start : start + size], observed[start : start + size], centre, buffer)
        for level in range(LEVELS):
            before = min(blocks[level], TAIL)
            for row in range(3):
                buffer[row, :TAIL] = tails[row, level]
                tails[row, level] = buffer[row, size : size + TAIL]
            _difference(buffer, before, size, level, windows[level], prefix, sums[:, level])
            waiting = blocks[level] % 2
            blocks[level] += size
            for row in range(3):
                odd[row, level] = _pair(buffer[row], size, waiting, odd[row, level], spare[row])
            size = (size + waiting) // 2
            if size == 0:
                break
            buffer, spare = spare, buffer


@njit(cache=True, nogil=True)
def _fill(values: Floats, observed: Mask, centre: float, buffer: Floats) -> None:
    """Blocks of one sample: value about the centre, count, square."""
    value, count, square = buffer[0][TAIL:], buffer[1][TAIL:], buffer[2][TAIL:]
    for i in range(values.size):
        count[i] = 1.0 if observed[i] else 0.0
    for i in range(values.size):
        value[i] = values[i] - centre if observed[i] else 0.0
    for i in range(values.size):
        square[i] = value[i] * value[i]


@njit(cache=True, nogil=True)
def _pair(blocks: Floats, size: int, waiting: int, odd: float, out: Floats) -> float:
    """Add the new blocks two by two into ``out``; return the one that awaits its partner."""
    new, paired = blocks[TAIL:], out[TAIL:]
    if waiting:
        if size:
            paired[0] = odd + new[0]
        paired, new = paired[1:], new[1:]
        size -= 1
    halves = size // 2
    both = new[: 2 * halves].reshape((halves, 2))
    for i in range(halves):
        paired[i] = both[i, 0] + both[i, 1]
    return new[size - 1] if size % 2 else 0.0


@njit(cache=True, nogil=True, fastmath=_FAST)
def _missing(counts: Floats, first: int, last: int, length: float) -> float:
    """Absent samples of the blocks from first to last."""
    part = counts[first:last]
    seen = 0.0
    for i in range(part.size):
        seen += part[i]
    return (last - first) * length - seen


@njit(cache=True, nogil=True)
def _difference(
    buffer: Floats,
    before: int,
    size: int,
    level: int,
    windows: Mask,
    prefix: Floats,
    sums: Floats,
) -> None:
    """Add the differences that end in the ``size`` new blocks to ``sums``, shape (3, k)."""
    first = TAIL - before
    total = before + size
    length = 2.0**level
    whole = _missing(buffer[1], first, TAIL + size, length) == 0.0
    references = (buffer[0, first], 0.0, 0.0) if whole else (0.0, 0.0, 0.0)
    for row in range(1 if whole else 3):
        _accumulate(buffer[row], first, total, references[row], prefix[row])
    for k in range(1, WIDEST + 1):
        start = max(0, before - 2 * k + 1)
        count = total - 2 * k - start + 1
        if not windows[k] or count <= 0:
            continue
        if whole:
            sums[0, k] += _whole_squares(prefix[0], start, k, count) / (k * length) ** 2
            sums[2, k] += count
        else:
            square, excess, used = _masked_squares(prefix, start, k, count, length)
            sums[0, k] += square
            sums[1, k] += excess
            sums[2, k] += used


@njit(cache=True, nogil=True)
def _accumulate(blocks: Floats, first: int, total: int, reference: float, prefix: Floats) -> None:
    """Prefix sums of blocks minus a reference, which second differences do not see."""
    whole = total - total % 4
    new = blocks[first : first + whole].reshape((whole // 4, 4))
    out = prefix[1 : whole + 1].reshape((whole // 4, 4))
    running = 0.0
    prefix[0] = running
    for i in range(whole // 4):  # by fours: one addition waits for the last, not four
        a, b = new[i, 0] - reference, new[i, 1] - reference
        c, d = new[i, 2] - reference, new[i, 3] - reference
        out[i, 0] = running + a
        out[i, 1] = running + (a + b)
        out[i, 2] = running + ((a + b) + c)
        running += (a + b) + (c + d)
        out[i, 3] = running
    for i in range(whole, total):
        running += blocks[first + i] - reference
        prefix[i + 1] = running


@njit(cache=True, nogil=True, fastmath=_FAST)
def _whole_squares(prefix: Floats, start: int, k: int, count: int) -> float:
    """Sum of squared differences of adjacent windows of ``k`` blocks, nothing missing."""
    left = prefix[start : start + count]
    middle = prefix[start + k : start + k + count]
    right = prefix[start + 2 * k : start + 2 * k + count]
    square = 0.0
    for i in range(count):
        difference = right[i] - 2.0 * middle[i] + left[i]
        square += difference * difference
    return square


@njit(cache=True, nogil=True, fastmath=_FAST)
def _masked_squares(
    prefix: Floats, start: int, k: int, count: int, length: float
) -> tuple[float, float, float]:
    """Squared differences of the means of whole enough windows, their excess and their number."""
    mean = _windows(prefix[0], start, k, count)
    enough = _windows(prefix[1], start, k, count)
    excess = _windows(prefix[2], start, k, count)
    inverse_m, least = 1.0 / (k * length), WHOLE * k * length
    for i in range(count + k):
        seen, total = enough[i], mean[i]
        inverse = 1.0 / (seen if seen > 1.0 else 1.0)
        scatter = excess[i] - total * total * inverse
        scatter = (scatter if scatter > 0.0 else 0.0) / (seen - 1.0 if seen > 2.0 else 1.0)
        mean[i] = total * inverse
        excess[i] = (inverse - inverse_m) * scatter
        enough[i] = 1.0 if seen >= least else 0.0
    square, beyond, used = 0.0, 0.0, 0.0
    mean_end, excess_end, enough_end = mean[k:], excess[k:], enough[k:]
    for i in range(count):
        both = enough[i] * enough_end[i]
        difference = mean_end[i] - mean[i]
        square += both * difference * difference
        beyond += both * (excess_end[i] + excess[i])
        used += both
    return square, beyond, used


@njit(cache=True, nogil=True)
def _windows(prefix: Floats, start: int, k: int, count: int) -> Floats:
    """Sums over windows of ``k`` blocks; alone in its loop, so that it is vectorised."""
    left, right = prefix[start:], prefix[start + k :]
    sums = np.empty(count + k)
    for i in range(count + k):
        sums[i] = right[i] - left[i]
    return sums


@njit(cache=True, nogil=True)
def mean_excess(total: float, seen: float, squares: float, m: float) -> float:
    """Variance that a window mean gains by resting on ``seen`` of its ``m`` samples."""
    scatter = max(squares - total * total / seen, 0.0) / max(seen - 1.0, 1.0)
    return (1.0 / seen - 1.0 / m) * scatter
