"""Streams of an IMU whose noise is known, and what drivers and clocks do to them.

Every fault takes a whole stream (what the sensor measured and when) and returns what arrives.  Of
the noise only this is known: white, with another deviation on each axis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from imu_noise_id.columns import TopicColumns
from imu_noise_id.model import NoiseModel

from imu_noise_id import cdr

RATE_HZ = 1000.0
PERIOD_NS = 1_000_000
START_NS = 1_700_000_000_000_000_000
SIGMA = np.array((1e-3, 2e-3, 3e-3, 1e-2, 2e-2, 3e-2))
"""Of a sample: angular velocity in rad/s, linear acceleration in m/s^2."""
MEAN = np.array((1e-3, -2e-3, 0.0, 0.05, -0.1, 9.81))
ROWS = len(cdr.LAYOUTS[cdr.IMU].columns)

Rng = np.random.Generator


@dataclass(frozen=True)
class Stream:
    """Stamps, values and times of arrival, in the order of arrival."""

    stamp_ns: np.ndarray
    values: np.ndarray
    log_ns: np.ndarray

    def take(self, index: np.ndarray) -> Stream:
        """Only these samples, in this order."""
        log_ns = np.maximum.accumulate(self.log_ns[index])
        return Stream(self.stamp_ns[index], self.values[:, index], log_ns)

    def columns(self) -> TopicColumns:
        """What a reader or a node makes of it."""
        return TopicColumns(
            "/imu/data", cdr.IMU, self.stamp_ns, self.log_ns, self.values, frozenset({b"imu"})
        )


def still(rng: Rng, count: int) -> Stream:
    """An IMU at rest on a perfect clock."""
    values = np.zeros((ROWS, count))
    values[:6] = MEAN[:, np.newaxis] + SIGMA[:, np.newaxis] * rng.standard_normal((6, count))
    stamp_ns = START_NS + PERIOD_NS * np.arange(count)
    return Stream(stamp_ns, values, stamp_ns + 200_000)


def none(stream: Stream, rng: Rng) -> Stream:
    """Nothing goes wrong."""
    return stream


def jitter(stream: Stream, rng: Rng) -> Stream:
    """Stamps scatter by a fifth of the period, in order."""
    noise = rng.normal(0.0, 0.2 * PERIOD_NS, stream.stamp_ns.size).astype(np.int64)
    return replace(stream, stamp_ns=np.sort(stream.stamp_ns + noise))


def bursts(stream: Stream, rng: Rng) -> Stream:
    """Twenty samples at a time are stamped when they arrive, 30 us apart."""
    k = np.arange(stream.stamp_ns.size)
    stamp_ns = START_NS + (k // 20 + 1) * 20 * PERIOD_NS + (k % 20) * 30_000
    return replace(stream, stamp_ns=stamp_ns, log_ns=stamp_ns + 200_000)


def shared_stamps(stream: Stream, rng: Rng) -> Stream:
    """Ten samples at a time bear the stamp of the last."""
    whole = stream.stamp_ns.size // 10 * 10
    last = stream.stamp_ns[:whole].reshape(-1, 10)[:, -1]
    return Stream(np.repeat(last, 10), stream.values[:, :whole], stream.log_ns[:whole])


def stalls(stream: Stream, rng: Rng) -> Stream:
    """The driver stops for up to a second, five times, and stamps late what it then catches up."""
    stamp_ns = stream.stamp_ns.copy()
    for at in np.sort(rng.integers(1000, stamp_ns.size - 3000, 5)):
        length = int(rng.integers(50, 1000))
        late = stamp_ns[at + length] + 20_000 * np.arange(stamp_ns.size - at)
        stamp_ns[at:] = np.maximum(stamp_ns[at:], late)
    return replace(stream, stamp_ns=stamp_ns, log_ns=stamp_ns + 200_000)


def duplicates(stream: Stream, rng: Rng) -> Stream:
    """One message of a hundred comes twice."""
    size = stream.stamp_ns.size
    return stream.take(np.repeat(np.arange(size), 1 + (rng.random(size) < 0.01)))


def out_of_order(stream: Stream, rng: Rng) -> Stream:
    """One message of a hundred comes after the next."""
    order = np.arange(stream.stamp_ns.size)
    for k in np.flatnonzero(rng.random(order.size - 1) < 0.01):
        order[k], order[k + 1] = order[k + 1], order[k]
    return stream.take(order)


def drops(stream: Stream, rng: Rng) -> Stream:
    """One message of a hundred is lost, and once those of two seconds."""
    kept = rng.random(stream.stamp_ns.size) > 0.01
    kept[5000:7000] = False
    return stream.take(np.flatnonzero(kept))


def heavy_losses(stream: Stream, rng: Rng) -> Stream:
    """One message of ten is lost, and the stamps scatter by a fifth of the period."""
    stream = jitter(stream, rng)
    return stream.take(np.flatnonzero(rng.random(stream.stamp_ns.size) > 0.1))


def clock_step(seconds: float) -> Callable[[Stream, Rng], Stream]:
    """The clock is set in the middle."""

    def step(stream: Stream, rng: Rng) -> Stream:
        stamp_ns = stream.stamp_ns.copy()
        stamp_ns[stamp_ns.size // 2 :] += round(seconds * 1e9)
        return replace(stream, stamp_ns=stamp_ns)

    step.__name__ = f"clock_step_{seconds:+g}_s"
    return step


def frozen(stream: Stream, rng: Rng) -> Stream:
    """The stamps stand still for half a second, three times."""
    stamp_ns = stream.stamp_ns.copy()
    for at in rng.integers(1000, stamp_ns.size - 1000, 3):
        stamp_ns[at : at + 500] = stamp_ns[at]
    return replace(stream, stamp_ns=stamp_ns)


def not_finite(stream: Stream, rng: Rng) -> Stream:
    """Some samples are NaN or infinite, on one axis or on all."""
    values = stream.values.copy()
    for bad in (np.nan, np.inf, -np.inf):
        at = rng.integers(0, values.shape[1], 40)
        values[rng.integers(0, 6, 40), at] = bad
        values[:6, rng.integers(0, values.shape[1], 5)] = bad
    return replace(stream, values=values)


def restarts(stream: Stream, rng: Rng) -> Stream:
    """The driver is started again a hundred times and lacks 5 to 50 ms each time."""
    kept = np.ones(stream.stamp_ns.size, dtype=bool)
    for at in rng.integers(100, kept.size - 100, 100):
        kept[at : at + int(rng.integers(5, 50))] = False
    return stream.take(np.flatnonzero(kept))


def everything(stream: Stream, rng: Rng) -> Stream:
    """Jitter, losses, repeats, disorder, NaN and a clock that is set back."""
    for fault in (jitter, drops, not_finite, clock_step(-3600.0), duplicates, out_of_order):
        stream = fault(stream, rng)
    return stream


def rate_change(stream: Stream, rng: Rng) -> Stream:
    """From the middle on the driver takes a sample each 1.6 ms."""
    half = stream.stamp_ns.size // 2
    stamp_ns = stream.stamp_ns.copy()
    stamp_ns[half:] = stamp_ns[half] + 1_600_000 * np.arange(stamp_ns.size - half)
    return replace(stream, stamp_ns=stamp_ns, log_ns=stamp_ns + 200_000)


def swapped_axes(stream: Stream, rng: Rng) -> Stream:
    """From the middle on x, y and z are sent as y, z and x."""
    values, half = stream.values.copy(), stream.stamp_ns.size // 2
    for first in (0, 3):
        values[first : first + 3, half:] = np.roll(values[first : first + 3, half:], 1, axis=0)
    return replace(stream, values=values)


HARMLESS = (
    *(none, jitter, bursts, shared_stamps, stalls, duplicates, out_of_order, drops, frozen),
    *(clock_step(-1.0), clock_step(1.0), clock_step(-3600.0), clock_step(3600.0)),
    *(not_finite, restarts, everything, heavy_losses),
)
"""What must leave the estimates in their intervals."""

NAMED = {
    shared_stamps: "share one stamp, 10 at a time",
    HARMLESS[9]: "the clock was set once, by up to -0.999 s",
    HARMLESS[11]: "the clock was set once, by up to -3600 s",
    HARMLESS[12]: "the clock was set once, by up to +3600 s",
    not_finite: "samples are not finite: left out",
    rate_change: "the rate changes between 625 and 1000 Hz",
    swapped_axes: "the platform moved throughout, nothing identified",
}
"""What is to be said of a fault."""


def errors(model: NoiseModel) -> np.ndarray:
    """Errors of the white noise of each channel that has one, in its own standard errors."""
    found = []
    for channel, sigma in zip(model.channels, SIGMA, strict=True):
        for fitted in channel.effects:
            if fitted.name == "white_noise":
                (estimate,) = fitted.estimates
                truth = sigma / np.sqrt(RATE_HZ)
                found.append((float(estimate.value) - truth) / float(estimate.std_error))
    return np.array(found)
