"""Bandwidth limit: the sensor's own mechanics or its anti-aliasing filter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, ResponseEffect
from imu_noise_id.ordinates import Residual
from imu_noise_id.recording import Floats

ALIASES = 3
HIGHEST = 0.45
"""Corner of a digital filter, as a part of the sample rate, up to which it is told from white."""
FLOOR = 1e-12
"""Least power response of a digital filter, whose logarithm has no end at half the rate."""


@dataclass(frozen=True)
class BandwidthLimit(ResponseEffect):
    """Low pass of order 1 or 2 before sampling.

    |H|^2 = 1/(1 + u^2) or 1/((1 - u^2)^2 + (2 zeta u)^2) with u = f/f_c: a mass on a spring,
    thesis (13)-(16), has wn = 2 pi f_c and damping ratio zeta.  Sampling folds what lies above half
    the rate; R(f) is the folded sum, scaled to R(0) = 1.

    Attributes
    ----------
    cutoff_hz : float
        f_c; natural frequency where the order is 2.
    order : float
        1 or 2.
    damping : float
        zeta; without meaning for order 1.
    """

    cutoff_hz: float
    order: float = 1
    damping: float = 0.7071067811865476

    name: ClassVar[str] = "bandwidth_limit"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("cutoff_hz", "Hz", True, "corner, or natural frequency of order 2"),
        Parameter("order", "1", True, "1 or 2", estimated=False),
        Parameter("damping", "1", True, "damping ratio of order 2"),
    )

    @property
    def half_power_hz(self) -> float:
        """Where |H|^2 is one half: far below f_c where order 2 is overdamped."""
        if self.order < 1.5:
            return self.cutoff_hz
        less = 2.0 * self.damping**2 - 1.0
        root = float(np.hypot(less, 1.0))
        # no difference of two that are near
        square = 1.0 / (root + less) if less > 0.0 else root - less
        return self.cutoff_hz * float(np.sqrt(square))

    def free(self) -> tuple[str, ...]:
        """Cutoff, and the damping where the order is 2."""
        return ("cutoff_hz",) if self.order < 1.5 else ("cutoff_hz", "damping")

    def limits(self, sample_time_s: float, duration_s: float) -> tuple[tuple[float, float], ...]:
        """Cutoffs from a thousandth of the rate to the rate; damping 0.05 to 3."""
        rate_hz = 1.0 / sample_time_s
        return ((1e-3 * rate_hz, rate_hz), (0.05, 3.0))[: len(self.free())]

    @classmethod
    def starts(cls, residual: Residual) -> tuple[ResponseEffect, ...]:
        """Corners for a scan."""
        rate_hz = 1.0 / residual.ordinates.sample_time_s
        corners = rate_hz * np.array([0.01, 0.03, 0.1, 0.2, 0.35, 0.6])
        laws = ((1, 0.7), (2, 0.7), (2, 0.2))
        return tuple(cls(float(c), order, damping) for c in corners for order, damping in laws)

    def _law(self, frequency_hz: Floats) -> tuple[Floats, Floats, Floats]:
        """|H|^2 and its derivatives by log cutoff and log damping."""
        u2 = (frequency_hz / self.cutoff_hz) ** 2
        if self.order < 1.5:
            law = 1.0 / (1.0 + u2)
            return law, 2.0 * u2 * law**2, np.zeros_like(u2)
        damped = 4.0 * self.damping**2 * u2
        law = 1.0 / ((1.0 - u2) ** 2 + damped)
        by_cutoff = law**2 * (2.0 * damped - 4.0 * u2 * (1.0 - u2))
        return law, by_cutoff, -2.0 * damped * law**2

    def _folded(self, frequency_hz: Floats, sample_time_s: float) -> tuple[Floats, ...]:
        """Sum of ``_law`` over the aliases, the tail beyond them by its integral."""
        rate_hz = 1.0 / sample_time_s
        sums = [np.zeros_like(frequency_hz) for _ in range(3)]
        for alias in range(-ALIASES, ALIASES + 1):
            parts = self._law(frequency_hz + alias * rate_hz)
            sums = [total + part for total, part in zip(sums, parts, strict=True)]
        far = np.array([(ALIASES + 0.5) * rate_hz])
        if self.order < 1.5:
            tail = 2.0 * self._law(far)[0] * (ALIASES + 0.5)
            sums[0] = sums[0] + tail
            sums[1] = sums[1] + 2.0 * tail
        return tuple(sums)

    def power_response(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """R(f)."""
        at_zero = self._folded(np.zeros(1), sample_time_s)[0]
        return np.asarray(self._folded(frequency_hz, sample_time_s)[0] / at_zero)

    def log_response_gradient(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """By log cutoff, and for order 2 by log damping."""
        law, by_cutoff, by_damping = self._folded(frequency_hz, sample_time_s)
        law0, by_cutoff0, by_damping0 = self._folded(np.zeros(1), sample_time_s)
        rows = (by_cutoff / law - by_cutoff0 / law0, by_damping / law - by_damping0 / law0)
        return np.stack(rows[: len(self.free())])


@dataclass(frozen=True)
class DigitalBandwidthLimit(BandwidthLimit):
    """The same low pass as a digital filter at the sample rate, by Tustin's transform.

    |H|^2 as before with u = tan(pi f dt)/tan(pi f_c dt) (Oppenheim and Schafer): nothing folds, the
    corner stays at f_c, and the response ends in a zero at half the rate.  Its name and its
    parameters are those of the other form; ``form: digital`` tells them apart in files.
    """

    form: ClassVar[str] = "digital"

    def limits(self, sample_time_s: float, duration_s: float) -> tuple[tuple[float, float], ...]:
        """Cutoffs up to ``HIGHEST`` of the rate: beyond, only ordinates beside the zero show it."""
        (low_hz, high_hz), *others = super().limits(sample_time_s, duration_s)
        return ((low_hz, HIGHEST * high_hz), *others)

    @classmethod
    def starts(cls, residual: Residual) -> tuple[ResponseEffect, ...]:
        """Corners for a scan, those within the limits."""
        highest_hz = HIGHEST / residual.ordinates.sample_time_s
        corners = (e for e in super().starts(residual) if isinstance(e, cls))
        return tuple(e for e in corners if e.cutoff_hz < highest_hz)

    def _folded(self, frequency_hz: Floats, sample_time_s: float) -> tuple[Floats, ...]:
        """``_law`` at the warped frequency, floored."""
        corner = float(np.tan(np.pi * min(self.cutoff_hz * sample_time_s, 0.4999)))
        angle = np.pi * np.minimum(np.abs(frequency_hz) * sample_time_s, 0.5 - 1e-9)
        law, by_warped, by_damping = self._law(np.tan(angle) * (self.cutoff_hz / corner))
        # d(log tan x)/d(log x) = 2 x/sin 2x
        turn = 2.0 * np.pi * self.cutoff_hz * sample_time_s
        return law + FLOOR, by_warped * (turn / float(np.sin(turn))), by_damping
