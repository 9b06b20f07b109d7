"""A resonance that noise drives rings steadily; shocks now and then do not."""

import numpy as np
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.model import ChannelModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile.bands import intermittence
from imu_noise_id.reconcile.state import analyse
from imu_noise_id.reconcile.work import initial_state

NAME, DT, COUNT = "angular_velocity.x", 0.01, 60_000
BAND = NarrowBand(12.0, 1.0, 0.5)


def log_p(vibration: np.ndarray) -> float:
    values = np.random.default_rng(7).standard_normal(COUNT) + vibration
    given = {
        "white_noise": {"density": np.sqrt(DT)},
        "narrow_band": {"frequency_hz": 12.0, "bandwidth_hz": 1.0, "sigma": 0.5},
    }
    fitted = tuple(typed_effect(effect, NAME, numbers) for effect, numbers in given.items())
    model = ChannelModel(NAME, "/imu/data", "rad/s", 1.0 / DT, 0.0, fitted)
    return intermittence(analyse(initial_state(model, values, DT, 0.0, None, 1.0)), BAND)


def test_noise_through_a_resonance_is_steady() -> None:
    drawn = [BAND.simulate(COUNT, DT, np.random.default_rng(seed)) for seed in range(5)]
    assert min(log_p(vibration) for vibration in drawn) > np.log(1e-3)


def test_rings_after_shocks_are_not() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(300) * DT
    ring = np.exp(-np.pi * BAND.bandwidth_hz * t) * np.sin(2.0 * np.pi * BAND.frequency_hz * t)
    shocks = np.zeros(COUNT)
    shocks[rng.choice(COUNT, 100, replace=False)] = rng.choice([-1.0, 1.0], 100)
    rings = np.convolve(shocks, ring)[:COUNT]
    assert log_p(BAND.sigma / rings.std() * rings) < np.log(1e-6)
