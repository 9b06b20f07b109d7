"""Waiting for the start: samples and measurements kept until the filter can be levelled."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nav_fusion import arrays
from nav_fusion.alignment import MOVING_TILT_RAD, heading_by_field, hypotheses
from nav_fusion.noise import NavigationNoise
from nav_fusion.parameters import Parameters
from nav_fusion.state import Layout

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]

AHEAD_S = 2.0
KEPT_S = 5.0
GRAVITY_RANGE_M_S2 = (6.0, 14.0)
REST_RATE_RAD_S = 0.25
FIELD_SPREAD_RAD = 0.5
TURNING_SIGMAS = 5.0
"""Of the gyro's turn-on bias: a mean rate beyond turns the platform, however smoothly."""
MOVING_M_S, MOVING_SIGMAS = 0.5, 5.0
"""Speed of the first fixes, and that many of its standard errors, from which they move."""
CERTAIN_FAULTS = 5
"""So many fixes in a row before which the samples were absurd: the unit is wrong, for good."""


@dataclass(frozen=True)
class Measurement:
    """One aiding measurement: when it holds, its kind and its numbers (``nav_fusion.observe``)."""

    time_ns: int
    kind: int
    z: Floats


@dataclass(frozen=True)
class Start:
    """How the filter begins.

    Attributes
    ----------
    bank : (K, size) float64
        Hypotheses at ``stamp_ns[0]``.
    stamp_ns, rate, force : (k,), (k, 3), (k, 3)
        Samples from there on.
    replayed : int
        So many of them were waited for: what they give is not published.
    measurements : tuple of Measurement
        Later than ``stamp_ns[0]``, in order of arrival.
    skipped : int
        Fixes before the start.
    period_s : float
        Between samples.
    still : bool
        The platform seems to rest.
    """

    bank: Floats
    stamp_ns: Stamps
    rate: Floats
    force: Floats
    replayed: int
    measurements: tuple[Measurement, ...]
    skipped: int
    period_s: float
    still: bool


class Waiting:
    """What was fed before the start."""

    def __init__(self, noise: NavigationNoise, parameters: Parameters, layout: Layout) -> None:
        self._noise = noise
        self._parameters = parameters
        self._layout = layout
        self._first_ns: int | None = None
        self._stamp_ns: Stamps = np.zeros(0, dtype=np.int64)
        self._rate: Floats = np.zeros((0, 3))
        self._force: Floats = np.zeros((0, 3))
        self._measurements: list[Measurement] = []
        self.fault: str | None = None
        self.ahead_s: float | None = None
        self.dropped = 0
        self._implausible = 0

    def add_measurement(self, measurement: Measurement) -> None:
        """Keep a measurement."""
        self._measurements.append(measurement)

    def add_samples(self, stamp_ns: Stamps, rate: Floats, force: Floats) -> Start | None:
        """Keep samples; return the start as soon as it can be made, from the sample that allows it.

        The start is at the earliest fix that has ``alignment_s`` of samples before it, and is made
        once ``lateness_s`` has passed, so that a late first fix finds its place.
        """
        if self._first_ns is None:
            self._first_ns = int(stamp_ns[0])
        self._drop_ahead(int(stamp_ns[0]))
        before = self._stamp_ns.size
        self._stamp_ns = np.concatenate((self._stamp_ns, stamp_ns))
        self._rate = np.concatenate((self._rate, rate))
        self._force = np.concatenate((self._force, force))
        while (fix := self._earliest_fix()) is not None:
            due = fix.time_ns + round(self._parameters.lateness_s * 1e9)
            trigger = max(int(np.searchsorted(self._stamp_ns, due)), before)
            if trigger >= self._stamp_ns.size:
                break
            start = self._start(fix, trigger)
            if start is not None:
                return start
            self._measurements.remove(fix)
            self.dropped += 1
        self._trim()
        return None

    def _earliest_fix(self) -> Measurement | None:
        assert self._first_ns is not None
        ready = self._first_ns + round(self._parameters.alignment_s * 1e9)
        fixes = [m for m in self._measurements if m.kind == arrays.FIX and m.time_ns > ready]
        return min(fixes, key=lambda m: m.time_ns, default=None)

    def _drop_ahead(self, now_ns: int) -> None:
        limit = now_ns + round(AHEAD_S * 1e9)
        ahead = [m for m in self._measurements if m.time_ns > limit]
        if ahead:
            self.ahead_s = (ahead[0].time_ns - now_ns) * 1e-9
            self._measurements = [m for m in self._measurements if m.time_ns <= limit]
            self.dropped += sum(m.kind == arrays.FIX for m in ahead)

    def _trim(self) -> None:
        fix = self._earliest_fix()
        newest = int(self._stamp_ns[-1]) if fix is None else fix.time_ns
        keep_s = KEPT_S + self._parameters.alignment_s + self._parameters.gnss_delay_s
        oldest = newest - round(keep_s * 1e9)
        first = int(np.searchsorted(self._stamp_ns, oldest))
        if first > self._stamp_ns.size // 2:
            self._stamp_ns = self._stamp_ns[first:]
            self._rate, self._force = self._rate[first:], self._force[first:]
            old = [m for m in self._measurements if m.time_ns < oldest]
            self.dropped += sum(m.kind == arrays.FIX for m in old)
            self._measurements = [m for m in self._measurements if m.time_ns >= oldest]

    def _start(self, fix: Measurement, trigger: int) -> Start | None:
        """Level on the samples before the fix; None, with ``fault`` set, when they are absurd."""
        p = self._parameters
        first = int(np.searchsorted(self._stamp_ns, fix.time_ns)) - 1
        begin = int(np.searchsorted(self._stamp_ns, fix.time_ns - round(p.alignment_s * 1e9)))
        if first - begin < 4:
            self.fault = (
                f"the IMU has fewer than 5 samples in the {p.alignment_s:g} s before the "
                "first fix: raise alignment_s or mend the driver"
            )
            return None
        window = slice(begin, first + 1)
        period_s = float(np.median(np.diff(self._stamp_ns[window]))) * 1e-9
        force, rate = self._force[window], self._rate[window]
        quiet = quiet_limits(self._layout, p, 1.0 / period_s)
        # later ones may be under way: the start would depend on when they arrive
        known = [m for m in self._measurements if m.time_ns <= fix.time_ns]
        moves = fixes_move([m for m in known if m.kind == arrays.FIX])
        steady = not moves and bool(force.var(axis=0).sum() < quiet[0])
        turning = np.linalg.norm(rate.mean(axis=0)) > TURNING_SIGMAS * p.gyro_turn_on_rad_s
        still = steady and not turning and bool(rate.var(axis=0).sum() < quiet[1])
        fault = _implausible(force.mean(axis=0), rate.mean(axis=0), steady)
        if fault is not None:
            self._implausible += 1
        elif self._implausible < CERTAIN_FAULTS:
            self._implausible = 0
        self.fault = fault if self._implausible < CERTAIN_FAULTS else self.fault or fault
        if self.fault is not None:
            return None
        noise_tilt = math.sqrt(float(self._layout.accel_psd.max()) / p.alignment_s) / 9.8
        tilt = noise_tilt + 1e-4 if still else MOVING_TILT_RAD
        headings, spread = self._headings(force.mean(axis=0), self._stamp_ns[window])
        bank = hypotheses(
            self._layout,
            fix.z[0:3],
            force.mean(axis=0),
            headings,
            spread,
            tilt,
            p.initial_speed_sigma_m_s,
        )
        begin_ns = int(self._stamp_ns[first])
        later = tuple(m for m in self._measurements if m.time_ns > begin_ns)
        earlier = sum(m.kind == arrays.FIX for m in self._measurements) - sum(
            m.kind == arrays.FIX for m in later
        )
        return Start(
            bank,
            self._stamp_ns[first:],
            self._rate[first:],
            self._force[first:],
            trigger - first,
            later,
            earlier + self.dropped,
            period_s,
            still,
        )

    def _headings(self, force: Floats, stamp_ns: Stamps) -> tuple[Floats, float]:
        """Start headings and the spread of each: known, by magnetometer, or all around."""
        p = self._parameters
        if math.isfinite(p.initial_heading_rad):
            return np.array([p.initial_heading_rad]), p.initial_heading_sigma_rad
        fields = [
            m.z[0:3]
            for m in self._measurements
            if m.kind == arrays.FIELD and stamp_ns[0] <= m.time_ns <= stamp_ns[-1]
        ]
        if fields:
            field = np.mean(fields, axis=0)
            heading = heading_by_field(force, field, p.declination_rad)
            return np.array([heading]), FIELD_SPREAD_RAD
        count = p.heading_hypotheses
        return 2.0 * math.pi * np.arange(count) / count, 1.2 * math.pi / count


