"""The filter as a thing that is fed: the live node and ``fuse --bag`` use this and nothing else.

How to use it::

    engine = Engine(noise, parameters)          # noise: nav_fusion.noise.NavigationNoise
    rows = engine.add_imu(stamp_ns, rate, force)      # (k,), (k, 3), (k, 3): any k >= 0
    engine.add_fix(stamp_ns, latitude_deg, longitude_deg, altitude_m, covariance, status)
    engine.add_velocity(stamp_ns, (east, north, up), covariance)
    engine.add_field(stamp_ns, (x, y, z))
    solution = solve(rows, engine.origin, ...)        # nav_fusion.solution: ENU, covariances
    engine.status()                                   # counts, NIS, whiteness, biases, notes

What holds:

- Feed everything in the order in which it *arrived* (a bag: the order of its log times).
- The same bits come out whatever the size of the IMU blocks.  ``rows`` are what became due for
  publishing while the block was taken, stamped with the state's time: the first sample at or after
  each multiple of 1/publish_rate_hz.  A row uses nothing that was fed after its sample.
- A fix, velocity or field up to ``lateness_s`` late ends in the same state, to the last bit, as
  if it had come in order.  Rows that are out already stay as they were.
- Nothing raises on bad data: it is counted, noted, and left out (``status``).  ``fault`` is a
  sentence while the filter cannot start, else None.
- A filter that agrees with few fixes after it has begun, or begun again from them, is lost: it is
  aligned anew from the samples and measurements behind the fix that showed it.
- A jump of the IMU's clock backwards by more than ``BACKWARDS_S``, or forwards by more than
  ``longest_gap_s``, starts the alignment anew (simulation restarted, bag looped).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from nav_fusion import arrays, core, hypotheses, observe
from nav_fusion.alignment import rotation_of
from nav_fusion.earth import geodetic_from_ecef
from nav_fusion.evidence import Steps, steps_of
from nav_fusion.noise import NavigationNoise
from nav_fusion.parameters import DEFAULTS, Parameters
from nav_fusion.starting import AHEAD_S, Measurement, Start, Waiting, quiet_limits
from nav_fusion.state import SLOW, Layout, layout_of

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]

BACKWARDS_S = 2.0
APART_S = 10.0
UNKNOWN_FIX_COVARIANCE = np.diag(np.square((2.5, 2.5, 5.0)))
FIELD_RANGE_T = (15e-6, 80e-6)
NO_FIX, UNKNOWN_STATUS = -1, -2
KEPT_CHUNKS = 1000


@dataclass(frozen=True)
class Rows:
    """States due for publishing.

    Attributes
    ----------
    stamp_ns : (k,) int64
    values : (k, OUT_SIZE) float64
        Laid out as in ``nav_fusion.arrays``; ``nav_fusion.solution.solve`` reads them.
    """

    stamp_ns: Stamps
    values: Floats


@dataclass
class Counts:
    """What happened to what was fed; ``late`` fixes are also among used or gated ones."""

    imu_samples: int = 0
    imu_duplicates: int = 0
    imu_out_of_order: int = 0
    imu_non_finite: int = 0
    late: int = 0
    rejected: int = 0
    restarts: int = 0


@dataclass(frozen=True)
class Status:
    """State of the filter in figures.

    Attributes
    ----------
    aligned : bool
        One heading is left.
    hypotheses : int
    heading_known_s : float or None
        Time after the start at which the heading was found.
    used, gated, late, rejected : int
        Fixes.
    velocity_used, velocity_gated, heading_used, heading_gated, still_updates, recovered : int
    imu_samples, imu_duplicates, imu_out_of_order, imu_non_finite, gaps : int
    gap_s : float
        Time without IMU.
    nis_last, nis_mean, nis_recent : float or None
        Of fixes, 3 degrees of freedom each; recent over about 100 fixes.
    nis_dof : int
        Degrees of freedom behind the mean; gated and repeated fixes are not among them.
    nis_lower, nis_upper : float or None
        95 % band of the mean under a true model.
    whiteness : float or None
        Portmanteau statistic over 5 lags; ``whiteness_limit`` its 99 % quantile.
    correlation : float or None
        Of successive innovations, of the axis where it is largest in size.
    white : bool or None
        None with fewer than 20 fixes.
    gate : float
        Threshold on the NIS.
    still : bool
    gyro_bias, accel_bias, gyro_bias_sigma, accel_bias_sigma : tuple of float
    notes : tuple of str
    doubts : tuple of str
        Those of the notes by which a test speaks against the noise model (``nav_fusion.doubt``).
    fault : str or None
    """

    aligned: bool
    hypotheses: int
    heading_known_s: float | None
    used: int
    gated: int
    late: int
    rejected: int
    velocity_used: int
    velocity_gated: int
    heading_used: int
    heading_gated: int
    still_updates: int
    recovered: int
    imu_samples: int
    imu_duplicates: int
    imu_out_of_order: int
    imu_non_finite: int
    gaps: int
    gap_s: float
    nis_last: float | None
    nis_mean: float | None
    nis_recent: float | None
    nis_dof: int
    nis_lower: float | None
    nis_upper: float | None
    whiteness: float | None
    whiteness_limit: float
    correlation: float | None
    white: bool | None
    gate: float
    still: bool
    gyro_bias: tuple[float, ...]
    accel_bias: tuple[float, ...]
    gyro_bias_sigma: tuple[float, ...]
    accel_bias_sigma: tuple[float, ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...]
    fault: str | None


class Engine:
    """Filter of one platform; see the module's page for the rules."""

    def __init__(self, noise: NavigationNoise, parameters: Parameters = DEFAULTS) -> None:
        self.noise = noise
        self.parameters = parameters
        self.layout: Layout = layout_of(noise, parameters.use_velocity, parameters.use_magnetometer)
        self.counts = Counts()
        self.fault: str | None = None
        self._notes: dict[str, None] = dict.fromkeys(noise.notes)
        self._past = np.zeros(SLOW)
        self._steps: tuple[Steps, Steps] | None = None
        self._white = np.array(
            [[a.white_sigma for a in axes] for axes in (noise.position, noise.velocity)]
        )
        self._results: deque[tuple[Stamps, Floats]] = deque(maxlen=KEPT_CHUNKS)
        self._origin: tuple[float, float, float] | None = None
        self._mounting = rotation_of(*parameters.mounting_rpy_rad)
        self._restart()

    # ------------------------------------------------------------------ feeding

    def add_imu(self, stamp_ns: Stamps, rate: Floats, force: Floats) -> Rows:
        """Feed a block of samples: stamps (k,), angular rate rad/s and specific force m/s^2 (k, 3).

        Returns the rows that became due.
        """
        stamp_ns = np.ascontiguousarray(stamp_ns, dtype=np.int64).reshape(-1)
        rate = np.ascontiguousarray(rate, dtype=float).reshape(-1, 3)
        force = np.ascontiguousarray(force, dtype=float).reshape(-1, 3)
        longest_ns = round(self.parameters.longest_gap_s * 1e9)
        if self._last_ns is not None and core.is_plain(
            self._last_ns, longest_ns, stamp_ns, rate, force
        ):
            return self._take(stamp_ns, rate, force)
        parts: list[Rows] = []
        start = 0
        while start < stamp_ns.size:
            stop = self._before_jump(stamp_ns, start)
            parts.append(
                self._add_ordered(stamp_ns[start:stop], rate[start:stop], force[start:stop])
            )
            if stop < stamp_ns.size:
                self._jump(int(stamp_ns[stop]))
            start = stop
        return joined(parts)

    def add_fix(
        self,
        stamp_ns: int,
        latitude_deg: float,
        longitude_deg: float,
        altitude_m: float,
        covariance: Floats | None = None,
        status: int = 0,
    ) -> None:
        """Feed a fix of the antenna (WGS-84); covariance (3, 3) east-north-up m^2, None if unknown.

        ``status`` as in NavSatStatus, by whose page a fix is valid from 0 (STATUS_FIX) on: -1 is
        no fix, and -2 a status that the driver has not set.
        """
        where = (latitude_deg, longitude_deg, altitude_m)
        if status == UNKNOWN_STATUS:
            self._reject(
                "fixes whose status was never set (-2, unknown): NavSatStatus calls a fix valid "
                "from 0 (STATUS_FIX) on; let the driver set it"
            )
            return
        if status <= NO_FIX:
            self._reject(f"receiver says that it has no fix (status {status})")
            return
        if math.isnan(altitude_m) and all(map(math.isfinite, where[:2])):
            self._reject("fixes without an altitude (NaN)")
            return
        if not all(map(math.isfinite, where)) or abs(latitude_deg) > 90 or abs(longitude_deg) > 360:
            self._reject("fix that is not a place on Earth (NaN or out of range)")
            return
        z = np.zeros(arrays.Z_SIZE)
        claim, claimed = self._usable_claim(covariance), self.noise.position_claimed
        latitude, longitude, altitude = map(float, where)
        observe.write_fix(z, latitude, longitude, altitude, claim, self._white[0], claimed)
        self._add(Measurement(self._true_time(stamp_ns), arrays.FIX, z))

    def add_velocity(
        self,
        stamp_ns: int,
        velocity: Floats | tuple[float, float, float],
        covariance: Floats | None = None,
    ) -> None:
        """Feed a velocity of the antenna, east-north-up m/s; covariance (3, 3) or None."""
        if not self.parameters.use_velocity:
            return
        z = np.zeros(arrays.Z_SIZE)
        z[0:3] = velocity
        if not np.isfinite(z[0:3]).all():
            self._note("velocities that are NaN were left out")
            return
        R = np.diag(self._white[1] ** 2)
        if covariance is not None and observe.is_covariance(np.asarray(covariance, dtype=float)):
            R = np.maximum(np.diag(np.diag(covariance)), R)
        z[6:15] = R.ravel()
        z[15:18] = 1.0
        self._add(Measurement(self._true_time(stamp_ns), arrays.VELOCITY_KIND, z))

    def add_field(self, stamp_ns: int, field: Floats | tuple[float, float, float]) -> None:
        """Feed a magnetic field, T, sensor axes."""
        if not self.parameters.use_magnetometer:
            return
        p = self.parameters
        raw = np.asarray(field, dtype=float)
        calibrated = self._mounting @ (np.array(p.soft_iron) @ (raw - np.array(p.hard_iron_t)))
        strength = float(np.linalg.norm(calibrated))
        if not FIELD_RANGE_T[0] <= strength <= FIELD_RANGE_T[1]:
            self._note(
                "magnetic fields outside 15 to 80 uT were left out: not the Earth's; "
                "calibrate hard_iron_t and soft_iron"
            )
            return
        z = np.zeros(arrays.Z_SIZE)
        z[0:3] = calibrated
        z[6] = self.noise.heading.white_sigma**2
        z[15] = 1.0
        self._add(Measurement(int(stamp_ns), arrays.FIELD, z))

    def make_room(self) -> None:
        """Drop the measurements that no rewind can reach any more; what became of them is kept."""
        assert self._core is not None
        count = core.settled(self._core)
        self._keep_results(count)
        core.forget(self._core, count)

    # ------------------------------------------------------------------ asking

    @property
    def running(self) -> bool:
        """Whether the filter has started."""
        return self._core is not None

    @property
    def origin(self) -> tuple[float, float, float] | None:
        """Latitude deg, longitude deg, altitude m of the ENU frame; None before the first fix."""
        if self.parameters.origin is not None:
            return self.parameters.origin
        if self._origin is None and self._core is not None:
            s = self._best()
            if s[observe.USED] > 0:
                first = s[observe.FIRST_FIX : observe.FIRST_FIX + 3]
                latitude, longitude, altitude = geodetic_from_ecef(first)
                self._origin = (math.degrees(latitude), math.degrees(longitude), float(altitude))
        return self._origin

    def state(self) -> Floats:
        """Return the heaviest hypothesis as a flat array (a copy); empty before the start."""
        return self._best().copy() if self._core is not None else np.zeros(0)

    def turns_too_fast(self) -> bool:
        """Whether the angular rate stays where no platform's does: degrees per second, perhaps."""
        return self._core is not None and bool(self._core.shared[arrays.FAST_BLOCKS] >= 4)

    def results(self) -> tuple[Stamps, Floats]:
        """Fixes applied so far: when they hold, and (k, RESULT_SIZE) what became of each.

        As it is by now: of a fix that was repeated after a late one, the last time.  A live node
        that runs for days keeps the newest ``KEPT_CHUNKS`` blocks of some hundred.
        """
        kept = list(self._results)
        if self._core is not None:
            kept.append(self._newest_results(int(self._core.cursor[arrays.NEXT])))
        if not kept:
            return np.zeros(0, dtype=np.int64), np.zeros((0, observe.RESULT_SIZE))
        return np.concatenate([a for a, _ in kept]), np.concatenate([b for _, b in kept])

    def steps(self) -> tuple[Steps, Steps]:
        """Return what the model says of the first differences of gyro and accelerometer at rest."""
        if self._steps is None:
            rate_hz = self._rate_hz
            self._steps = steps_of(self.noise.gyro, rate_hz), steps_of(self.noise.accel, rate_hz)
        return self._steps

    def status(self) -> Status:
        """Return counts, consistency, biases and notes as they are now."""
        from nav_fusion.consistency import status_of

        return status_of(self)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader should know, one sentence each."""
        return tuple(self._notes)

    # ------------------------------------------------------------------ inside

    def _restart(self) -> None:
        self._core: arrays.Core | None = None
        self._rate_hz = math.nan
        self._steps = None
        self._last_ns: int | None = None
        self._waiting = Waiting(self.noise, self.parameters, self.layout)
        self._out_ns: Stamps = np.zeros(0, dtype=np.int64)
        self._out: Floats = np.zeros((0, arrays.OUT_SIZE))

    def _before_jump(self, stamp_ns: Stamps, start: int) -> int:
        """Index of the first sample from ``start`` on whose stamp jumps, or the size."""
        last = int(stamp_ns[start]) if self._last_ns is None else self._last_ns
        newest = np.maximum.accumulate(np.concatenate(([last], stamp_ns[start:])))
        step = stamp_ns[start:] - newest[:-1]
        jump = (step < -BACKWARDS_S * 1e9) | (step > self.parameters.longest_gap_s * 1e9)
        found = np.flatnonzero(jump)
        return start + int(found[0]) if found.size else stamp_ns.size

    def _jump(self, stamp_ns: int) -> None:
        assert self._last_ns is not None
        step = (stamp_ns - self._last_ns) * 1e-9
        self.counts.restarts += 1
        self._note(f"IMU stamps jumped by {step:+.1f} s: the filter was started anew")
        self._keep_counts()
        self._restart()

    def _newest_results(self, count: int) -> tuple[Stamps, Floats]:
        assert self._core is not None
        fix = self._core.kind[:count] == arrays.FIX
        outcome = self._core.z[:count, arrays.OUTCOME : arrays.OUTCOME + observe.RESULT_SIZE]
        return self._core.measurement_ns[:count][fix], outcome[fix]

    def _keep_results(self, count: int) -> None:
        self._results.append(self._newest_results(count))

    def _keep_counts(self) -> None:
        """Carry the fixes of the filter that ends over into the totals."""
        if self._core is None:
            return
        self._origin = self.origin  # of the first filter, whenever it is asked for
        s = self._best()
        self._keep_results(int(self._core.cursor[arrays.NEXT]))
        for slot in observe.TOTALS:
            self._past[slot] += s[slot]

    def _add_ordered(self, stamp_ns: Stamps, rate: Floats, force: Floats) -> Rows:
        keep = self._usable_samples(stamp_ns, rate, force)
        if not keep.all():
            stamp_ns, rate, force = stamp_ns[keep], rate[keep], force[keep]
        return self._take(stamp_ns, rate, force)

    def _take(self, stamp_ns: Stamps, rate: Floats, force: Floats) -> Rows:
        """Take samples that are finite and in order."""
        if stamp_ns.size == 0:
            return _no_rows()
        if self.parameters.mounting_rpy_rad != (0.0, 0.0, 0.0):
            rate = np.ascontiguousarray(rate @ self._mounting.T)
            force = np.ascontiguousarray(force @ self._mounting.T)
        self.counts.imu_samples += stamp_ns.size
        self._last_ns = int(stamp_ns[-1])
        return self._advance(stamp_ns, rate, force)

    def _advance(self, stamp_ns: Stamps, rate: Floats, force: Floats) -> Rows:
        """Filter samples, or wait with them; what one pass cannot hold, in parts.

        Each part finds out anew whether the filter runs: it may have been lost in the one before.
        """
        if self._core is None:
            return self._wait(stamp_ns, rate, force)
        most = arrays.MOST_SAMPLES
        if stamp_ns.size <= most:
            return self._feed(stamp_ns, rate, force)
        parts = [slice(a, a + most) for a in range(0, stamp_ns.size, most)]
        return joined([self._advance(stamp_ns[p], rate[p], force[p]) for p in parts])

    def _usable_samples(self, stamp_ns: Stamps, rate: Floats, force: Floats) -> NDArray[np.bool_]:
        finite = np.isfinite(rate).all(axis=1) & np.isfinite(force).all(axis=1)
        order = np.where(finite, stamp_ns, np.iinfo(np.int64).min)
        last = np.iinfo(np.int64).min if self._last_ns is None else self._last_ns
        before = np.maximum.accumulate(np.concatenate(([last], order[:-1])))
        repeated = finite & (stamp_ns == before)
        backwards = finite & (stamp_ns < before)
        self.counts.imu_non_finite += int((~finite).sum())
        self.counts.imu_duplicates += int(repeated.sum())
        self.counts.imu_out_of_order += int(backwards.sum())
        return finite & (stamp_ns > before)

    def _feed(self, stamp_ns: Stamps, rate: Floats, force: Floats) -> Rows:
        assert self._core is not None
        if self._out_ns.size < stamp_ns.size:
            self._out_ns = np.zeros(stamp_ns.size, dtype=np.int64)
            self._out = np.zeros((stamp_ns.size, arrays.OUT_SIZE))
        before = int(self._core.cursor[arrays.AHEAD])
        head = int(self._core.cursor[arrays.SAMPLES]) + stamp_ns.size
        count = core.feed(self._core, stamp_ns, rate, force, self._out_ns, self._out)
        ahead = int(self._core.cursor[arrays.AHEAD]) - before
        if ahead:
            self._reject(f"fixes more than {AHEAD_S:g} s ahead of the IMU's clock", ahead)
        rows = Rows(self._out_ns[:count].copy(), self._out[:count].copy())
        return joined([rows, self._align_again(head)]) if self._lost() else rows

    def _lost(self) -> bool:
        return self._core is not None and bool(self._core.cursor[arrays.LOST_NS] != 0)

    def _align_again(self, head: int) -> Rows:
        """Begin from nothing behind the fix at which the filter was found lost.

        With the ``head`` samples fed so far and the measurements, as if none had come before.
        """
        assert self._core is not None
        lost_ns = int(self._core.cursor[arrays.LOST_NS])
        self.counts.restarts += 1
        self._note(
            "the filter was lost: it kept out fixes without a break soon after it had begun, and "
            "was aligned anew"
        )
        samples = core.samples_after(self._core, lost_ns, head)
        later = core.measurements_after(self._core, lost_ns)
        last_ns = self._last_ns
        self._keep_counts()
        self._restart()
        self._last_ns = last_ns
        for time_ns, kind, z in later:
            self._waiting.add_measurement(Measurement(time_ns, kind, z))
        return self._wait(*samples) if samples[0].size else _no_rows()

    def _add(self, measurement: Measurement) -> None:
        is_fix = measurement.kind == arrays.FIX
        if self._last_ns is not None and is_fix:
            self._compare_clocks(measurement.time_ns)
        if self._core is None:
            self._waiting.add_measurement(measurement)
            return
        if self._core.cursor[arrays.HEAD_MEASUREMENT] == arrays.MEASUREMENT_RING:
            self.make_room()
        head = int(self._core.cursor[arrays.SAMPLES])
        outcome = core.insert(self._core, measurement.time_ns, measurement.kind, measurement.z)
        if self._lost():
            self._align_again(head)
        if not is_fix:
            return
        if outcome == core.LATE:
            assert self._last_ns is not None
            self.counts.late += measurement.time_ns < self._last_ns
        elif outcome == core.TOO_LATE:
            self._reject(f"fixes more than {self.parameters.lateness_s:g} s late")
        elif outcome != core.ACCEPTED:
            self._reject(
                "fixes whose stamp repeats"
                if outcome == core.DUPLICATE
                else "fixes while no IMU sample came"
            )

    def _compare_clocks(self, time_ns: int) -> None:
        assert self._last_ns is not None
        apart = (time_ns - self._last_ns) * 1e-9
        if apart < -APART_S:
            self._note_clocks(apart)

    def _note_clocks(self, apart: float) -> None:
        self._note(
            f"stamps of the fixes are {abs(apart):.0f} s "
            f"{'ahead of' if apart > 0 else 'behind'} those of the IMU: their clocks differ; "
            "set gnss_delay_s or mend the driver"
        )

    def _wait(self, stamp_ns: Stamps, rate: Floats, force: Floats) -> Rows:
        """Before the start: keep the samples, and start when the first fix is certain."""
        start = self._waiting.add_samples(stamp_ns, rate, force)
        self.fault = self._waiting.fault
        if self._waiting.ahead_s is not None and self._waiting.ahead_s > APART_S:
            self._note_clocks(self._waiting.ahead_s)
        if start is None:
            return _no_rows()
        if start.skipped:
            self._reject("fixes before the filter could be levelled", start.skipped)
        self._core = self._new_core(start)
        self._rate_hz = 1.0 / start.period_s
        core.begin(self._core, int(start.stamp_ns[0]), start.rate[0], start.force[0])
        for measurement in start.measurements:
            core.insert(self._core, measurement.time_ns, measurement.kind, measurement.z)
        waited = slice(1, start.replayed + 1)
        self._advance(start.stamp_ns[waited], start.rate[waited], start.force[waited])
        rest = slice(start.replayed + 1, None)
        return self._advance(start.stamp_ns[rest], start.rate[rest], start.force[rest])

    def _new_core(self, start: Start) -> arrays.Core:
        p = self.parameters
        window_s = p.lateness_s + max(p.gnss_delay_s, 0.0)
        gap_s = 2.5 * start.period_s
        spans = (window_s / 10, 1 / p.publish_rate_hz, gap_s, window_s, AHEAD_S)
        times = np.array([start.stamp_ns[0], *(round(t * 1e9) for t in spans)], dtype=np.int64)
        gap = np.array(
            [p.gap_accel_m_s2, p.gap_correlation_s, p.gap_rate_rad_s, p.gap_correlation_s]
        )
        quiet = quiet_limits(self.layout, p, 1.0 / start.period_s)
        made = arrays.new_core(self.layout, start.bank, times, gap, quiet, packed_sensing(p))
        made.shared[arrays.REPOSE] = float(start.still)
        return made

    def _best(self) -> Floats:
        assert self._core is not None
        return self._core.bank[hypotheses.heaviest(self._core)]

    def _true_time(self, stamp_ns: int) -> int:
        return int(stamp_ns) - round(self.parameters.gnss_delay_s * 1e9)

    def _usable_claim(self, covariance: Floats | None) -> Floats:
        """Return the receiver's covariance, or a stated default where it is none."""
        if covariance is not None:
            matrix = np.asarray(covariance, dtype=float)
            if observe.is_covariance(matrix):
                return matrix
            self._note("the receiver's covariance is not one (zero, negative or NaN): not used")
        if self.noise.position_claimed:
            self._note("fixes without covariance: 2.5 m horizontal and 5 m vertical assumed")
        return UNKNOWN_FIX_COVARIANCE

    def _reject(self, why: str, count: int = 1) -> None:
        self.counts.rejected += count
        self._note(f"left out: {why}")

    def _note(self, sentence: str) -> None:
        if sentence not in self._notes and len(self._notes) < 100:
            self._notes[sentence] = None


def packed_sensing(parameters: Parameters) -> observe.Sensing:
    """Parameters as the compiled corrections want them."""
    gate = np.array([0.0, *(chdtri(k, 1.0 - parameters.gate_confidence) for k in (1, 2, 3))])
    return observe.Sensing(
        np.array(parameters.lever_arm_m, dtype=float),
        gate,
        np.array([parameters.recovery_fixes, parameters.recovery_s], dtype=float),
        np.array([parameters.declination_rad]),
        np.array([1e-4, 1e-6, 0.3, float(parameters.zero_velocity_updates)]),
    )


def _no_rows() -> Rows:
    return Rows(np.zeros(0, dtype=np.int64), np.zeros((0, arrays.OUT_SIZE)))


def joined(parts: list[Rows]) -> Rows:
    """Rows of several blocks as one."""
    filled = [p for p in parts if p.stamp_ns.size]
    if len(filled) == 1:
        return filled[0]
    if not filled:
        return _no_rows()
    return Rows(
        np.concatenate([p.stamp_ns for p in filled]), np.concatenate([p.values for p in filled])
    )
