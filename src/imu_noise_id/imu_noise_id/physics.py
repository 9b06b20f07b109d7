"""How inertial sensors sense: mass and spring, vibrating beam, Sagnac, gravity, Euler angles.

The formulae are those of chapter 2 of Alkan (2021), eqs. (1) to (32), with its misprints put right
where a docstring says so.  Body axes are forward, right, down in ``specific_force`` and for the
Euler angles (roll phi, pitch theta, yaw psi, in the order 3-2-1), as there; all else is SI.
"""

from __future__ import annotations

import numpy as np

from imu_noise_id.recording import Floats
from imu_noise_id.transfer_function import ContinuousTransfer

SPEED_OF_LIGHT = 299_792_458.0
STANDARD_GRAVITY = 9.80665


def mass_spring(mass_kg: float, damping: float, stiffness: float) -> ContinuousTransfer:
    """Displacement of a sprung mass per acceleration of its case.

    X/A = 1/(s^2 + 2 zeta w s + w^2), w = sqrt(k/m), zeta = b/(2 sqrt(m k)): the sensor's bandwidth,
    the ``bandwidth_limit`` of order 2 when divided by its gain 1/w^2 at rest.

    Parameters
    ----------
    mass_kg : float
    damping : float
        Force per velocity, N s/m.
    stiffness : float
        Force per displacement, N/m.
    """
    _positive(mass_kg=mass_kg, stiffness=stiffness)
    return ContinuousTransfer(
        np.array([1.0]), np.array([1.0, damping / mass_kg, stiffness / mass_kg])
    )


def natural_frequency_hz(mass_kg: float, stiffness: float) -> float:
    """Undamped resonance sqrt(k/m)/(2 pi)."""
    _positive(mass_kg=mass_kg, stiffness=stiffness)
    return float(np.sqrt(stiffness / mass_kg) / (2.0 * np.pi))


def damping_ratio(mass_kg: float, damping: float, stiffness: float) -> float:
    """Ratio zeta = b/(2 sqrt(m k))."""
    _positive(mass_kg=mass_kg, stiffness=stiffness)
    return float(damping / (2.0 * np.sqrt(mass_kg * stiffness)))


def beam_frequency_hz(
    acceleration: Floats | float, mass_kg: float, stiffness: float, sensitivity: float
) -> Floats:
    """Frequency of a vibrating beam loaded along its axis, f = f0 sqrt(1 + alpha M a/K).

    Parameters
    ----------
    acceleration : array_like
        m/s^2.
    mass_kg, stiffness : float
        f0 = sqrt(K/M)/(2 pi).
    sensitivity : float
        alpha, 1/m.

    Raises
    ------
    ValueError
        When the load exceeds what buckles the beam.
    """
    load = 1.0 + sensitivity * mass_kg * np.asarray(acceleration) / stiffness
    if np.any(load < 0.0):
        raise ValueError("the acceleration buckles the beam")
    return np.asarray(natural_frequency_hz(mass_kg, stiffness) * np.sqrt(load))


def beam_acceleration(
    frequency_hz: Floats | float, mass_kg: float, stiffness: float, sensitivity: float
) -> Floats:
    """Acceleration from a beam's frequency, a = (K/(alpha M)) (f^2/f0^2 - 1).

    (19) is misprinted.
    """
    ratio = np.asarray(frequency_hz) / natural_frequency_hz(mass_kg, stiffness)
    return np.asarray(stiffness / (sensitivity * mass_kg) * (ratio**2 - 1.0))


def sagnac_delay_s(rate: Floats | float, radius_m: float) -> Floats:
    """Time between waves sent both ways round a circle, 4 pi R^2 Omega/c^2 (rate in rad/s)."""
    return np.asarray(4.0 * np.pi * radius_m**2 * np.asarray(rate) / SPEED_OF_LIGHT**2)


def sagnac_path_m(rate: Floats | float, area_m2: float) -> Floats:
    """Difference of the two paths round an area, dL = 4 A Omega/c (rate rad/s)."""
    return np.asarray(4.0 * area_m2 * np.asarray(rate) / SPEED_OF_LIGHT)


def gravity_projection(roll: float, pitch: float, gravity: float = STANDARD_GRAVITY) -> Floats:
    """Part of an accelerometer's output that opposes gravity, [g sin th, -g cos th sin Phi, ...].

    Returns
    -------
    (3,) float64
        [g sin th, -g cos th sin Phi, -g cos th cos Phi] in forward, right, down: minus the gravity
        vector, so that a level sensor at rest shows -g on the axis that points down.
    """
    return gravity * np.array(
        [np.sin(pitch), -np.cos(pitch) * np.sin(roll), -np.cos(pitch) * np.cos(roll)]
    )


def specific_force(
    velocity_rate: Floats, rate: Floats, velocity: Floats, roll: float, pitch: float
) -> Floats:
    """Output of an accelerometer triad, V' + Omega x V plus the projection of gravity.

    The third row is W' + P V - Q U + ..., misprinted in (9) and (12).

    Parameters
    ----------
    velocity_rate, rate, velocity : (3,) float64
        [U', V', W'] m/s^2, [P, Q, R] rad/s, [U, V, W] m/s in body axes.
    roll, pitch : float
        rad.
    """
    return np.asarray(
        velocity_rate + np.cross(rate, velocity) + gravity_projection(roll, pitch), dtype=np.float64
    )


def attitude(roll: float, pitch: float, yaw: float) -> Floats:
    """Rotation from the level frame to the body, R1(roll) R2(pitch) R3(yaw), shape (3, 3).

    The standard matrix; (11) is misprinted, its result is right.
    """
    cr, sr, cp, sp = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch)
    cy, sy = np.cos(yaw), np.sin(yaw)
    return np.array(
        [
            [cp * cy, cp * sy, -sp],
            [sr * sp * cy - cr * sy, sr * sp * sy + cr * cy, sr * cp],
            [cr * sp * cy + sr * sy, cr * sp * sy - sr * cy, cr * cp],
        ]
    )


def euler_rates(roll: float, pitch: float, rate: Floats) -> Floats:
    """Rates of roll, pitch and yaw from the body's [P, Q, R], rad/s, shape (3,).

    Phi' = P + (Q sin Phi + R cos Phi) tan th; th' = Q cos Phi - R sin Phi;
    psi' = (Q sin Phi + R cos Phi)/cos th.

    Raises
    ------
    ValueError
        At a pitch of +-90 degrees, where roll and yaw are one.
    """
    if abs(np.cos(pitch)) < 1e-12:
        raise ValueError("Euler angles are singular at a pitch of +-90 degrees")
    p, q, r = rate
    about_down = q * np.sin(roll) + r * np.cos(roll)
    return np.array(
        [
            p + about_down * np.tan(pitch),
            q * np.cos(roll) - r * np.sin(roll),
            about_down / np.cos(pitch),
        ]
    )


def _positive(**values: float) -> None:
    for name, value in values.items():
        if not value > 0.0:
            raise ValueError(f"{name} must be positive, not {value}")
