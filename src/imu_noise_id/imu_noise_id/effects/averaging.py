"""Averaging: each sample is the mean of the signal over a window before it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, ResponseEffect
from imu_noise_id.ordinates import Residual
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class Averaging(ResponseEffect):
    """Boxcar over a window w that need not be a whole number of samples.

    Continuous white noise averaged over w and sampled at dt is correlated over the overlap,
    r(h) = r(0) (1 - h dt/w), so the response of the sampled signal is

        R(f) = c (1 + 2 sum_{h < w/dt} (1 - h dt/w) cos(2 pi f h dt)),   R(0) = 1,

    which is the sum of sinc^2(f w) over all aliases; a window up to one sample changes nothing.
    R(0) = 1 keeps ``white_noise.density`` the level that the Allan curve shows.

    Attributes
    ----------
    window_s : float
        w.
    """

    window_s: float

    name: ClassVar[str] = "averaging"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("window_s", "s", True, "length of the boxcar"),
    )

    def limits(self, sample_time_s: float, duration_s: float) -> tuple[tuple[float, float], ...]:
        """From one sample, below which nothing shows, to 30."""
        return ((1.001 * sample_time_s, 30.0 * sample_time_s),)

    @classmethod
    def starts(cls, residual: Residual) -> tuple[ResponseEffect, ...]:
        """Windows for a scan: the likelihood has several maxima."""
        dt = residual.ordinates.sample_time_s
        return tuple(cls(w * dt) for w in (1.2, 1.5, 2.0, 2.6, 3.5, 5.0, 8.0, 12.0, 20.0))

    def _sums(self, frequency_hz: Floats, sample_time_s: float) -> tuple[Floats, Floats, float]:
        """Return cos-sums of overlap and of its derivative by log w; the sum at 0 Hz."""
        lag = np.arange(1, int(np.ceil(self.window_s / sample_time_s)))
        ratio = lag * sample_time_s / self.window_s
        cosine = 2.0 * np.cos(2.0 * np.pi * sample_time_s * np.outer(frequency_hz, lag))
        return cosine @ (1.0 - ratio), cosine @ ratio, float(2.0 * np.sum(1.0 - ratio))

    def power_response(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """R(f), floored at 1e-6 where a whole window has its nulls."""
        overlap, _, at_zero = self._sums(frequency_hz, sample_time_s)
        return np.asarray(np.maximum((1.0 + overlap) / (1.0 + at_zero), 1e-6))

    def log_response_gradient(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """Return d(log R)/d(log w)."""
        overlap, slope, at_zero = self._sums(frequency_hz, sample_time_s)
        _, slope_zero, _ = self._sums(np.zeros(1), sample_time_s)
        return (slope / np.maximum(1.0 + overlap, 1e-6) - slope_zero / (1.0 + at_zero))[None]
