"""A filter of a plain noise model whose start heading is given, for tests."""

from __future__ import annotations

from nav_fusion.engine import Engine, Rows
from nav_fusion.noise import AidNoise, AxisNoise, NavigationNoise
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.parameters import Parameters

from helpers.drive import Drive, play

HEADED = Parameters(initial_heading_rad=0.0, use_magnetometer=False, use_velocity=False)
GYRO = AxisNoise(1e-4, (SlowTerm(0.005, float("inf"), 1e-6, "rate_random_walk"),))
ACCEL = AxisNoise(2e-3, (SlowTerm(0.05, float("inf"), 1e-5, "rate_random_walk"),))
NOISE = NavigationNoise(
    (GYRO,) * 3, (ACCEL,) * 3, (AidNoise(0.3),) * 3, (AidNoise(0.1),) * 3, AidNoise(0.05)
)


def fused(d: Drive, parameters: Parameters = HEADED, **how: object) -> tuple[Engine, Rows]:
    """Play a drive; return the engine and its rows."""
    engine = Engine(NOISE, parameters)
    rows = play(engine, d, **how)  # type: ignore[arg-type]
    return engine, rows
