"""Which states the filter has, and where each lies in the flat array that a hypothesis is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from imu_noise_id.errors import InputError
from numpy.typing import NDArray

from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise, SlowTerm

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NAV = 9
"""Error states of navigation: r, v, psi."""

STRIDE = 48
"""Distance between rows of a covariance; the most error states that a filter can have."""

# What a slow state acts on.
GYRO, ACCEL, POSITION, VELOCITY, HEADING = 0, 3, 6, 9, 12
IMU_TARGETS = 6

# Layout of one hypothesis: navigation, bookkeeping, slow states, covariance.
R, V, Q = 0, 3, 6
ALIVE, LOG_WEIGHT = 10, 11
BIAS = 76
ELAPSED, FORCE_SUM, TURN_SUM, GAP_VARIANCE = 82, 83, 86, 95
SLOW = 104
"""Bookkeeping of ``nav_fusion.observe`` lies between ``LOG_WEIGHT`` and ``BIAS``;
then the summed biases, and what gathers until the covariance is brought up to date."""


class SlowModel(NamedTuple):
    """Slow states as arrays, in the order gyro, accelerometer, position, velocity, heading.

    ``target`` (m,) what each acts on; ``rate`` (m,) 1/T; ``psd`` (m,) of its driving noise;
    ``variance`` (m,) at the start.
    """

    target: Ints
    rate: Floats
    psd: Floats
    variance: Floats


@dataclass(frozen=True)
class Layout:
    """Sizes that follow from a noise model.

    Attributes
    ----------
    slow : SlowModel
    names : tuple of str
        Effect behind each slow state.
    gyro_psd, accel_psd : (3,) float64
        White spectra of the inertial axes.
    """

    slow: SlowModel
    names: tuple[str, ...]
    gyro_psd: Floats
    accel_psd: Floats

    @property
    def states(self) -> int:
        """Number n of error states."""
        return NAV + self.slow.target.size

    @property
    def size(self) -> int:
        """Floats in one hypothesis."""
        return SLOW + self.slow.target.size + self.states * STRIDE


def layout_of(noise: NavigationNoise, velocity: bool = True, heading: bool = True) -> Layout:
    """Lay out the states of a noise model; aids that are not there get none."""
    groups: list[tuple[int, tuple[AxisNoise | AidNoise, ...]]] = [
        (GYRO, noise.gyro),
        (ACCEL, noise.accel),
        (POSITION, noise.position),
    ]
    if velocity:
        groups.append((VELOCITY, noise.velocity))
    if heading:
        groups.append((HEADING, (noise.heading,)))
    rows: list[tuple[int, SlowTerm]] = [
        (base + axis, term)
        for base, axes in groups
        for axis, one in enumerate(axes)
        for term in one.terms
    ]
    if NAV + len(rows) > STRIDE:
        raise InputError(
            f"{noise.source or 'model'}: {len(rows)} slow terms, more than the {STRIDE - NAV} that "
            "the filter takes; leave out the weakest"
        )
    slow = SlowModel(
        np.array([target for target, _ in rows], dtype=np.int64),
        np.array([_rate(term) for _, term in rows], dtype=float),
        np.array([term.density**2 for _, term in rows], dtype=float),
        np.array([term.initial_sigma**2 for _, term in rows], dtype=float),
    )
    return Layout(
        slow,
        tuple(term.name for _, term in rows),
        np.array([a.white_density**2 for a in noise.gyro]),
        np.array([a.white_density**2 for a in noise.accel]),
    )


def _rate(term: SlowTerm) -> float:
    return 0.0 if math.isinf(term.correlation_time_s) else 1.0 / term.correlation_time_s
