"""``fuse --bag``: a recording through the engine in the order in which it was received."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from imu_noise_id.assemble import to_recording
from imu_noise_id.bag_writer import TopicBytes, write_bag
from imu_noise_id.bags import read_topics
from imu_noise_id.columns import TopicColumns
from imu_noise_id.errors import InputError
from imu_noise_id.identify import identify_recording
from imu_noise_id.model import NoiseModel
from imu_noise_id.recording import Channel, Recording
from imu_noise_id.results_file import write_json
from imu_noise_id.topics import TopicNames
from numpy.typing import NDArray

from imu_noise_id import cdr
from nav_fusion import arrays
from nav_fusion.consistency import Innovations, innovations_of
from nav_fusion.doubt import FIX_KINDS, doubts_of
from nav_fusion.engine import Engine, Rows, Status, joined
from nav_fusion.feeding import adder, inertial
from nav_fusion.noise import AidRates, NavigationNoise, TurnOn, from_model, mems_defaults
from nav_fusion.parameters import DEFAULTS, Parameters
from nav_fusion.published import FIX_TOPIC, ODOMETRY_TOPIC, fix_messages, odometry_messages
from nav_fusion.rivals import LONGEST_S, likelier
from nav_fusion.solution import Solution, solve

Stamps = NDArray[np.int64]

MEASURES = {
    cdr.NAV_SAT_FIX: "position_hz",
    cdr.TWIST: "velocity_hz",
    cdr.TWIST_WITH_COVARIANCE: "velocity_hz",
    cdr.MAGNETIC_FIELD: "heading_hz",
}
"""Types of the aids, and which of ``AidRates`` each is."""
AIDS = tuple(MEASURES)
SHORTEST_STILL_S = 60.0
"""A shorter leading rest identifies nothing that the defaults do not know as well."""
MOVING_SHARE = 0.1
"""Of its beginning a platform must move, to tell of a delay or of where the antenna is."""
GNSS_STILL_S = 600.0
"""A shorter rest does not show the receiver's colour."""
FORMAT = "fuse/1"
STEPS = 51
"""Of which :func:`fuse_bag` tells: one when all is read, the rest spread over the samples."""


@dataclass(frozen=True)
class FuseResult:
    """What a recording gave.

    Attributes
    ----------
    solution : Solution
        What the live node would have published.
    origin : (3,)
        Latitude deg, longitude deg, altitude m of its east-north-up frame.
    status : Status
        At the end.
    engine : Engine
    notes : tuple of str
    """

    solution: Solution
    origin: tuple[float, float, float]
    status: Status
    engine: Engine
    notes: tuple[str, ...]

    @property
    def innovations(self) -> Innovations:
        """Every fix against what the filter expected of it."""
        return innovations_of(self.engine)


def _say_nothing(step: str) -> None:
    """Tell nobody."""


def fuse_bag(
    bag: str | Path,
    model: NoiseModel | None = None,
    parameters: Parameters = DEFAULTS,
    topics: TopicNames | None = None,
    done: Callable[[str], None] = _say_nothing,
) -> FuseResult:
    """Read a bag and fuse it; ``done`` is told ``STEPS`` times how far it is.

    Raises
    ------
    InputError
        When the bag has no IMU or no fix, when the model lacks an inertial channel, or when the
        filter could not start, with the reason.
    """
    columns, notes = read_topics(bag, topics)
    kinds = {c.type for c in columns if c.stamp_ns.size}
    for needed, what in ((cdr.IMU, "sensor_msgs/Imu"), (cdr.NAV_SAT_FIX, "sensor_msgs/NavSatFix")):
        if needed not in kinds:
            raise InputError(
                f"{bag}: no {what} topic with messages: nothing to fuse; "
                "record it, or name it with --topic"
            )
    noise = choose_noise(columns, model, parameters, str(bag))
    done("fusing")
    return fuse_columns(columns, noise, parameters, str(bag), notes, done)


def fuse_columns(
    columns: Sequence[TopicColumns],
    noise: NavigationNoise,
    parameters: Parameters,
    source: str,
    notes: Sequence[str] = (),
    done: Callable[[str], None] = _say_nothing,
) -> FuseResult:
    """Fuse topics in the order of their times of reception."""
    engine = Engine(noise, parameters)
    rows = run(engine, columns, done)
    status = engine.status()
    origin = engine.origin
    said = (f"noise model: {noise.source}", *notes, *status.notes)
    if not engine.running or origin is None or not rows.stamp_ns.size:
        reason = (
            engine.fault
            or _apart(columns)
            or "; ".join(
                (
                    "no fix has a second of IMU samples before it and half a second after it",
                    *status.notes,
                    *notes,
                )
            )
        )
        raise InputError(f"{source}: the filter could not start: {reason}")
    if engine.turns_too_fast():
        raise InputError(
            f"{source}: angular_velocity stays above 8 rad/s for a second or more: degrees per "
            "second, perhaps; it must be rad/s"
        )
    solution = solve(rows.stamp_ns, rows.values, origin, parameters.lever_arm_m)
    if _is_worth_asking(engine, solution):
        said = (*said, *_likelier(columns, noise, parameters))
    return FuseResult(solution, origin, status, engine, said)