def quiet_limits(layout: Layout, parameters: Parameters, rate_hz: float) -> Floats:
    """Variances of accelerometer and gyro (all axes) below which a platform rests, and times.

    Twice what the model's white noise gives, plus what an idling engine may add; block length s,
    blocks in a row, a mean angular rate that no platform keeps up, the accelerometer's variance by
    white noise alone, and by how much (squared) the mean force of two blocks may differ beyond it.
    """
    p = parameters
    white = float(layout.accel_psd.sum()) * rate_hz
    accel = 2.0 * white + 3.0 * p.still_accel_m_s2**2
    gyro = 2.0 * float(layout.gyro_psd.sum()) * rate_hz + 3.0 * p.still_gyro_rad_s**2
    return np.array([accel, gyro, 0.25, 4.0, 8.0, white, 0.1 * p.still_accel_m_s2**2])


def fixes_move(fixes: list[Measurement]) -> bool:
    """Whether a straight line through fixes moves: smooth motion looks like rest to an IMU.

    Levelled on the force of a turn or of a run-up as if it were gravity alone, a filter that is
    sure of it is lost for good.  Colour of the receiver, alike in fixes so near in time, is not
    among the errors; ``MOVING_M_S`` is room for it.
    """
    t = np.array([m.time_ns - fixes[0].time_ns for m in fixes]) * 1e-9
    if t.size < 2 or np.ptp(t) < 0.1:
        return False
    t -= t.mean()
    places = np.array([m.z[0:3] for m in fixes])
    speed = float(np.linalg.norm(t @ (places - places.mean(axis=0)) / (t @ t)))
    variance = max(float(np.trace(m.z[6:15].reshape(3, 3))) for m in fixes)
    return speed > MOVING_M_S + MOVING_SIGMAS * math.sqrt(variance / float(t @ t))


def _implausible(force: Floats, rate: Floats, steady: bool) -> str | None:
    """Return a sentence about units where the means cannot be SI, or None."""
    norm, speed = float(np.linalg.norm(force)), float(np.linalg.norm(rate))
    low, high = GRAVITY_RANGE_M_S2
    if 0.5 < norm < 2.0:
        return (
            f"linear_acceleration has a mean of {norm:.2f}, which is g and not m/s^2: "
            "multiply by 9.80665 in the driver"
        )
    if not low < norm < high:
        return (
            f"linear_acceleration has a mean of {norm:.2f} m/s^2 and gravity is 9.8: "
            "check unit and calibration"
        )
    if steady and speed > REST_RATE_RAD_S:
        return (
            f"angular_velocity is {speed:.2f} rad/s at rest: degrees per second, perhaps; "
            "it must be rad/s"
        )
    return None
