"""What acts on a topic as a whole: held samples, jitter of the stamps, dropouts."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from imu_noise_id.effects.dropouts import FEWEST_GAPS, Dropouts, gap_lengths
from imu_noise_id.effects.held_samples import HeldSamples, fresh_samples, held_factor
from imu_noise_id.effects.timestamp_jitter import TimestampJitter, jitter_std
from imu_noise_id.model import Estimate, FittedEffect
from imu_noise_id.recording import DERIVED, Channel

LEAST_FACTOR = 1.1
LEAST_JITTER = 0.01
"""Of a sample period; what is below does no harm and is not named."""


@dataclass(frozen=True)
class Transport:
    """Effects on the messages of one topic.

    Attributes
    ----------
    effects : tuple of FittedEffect
        Listed on each of the topic's channels.
    factor : float
        Messages per new sample, 1.0 where none is held.
    """

    effects: tuple[FittedEffect, ...]
    factor: float


def find_transport(channels: tuple[Channel, ...]) -> Transport:
    """Effects on the transport of the channels of one topic, which share their stamps."""
    first = max(channels, key=lambda c: c.stamp_ns.size)  # the others lack what was not finite
    effects: list[FittedEffect] = []
    factor = held_factor([c.values for c in _measured(channels)])
    if factor >= LEAST_FACTOR:
        effects.append(_exact(HeldSamples(factor), (factor,), ("1",)))
    else:
        factor = 1.0
    jitter = jitter_std(first.stamp_ns, first.rate_hz)
    if jitter > LEAST_JITTER / first.rate_hz:
        error = jitter * float(np.sqrt(35.0 / 36.0 / max(first.stamp_ns.size, 1)))
        row = Estimate(jitter, error, jitter - 1.96 * error, jitter + 1.96 * error, "s")
        effects.append(FittedEffect(TimestampJitter(jitter), (row,)))
    missing = gap_lengths(first.stamp_ns, first.rate_hz)
    if missing.size >= FEWEST_GAPS:
        effects.append(_dropouts(first, missing))
    return Transport(tuple(effects), factor)


def _measured(channels: tuple[Channel, ...]) -> tuple[Channel, ...]:
    """Channels of a topic without those computed from other topics too, where there are any."""
    return tuple(c for c in channels if c.name not in DERIVED) or channels


def without_repeats(channel: Channel, group: tuple[Channel, ...], factor: float) -> Channel:
    """Return the channel with its new samples only, at the rate at which they come.

    A sample is new where any channel of the topic changes; a channel may lack samples that others
    have.
    """
    if factor == 1.0:
        return channel
    new = [c.stamp_ns[fresh_samples(c.values)] for c in _measured(group)]
    fresh = np.isin(channel.stamp_ns, np.concatenate(new))
    return dataclasses.replace(
        channel,
        stamp_ns=channel.stamp_ns[fresh],
        values=channel.values[fresh],
        still=channel.still[fresh],
        rate_hz=channel.rate_hz / factor,
    )


def _dropouts(channel: Channel, missing: NDArray[np.int64]) -> FittedEffect:
    """Gaps per second and their mean length, from the number of messages missing in each gap."""
    gaps = missing.size
    rate, length = gaps / channel.duration_s, float(missing.mean()) / channel.rate_hz
    spread = float(np.exp(1.96 / np.sqrt(gaps)))
    rows = tuple(
        Estimate(value, value / float(np.sqrt(gaps)), value / spread, value * spread, unit)
        for value, unit in ((rate, "1/s"), (length, "s"))
    )
    return FittedEffect(Dropouts(rate, length), rows)


def _exact(effect: HeldSamples, values: tuple[float, ...], units: tuple[str, ...]) -> FittedEffect:
    rows = tuple(Estimate(v, None, None, None, u) for v, u in zip(values, units, strict=True))
    return FittedEffect(effect, rows)
