"""One channel on a uniform grid of time, with a mask where samples are absent."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from imu_noise_id.recording import Channel, Floats, Mask
from imu_noise_id.stamps import cells


@dataclass(frozen=True)
class Series:
    """Uniformly sampled values with a mask.

    Attributes
    ----------
    values : (n,) float64
        Value at ``start_s + k * sample_time_s``; 0.0 and without meaning where not observed.
    observed : (n,) bool
        Whether sample k was recorded (and the platform stood still).
    sample_time_s : float
    start_s : float
        Time of sample 0 since the recording's first stamp.
    """

    values: Floats
    observed: Mask
    sample_time_s: float
    start_s: float = 0.0

    @property
    def complete(self) -> bool:
        """Whether every sample was observed."""
        return bool(self.observed.all())

    @property
    def seen(self) -> Floats:
        """The observed samples, not copied where all were."""
        return self.values if self.complete else self.values[self.observed]

    @cached_property
    def mean(self) -> float:
        """Mean of the observed samples, summed about the first of them to keep digits."""
        seen = self.seen
        return float(seen[0] + np.mean(seen - seen[0]))

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and the last sample since the recording's first stamp."""
        return self.start_s, self.start_s + self.sample_time_s * (self.values.size - 1)

    @property
    def time_s(self) -> Floats:
        """Time of each sample since the recording's first stamp, shape (n,)."""
        return self.start_s + self.sample_time_s * np.arange(self.values.size, dtype=np.float64)


def to_series(channel: Channel, recording_start_ns: int) -> Series:
    """Put a channel on the grid of its own rate.

    The cells are those of `stamps.cells`: jitter and a slow drift of the clock do not open or close
    cells, and a gap keeps its length to within half a sample.  Moving samples become unobserved;
    leading and trailing unobserved cells are cut.  A channel without a gap shares its samples.

    Parameters
    ----------
    channel : Channel
    recording_start_ns : int
        ``Recording.start_ns``.

    Returns
    -------
    Series

    Raises
    ------
    ValueError
        When no still sample is left.
    """
    if not channel.still.any():
        raise ValueError(f"{channel.topic} {channel.name}: no still sample")
    sample_time_s = 1.0 / channel.rate_hz
    first = int(np.argmax(channel.still))
    last = channel.still.size - int(np.argmax(channel.still[::-1]))
    start_s = float(channel.stamp_ns[first] - recording_start_ns) * 1e-9
    still, samples = channel.still[first:last], channel.values[first:last]
    cell = cells(channel.stamp_ns, 1e9 * sample_time_s)[first:last]
    size = int(cell[-1] - cell[0]) + 1
    if size == samples.size and still.all():  # on the grid as they are
        return Series(samples, still, sample_time_s, start_s)
    values = np.zeros(size)
    observed = np.zeros(size, dtype=bool)
    used = cell[still] - cell[0]
    values[used] = samples[still]
    observed[used] = True
    return Series(values, observed, sample_time_s, start_s)
