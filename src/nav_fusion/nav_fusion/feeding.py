"""Decoded messages to the engine: the live node and ``fuse --bag`` feed it with this."""

from __future__ import annotations

import numpy as np
from imu_noise_id.cdr import LAYOUTS, Decoded

from imu_noise_id import cdr
from nav_fusion.engine import Engine, Rows

_CLAIMED = 0


def feed(engine: Engine, msgtype: str, decoded: Decoded) -> Rows:
    """Feed a batch of messages of one topic; return the rows that became due.

    Batches must come in the order of arrival; only IMU samples make rows due.
    """
    columns = dict(zip(LAYOUTS[msgtype].columns, decoded.values, strict=True))
    if msgtype == cdr.IMU:
        rate, force = decoded.values[:3].T, decoded.values[3:6].T
        return engine.add_imu(decoded.stamp_ns, rate, force)
    for k, stamp_ns in enumerate(decoded.stamp_ns.tolist()):
        row = {name: float(column[k]) for name, column in columns.items()}
        if msgtype == cdr.NAV_SAT_FIX:
            _add_fix(engine, stamp_ns, row)
        elif msgtype == cdr.MAGNETIC_FIELD:
            engine.add_field(stamp_ns, _three(row, "magnetic_field"))
        else:
            engine.add_velocity(stamp_ns, _three(row, "linear"), _velocity_covariance(row))
    return Rows(np.empty(0, np.int64), np.empty((0, 0)))


def _add_fix(engine: Engine, stamp_ns: int, row: dict[str, float]) -> None:
    covariance = None
    if row["covariance_type"] > _CLAIMED:
        covariance = np.array([row[f"position_covariance.{k}"] for k in range(9)]).reshape(3, 3)
    place = row["latitude"], row["longitude"], row["altitude"]
    engine.add_fix(stamp_ns, *place, covariance, int(row["status"]))


def _velocity_covariance(row: dict[str, float]) -> np.ndarray | None:
    """The upper left 3 x 3 of a twist's covariance, None where it claims nothing."""
    if "covariance.0" not in row:
        return None
    matrix = np.array([[row[f"covariance.{6 * i + j}"] for j in range(3)] for i in range(3)])
    return matrix if matrix.any() else None


def _three(row: dict[str, float], name: str) -> tuple[float, float, float]:
    return row[f"{name}.x"], row[f"{name}.y"], row[f"{name}.z"]
