"""Mixtures of noise and hits are told from laws that have long tails and no hits."""

import numpy as np
import pytest
from imu_noise_id.hits import Answer, hit_mixtures

COUNT = 60_000


def answer(values: np.ndarray) -> Answer:
    unit = values * 0.6745 / np.median(np.abs(values))
    return hit_mixtures(unit, 0.003, 4.0)


@pytest.mark.parametrize("degrees", [4, 8])
def test_heavy_tails_have_far_more_hits_than_outliers_are(degrees: int) -> None:
    found = answer(np.random.default_rng(degrees).standard_t(degrees, COUNT))
    assert found.rate > 0.03
    assert found.tails > 5.0


def test_laplace_noise_is_likelier_of_a_long_tailed_law() -> None:
    assert answer(np.random.default_rng(1).laplace(size=COUNT)).tails > 50.0


@pytest.mark.parametrize("size", [6.0, 30.0])
@pytest.mark.parametrize("rate", [1e-3, 1e-2])
def test_hits_are_likelier_of_a_mixture(rate: float, size: float) -> None:
    rng = np.random.default_rng([2, round(size)])
    hit = rng.random(COUNT) < rate
    found = answer(rng.standard_normal(COUNT) + hit * size * rng.standard_normal(COUNT))
    assert found.tails < -20.0
    assert found.rate == pytest.approx(hit.mean(), rel=0.5)
