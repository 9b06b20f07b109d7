"""Which states the filter has, and where each lies in the flat array that a hypothesis is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from imu_noise_id.errors import InputError
from numpy.typing import NDArray

from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise
from nav_fusion.noise_terms import PairTerm, SlowTerm

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NAV = 9
"""Error states of navigation: r, v, psi."""

STRIDE = 48
"""Distance between rows of a covariance; the most error states that a filter can have."""

# What a slow state acts on.
GYRO, ACCEL, POSITION, VELOCITY, HEADING, UNSEEN = 0, 3, 6, 9, 12, 99
IMU_TARGETS = 6

# Layout of one hypothesis: navigation, bookkeeping, slow states, covariance.
R, V, Q = 0, 3, 6
ALIVE, LOG_WEIGHT = 10, 11
ASLEEP = -1.0
"""``ALIVE`` of a hypothesis that is not followed at rest (:mod:`nav_fusion.circle`); dead is 0."""
BIAS = 76
ELAPSED, FORCE_SUM, TURN_SUM, GAP_VARIANCE = 82, 83, 86, 95
SPANS, DRIFTS, USED_BEFORE = 97, 113, 119
TILT_AT = 120
SLOW = 124
"""Bookkeeping of ``nav_fusion.observe`` lies between ``LOG_WEIGHT`` and ``BIAS``;
then the summed biases, what gathers until the covariance is brought up to date, the sums of
innovations over blocks, how many fixes had been used when the filter was last started anew, and
the attitude (quaternion) by which P's tilt stands (:mod:`nav_fusion.repose`)."""


class SlowModel(NamedTuple):
    """Slow states as arrays, in the order gyro, accelerometer, position, velocity, heading.

    ``target`` (m,) what each acts on; ``rate`` (m,) 1/T; ``psd`` (m,) of its driving noise;
    ``variance`` (m,) at the start; ``spin`` (m,) rad/s, other than 0 where a state and the next
    are a pair (:class:`nav_fusion.noise_terms.PairTerm`).
    """

    target: Ints
    rate: Floats
    psd: Floats
    variance: Floats
    spin: Floats


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
    rows = [
        row
        for base, axes in groups
        for axis, one in enumerate(axes)
        for term in one.terms
        for row in rows_of(base + axis, term)
    ]
    if NAV + len(rows) > STRIDE:
        raise InputError(
            f"{noise.source or 'model'}: {len(rows)} slow terms, more than the {STRIDE - NAV} that "
            "the filter takes; leave out the weakest"
        )
    numbers = np.array([row[1:5] for row in rows], dtype=float).reshape(-1, 4).T.copy()
    slow = SlowModel(np.array([row[0] for row in rows], dtype=np.int64), *numbers)
    return Layout(
        slow,
        tuple(row[5] for row in rows),
        np.array([a.white_density**2 for a in noise.gyro]),
        np.array([a.white_density**2 for a in noise.accel]),
    )


def rows_of(
    target: int, term: SlowTerm | PairTerm
) -> tuple[tuple[int, float, float, float, float, str], ...]:
    """Target, rate, spectrum, variance, spin and name of each state of a term."""
    if isinstance(term, PairTerm):
        variance, (first, second) = term.sigma**2, term.rates
        return (
            (target, first, 2 * first * variance, variance, term.spin_rad_s, term.name),
            (UNSEEN, second, 2 * second * variance, variance, 0.0, term.name),
        )
    rate = 0.0 if math.isinf(term.correlation_time_s) else 1.0 / term.correlation_time_s
    return ((target, rate, term.density**2, term.initial_sigma**2, 0.0, term.name),)
