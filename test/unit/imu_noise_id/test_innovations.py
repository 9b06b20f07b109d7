"""The innovations likelihood is the Gaussian one, gaps included, and its maximum is found."""

import numpy as np
import pytest
from imu_noise_id.innovations import Innovations, evaluate, maximise, residuals, warm_up, white
from scipy.linalg import toeplitz
from scipy.signal import lfilter

MODELS = {
    "one slow state": ([1.0, -0.999], [1.0, -0.995]),
    "one fast state": ([1.0, -0.55], [1.0, -0.20]),
    "two states": ([1.0, -1.6, 0.7], [1.0, 0.3, -0.4]),
    "a resonance and a slow state": (
        np.polymul([1.0, -0.99], [1.0, 1.2, 0.81]),
        np.polymul([1.0, -0.9], [1.0, 0.9, 0.5]),
    ),
}


def start(phi, theta):
    return Innovations(np.array(phi), np.array(theta), 1.0, 0.0, 1)


def lossy(size, rng):
    observed = rng.random(size) > 0.1
    observed[size // 3 : size // 2] = False
    return observed


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("gaps", [False, True])
def test_deviance_equals_that_of_the_joint_gaussian_density(name, gaps):
    phi, theta = (np.asarray(side, dtype=float) for side in MODELS[name])
    size = 120
    rng = np.random.default_rng(1)
    values = lfilter(theta, phi, rng.standard_normal(size + 4000))[-size:]
    observed = lossy(size, rng) if gaps else np.ones(size, dtype=bool)
    impulse = lfilter(theta, phi, np.eye(1, 30_000)[0])
    covariance = toeplitz([impulse[: impulse.size - k] @ impulse[k:] for k in range(size)])
    covariance = covariance[np.ix_(observed, observed)]
    y = values[observed]
    variance = y @ np.linalg.solve(covariance, y) / y.size
    expected = y.size * np.log(variance) + np.linalg.slogdet(covariance)[1]
    found = evaluate(values, observed, phi, theta)
    assert found.variance == pytest.approx(variance, rel=1e-7)
    assert found.deviance == pytest.approx(expected, abs=1e-5)
    assert found.observed == y.size


@pytest.mark.parametrize("name", MODELS)
def test_no_neighbour_of_the_maximum_is_likelier(name):
    phi, theta = (np.asarray(side, dtype=float) for side in MODELS[name])
    rng = np.random.default_rng(2)
    values = lfilter(theta, phi, rng.standard_normal(6000))[1000:]
    observed = lossy(5000, rng)
    best = maximise(values, observed, start(phi, theta))
    assert best.deviance <= evaluate(values, observed, phi, theta).deviance
    for i in range(1, phi.size):
        for change in (-1e-3, 1e-3):
            moved = best.phi + change * np.eye(1, phi.size, i)[0] * (1 - abs(best.phi[1]) % 1)
            if np.all(np.abs(np.roots(moved)) < 1.0):
                assert evaluate(values, observed, moved, best.theta).deviance > best.deviance - 2e-3


def test_a_far_start_reaches_the_same_maximum():
    rng = np.random.default_rng(3)
    values = lfilter([1.0, -0.2], [1.0, -0.55], rng.standard_normal(5000))
    observed = np.ones(5000, dtype=bool)
    near = maximise(values, observed, start([1.0, -0.55], [1.0, -0.2]))
    far = maximise(values, observed, start([1.0, 0.3], [1.0, 0.4]))
    assert far.phi[1] == pytest.approx(near.phi[1], abs=2e-3)
    assert far.deviance == pytest.approx(near.deviance, abs=1e-2)


def test_a_climb_ends_where_its_goal_is_out_of_reach_and_only_there():
    rng = np.random.default_rng(5)
    observed = np.ones(5000, dtype=bool)
    nothing = rng.standard_normal(5000)
    weak = nothing + lfilter([0.05], [1.0, -0.97], rng.standard_normal(5000))
    for values, reached in ((nothing, False), (weak, True)):
        goal = white(values, observed).deviance - 11.5
        begin = evaluate(values, observed, np.array([1.0, -0.9]), np.array([1.0, -0.85]))
        whole = maximise(values, observed, begin)
        short = maximise(values, observed, begin, 15, goal)
        assert (whole.deviance < goal) == reached
        assert (short.deviance == whole.deviance) == reached
        assert short.deviance > goal or reached


def test_residuals_of_the_true_model_are_the_innovations():
    rng = np.random.default_rng(4)
    e = rng.standard_normal(4000)
    values = lfilter([1.0, -0.2], [1.0, -0.55], e)
    model = evaluate(
        values, np.ones(4000, dtype=bool), np.array([1.0, -0.55]), np.array([1.0, -0.2])
    )
    found = residuals(values, np.ones(4000, dtype=bool), model)
    np.testing.assert_allclose(found[100:], e[100:], atol=1e-8)


def test_order_zero_is_the_variance():
    values = np.array([1.0, -1.0, 5.0])
    found = white(values, np.array([True, True, False]))
    assert (found.order, found.variance, found.observed) == (0, 1.0, 2)


def test_warm_up_runs():
    warm_up()
