"""The axes of a sensor together: states that they share are found once."""

import numpy as np
import pytest
from imu_noise_id.allan import allan
from imu_noise_id.cca import past_future
from imu_noise_id.joint_cca import joint
from imu_noise_id.series import Series
from imu_noise_id.shaping_allan import allan_deviation, allan_distance, axis_allan_deviation
from scipy.signal import lfilter


def series_of(values, observed=None, sample_time_s=1e-3):
    observed = np.ones(values.size, dtype=bool) if observed is None else observed
    return Series(np.where(observed, values, 0.0), observed, sample_time_s)


def test_three_axes_share_one_slow_state():
    rng = np.random.default_rng(12)
    size, pole = 60_000, 0.98
    slow = lfilter([1.0], [1.0, -pole], rng.standard_normal(size))
    shares = np.array([0.3, -0.2, 0.1])
    mixing = np.array([[1.0, 0, 0], [0.5, 1.0, 0], [0, 0.2, 2.0]])
    values = slow[:, None] * shares + rng.standard_normal((size, 3)) @ mixing.T
    found = joint(tuple(series_of(column, sample_time_s=0.01) for column in values.T))
    assert found.significant
    assert found.order == 1
    space = found.state_space
    assert space.A[0, 0] == pytest.approx(pole, abs=0.004)
    direction = space.C[:, 0] / np.linalg.norm(space.C[:, 0])
    np.testing.assert_allclose(abs(direction @ shares) / np.linalg.norm(shares), 1.0, atol=0.02)
    assert np.max(np.abs(np.linalg.eigvals(space.A - space.K @ space.C))) < 1.0


def gauss_markov(size, time_s, sigma, rng):
    """Rate 100 Hz, from the stationary state."""
    pole = np.exp(-0.01 / time_s)
    drive = rng.standard_normal(size + int(1000 * time_s)) * sigma * np.sqrt(1.0 - pole**2)
    return lfilter([1.0], [1.0, -pole], drive)[-size:]


def together(columns):
    return joint(tuple(series_of(column, sample_time_s=0.01) for column in columns))


def test_one_axis_at_a_time_tells_the_story_of_the_joint_model():
    """A shared Gauss-Markov state of 10 s: joint and single models put it in the same place."""
    rng = np.random.default_rng(21)
    slow = gauss_markov(60_000, 10.0, 0.1, rng)
    columns = [share * slow + rng.standard_normal(slow.size) for share in (1.0, -0.7, 0.5)]
    found = together(columns)
    assert found.order == 1
    time_s = -0.01 / np.log(found.state_space.A[0, 0])
    # relative standard error of a correlation time from 60 of them is about sqrt(2/60)
    assert abs(np.log(time_s / 10.0)) < 3.0 * np.sqrt(2.0 / 60.0)
    for axis, column in enumerate(columns):
        series = series_of(column, sample_time_s=0.01)
        measured, alone = allan(series), past_future(series)
        assert alone.order == 1
        dof = measured.degrees_of_freedom
        ours = axis_allan_deviation(found.state_space, axis, measured.averaging_factor)
        single = allan_deviation(alone.H_z, measured.averaging_factor)
        assert allan_distance(single, ours, dof) < 0.08
        assert allan_distance(measured.deviation, ours, dof) < 0.1


def test_a_long_record_is_modelled_by_its_block_means(monkeypatch):
    """At the rate of the samples again: the same pole, density and Allan curve."""
    rng = np.random.default_rng(25)
    slow = gauss_markov(60_000, 10.0, 0.1, rng)
    columns = [share * slow + rng.standard_normal(slow.size) for share in (1.0, -0.7, 0.5)]
    whole = together(columns)
    monkeypatch.setattr("imu_noise_id.joint_cca.WHOLE_ROWS", 20_000)
    found = together(columns)
    assert "means of 4 samples" in found.notes[0]
    assert found.order == whole.order == 1
    assert found.state_space.sample_time_s == 0.01
    assert found.state_space.A[0, 0] == pytest.approx(whole.state_space.A[0, 0], abs=2e-4)
    m = np.array([1, 10, 100, 1000, 10_000])
    for axis in range(3):
        both = [axis_allan_deviation(one.state_space, axis, m) for one in (found, whole)]
        np.testing.assert_allclose(*both, rtol=0.03)


def test_axes_with_a_slow_state_each_take_three():
    rng = np.random.default_rng(22)
    columns = [
        gauss_markov(60_000, time_s, 0.15, rng) + rng.standard_normal(60_000)
        for time_s in (1.0, 5.0, 20.0)
    ]
    found = together(columns)
    assert found.order == 3
    times_s = np.sort(-0.01 / np.log(np.abs(np.linalg.eigvals(found.state_space.A))))
    assert np.all(np.abs(np.log(times_s / [1.0, 5.0, 20.0])) < 0.7)


def test_a_vibration_and_a_slow_state_are_found_together():
    rng = np.random.default_rng(23)
    poles = 0.99 * np.exp([0.9j, -0.9j])
    band = lfilter([0.05], np.real(np.poly(poles)), rng.standard_normal(60_000))
    slow = gauss_markov(60_000, 10.0, 0.1, rng)
    found = together(
        [s * slow + b * band + rng.standard_normal(60_000) for s, b in ((1, 0.5), (-1, 0), (0, 1))]
    )
    assert found.order == 3
    eigenvalues = np.linalg.eigvals(found.state_space.A)
    assert np.max(np.abs(np.angle(eigenvalues))) == pytest.approx(0.9, abs=0.02)


def test_three_axes_of_white_noise_have_a_state_in_one_record_of_a_hundred():
    rng = np.random.default_rng(24)
    states = [together(rng.standard_normal((3, 3000))).order > 0 for _ in range(200)]
    assert np.mean(states) < 0.01 + 3.0 * np.sqrt(0.01 / 200)


def test_three_white_axes_share_nothing():
    rng = np.random.default_rng(13)
    values = rng.standard_normal((20_000, 3))
    values[:, 1] += 0.8 * values[:, 0]
    found = joint(tuple(series_of(column) for column in values.T))
    assert not found.significant
    assert found.order == 0
    expected = np.cov(values.T)
    np.testing.assert_allclose(found.state_space.innovation_covariance, expected, atol=0.05)


@pytest.mark.parametrize("values", [np.zeros(1000), np.full(1000, 9.81), np.arange(5.0)])
def test_what_cannot_be_had_is_refused_with_a_reason(values):
    with pytest.raises(ValueError, match=r"constant|too few"):
        joint((series_of(values), series_of(values)))