def _is_worth_asking(engine: Engine, solution: Solution) -> bool:
    """Whether another delay or antenna may be why the fixes speak against the model.

    They make fixes differ by more than expected, and of a platform that rests they show nothing.
    """
    beginning = solution.stamp_ns < solution.stamp_ns[0] + round(LONGEST_S * 1e9)
    if np.mean(solution.still[beginning]) > 1.0 - MOVING_SHARE:
        return False
    return any(
        d.holds and d.kind in FIX_KINDS and (d.kind == "correlation" or d.size > 1.0)
        for d in doubts_of(engine)
    )


def _likelier(
    columns: Sequence[TopicColumns], noise: NavigationNoise, parameters: Parameters
) -> tuple[str, ...]:
    """Say which other setting the fixes of the beginning speak for, if for one."""
    last = min(int(c.log_ns.min()) for c in columns if c.log_ns.size) + round(LONGEST_S * 1e9)
    beginning = [
        replace(c, stamp_ns=c.stamp_ns[k], log_ns=c.log_ns[k], values=c.values[:, k])
        for c, k in ((c, c.log_ns <= last) for c in columns)
    ]

    def fused(p: Parameters) -> Engine:
        engine = Engine(noise, p)
        run(engine, beginning)
        return engine

    said = likelier(fused, parameters)
    return () if said is None else (said,)


def _apart(columns: Sequence[TopicColumns]) -> str:
    """Return a sentence where the stamps of IMU and fixes do not overlap."""
    imu = next(c for c in columns if c.type == cdr.IMU)
    fixes = next(c for c in columns if c.type == cdr.NAV_SAT_FIX)
    ahead = fixes.stamp_ns.min() > imu.stamp_ns.max()
    if not ahead and fixes.stamp_ns.max() >= imu.stamp_ns.min():
        return ""
    apart = abs(float(fixes.stamp_ns[0] - imu.stamp_ns[0])) * 1e-9
    return (
        f"stamps of {fixes.topic} begin {apart:.0f} s {'after' if ahead else 'before'} those of "
        f"{imu.topic} and do not overlap: their clocks differ; mend the driver"
    )


def run(
    engine: Engine, columns: Sequence[TopicColumns], done: Callable[[str], None] = _say_nothing
) -> Rows:
    """Feed everything in order of arrival; IMU samples between two other messages as one block."""
    imu = next(c for c in columns if c.type == cdr.IMU)
    aids = [c for c in columns if c.type in AIDS and c.stamp_ns.size]
    arrived = np.maximum.accumulate(imu.log_ns)
    add = [adder(engine, c.type, c.stamp_ns, c.values) for c in aids]
    events = sorted(
        (until, log_ns, k, i)
        for k, c in enumerate(aids)
        for i, (until, log_ns) in enumerate(_arrivals(arrived, c.log_ns))
    )
    parts: list[Rows] = []
    begin, told = 0, 0
    for until, _, k, i in events:
        if until > begin:
            block = slice(begin, until)
            parts.append(engine.add_imu(imu.stamp_ns[block], *inertial(imu.values[:, block])))
            begin = until
            while told < (STEPS - 1) * begin // imu.stamp_ns.size:
                done("fusing")
                told += 1
        add[k](i)
    parts.append(engine.add_imu(imu.stamp_ns[begin:], *inertial(imu.values[:, begin:])))
    for _ in range(told, STEPS - 1):
        done("fused")
    return joined(parts)


def _arrivals(arrived: Stamps, log_ns: Stamps) -> Iterable[tuple[int, int]]:
    """How many samples came before each message, and when it came."""
    in_order = np.maximum.accumulate(log_ns)
    before = np.searchsorted(arrived, in_order, side="right")
    return zip(before.tolist(), in_order.tolist(), strict=True)


def choose_noise(
    columns: Sequence[TopicColumns], model: NoiseModel | None, parameters: Parameters, source: str
) -> NavigationNoise:
    """Choose a model: the one given, else of the leading still part, else stated defaults."""
    turn_on = TurnOn(parameters.gyro_turn_on_rad_s, parameters.accel_turn_on_m_s2)
    if model is not None:
        return from_model(model, turn_on, rates_of(columns))
    still_s, recording = leading_rest(columns, source)
    if still_s < SHORTEST_STILL_S:
        defaults = mems_defaults(turn_on)
        return replace(
            defaults,
            notes=(
                *defaults.notes,
                f"no --model, and the platform rests for {still_s:.0f} s at the start (less than "
                f"{SHORTEST_STILL_S:.0f}): values of a consumer MEMS IMU are used",
            ),
        )
    found = identify_recording(recording)
    noise = from_model(found.model, turn_on)
    return replace(
        noise, source=f"identified from the first {still_s:.0f} s, in which the platform rests"
    )


def rates_of(columns: Sequence[TopicColumns]) -> AidRates:
    """Rate of each aid by the median step of its stamps; the default where there are none."""
    rates = AidRates()
    for column in columns:
        if column.type in MEASURES and (steps := np.diff(np.unique(column.stamp_ns))).size:
            rates = replace(rates, **{MEASURES[column.type]: 1e9 / float(np.median(steps))})
    return rates


