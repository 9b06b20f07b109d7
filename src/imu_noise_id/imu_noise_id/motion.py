"""When the platform moved, and how that is told from noise.

Means over one second are compared with those of the second before.  An axis *moves* when they
differ by more than its noise explains: four times what the sample-to-sample scatter of those two
seconds (white noise, vibration, a burst) leaves in the difference of two means, and more than a
floor that bias drift does not reach in a second.  The platform moves where at least two of a
sensor's axes do at once, and by more than six times what is usual in the quietest part of the
recording, so that neither a step or drift of one channel nor a strong but steady coloured noise
counts.  What lies turned by more than ten degrees from the attitude in which the recording spends
most of its time is left out too, and where anything moved, the seconds in which two axes are twice
as loud as in the quietest tenth: knocks, and what rings after a move.  A receiver
moves when its velocity, or the way between medians
of its position, says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imu_noise_id.recording import Floats, Mask, Stamps

BLOCK_S = 1.0
BLOCK_SAMPLES = 16
NOISE_FACTOR = 4.0
QUIET_FACTOR = 15.0
GYRO_FLOOR = 0.005
"""rad/s; change of a one-second mean."""
ACCELEROMETER_FLOOR = 0.05
"""m/s^2."""
FIELD_FLOOR = 0.01
"""Of the field's strength."""
TURNED_RAD = np.deg2rad(10.0)
SPEED_M_S = 0.5
WAY_M = 5.0
MOST_WAYS = 4.0
"""A receiver that goes so many times `WAY_M` in a block moves, however steadily."""
POSITION_BLOCK_S = 10.0
SHORTEST_STILL_S = 5.0
UNEASY = 1.5
"""Times what white noise explains; where nine tenths of the seconds change by more on two axes, and
axes change together, there is no still part."""
LOUD = 2.0
"""Times the quietest tenth of the seconds; white noise comes to 1.2 in a second at 100 Hz."""
_CANDIDATES = 200

Topic = tuple[tuple[str, ...], Stamps, Floats]


@dataclass(frozen=True)
class Intervals:
    """Stretches of time, ascending and apart, ends included.

    Attributes
    ----------
    begin_ns, end_ns : (n,) int64
    """

    begin_ns: Stamps
    end_ns: Stamps

    def still(self, stamp_ns: Stamps) -> Mask:
        """Which stamps lie in none of the intervals."""
        if self.begin_ns.size == 0:
            return np.ones(stamp_ns.size, dtype=bool)
        begun = np.searchsorted(self.begin_ns, stamp_ns, side="right")
        return begun == np.searchsorted(self.end_ns, stamp_ns)

    def seconds_since(self, start_ns: int) -> tuple[tuple[float, float], ...]:
        """The intervals in seconds since a stamp."""
        return tuple(
            ((begin - start_ns) * 1e-9, (end - start_ns) * 1e-9)
            for begin, end in zip(self.begin_ns.tolist(), self.end_ns.tolist(), strict=True)
        )

    def note(self, start_ns: int) -> str:
        """The intervals in a sentence."""
        parts = [f"{begin:.1f}-{end:.1f}" for begin, end in self.seconds_since(start_ns)]
        more = f" and {len(parts) - 5} more" if len(parts) > 5 else ""
        return f"the platform moved at {', '.join(parts[:5])}{more} s: left out"


@dataclass(frozen=True)
class _Blocks:
    """Means over consecutive blocks of a sensor's k axes, empty blocks left out.

    Attributes
    ----------
    begin_ns, end_ns : (n,) int64
    mean, scatter : (k, n) float64
        Mean, and its standard deviation were the samples' scatter white.
    """

    begin_ns: Stamps
    end_ns: Stamps
    mean: Floats
    scatter: Floats

    def changes(self, floor: float) -> Floats:
        """Change of each axis between neighbouring blocks in units of what noise explains.

        Shape (k, n - 1); 0 where a gap of more than a block lies between.
        """
        noise = np.hypot(self.scatter[:, 1:], self.scatter[:, :-1])
        least = np.maximum(NOISE_FACTOR * noise, floor)
        scores = np.abs(np.diff(self.mean)) / np.maximum(least, np.finfo(float).tiny)
        apart = self.begin_ns[1:] - self.end_ns[:-1] > self.end_ns[:-1] - self.begin_ns[:-1]
        scores[:, apart] = 0.0
        return scores


