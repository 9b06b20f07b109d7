"""A burst is louder noise: a tone or a ring that is there for a while does not get its name."""

import numpy as np
import pytest
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import reconcile_recording
from imu_noise_id.reconcile.explain import candidates, loudest_log_p
from imu_noise_id.reconcile.state import analyse
from imu_noise_id.reconcile.work import initial_state
from imu_noise_id.recording import Channel, Recording

NAME, DT, COUNT = "angular_velocity.x", 0.01, 20_000
BURST = slice(7_000, 14_000)


def named(values):
    white = typed_effect("white_noise", NAME, {"density": np.sqrt(DT)})
    model = ChannelModel(NAME, "/imu/data", "rad/s", 1.0 / DT, 0.0, (white,))
    analysis = analyse(initial_state(model, values, DT, 0.0, None, 1.0))
    return [c.effect.name for c in candidates(analysis.state, analysis)]


def test_a_tone_that_is_there_for_a_while_is_no_louder_noise():
    loud, tone = np.random.default_rng(3).standard_normal((2, COUNT))
    loud[BURST] *= np.sqrt(3.0)
    tone[BURST] += 2.0 * np.sin(0.7 * np.arange(BURST.stop - BURST.start))
    assert "variance_change" in named(loud)
    assert "variance_change" not in named(tone)


def steps_of(values):
    """Steps of a reconciliation of samples whose model is white noise of unit variance."""
    white = typed_effect("white_noise", NAME, {"density": np.sqrt(DT)})
    model = NoiseModel((ChannelModel(NAME, "/imu/data", "rad/s", 1.0 / DT, 0.0, (white,)),))
    stamps = np.arange(values.size, dtype=np.int64) * round(DT * 1e9)
    still = np.ones(values.size, dtype=bool)
    channel = Channel("/imu/data", NAME, "rad/s", stamps, values, still, 1.0 / DT)
    result = reconcile_recording(Recording("made", 0, (channel,)), model, 0, 1)
    return result.channel(NAME)


@pytest.mark.parametrize("share", [0.25, 0.5, 0.75])
def test_of_two_levels_the_one_that_the_model_has_is_no_burst(share):
    values = np.random.default_rng(5).standard_normal(COUNT)
    begin = round(share * COUNT)
    values[begin:] *= 1.25
    (step,) = steps_of(values).steps
    burst = step.effect.effect
    assert (step.action, burst.name) == ("add", "variance_change")
    assert abs(burst.from_s - begin * DT) < 1.0
    assert abs(burst.to_s - COUNT * DT) < 1e-6
    assert abs(burst.ratio / 1.25**2 - 1.0) < 0.06


def test_a_vibration_that_begins_half_way_and_drifts_is_no_louder_noise():
    t = np.arange(COUNT // 2) * DT
    for seed in range(3):
        values = np.random.default_rng(seed).standard_normal(COUNT)
        values[COUNT // 2 :] += 0.7 * np.sin(2.0 * np.pi * (20.0 * t + 0.01 * t**2))
        answer = steps_of(values)
        assert answer.verdict == "unexplained"
        assert "variance_change" not in [s.effect.name for s in answer.steps]


def test_the_chance_of_the_loudest_ordinate_is_what_white_noise_shows():
    rng = np.random.default_rng(4)
    seen = np.array([loudest_log_p(rng.standard_normal(200)) for _ in range(2000)])
    # an upper bound, Bonferroni's, close where it is small; standard error 0.005
    assert 0.03 < np.mean(seen < np.log(0.05)) < 0.065
