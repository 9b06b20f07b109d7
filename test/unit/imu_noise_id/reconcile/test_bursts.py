"""A burst is louder noise: a tone or a ring that is there for a while does not get its name."""

import numpy as np
from imu_noise_id.model import ChannelModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile.explain import candidates, loudest_log_p
from imu_noise_id.reconcile.state import analyse
from imu_noise_id.reconcile.work import initial_state

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


def test_the_chance_of_the_loudest_ordinate_is_what_white_noise_shows():
    rng = np.random.default_rng(4)
    seen = np.array([loudest_log_p(rng.standard_normal(200)) for _ in range(2000)])
    # an upper bound, Bonferroni's, close where it is small; standard error 0.005
    assert 0.03 < np.mean(seen < np.log(0.05)) < 0.065
