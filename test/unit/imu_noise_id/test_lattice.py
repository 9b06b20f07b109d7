"""A lattice of values is the output's or an angle's, and the spectrum of the errors says which."""

import numpy as np
import pytest
from imu_noise_id.identify import identify_recording
from imu_noise_id.lattice import of_an_angle
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import reconcile_recording
from imu_noise_id.recording import Channel, Recording

COUNT, RATE_HZ = 60_000, 200.0
NAME, DENSITY = "angular_velocity.y", 1.4e-4
SIGMA = DENSITY * np.sqrt(RATE_HZ)


def rates(sigma: float = SIGMA, seed: int = 0) -> np.ndarray:
    return sigma * np.random.default_rng(seed).standard_normal(COUNT) - 2e-3


def counted(rate: np.ndarray, angle_step: float) -> np.ndarray:
    """Rates by counting whole steps of the angle."""
    angle = np.cumsum(rate) / RATE_HZ
    return np.diff(np.round(angle / angle_step) * angle_step, prepend=0.0) * RATE_HZ


@pytest.mark.parametrize("steps_per_sigma", [1.0, 1.5, 2.0])
def test_an_angle_that_was_rounded_is_told_from_an_output_that_was(steps_per_sigma: float) -> None:
    step = steps_per_sigma * SIGMA
    assert of_an_angle(counted(rates(), step / RATE_HZ), step, 1.0 / RATE_HZ)
    assert not of_an_angle(step * np.rint(rates() / step), step, 1.0 / RATE_HZ)


@pytest.mark.parametrize("frequency_hz", [20.0, 90.0])
def test_a_line_does_not_make_it_an_angle(frequency_hz: float) -> None:
    line = 5.0 * SIGMA * np.sin(2.0 * np.pi * frequency_hz * np.arange(COUNT) / RATE_HZ)
    step = 1.0 * SIGMA
    assert not of_an_angle(step * np.rint((rates() + line) / step), step, 1.0 / RATE_HZ)


def test_an_output_of_fewer_high_frequencies_or_more_is_no_angle() -> None:
    white = rates()
    step = 0.5 * SIGMA
    for kernel in ([0.5, 0.5], [1.0, -0.5], [1.0, -0.9]):
        shaped = np.convolve(white, kernel)[:COUNT]
        assert not of_an_angle(step * np.rint(shaped / step), step, 1.0 / RATE_HZ)


def test_a_spectrum_that_rises_a_little_is_not_enough() -> None:
    few = 0.5 * SIGMA
    assert not of_an_angle(counted(rates(), few / RATE_HZ), few, 1.0 / RATE_HZ)


def one_channel(values: np.ndarray) -> Recording:
    stamp_ns = np.arange(COUNT) * round(1e9 / RATE_HZ)
    still = np.ones(COUNT, dtype=bool)
    return Recording(
        "gyro", 0, (Channel("/imu/data", NAME, "rad/s", stamp_ns, values, still, RATE_HZ),), None
    )


def its_model(*more: tuple[str, dict[str, float | str]]) -> NoiseModel:
    laws = (("white_noise", {"density": DENSITY}), *more)
    effects = tuple(typed_effect(law, NAME, dict(values)) for law, values in laws)
    return NoiseModel((ChannelModel(NAME, "", "rad/s", None, 0.0, effects),))


@pytest.mark.parametrize("seed", range(2))
def test_a_rounded_angle_is_quantization_alone_and_white_noise_stays(seed: int) -> None:
    (channel,) = reconcile_recording(
        one_channel(counted(rates(seed=seed), 2e-5)), its_model()
    ).channels
    assert channel.verdict == "explained"
    (step,) = channel.steps
    assert (step.action, step.effect.name) == ("add", "quantization")
    assert step.effect.effect.coefficient == pytest.approx(2e-5 / np.sqrt(12.0), rel=0.05)
    assert any("lattice" in note for note in channel.notes)


def test_a_model_that_has_the_angles_quantization_agrees() -> None:
    given = ("quantization", {"coefficient": 2e-5 / float(np.sqrt(12.0))})
    (channel,) = reconcile_recording(
        one_channel(counted(rates(seed=5), 2e-5)), its_model(given)
    ).channels
    assert channel.verdict == "agrees"


def test_a_rounded_output_is_output_rounding() -> None:
    values = 4e-3 * np.rint(rates(seed=3) / 4e-3)
    (channel,) = reconcile_recording(one_channel(values), its_model()).channels
    assert [s.effect.name for s in channel.steps] == ["output_rounding"]


def test_a_rounded_angle_is_identified_as_quantization_on_white_noise_of_its_density() -> None:
    (channel,) = identify_recording(one_channel(counted(rates(seed=1), 2e-5)), 1).model.channels
    assert sorted(e.name for e in channel.effects) == ["quantization", "white_noise"]
    found = {e.name: e.effect for e in channel.effects}
    assert found["white_noise"].density == pytest.approx(DENSITY, rel=0.03)
    assert found["quantization"].coefficient == pytest.approx(2e-5 / np.sqrt(12.0), rel=0.05)