def moving_intervals(topics: Sequence[Topic]) -> Intervals:
    """Find the stretches in which the platform moved.

    The accelerometers and gyros decide, or the magnetometer where there is none; a receiver that
    moves is believed in any case.

    Parameters
    ----------
    topics : sequence of (channel names, stamps (n,), values (k, n))

    Returns
    -------
    Intervals
    """
    found = {names[0].split(".")[0]: (stamps, values) for names, stamps, values in topics}
    parts: list[tuple[Stamps, Stamps]] = []
    if "angular_velocity" in found:
        parts += _inertial(*found["angular_velocity"])
    elif "magnetic_field" in found:
        parts += _magnetic(*found["magnetic_field"])
    if "velocity" in found:
        parts += _velocity(*found["velocity"])
    elif "position" in found:
        parts += _position(*found["position"])
    begin = np.concatenate([p[0] for p in parts] or [np.empty(0, np.int64)])
    end = np.concatenate([p[1] for p in parts] or [np.empty(0, np.int64)])
    return _joined(begin, end)


def _inertial(stamp_ns: Stamps, values: Floats) -> list[tuple[Stamps, Stamps]]:
    blocks = _blocks(stamp_ns, values, BLOCK_S)
    if blocks.begin_ns.size < 2:
        return []
    gyro, accelerometer = _rows(blocks, 0), _rows(blocks, 3)
    rates = gyro.changes(GYRO_FLOOR)
    forces = accelerometer.changes(ACCELEROMETER_FLOOR)
    together = _second_largest(np.vstack((rates, forces)))
    limit = _limit(together)
    pairs = _coupled_pairs(blocks)
    both = np.minimum(_second_largest(rates), _second_largest(forces))
    if np.median(both) > 1.0 and pairs >= 1:  # the quietest part is no quiet one
        limit = 1.0
    slight = (gyro.changes(0.1 * GYRO_FLOOR), accelerometer.changes(0.1 * ACCELEROMETER_FLOOR))
    uneasy = _second_largest(np.vstack(slight)) * NOISE_FACTOR
    if np.quantile(uneasy, 0.1) > UNEASY and pairs >= 2:
        return [(blocks.begin_ns[:1], blocks.end_ns[-1:])]
    found = [_about(blocks, together > limit), _turned(accelerometer)]
    return [*found, _shaken(blocks)] if any(begin.size for begin, _ in found) else found


def _magnetic(stamp_ns: Stamps, values: Floats) -> list[tuple[Stamps, Stamps]]:
    blocks = _blocks(stamp_ns, values, BLOCK_S)
    if blocks.begin_ns.size < 2:
        return []
    strength = float(np.median(np.linalg.norm(blocks.mean, axis=0)))
    together = _second_largest(blocks.changes(FIELD_FLOOR * strength))
    return [_about(blocks, together > _limit(together, 0.02)), _turned(blocks)]


def _velocity(stamp_ns: Stamps, values: Floats) -> list[tuple[Stamps, Stamps]]:
    blocks = _blocks(stamp_ns, values, BLOCK_S)
    speed = np.hypot(blocks.mean[0], blocks.mean[1])
    noise = np.hypot(blocks.scatter[0], blocks.scatter[1])
    fast = speed > np.maximum(SPEED_M_S, NOISE_FACTOR * noise)
    return [(blocks.begin_ns[fast], blocks.end_ns[fast])]


def _position(stamp_ns: Stamps, values: Floats) -> list[tuple[Stamps, Stamps]]:
    """Blocks whose median lies far from the one before; a jump of one fix moves no median."""
    edge, begin_ns, end_ns = _edges(stamp_ns, POSITION_BLOCK_S)
    middle = np.array(
        [
            np.nanmedian(values[:2, a:b], axis=1)
            if np.isfinite(values[0, a:b]).any()
            else (np.nan, np.nan)
            for a, b in zip(edge[:-1].tolist(), edge[1:].tolist(), strict=True)
        ]
    ).reshape(-1, 2)
    known = np.isfinite(middle[:, 0])
    blocks = _Blocks(begin_ns[known], end_ns[known], middle[known].T, np.zeros((2, known.sum())))
    if blocks.begin_ns.size < 2:
        return []
    way = np.hypot(*np.diff(blocks.mean)) / WAY_M
    return [_about(blocks, way > min(_limit(way), MOST_WAYS))]


def _edges(stamp_ns: Stamps, block_s: float) -> tuple[Stamps, Stamps, Stamps]:
    """First sample of each block and one past the last; first and last stamps of the blocks."""
    span = int(stamp_ns[-1] - stamp_ns[0])
    typical = float(np.median(np.diff(stamp_ns[:10_000]))) if stamp_ns.size > 1 else 1.0
    length = max(block_s * 1e9, BLOCK_SAMPLES * typical, span / (4.0 * stamp_ns.size))
    at = stamp_ns[0] + (np.arange(int(span / length) + 1) * length).astype(np.int64)
    edge = np.unique(np.append(np.searchsorted(stamp_ns, at), stamp_ns.size))
    return edge, stamp_ns[edge[:-1]], stamp_ns[edge[1:] - 1]


