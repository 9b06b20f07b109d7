"""Mixtures of noise and hits are told from laws that have long tails and no hits."""

import numpy as np
import pytest
from imu_noise_id.hits import Answer, Even, Laplace, Normal, hit_mixtures

COUNT = 60_000


def answer(values: np.ndarray) -> Answer:
    unit = values * 0.6745 / np.median(np.abs(values))
    return hit_mixtures(unit, 0.003, 4.0)


@pytest.mark.parametrize("degrees", [4, 8])
def test_heavy_tails_have_far_more_hits_than_outliers_are(degrees: int) -> None:
    found = answer(np.random.default_rng(degrees).standard_t(degrees, COUNT))
    assert found.rate > 0.03
    assert found.tails > 5.0


def test_laplace_noise_is_hit_all_of_it_or_not_at_all() -> None:
    found = answer(np.random.default_rng(1).laplace(size=COUNT))
    assert found.rate > 0.5
    assert abs(found.tails) < 5.0


@pytest.mark.parametrize("law", ["normal", "laplace", "even"])
def test_the_laws_chances_and_densities_are_those_of_drawn_hits(law: str) -> None:
    rng = np.random.default_rng(3)
    sizes = {
        "normal": 4.0 * rng.standard_normal(10 * COUNT),
        "laplace": rng.laplace(0.0, 4.0 / np.sqrt(2.0), 10 * COUNT),
        "even": rng.uniform(2.0, 5.0, 10 * COUNT) * rng.choice([-1.0, 1.0], 10 * COUNT),
    }[law]
    seen = sizes + rng.standard_normal(10 * COUNT)
    of = {"normal": Normal(4.0), "laplace": Laplace(4.0), "even": Even(2.0, 5.0)}[law]
    assert float(of.size) == pytest.approx(np.sqrt(np.mean(sizes**2)), rel=0.01)
    for x in (0.5, 3.0, 6.0):
        assert float(of.beyond(x)) == pytest.approx(np.mean(np.abs(seen) > x), rel=0.02)
        density = np.mean(np.abs(seen - x) < 0.1) / 0.2
        assert float(np.exp(of.log_density(x))) == pytest.approx(density, rel=0.06)


@pytest.mark.parametrize("size", [6.0, 30.0])
@pytest.mark.parametrize("rate", [1e-3, 1e-2])
def test_hits_are_likelier_of_a_mixture(rate: float, size: float) -> None:
    rng = np.random.default_rng([2, round(size)])
    hit = rng.random(COUNT) < rate
    found = answer(rng.standard_normal(COUNT) + hit * size * rng.standard_normal(COUNT))
    assert found.tails < -20.0
    assert found.rate == pytest.approx(hit.mean(), rel=0.5)
