"""nav_fusion.chains and schedule: the figures that an independent reading of the thesis gave."""

from __future__ import annotations

import math

import numpy as np
import pytest
from nav_fusion.chains import (
    ContinuousModel,
    SampledModel,
    heading_chain,
    identified_chain,
    position_chain,
)
from nav_fusion.discretize import first_order
from nav_fusion.noise import AidNoise, AxisNoise
from nav_fusion.noise_terms import SlowTerm
from nav_fusion.schedule import run_covariance, steady

LATITUDE = SampledModel(0.8208, 0.5819, 17.49, -14.49, 0.1)
MAGNETOMETER = SampledModel(-0.6155, -0.7679, 339.2, 47.59, 0.1)
# sigmas after 300 s found by another program from the printed models: audit of the thesis, part 6
ACCELEROMETERS = [
    ((0.0006629, -0.344, 427.7, 1e-3), 0.035, 0.0015),
    ((0.000524, -1.264, 308.5, 1e-3), 0.052, 0.0049),
    ((0.0005878, -0.5371, 623.9, 1e-3), 0.036, 0.0015),
    ((-0.000388, 0.0302, 135.3, 1e-2), 0.034, 0.0013),
]
GYROS = [
    ((-0.004277, 4.314, 587.8, 1e-3), 0.0044),
    ((0.0001333, -6.574, 685.3, 1e-3), 0.0047),
    ((-0.0212, 30.91, 609.7, 1e-3), 0.0102),
    ((0.04694, -19.44, 403.8, 1e-2), 0.0176),
]


@pytest.mark.parametrize(("model", "position", "velocity"), ACCELEROMETERS)
def test_position_and_velocity_after_300_s(
    model: tuple[float, ...], position: float, velocity: float
) -> None:
    run = run_covariance(position_chain(ContinuousModel(*model), LATITUDE), 300.0)
    assert run.sigma(0)[-1] == pytest.approx(position, abs=6e-4)
    assert run.sigma(1)[-1] == pytest.approx(velocity, abs=6e-5)


@pytest.mark.parametrize(("model", "heading"), GYROS)
def test_heading_after_300_s(model: tuple[float, ...], heading: float) -> None:
    run = run_covariance(heading_chain(ContinuousModel(*model), MAGNETOMETER), 300.0)
    assert math.degrees(run.sigma(0)[-1]) == pytest.approx(heading, abs=1.2e-4)


def test_the_run_settles_at_the_periodic_riccati_solution() -> None:
    chain = position_chain(ContinuousModel(*ACCELEROMETERS[1][0]), LATITUDE)
    last = run_covariance(chain, 1000.0).covariance[-1]
    np.testing.assert_allclose(np.diag(last), np.diag(steady(chain)), rtol=1e-6)


def test_the_first_order_variant_is_close_at_1_khz_and_not_the_same() -> None:
    model = ContinuousModel(*ACCELEROMETERS[0][0])
    exact_run = run_covariance(position_chain(model, LATITUDE), 20.0).covariance[-1]
    rough = run_covariance(position_chain(model, LATITUDE, first_order), 20.0).covariance[-1]
    np.testing.assert_allclose(np.diag(rough)[:2], np.diag(exact_run)[:2], rtol=1e-2)
    assert not np.array_equal(rough, exact_run)


def test_tustin_maps_the_printed_pair() -> None:
    n1, n0, p = SampledModel(-0.3059, 0.9285, 186.7, -101.9, 1e-3).continuous()
    assert (n1, n0, p) == pytest.approx((-0.004277, 4.314, 587.8), rel=1e-3)


def test_a_gyro_alone_walks_as_its_noise_says() -> None:
    """With an aid that says nothing the heading's variance is N^2 t + K^2 t^3/3."""
    axis = AxisNoise(1e-3, (SlowTerm(0.0, math.inf, 1e-4, "rate_random_walk"),))
    chain = identified_chain(axis, AidNoise(1e9), 1, 0.0)
    run = run_covariance(chain, 100.0)
    expected = 1e-6 * 100 + 1e-8 * 100**3 / 3
    assert run.sigma(0)[-1] ** 2 == pytest.approx(expected, rel=1e-9)


def test_the_covariance_does_not_depend_on_the_inertial_rate() -> None:
    axis = AxisNoise(2e-3, (SlowTerm.gauss_markov(3e-3, 50.0, "gauss_markov"),))
    aid = AidNoise(0.3, (SlowTerm.gauss_markov(0.8, 30.0, "gauss_markov"),))
    last = [
        run_covariance(identified_chain(axis, aid, 2, 5.0, rate), 60.0).covariance[-1]
        for rate in (100.0, 200.0, 1000.0)
    ]
    np.testing.assert_allclose(last[0], last[2], rtol=1e-8, atol=1e-14)
    np.testing.assert_allclose(last[1], last[2], rtol=1e-8, atol=1e-14)