def _blocks(stamp_ns: Stamps, values: Floats, block_s: float) -> _Blocks:
    edge, begin_ns, end_ns = _edges(stamp_ns, block_s)
    first = edge[:-1]
    mean = np.empty((values.shape[0], first.size))
    scatter = np.empty_like(mean)
    enough = np.ones(first.size, dtype=bool)
    for axis, row in enumerate(values):
        finite = np.isfinite(row)
        count = np.diff(edge).astype(float)
        if not finite.all():
            count = np.add.reduceat(finite, first, dtype=float)
            row = np.where(finite, row, 0.0)  # noqa: PLW2901  # the other loop is the same row
        enough &= count > 2
        count = np.maximum(count, 1.0)
        step = np.diff(row, append=row[-1])
        if not finite.all():
            step[~finite | ~np.append(finite[1:], True)] = 0.0
        step *= step
        mean[axis] = np.add.reduceat(row, first) / count
        scatter[axis] = np.sqrt(np.add.reduceat(step, first) / 2.0) / count
    return _Blocks(begin_ns[enough], end_ns[enough], mean[:, enough], scatter[:, enough])


def _rows(blocks: _Blocks, first: int) -> _Blocks:
    rows = slice(first, first + 3)
    return _Blocks(blocks.begin_ns, blocks.end_ns, blocks.mean[rows], blocks.scatter[rows])


def _second_largest(scores: Floats) -> Floats:
    return np.sort(scores, axis=0)[-2]


def _coupled_pairs(blocks: _Blocks) -> int:
    """How many pairs of axes change together, as those of a body do and noises do not."""
    changes = np.diff(blocks.mean)
    count = changes.shape[1]
    spread = changes.std(axis=1)
    if count < 10 or not (spread > 0).all():
        return 0
    changes = (changes - changes.mean(axis=1, keepdims=True)) / spread[:, np.newaxis]
    r = np.abs((changes @ changes.T / count)[np.triu_indices(changes.shape[0], 1)])
    return int(np.count_nonzero(r > np.tanh(5.0 / np.sqrt(count - 3.0))))


def _limit(scores: Floats, quietest: float = 0.05) -> float:
    return max(1.0, QUIET_FACTOR * float(np.quantile(scores, quietest)))


def _about(blocks: _Blocks, moved: Mask) -> tuple[Stamps, Stamps]:
    """Begins and ends of the blocks beside each change, and of one more on either side."""
    at = np.flatnonzero(moved)
    last = blocks.begin_ns.size - 1
    return blocks.begin_ns[np.maximum(at - 1, 0)], blocks.end_ns[np.minimum(at + 2, last)]


def _turned(blocks: _Blocks) -> tuple[Stamps, Stamps]:
    """Blocks whose vector points elsewhere than most do."""
    length = np.linalg.norm(blocks.mean, axis=0)
    direction = blocks.mean / np.maximum(length, 1e-300)
    some = direction[:, :: max(1, direction.shape[1] // _CANDIDATES)]
    near = direction.T @ some > np.cos(TURNED_RAD)
    away = ~near[:, int(np.argmax(near.sum(axis=0)))]
    trusted = length > 3.0 * np.linalg.norm(blocks.scatter, axis=0) / np.sin(TURNED_RAD)
    away &= trusted
    return blocks.begin_ns[away], blocks.end_ns[away]


def _shaken(blocks: _Blocks) -> tuple[Stamps, Stamps]:
    """Blocks in which two axes or more are far louder than usual, and one on either side.

    Knocks on a table, hands near the sensor, what rings after a move: before and after it is held.
    """
    usual = np.quantile(blocks.scatter, 0.1, axis=1, keepdims=True)
    loud = np.count_nonzero(blocks.scatter > LOUD * usual, axis=0) >= 2
    at = np.flatnonzero(loud)
    last = blocks.begin_ns.size - 1
    return blocks.begin_ns[np.maximum(at - 1, 0)], blocks.end_ns[np.minimum(at + 1, last)]


def _joined(begin_ns: Stamps, end_ns: Stamps) -> Intervals:
    """Intervals without overlap, those joined between which there is hardly a still moment."""
    if begin_ns.size == 0:
        return Intervals(begin_ns, end_ns)
    order = np.argsort(begin_ns, kind="stable")
    begin, reach = begin_ns[order], np.maximum.accumulate(end_ns[order])
    fresh = begin[1:] - reach[:-1] > round(SHORTEST_STILL_S * 1e9)
    return Intervals(begin[np.append(True, fresh)], reach[np.append(fresh, True)])
