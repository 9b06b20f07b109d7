"""nav_fusion.rivals: a delay or an antenna that was forgotten is named, and nothing else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nav_fusion.engine import Engine
from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.parameters import Parameters
from nav_fusion.rivals import likelier

from helpers.drive import Drive, drive, play

GYRO = AxisNoise(1e-4, (SlowTerm(1e-3, float("inf"), 0.0, "turn_on_bias"),))
ACCEL = AxisNoise(2e-3, (SlowTerm(0.05, float("inf"), 0.0, "turn_on_bias"),))
NOISE = NavigationNoise(
    (GYRO,) * 3, (ACCEL,) * 3, (AidNoise(0.3),) * 3, (AidNoise(0.1),) * 3, AidNoise(0.02)
)
HEADED = Parameters(initial_heading_rad=0.0, use_magnetometer=False, use_velocity=False)
TRUE = drive(seconds=60.0, seed=4)


def said(d: Drive, settings: Parameters = HEADED) -> str | None:
    def fused(p: Parameters) -> Engine:
        engine = Engine(NOISE, p)
        play(engine, d)
        return engine

    return likelier(fused, settings)


@pytest.mark.parametrize("seed", range(3))
def test_true_settings_have_no_rival(seed: int) -> None:
    assert said(drive(seconds=60.0, seed=10 + seed)) is None


def test_a_forgotten_delay_is_named() -> None:
    late = replace(TRUE, fix_ns=TRUE.fix_ns + 200_000_000)
    assert "gnss_delay_s 0.2 (" in (said(late) or "")
    assert said(late, replace(HEADED, gnss_delay_s=0.2)) is None


def test_a_forgotten_antenna_is_named() -> None:
    """The platform turns on the spot at 0.5 rad/s, its antenna 1 m to the left of the IMU."""
    turn = np.full(TRUE.stamp_ns.size, 0.5)
    turn[TRUE.stamp_ns < TRUE.stamp_ns[0] + 3_000_000_000] = 0.0
    angle = np.cumsum(turn) / 100
    rate = np.random.default_rng(3).normal(0, 1e-3, TRUE.rate.shape)
    rate[:, 2] += turn
    rest = drive(seconds=60.0, rest_s=100.0, seed=5)
    k = np.searchsorted(rest.stamp_ns, rest.fix_ns)
    north, east = np.cos(angle[k]), -np.sin(angle[k])
    around = np.stack([north / 111_178.0, east / 76_060.0, 0 * north], axis=1)
    d = replace(rest, rate=rate, fix=rest.fix + around)
    assert "1 m further to the left" in (said(d) or "")
    assert said(d, replace(HEADED, lever_arm_m=(0.0, 1.0, 0.0))) is None
