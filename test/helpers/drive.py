"""A drive for tests: rest, then straight east with gentle changes of speed, on a flat map."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from imu_noise_id.bag_writer import TopicBytes, write_bag
from nav_fusion.engine import Engine, Rows, joined

from imu_noise_id import cdr

START_NS = 1_700_000_000_000_000_000
LATITUDE, LONGITUDE, ALTITUDE, GRAVITY = 47.0, 8.0, 400.0, 9.80863
EAST_M = 6378137.0 / np.sqrt(1 - 0.00669438 * np.sin(np.radians(LATITUDE)) ** 2) + ALTITUDE


@dataclass(frozen=True)
class Drive:
    """IMU samples and fixes: stamps ns, rate and force (n, 3), fixes (k, 3) deg, deg, m."""

    stamp_ns: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    fix_ns: np.ndarray
    fix: np.ndarray


def drive(
    seconds: float = 30.0,
    rate_hz: float = 100.0,
    seed: int = 1,
    rest_s: float = 5.0,
    noise_m: float = 0.3,
) -> Drive:
    """Make a drive; GNSS at 5 Hz, on IMU samples."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    moving = np.clip(t - rest_s, 0, None)
    acceleration = np.where(t > rest_s, 1.5 * np.sin(0.4 * moving), 0.0)
    east = 1.5 / 0.4 * moving - 1.5 / 0.16 * np.sin(0.4 * moving)
    force = np.stack([acceleration, 0 * t, 0 * t + GRAVITY], axis=1)
    force += rng.normal(0, 0.02, force.shape)
    rate = rng.normal(0, 1e-3, force.shape)
    k = np.arange(0, t.size, round(rate_hz / 5))
    noise = rng.normal(0, noise_m, (k.size, 3))
    latitude = LATITUDE + np.degrees(noise[:, 1] / 6.37e6)
    longitude = LONGITUDE + np.degrees(
        (east[k] + noise[:, 0]) / (EAST_M * np.cos(np.radians(LATITUDE)))
    )
    fix = np.stack([latitude, longitude, ALTITUDE + noise[:, 2]], axis=1)
    stamp_ns = START_NS + np.rint(t * 1e9).astype(np.int64)
    return Drive(stamp_ns, rate, force, stamp_ns[k], fix)


def without_fixes(d: Drive, from_s: float, to_s: float) -> Drive:
    """Leave the fixes of a stretch out."""
    t = (d.fix_ns - START_NS) * 1e-9
    keep = (t < from_s) | (t >= to_s)
    return replace(d, fix_ns=d.fix_ns[keep], fix=d.fix[keep])


def until(d: Drive, seconds: float) -> Drive:
    """Cut a drive off."""
    n = int(np.searchsorted(d.stamp_ns, START_NS + round(seconds * 1e9)))
    k = int(np.searchsorted(d.fix_ns, START_NS + round(seconds * 1e9)))
    return Drive(d.stamp_ns[:n], d.rate[:n], d.force[:n], d.fix_ns[:k], d.fix[:k])


def play(
    engine: Engine,
    d: Drive,
    late_s: np.ndarray | float = 0.0,
    block: int = 1_000_000,
    covariance: np.ndarray | None = None,
) -> Rows:
    """Feed a drive; each fix arrives ``late_s`` after its stamp, samples in blocks of a size."""
    arrival = d.fix_ns + np.rint(np.broadcast_to(late_s, d.fix_ns.shape) * 1e9).astype(np.int64)
    rows = []
    begin = 0

    def samples(end: int) -> None:
        nonlocal begin
        for a in range(begin, end, block):
            part = slice(a, min(a + block, end))
            rows.append(engine.add_imu(d.stamp_ns[part], d.rate[part], d.force[part]))
        begin = max(begin, end)

    for k in np.argsort(arrival, kind="stable"):
        samples(int(np.searchsorted(d.stamp_ns, arrival[k], side="right")))
        engine.add_fix(int(d.fix_ns[k]), *d.fix[k], covariance)
    samples(d.stamp_ns.size)
    return joined(rows)


def write(d: Drive, path: Path, late_s: float = 0.0) -> Path:
    """Write a drive as a bag; fixes are received ``late_s`` late."""
    names = [f"{n}.{a}" for n in ("angular_velocity", "linear_acceleration") for a in "xyz"]
    imu = dict(zip(names, np.hstack((d.rate, d.force)).T, strict=True))
    fixes = dict(zip(("latitude", "longitude", "altitude"), d.fix.T, strict=True))
    fixes |= {f"position_covariance.{k}": 0.09 for k in (0, 4, 8)} | {"covariance_type": 2.0}
    write_bag(
        path,
        [
            TopicBytes(
                "/imu/data", cdr.IMU, d.stamp_ns, cdr.encode(cdr.IMU, d.stamp_ns, imu, "imu")
            ),
            TopicBytes(
                "/gps/fix",
                cdr.NAV_SAT_FIX,
                d.fix_ns + round(late_s * 1e9),
                cdr.encode(cdr.NAV_SAT_FIX, d.fix_ns, fixes, "gps"),
            ),
        ],
    )
    return path
