"""What was recorded: channels of stamped samples, and what is wrong with them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]
Mask = NDArray[np.bool_]

DERIVED = ("heading",)
"""Channels computed from others: what they share with those says nothing of the sensor."""

UNITS = {
    "angular_velocity": "rad/s",
    "linear_acceleration": "m/s^2",
    "position": "m",
    "velocity": "m/s",
    "magnetic_field": "T",
    "heading": "rad",
    "temperature": "degC",
}


def unit_of(channel_name: str) -> str:
    """Unit of a channel by its name: ``angular_velocity.x`` -> ``rad/s``."""
    return UNITS[channel_name.split(".")[0]]


@dataclass(frozen=True)
class Quality:
    """What the reader found out about the samples of one channel.

    Attributes
    ----------
    gaps : int
        Stretches in which at least one expected sample is absent.
    missing : int
        Expected samples that are absent, all gaps together.
    duplicates, out_of_order, non_finite : int
        Samples left out because their stamp repeats, runs backwards, or their value is NaN or inf.
    held : int
        Samples equal to their predecessor to the last bit (kept; an effect may explain them).
    static : bool
        Whether the platform stood still for the whole recording.
    jitter_s : float
        Standard deviation of the stamps about the uniform grid.
    moving_s : tuple of (float, float)
        Parts left out because the platform moved, seconds since the recording's first stamp.
    notes : tuple of str
        What a reader should know, one sentence each.
    """

    gaps: int = 0
    missing: int = 0
    duplicates: int = 0
    out_of_order: int = 0
    non_finite: int = 0
    held: int = 0
    static: bool = True
    jitter_s: float = 0.0
    moving_s: tuple[tuple[float, float], ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Channel:
    """One scalar signal of a topic.

    Attributes
    ----------
    topic, name, unit : str
        See the package's conventions for names and units.
    stamp_ns : (n,) int64
        Strictly increasing header stamps.  Channels of one topic may share the array.
    values : (n,) float64
        Finite samples, mean included.
    still : (n,) bool
        False where the platform moved; those samples are not used for identification.
    rate_hz : float
        Samples per second where there is no gap.
    quality : Quality
    """

    topic: str
    name: str
    unit: str
    stamp_ns: Stamps
    values: Floats
    still: Mask
    rate_hz: float
    quality: Quality = field(default_factory=Quality)

    @property
    def duration_s(self) -> float:
        """Time between the first and the last sample."""
        if self.stamp_ns.size < 2:
            return 0.0
        return float(self.stamp_ns[-1] - self.stamp_ns[0]) * 1e-9


@dataclass(frozen=True)
class ReceiverClaim:
    """The GNSS receiver's own covariance of each fix.

    Attributes
    ----------
    stamp_ns : (n,) int64
    covariance : (n, 3, 3) float64
        Position covariance in m^2, east-north-up; fixes without one are left out.
    """

    stamp_ns: Stamps
    covariance: NDArray[np.float64]


@dataclass(frozen=True)
class Recording:
    """Everything that one bag, or one live buffer, says about the sensors.

    Attributes
    ----------
    source : str
        The bag's path, or ``live``.
    start_ns : int
        First stamp of the recording; every ``time_s`` counts from here.
    channels : tuple of Channel
        In the order of the conventions page.
    temperature : Channel or None
        The regressor, where a Temperature topic was recorded.
    claim : ReceiverClaim or None
        What the GNSS receiver says of itself.
    notes : tuple of str
        What concerns the recording as a whole (no index, truncated, log time used, ...).
    """

    source: str
    start_ns: int
    channels: tuple[Channel, ...]
    temperature: Channel | None = None
    claim: ReceiverClaim | None = None
    notes: tuple[str, ...] = ()

    def channel(self, name: str) -> Channel:
        """Return the channel of that name; raise KeyError when there is none."""
        for channel in self.channels:
            if channel.name == name:
                return channel
        raise KeyError(name)
