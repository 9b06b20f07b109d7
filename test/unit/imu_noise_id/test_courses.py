"""Ramps, temperature and steps are told from the noise that they lie in."""

import numpy as np
import pytest
from imu_noise_id.courses import _ramp, explain
from imu_noise_id.ordinates import cosine_coefficients, ordinates
from imu_noise_id.selection import select
from numpy.testing import assert_allclose

from helpers.noise_records import DT, markov, walk, white

N = 40000
TIME_S = DT * np.arange(N)


def explained(values, temperature=None):
    coefficients = cosine_coefficients(values)
    return explain(coefficients, select(ordinates(coefficients, DT)), 0.0, temperature)


def course_names(found):
    return [c.effect.name for c in found.courses]


def test_noise_alone_has_no_course():
    rng = np.random.default_rng(41)
    wrong = 0
    for _ in range(10):
        for slow in (walk(N, rng, 0.3), markov(N, rng, 2.0, 5.0)):
            wrong += course_names(explained(white(N, rng) + slow)) != []
    assert wrong <= 1


def test_ramp_is_found_within_its_interval():
    named = 0
    for seed in range(42, 52):
        found = explained(white(N, np.random.default_rng(seed)) + 0.01 * TIME_S)
        for course in found.courses:
            assert course.effect.name == "rate_ramp"
            assert abs(course.amount - 0.01) < 3.5 * course.std_error
            assert [e.name for e in found.fit.effects] == ["white_noise"]
        named += len(found.courses)
    assert named >= 9


def test_a_ramp_that_a_walk_fits_as_well_is_said_to_be_its_rival():
    found = explained(white(N, np.random.default_rng(42)) + 0.01 * TIME_S)
    assert (found.courses, found.rivals) == ((), ("rate_ramp",))


def test_a_strong_ramp_has_no_rival_and_a_weak_one_has():
    def notes(slope):
        records = (white(N, np.random.default_rng(s)) + slope * TIME_S for s in range(42, 50))
        return [c.note for y in records for c in explained(y).courses]

    assert set(notes(0.1)) == {""}
    assert any("between rate_ramp and" in note for note in notes(0.004))


def test_step_is_found_in_slow_noise():
    rng = np.random.default_rng(43)
    found = explained(white(N, rng) + walk(N, rng, 0.05) + 6.0 * (TIME_S >= 123.0))
    assert course_names(found) == ["bias_step"]
    assert abs(found.courses[0].effect.time_s - 123.0) < 1.0
    assert abs(found.courses[0].amount - 6.0) < 4.0 * found.courses[0].std_error


def test_temperature_is_told_from_a_walk():
    rng = np.random.default_rng(44)
    temperature = 20.0 + 5.0 * np.sin(TIME_S / 40.0)
    found = explained(white(N, rng) + walk(N, rng, 0.05) + 0.8 * temperature, temperature)
    assert course_names(found) == ["temperature"]
    assert abs(found.courses[0].amount - 0.8) < 4.0 * found.courses[0].std_error


@pytest.mark.parametrize("n", [2, 7, 1000])
def test_the_transform_of_a_ramp_is_known(n: int) -> None:
    ramp = cosine_coefficients(DT * np.arange(n))
    assert_allclose(_ramp(n, DT)[1:], ramp[1:], atol=1e-12 * np.abs(ramp).max())
