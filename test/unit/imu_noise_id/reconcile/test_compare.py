"""The significance of a course counts what is known of the noise that it stands in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_noise_id.effects.rate_ramp import RateRamp
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.reconcile.compare import freedom, gain_log_p
from imu_noise_id.reconcile.prior import Prior
from imu_noise_id.reconcile.state import Column, State, analyse
from scipy import stats

N, DT = 64, 0.5


@pytest.mark.parametrize("samples", [4, 7, 30])
def test_a_gain_in_noise_of_unknown_level_has_students_law(samples: int) -> None:
    rng = np.random.default_rng(samples)
    x, y = rng.standard_normal((2, samples))
    line = stats.linregress(x, y)
    left = y - line.intercept - line.slope * x
    # twice the gain of the likelihood, without the one degree that the mean takes
    twice = (samples - 1) * np.log(np.sum((y - y.mean()) ** 2) / np.sum(left**2))
    assert np.exp(gain_log_p(samples - 2, twice)) == pytest.approx(line.pvalue, rel=1e-9)


def test_a_gain_in_known_noise_has_the_law_of_chi_square() -> None:
    for value in (1.0, 9.0, 25.0, 1000.0):
        known = stats.chi2.logsf(value, 1)
        assert gain_log_p(1e9, value) == pytest.approx(known, rel=1e-3 if value < 100 else 0.01)


def test_the_level_of_white_noise_is_known_by_as_many_degrees_as_there_are_ordinates() -> None:
    values = np.random.default_rng(5).standard_normal(N)
    state = State(values, DT, 0.0, None, (WhiteNoise(0.7),), Prior.none())
    ramp = Column(RateRamp(1.0), state.time_s - state.time_s.mean())
    assert freedom(state, analyse(state), ramp) == pytest.approx(N - 1, rel=1e-2)


def test_of_a_level_that_the_model_knows_nothing_is_left_to_learn() -> None:
    values = np.random.default_rng(5).standard_normal(N)
    effects = (WhiteNoise(np.sqrt(DT)),)
    known = Prior(np.log([np.sqrt(DT)]), np.eye(1), np.array([1e-4]))
    state = State(values, DT, 0.0, None, effects, known)
    ramp = Column(RateRamp(1.0), state.time_s - state.time_s.mean())
    assert freedom(state, analyse(state), ramp) > 1e6
    assert freedom(state, analyse(replace(state, prior=Prior.none())), ramp) < 100.0


def test_a_spectrum_with_nothing_free_is_known() -> None:
    values = np.random.default_rng(5).standard_normal(N)
    state = State(values, DT, 0.0, None, (), Prior.none(), floor=DT)
    ramp = Column(RateRamp(1.0), state.time_s - state.time_s.mean())
    known = freedom(state, analyse(state), ramp)
    assert known > 1e6
    assert gain_log_p(known, 9.0) == pytest.approx(stats.chi2.logsf(9.0, 1), rel=1e-3)
