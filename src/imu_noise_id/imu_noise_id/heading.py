"""Magnetic heading of a tilted magnetometer."""

from __future__ import annotations

import numpy as np

from imu_noise_id.recording import Floats, Stamps

TILT_WINDOW_S = 1.0


def heading(
    stamp_ns: Stamps, field: Floats, accel_stamp_ns: Stamps, acceleration: Floats
) -> Floats:
    """Heading of the levelled magnetic field, unwrapped.

    heading = atan2(-m_y, m_x) of the field turned level by the roll and pitch that the
    accelerometers show (their mean over one second about the sample):
    roll = atan2(a_y, a_z), pitch = atan2(-a_x, sqrt(a_y^2 + a_z^2)).

    Parameters
    ----------
    stamp_ns : (n,) int64
    field : (3, n) float64
        In the sensor's axes, in which a level sensor at rest measures +g on z.
    accel_stamp_ns : (m,) int64
    acceleration : (3, m) float64

    Returns
    -------
    (n,) float64
        In rad, NaN where the field or the tilt is not known.
    """
    ax, ay, az = _means_about(stamp_ns, accel_stamp_ns, acceleration)
    roll = np.arctan2(ay, az)
    pitch = np.arctan2(-ax, np.hypot(ay, az))
    mx, my, mz = field
    level_y = np.cos(roll) * my - np.sin(roll) * mz
    level_z = np.sin(roll) * my + np.cos(roll) * mz
    level_x = np.cos(pitch) * mx + np.sin(pitch) * level_z
    angle = np.arctan2(-level_y, level_x)
    known = np.isfinite(angle)
    angle[known] = np.unwrap(angle[known])
    return angle


def _means_about(stamp_ns: Stamps, at_ns: Stamps, values: Floats) -> Floats:
    """Means of the finite samples within half a window of each stamp, the nearest if there is none.

    Shape (3, n); NaN where nothing is within ten windows.
    """
    finite = np.isfinite(values).all(axis=0)
    if not finite.all():
        at_ns, values = at_ns[finite], values[:, finite]
    if at_ns.size == 0:
        return np.full((3, stamp_ns.size), np.nan)
    half = round(TILT_WINDOW_S * 0.5e9)
    begin = np.searchsorted(at_ns, stamp_ns - half)
    end = np.searchsorted(at_ns, stamp_ns + half, side="right")
    nearest = np.clip(np.searchsorted(at_ns, stamp_ns), 0, at_ns.size - 1)
    begin, end = np.where(end > begin, begin, nearest), np.where(end > begin, end, nearest + 1)
    means = np.empty((3, stamp_ns.size))
    for axis in range(3):
        middle = values[axis, 0]
        total = np.concatenate(([0.0], np.cumsum(values[axis] - middle)))
        means[axis] = middle + (total[end] - total[begin]) / (end - begin)
    means[:, np.abs(at_ns[nearest] - stamp_ns) > 10 * 2 * half] = np.nan
    return means
