"""Steps coarser than the noise: the model agrees at any level, and what it lacks is still named."""

import numpy as np
import pytest
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import ChannelReconciliation, reconcile_recording
from imu_noise_id.reconcile.unrounded import draw, first_draw, too_few_values
from imu_noise_id.recording import Channel, Recording

NAME = "angular_velocity.x"
RATE_HZ, COUNT = 200.0, 60_000
SIGMA, SLOW, SLOW_S = 0.003, 0.0005, 40.0
LINE_HZ = 37.3


def before_rounding(seed: int) -> np.ndarray:
    """White noise beside an exponentially correlated course, run as a recursion."""
    rng = np.random.default_rng(seed)
    a = np.exp(-1.0 / RATE_HZ / SLOW_S)
    x, slow = SLOW * rng.standard_normal(), []
    for w in (rng.standard_normal(COUNT) * SLOW * np.sqrt(1.0 - a * a)).tolist():
        x = a * x + w
        slow.append(x)
    return np.array(slow) + SIGMA * rng.standard_normal(COUNT)


def channel_of(values: np.ndarray) -> Channel:
    stamps = np.rint(np.arange(values.size) / RATE_HZ * 1e9).astype(np.int64)
    still = np.ones(values.size, dtype=bool)
    return Channel("/imu/data", NAME, "rad/s", stamps, values, still, RATE_HZ)


def typed_model(step: float) -> ChannelModel:
    effects = (
        typed_effect("white_noise", NAME, {"density": SIGMA / np.sqrt(RATE_HZ)}),
        typed_effect("gauss_markov", NAME, {"sigma": SLOW, "correlation_time_s": SLOW_S}),
        typed_effect("output_rounding", NAME, {"step": step}),
    )
    return ChannelModel(NAME, "/imu/data", "rad/s", RATE_HZ, 0.0, effects)


def rounded(values: np.ndarray, coarse: float, place: float) -> Recording:
    """Values put ``place`` steps from one, rounded in steps of ``coarse`` deviations."""
    step = coarse * SIGMA
    return Recording("made", 0, (channel_of(step * np.rint(values / step + place)),))


def reconciled(values: np.ndarray, coarse: float, place: float) -> ChannelReconciliation:
    model = NoiseModel((typed_model(coarse * SIGMA),))
    (found,) = reconcile_recording(rounded(values, coarse, place), model, 0, 1).channels
    return found


@pytest.mark.parametrize("place", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("coarse", [1.5, 2.0, 3.0, 4.0])
def test_a_coarse_sensor_agrees_with_its_model_wherever_its_level_lies(coarse, place):
    found = reconciled(before_rounding(3), coarse, place)
    assert (found.verdict, found.steps) == ("agrees", ())
    assert f"{coarse:.1f} standard deviations" in found.notes[0]


@pytest.mark.parametrize("coarse", [2.0, 3.0])
def test_a_line_beneath_the_steps_is_named_with_its_amplitude(coarse):
    t = np.arange(COUNT) / RATE_HZ
    amplitude = 0.15 * SIGMA
    line = amplitude * np.sin(2.0 * np.pi * LINE_HZ * t + 1.0)
    found = reconciled(before_rounding(4) + line, coarse, 0.3)
    (step,) = found.steps
    assert found.verdict == "explained"
    assert step.effect.effect.frequency_hz == pytest.approx(LINE_HZ, abs=1e-3)
    assert step.effect.effect.amplitude == pytest.approx(amplitude, rel=0.12)


def test_a_change_of_the_level_by_less_than_a_step_is_named():
    height = SIGMA
    change = height * (np.arange(COUNT) > 0.6 * COUNT)
    found = reconciled(before_rounding(5) + change, 3.0, 0.1)
    (step,) = found.steps
    assert step.effect.name == "bias_step"
    assert step.effect.effect.time_s == pytest.approx(180.0, abs=1.0)
    assert step.effect.effect.height == pytest.approx(height, rel=0.35)


@pytest.mark.parametrize("coarse", [2.0, 3.0])
def test_louder_noise_is_known_through_the_steps(coarse):
    more = np.sqrt(1.1**2 - 1.0) * SIGMA * np.random.default_rng(6).standard_normal(COUNT)
    found = reconciled(before_rounding(6) + more, coarse, 0.4)
    (step,) = found.steps
    assert step.action == "refit"
    density = step.effect.effect.density
    assert density * np.sqrt(RATE_HZ) == pytest.approx(1.1 * SIGMA, rel=0.02)


def test_a_burst_is_as_loud_as_it_was_and_the_mended_model_has_it():
    within = (np.arange(COUNT) >= 20_000) & (np.arange(COUNT) < 36_000)
    more = SIGMA * within * np.random.default_rng(11).standard_normal(COUNT)
    recording = rounded(before_rounding(12) + more, 2.5, 0.3)
    result = reconcile_recording(recording, NoiseModel((typed_model(2.5 * SIGMA),)), 0, 1)
    (step,) = result.channels[0].steps
    assert step.effect.name == "variance_change"
    assert step.effect.effect.ratio == pytest.approx(2.0, rel=0.1)
    (again,) = reconcile_recording(recording, result.model, 0, 1).channels
    assert (again.verdict, again.steps) == ("agrees", ())


def test_a_lost_sample_is_drawn_from_the_model_and_the_others_from_their_steps():
    rng = np.random.default_rng(7)
    x = rng.standard_normal(20_000)
    missing = rng.random(x.size) < 0.2
    values = np.where(missing, 40.0, 3.0 * np.rint(x / 3.0 + 0.2) - 0.6)
    inverse = np.ones(x.size)
    inverse[0] = 0.0
    steps = draw(first_draw(values, missing, 3.0, 1.0, (8,)), np.zeros(x.size), inverse, 1.0, 0)
    assert np.abs(steps.drawn - values)[~missing].max() <= 1.5 + 1e-9
    error = 1.0 / np.sqrt(2.0 * missing.sum())
    assert np.std(steps.drawn[missing]) == pytest.approx(1.0, abs=4.0 * error)
    assert np.std(steps.drawn) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("place", [0.35, 0.5])
def test_where_steps_hide_the_noise_it_is_said_and_no_more(place):
    found = reconciled(before_rounding(9), 9.0, place)
    assert (found.verdict, found.steps) == ("agrees", ())
    assert found.notes == ("too coarse to compare in the spectrum: 2 distinct values",)


def test_few_values_that_speak_of_louder_noise_are_compared():
    (channel,) = rounded(3.0 * before_rounding(10), 9.0, 0.3).channels
    assert np.unique(channel.values).size > 2
    assert too_few_values(channel, typed_model(9.0 * SIGMA)) == 0
    assert reconciled(3.0 * before_rounding(10), 9.0, 0.3).verdict != "agrees"