def leading_rest(columns: Sequence[TopicColumns], source: str) -> tuple[float, Recording]:
    """How long the platform rests from the start, and the recording of that part.

    The receiver's channels are in it only where it is long enough to show their colour.
    """
    recording = to_recording([c for c in columns if c.stamp_ns.size], source)
    still_s = math.inf
    for channel in recording.channels:
        if channel.name.startswith(("angular_velocity", "linear_acceleration")):
            moved = np.flatnonzero(~channel.still)
            last = moved[0] - 1 if moved.size else channel.stamp_ns.size - 1
            rest = (channel.stamp_ns[max(last, 0)] - channel.stamp_ns[0]) * 1e-9
            still_s = min(still_s, float(rest))
    if not math.isfinite(still_s):
        return 0.0, recording
    keep = tuple(
        _head(c, still_s)
        for c in recording.channels
        if still_s >= GNSS_STILL_S or not c.name.startswith(("position", "velocity"))
    )
    return still_s, replace(recording, channels=tuple(c for c in keep if c.stamp_ns.size > 100))


def _head(channel: Channel, seconds: float) -> Channel:
    count = int(np.searchsorted(channel.stamp_ns, channel.stamp_ns[0] + round(seconds * 1e9)))
    return replace(
        channel,
        stamp_ns=channel.stamp_ns[:count],
        values=channel.values[:count],
        still=channel.still[:count],
    )


def fuse_tree(result: FuseResult) -> dict[str, Any]:
    """``fuse/1``."""
    s = result.status
    latitude, longitude, altitude = result.origin
    return {
        "format": FORMAT,
        "origin": {"latitude_deg": latitude, "longitude_deg": longitude, "altitude_m": altitude},
        "imu_samples": s.imu_samples,
        "fixes": {"used": s.used, "gated": s.gated, "late": s.late, "rejected": s.rejected},
        "nis": {"mean": s.nis_mean, "dof": s.nis_dof, "lower": s.nis_lower, "upper": s.nis_upper},
        "white": bool(s.white) if s.white is not None else None,
        "innovation_correlation": s.correlation,
        "gate": {"threshold": s.gate, "confidence": result.engine.parameters.gate_confidence},
        "imu": {
            "duplicates": s.imu_duplicates,
            "out_of_order": s.imu_out_of_order,
            "non_finite": s.imu_non_finite,
            "gaps": s.gaps,
            "gap_s": s.gap_s,
        },
        "velocities": {"used": s.velocity_used, "gated": s.velocity_gated},
        "headings": {"used": s.heading_used, "gated": s.heading_gated},
        "heading_known_s": s.heading_known_s,
        "still_updates": s.still_updates,
        "gyro_bias_rad_s": {"value": s.gyro_bias, "sigma": s.gyro_bias_sigma},
        "accel_bias_m_s2": {"value": s.accel_bias, "sigma": s.accel_bias_sigma},
        "model": result.engine.noise.source,
        "doubts": list(s.doubts),
        "notes": list(result.notes),
    }


def write_result(result: FuseResult, folder: Path, told: Callable[[str], None]) -> None:
    """Write ``filtered/`` and ``fuse.json``, each whole.

    Raises
    ------
    OutputError
        When a file cannot be written.
    """
    stamp_ns = result.solution.stamp_ns
    write_bag(
        folder / "filtered",
        [
            TopicBytes(ODOMETRY_TOPIC, cdr.ODOMETRY, stamp_ns, odometry_messages(result.solution)),
            TopicBytes(FIX_TOPIC, cdr.NAV_SAT_FIX, stamp_ns, fix_messages(result.solution)),
        ],
    )
    told("filtered/")
    write_json(fuse_tree(result), folder / "fuse.json")
    told("fuse.json")


def warm_up() -> None:
    """Compile the filter, so that nobody waits for it later; the build calls this."""
    engine = Engine(mems_defaults(), Parameters())
    stamp_ns = np.arange(0, 5_000_000_000, 10_000_000, dtype=np.int64)
    force = np.tile([0.0, 0.0, 9.81], (stamp_ns.size, 1))
    zero = np.zeros((stamp_ns.size, 3))
    for k in range(10):
        part = slice(50 * k, 50 * (k + 1))
        rows = engine.add_imu(stamp_ns[part], zero[part], force[part])
        at = int(stamp_ns[part][-1])
        engine.add_fix(at, 47.0, 8.0, 400.0 + 0.01 * k, np.eye(3))
        engine.add_fix(at - 300_000_000, 47.0, 8.0, 400.5 + 0.01 * k, np.eye(3))
        engine.add_velocity(at, (0.0, 0.0, 0.0), np.eye(3))
        engine.add_field(at, (2e-5, 0.0, -4e-5))
    engine.make_room()
    engine.status()
    assert engine.origin is not None
    solve(rows.stamp_ns, rows.values, engine.origin)
    assert engine.state().size > arrays.OUT_SIZE
