"""Bags for tests: of arrays, and of the recordings in ``../shared/data``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from imu_noise_id.bag_writer import TopicBytes, write_bag

from imu_noise_id import cdr

START_NS = 1_700_000_000_000_000_000
GRAVITY = 9.80665


def uniform(count, rate_hz, start_ns=START_NS):
    """Return stamps of a perfect clock."""
    return start_ns + np.rint(np.arange(count) * (1e9 / rate_hz)).astype(np.int64)


def messages(topic, msgtype, stamp_ns, members, frame_id="sensor", log_ns=None):
    """Return the messages of a topic."""
    rows = cdr.encode(msgtype, stamp_ns, members, frame_id)
    return TopicBytes(topic, msgtype, stamp_ns if log_ns is None else log_ns, rows)


def columns(name, values, axes="xyz"):
    """Return members ``name.x`` ... of an (n, 3) array."""
    return {f"{name}.{axis}": column for axis, column in zip(axes, values.T, strict=True)}


def imu(stamp_ns, gyro, accel, topic="/imu/data", **more):
    """Return Imu messages of (n, 3) arrays in SI units."""
    members = columns("angular_velocity", gyro) | columns("linear_acceleration", accel)
    return messages(topic, cdr.IMU, stamp_ns, members, **more)


def still_imu(rng, count=2000, rate_hz=200.0, topic="/imu/data", stamp_ns=None):
    """Return the messages of a MEMS IMU with white noise at rest."""
    stamp_ns = uniform(count, rate_hz) if stamp_ns is None else stamp_ns
    gyro = rng.normal(0.0, 0.003, (stamp_ns.size, 3))
    accel = rng.normal(0.0, 0.03, (stamp_ns.size, 3)) + np.array((0.0, 0.0, GRAVITY))
    return imu(stamp_ns, gyro, accel, topic)


def field(stamp_ns, tesla, topic="/imu/mag"):
    """Return MagneticField messages of an (n, 3) array."""
    return messages(topic, cdr.MAGNETIC_FIELD, stamp_ns, columns("magnetic_field", tesla))


def fixes(stamp_ns, llh, topic="/gps/fix", **members):
    """Return NavSatFix messages of (n, 3) degrees, degrees, metres."""
    names = ("latitude", "longitude", "altitude")
    members |= dict(zip(names, llh.T, strict=True))
    return messages(topic, cdr.NAV_SAT_FIX, stamp_ns, members)


def velocities(stamp_ns, enu, topic="/gps/vel", msgtype=cdr.TWIST):
    """Return TwistStamped messages of an (n, 3) array."""
    return messages(topic, msgtype, stamp_ns, columns("linear", enu))


def temperatures(stamp_ns, celsius, topic="/imu/temperature"):
    """Return Temperature messages."""
    return messages(topic, cdr.TEMPERATURE, stamp_ns, {"temperature": celsius})


def npz_bag(source: Path, folder: Path) -> Path:
    """Turn a recording of ``../shared/data`` into a bag and return its path.

    An Imu topic needs all six axes; sensors that the recording lacks have no topic.
    """
    data = np.load(source)
    topics = []
    if "gyro" in data:
        topics.append(imu(_stamps(data, "t", len(data["gyro"])), data["gyro"], data["accel"]))
    for key, scale in (("mag_uT", 1e-6), ("mag", 1e-6), ("mag_counts", 1e-4 / 12_000)):
        if key in data:
            own = "mag_t" if "mag_t" in data else "t"
            topics.append(field(_stamps(data, own, len(data[key])), scale * data[key]))
    if "gnss_t" in data:
        topics += _receiver(data)
    target = folder / source.stem
    write_bag(target, topics)
    return target


def _receiver(data):
    llh = data["gnss_llh"] if "gnss_llh" in data else data["gnss_raw"][:, [0, 1, 4]]
    stamp_ns = _stamps(data, "gnss_t", len(llh))
    topics = [fixes(stamp_ns, llh)]
    if "gnss_vel_neu" in data:
        topics.append(velocities(stamp_ns, data["gnss_vel_neu"][:, [1, 0, 2]]))
    elif "gnss_vel_ned" in data:
        topics.append(velocities(stamp_ns, data["gnss_vel_ned"][:, [1, 0, 2]] * (1, 1, -1)))
    return topics


def _stamps(data, key, count):
    if key not in data:
        return uniform(count, float(data["rate_hz"]))
    first = min(float(data[name][0]) for name in ("t", "gnss_t", "mag_t") if name in data)
    return START_NS + np.rint((data[key] - first) * 1e9).astype(np.int64)
