"""A course that takes its time is no step, nor several; a step with an edge is one."""

import numpy as np
import pytest
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import ChannelReconciliation, reconcile_recording
from imu_noise_id.recording import Channel, Recording

COUNT, RATE_HZ = 60_000, 100.0
NAME, DENSITY = "angular_velocity.y", 1e-4
TIME_S = np.arange(COUNT) / RATE_HZ


def answered(course: np.ndarray, seed: int) -> ChannelReconciliation:
    """A course on white noise against the model of that noise."""
    noise = DENSITY * np.sqrt(RATE_HZ) * np.random.default_rng(seed).standard_normal(COUNT)
    stamp_ns = np.arange(COUNT) * round(1e9 / RATE_HZ)
    still = np.ones(COUNT, dtype=bool)
    channel = Channel("/imu/data", NAME, "rad/s", stamp_ns, noise + course, still, RATE_HZ)
    white = typed_effect("white_noise", NAME, {"density": DENSITY})
    model = NoiseModel((ChannelModel(NAME, "", "rad/s", None, 0.0, (white,)),))
    return reconcile_recording(Recording("gyro", 0, (channel,), None), model).channels[0]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    "course",
    [
        np.exp(-TIME_S / 45.0),
        np.exp(-TIME_S / 120.0),
        1.0 - np.exp(-np.maximum(TIME_S - 200.0, 0.0) / 60.0),
        np.clip((TIME_S - 150.0) / 200.0, 0.0, 1.0),
    ],
    ids=["warming", "slow warming", "relaxation", "ramp that ends"],
)
def test_a_smooth_course_is_neither_steps_nor_a_telegraph(course: np.ndarray, seed: int) -> None:
    found = answered(6e-4 * course, seed)
    names = {step.effect.name for step in found.steps}
    assert not names & {"bias_step", "random_telegraph"}
    unnamed = found.verdict == "unexplained"
    assert unnamed or any("between" in step.effect.note for step in found.steps)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    "course",
    [
        0.5 * np.tanh((TIME_S - 250.0) / 0.15),
        0.5 * np.tanh((TIME_S - 420.0) / 3.0),
        np.clip((TIME_S - 331.0) / 8.0, 0.0, 1.0),
        1.0 * (TIME_S > 207.0),
    ],
    ids=["quick edge", "edge of seconds", "sloping edge", "no edge"],
)
def test_a_step_with_an_edge_is_a_step(course: np.ndarray, seed: int) -> None:
    found = answered(2.5e-4 * course, seed)
    (step,) = found.steps
    assert step.effect.name == "bias_step"
    assert found.verdict == "explained"


def test_the_interval_of_a_steps_time_ends_where_the_record_does() -> None:
    found = answered(-1.2e-4 * (TIME_S > 20.0), 3)
    (step,) = found.steps
    time_s = step.effect.estimates[0]
    assert time_s.lower is not None
    assert 0.0 <= time_s.lower < time_s.value
