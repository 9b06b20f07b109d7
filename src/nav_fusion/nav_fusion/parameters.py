"""Every parameter of the filter, with unit, range and default; the node and commands share them."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from imu_noise_id.errors import InputError

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

IDENTITY: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Parameters:
    """Parameters of :class:`nav_fusion.engine.Engine`.

    Attributes
    ----------
    publish_rate_hz : float
        Rows of output a second; at most the IMU's rate.
    lever_arm_m : (3,)
        Antenna from the IMU, in body axes.
    gnss_delay_s : float
        How much later than true a fix is stamped.
    mounting_rpy_rad : (3,)
        Roll, pitch, yaw that turn IMU axes into body axes.
    declination_rad : float
        Magnetic north east of true north.
    hard_iron_t : (3,)
        Subtracted from the magnetometer, T, sensor axes.
    soft_iron : (3, 3)
        Multiplies what is left.
    gate_confidence : float
        A measurement is left out when it is less likely than 1 - this under the filter's own S.
    recovery_fixes, recovery_s : int, float
        So many fixes gated without a break, over so long: start anew from the fix.
    lateness_s : float
        How late a measurement may come and still be put in its place.
    alignment_s : float
        Length of IMU data from which the platform is levelled.
    initial_heading_rad, initial_heading_sigma_rad : float
        Heading at the start where it is known; NaN: from the magnetometer, else found from the
        fixes once moving.
    heading_hypotheses : int
        How many start headings are followed until the fixes tell them apart.
    initial_speed_sigma_m_s : float
        Standard deviation of the velocity at the start, each axis.
    origin : (3,) or None
        Latitude deg, longitude deg, altitude m of the ENU frame; None: the first fix used.
    gyro_turn_on_rad_s, accel_turn_on_m_s2 : float
        Standard deviation of the constant bias of a day.
    zero_velocity_updates : bool
        Use standing still.
    still_accel_m_s2, still_gyro_rad_s : float
        Standard deviation below which a quarter of a second counts as quiet, beyond white noise.
    gap_accel_m_s2, gap_rate_rad_s, gap_correlation_s : float
        Unknown motion while the IMU is silent.
    longest_gap_s : float
        A longer silence, or a jump of the clock, starts the alignment anew.
    use_velocity, use_magnetometer : bool
    """

    publish_rate_hz: float = 50.0
    lever_arm_m: Vector = (0.0, 0.0, 0.0)
    gnss_delay_s: float = 0.0
    mounting_rpy_rad: Vector = (0.0, 0.0, 0.0)
    declination_rad: float = 0.0
    hard_iron_t: Vector = (0.0, 0.0, 0.0)
    soft_iron: Matrix = IDENTITY
    gate_confidence: float = 0.9999
    recovery_fixes: int = 20
    recovery_s: float = 5.0
    lateness_s: float = 0.5
    alignment_s: float = 1.0
    initial_heading_rad: float = math.nan
    initial_heading_sigma_rad: float = 0.1
    heading_hypotheses: int = 32
    initial_speed_sigma_m_s: float = 100.0
    origin: Vector | None = None
    gyro_turn_on_rad_s: float = 0.01
    accel_turn_on_m_s2: float = 0.2
    zero_velocity_updates: bool = True
    still_accel_m_s2: float = 0.03
    still_gyro_rad_s: float = 0.003
    gap_accel_m_s2: float = 2.0
    gap_rate_rad_s: float = 0.3
    gap_correlation_s: float = 1.0
    longest_gap_s: float = 60.0
    use_velocity: bool = True
    use_magnetometer: bool = True

    def __post_init__(self) -> None:
        """Check ranges.

        Raises
        ------
        InputError
            Naming the parameter and what it may be.
        """
        for name, (low, high, unit) in RANGES.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(f"parameter {name}: {value} is not in [{low:g}, {high:g}] {unit}")
        known = {f.name for f in fields(self)}
        assert known.issuperset(RANGES)


RANGES: dict[str, tuple[float, float, str]] = {
    "publish_rate_hz": (0.01, 4000.0, "Hz"),
    "gnss_delay_s": (-1.0, 2.0, "s"),
    "declination_rad": (-math.pi, math.pi, "rad"),
    "gate_confidence": (0.5, 1.0 - 1e-12, ""),
    "recovery_fixes": (1, 10_000, "fixes"),
    "recovery_s": (0.0, 3600.0, "s"),
    "lateness_s": (0.0, 2.0, "s"),
    "alignment_s": (0.1, 30.0, "s"),
    "initial_heading_sigma_rad": (1e-6, math.pi, "rad"),
    "heading_hypotheses": (4, 72, ""),
    "initial_speed_sigma_m_s": (1e-3, 1e4, "m/s"),
    "gyro_turn_on_rad_s": (0.0, 1.0, "rad/s"),
    "accel_turn_on_m_s2": (0.0, 10.0, "m/s^2"),
    "still_accel_m_s2": (0.0, 10.0, "m/s^2"),
    "still_gyro_rad_s": (0.0, 1.0, "rad/s"),
    "gap_accel_m_s2": (0.0, 100.0, "m/s^2"),
    "gap_rate_rad_s": (0.0, 10.0, "rad/s"),
    "gap_correlation_s": (0.01, 100.0, "s"),
    "longest_gap_s": (1.0, 3600.0, "s"),
}
"""Lowest and highest value and unit of each bounded parameter."""

DEFAULTS = Parameters()
"""Every parameter as it is when nothing is said."""
