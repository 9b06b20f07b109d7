"""nav_fusion.evidence: how often a true model is spoken against, however often one looks."""

from __future__ import annotations

import numpy as np
import pytest
from imu_noise_id.effects.output_rounding import OutputRounding
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.model import ChannelModel, FittedEffect
from nav_fusion.noise import AxisNoise

from nav_fusion import evidence


def ever(logarithms: np.ndarray) -> float:
    """Share of runs (first axis) whose evidence at any look exceeds one test's limit."""
    return float(np.mean(logarithms.max(axis=1) > evidence.limit(1)))


def test_a_true_scale_is_doubted_in_one_run_of_a_hundred_at_most_over_all_looks() -> None:
    rng = np.random.default_rng(1)
    squares = np.cumsum(rng.chisquare(3, (1000, 300)), axis=1)
    dof = 3.0 * np.arange(1, 301)
    found = [[evidence.of_scale(s, d) for s, d in zip(run, dof, strict=True)] for run in squares]
    assert ever(np.array(found)) < 0.01 + 3 * np.sqrt(0.01 * 0.99 / 1000)


def test_white_innovations_are_doubted_in_one_run_of_a_hundred_at_most() -> None:
    e = np.random.default_rng(2).normal(size=(1000, 400))
    products = np.cumsum(e[:, 1:] * e[:, :-1], axis=1)
    squares = np.cumsum(e[:, :-1] ** 2, axis=1)
    found = [
        [evidence.of_correlation(p, s) for p, s in zip(*run, strict=True)]
        for run in zip(products, squares, strict=True)
    ]
    assert ever(np.array(found)) < 0.01 + 3 * np.sqrt(0.01 * 0.99 / 1000)


@pytest.mark.parametrize(("factor", "fixes"), [(0.5, 60), (1.5, 60), (3.0, 10)])
def test_a_wrong_sigma_is_found_within_so_many_fixes(factor: float, fixes: int) -> None:
    rng = np.random.default_rng(3)
    squares = factor**2 * rng.chisquare(3 * fixes, 200)
    found = [evidence.of_scale(s, 3.0 * fixes) > evidence.limit(8) for s in squares]
    assert np.mean(found) > 0.95


def test_the_evidence_of_very_many_squares_keeps_its_digits() -> None:
    assert evidence.of_scale(1e9, 1e9) == pytest.approx(
        evidence.of_scale(1e8, 1e8) - 1.151, abs=0.01
    )


def channel(*effects: object) -> ChannelModel:
    fitted = tuple(FittedEffect(e, ()) for e in effects)  # type: ignore[arg-type]
    return ChannelModel("angular_velocity.x", "/imu", "rad/s", 100.0, 0.0, fitted)


def mean_square(values: np.ndarray) -> float:
    return float(np.mean(np.diff(values) ** 2))


def test_first_differences_of_white_noise_have_the_mean_and_the_spread_that_is_told() -> None:
    rng = np.random.default_rng(4)
    steps = evidence.steps_of((AxisNoise(1e-3),) * 3, 100.0)
    n = 400
    means = [sum(mean_square(x) for x in rng.normal(0, 1e-2, (3, n + 1))) for _ in range(2000)]
    assert np.mean(means) == pytest.approx(steps.highest, rel=0.01)
    assert np.var(means) == pytest.approx(2 * steps.highest**2 / (steps.dof * n), rel=0.12)
    assert steps.lowest == steps.highest


@pytest.mark.parametrize("step", [0.003, 0.01, 0.019, 0.03, 0.1])
@pytest.mark.parametrize("level", [0.0, 0.3, 0.5])
def test_rounded_samples_are_inside_of_what_their_model_says_wherever_they_rest(
    step: float, level: float
) -> None:
    rng = np.random.default_rng(5)
    axis = AxisNoise(1e-3, (), channel(WhiteNoise(1e-3), OutputRounding(step)))
    steps = evidence.steps_of((axis,) * 3, 100.0)
    values = rng.normal(level * step, 1e-2, (3, 4001))
    mean = sum(mean_square(step * np.rint(x / step)) for x in values)
    assert abs(steps.factor(mean) - 1.0) < 0.05
