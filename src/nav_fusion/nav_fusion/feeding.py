"""Decoded messages to the engine: the live node and ``fuse --bag`` feed it with this."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from imu_noise_id.cdr import LAYOUTS
from numpy.typing import NDArray

from imu_noise_id import cdr
from nav_fusion.engine import Engine, Rows

_CLAIMED = 0


def feed(
    engine: Engine, msgtype: str, stamp_ns: NDArray[np.int64], values: NDArray[np.float64]
) -> Rows:
    """Feed a batch of messages of one topic; return the rows that became due.

    Batches must come in the order of arrival; only IMU samples make rows due.
    """
    if msgtype == cdr.IMU:
        return engine.add_imu(stamp_ns, *inertial(values))
    add = adder(engine, msgtype, stamp_ns, values)
    for k in range(stamp_ns.size):
        add(k)
    return Rows(np.empty(0, np.int64), np.empty((0, 0)))


def inertial(
    values: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angular rate and specific force (n, 3) of the columns of ``sensor_msgs/Imu``."""
    return np.ascontiguousarray(values[:3].T), np.ascontiguousarray(values[3:6].T)


def adder(
    engine: Engine, msgtype: str, stamp_ns: NDArray[np.int64], values: NDArray[np.float64]
) -> Callable[[int], None]:
    """Return what feeds the k-th of these messages of an aid."""
    at = {name: k for k, name in enumerate(LAYOUTS[msgtype].columns)}
    stamps, rows = stamp_ns.tolist(), np.ascontiguousarray(values.T)
    if msgtype == cdr.NAV_SAT_FIX:
        first, status, kind = (
            at[name] for name in ("position_covariance.0", "status", "covariance_type")
        )
        places = rows[:, [at[name] for name in ("latitude", "longitude", "altitude")]].tolist()
        claims = rows[:, first : first + 9].reshape(-1, 3, 3).copy()

        def add_fix(k: int) -> None:
            claim = claims[k] if rows[k, kind] > _CLAIMED else None
            latitude, longitude, altitude = places[k]
            said = int(rows[k, status])
            engine.add_fix(stamps[k], latitude, longitude, altitude, claim, said)

        return add_fix
    if msgtype == cdr.MAGNETIC_FIELD:
        field = rows[:, [at[f"magnetic_field.{a}"] for a in "xyz"]]
        return lambda k: engine.add_field(stamps[k], field[k])
    velocity = rows[:, [at[f"linear.{a}"] for a in "xyz"]]
    if "covariance.0" not in at:
        return lambda k: engine.add_velocity(stamps[k], velocity[k])
    corner = [at[f"covariance.{6 * i + j}"] for i in range(3) for j in range(3)]
    claimed = rows[:, corner].reshape(-1, 3, 3)

    def add_velocity(k: int) -> None:
        engine.add_velocity(stamps[k], velocity[k], claimed[k] if claimed[k].any() else None)

    return add_velocity
