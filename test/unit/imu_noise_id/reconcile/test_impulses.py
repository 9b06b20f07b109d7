"""A hit on coloured noise is one sample with its whole size, and a jump of the level is none."""

import numpy as np
import pytest
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import Reconciliation, reconcile_recording
from imu_noise_id.reconcile.impulses import impulses
from imu_noise_id.reconcile.state import analyse
from imu_noise_id.reconcile.work import initial_state
from imu_noise_id.recording import Channel, Recording
from scipy.signal import lfilter

COUNT, RATE_HZ, NAME = 9000, 5.0, "position.north"
WHITE_M, SLOW_M, SLOW_S = 0.006, 0.1, 9.0
JUMP = 4000


def positions(seed: int) -> np.ndarray:
    """Of a receiver whose error is slow at its rate: a walk from one fix to the next."""
    rng = np.random.default_rng(seed)
    stay = np.exp(-1.0 / (RATE_HZ * SLOW_S))
    driven = rng.standard_normal(COUNT) * SLOW_M * np.sqrt(1.0 - stay**2)
    return WHITE_M * rng.standard_normal(COUNT) + lfilter([1.0], [1.0, -stay], driven)


def its_model() -> ChannelModel:
    white = typed_effect("white_noise", NAME, {"density": WHITE_M / np.sqrt(RATE_HZ)})
    slow = typed_effect("gauss_markov", NAME, {"sigma": SLOW_M, "correlation_time_s": SLOW_S})
    return ChannelModel(NAME, "/fix", "m", None, 0.0, (white, slow))


def reconciled(values: np.ndarray) -> Reconciliation:
    stamp_ns = np.arange(COUNT) * round(1e9 / RATE_HZ)
    channel = Channel("/fix", NAME, "m", stamp_ns, values, np.ones(COUNT, dtype=bool), RATE_HZ)
    return reconcile_recording(Recording("fix", 0, (channel,)), NoiseModel((its_model(),)))


def hits(share: float, least_m: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng([seed, 1])
    size = rng.choice([-1.0, 1.0], COUNT) * least_m * rng.uniform(1.0, 2.0, COUNT)
    return (rng.random(COUNT) < share) * size


def test_a_hit_is_one_sample_of_its_size_and_a_jump_is_none() -> None:
    values = positions(1)
    values[2000] += 0.4
    values[JUMP:] += 0.4
    single = impulses(analyse(initial_state(its_model(), values, 1.0 / RATE_HZ, 0.0, None)))
    assert single.samples[2000] == pytest.approx(0.4, abs=4.0 * single.sigma)
    assert np.flatnonzero(np.abs(single.samples) > 5.0 * single.sigma).tolist() == [2000]


@pytest.mark.parametrize(("share", "least_m"), [(0.001, 0.2), (0.003, 0.2), (0.003, 2.0)])
def test_hits_on_coloured_positions_are_outliers_alone(share: float, least_m: float) -> None:
    added = hits(share, least_m, 3)
    (channel,) = reconciled(positions(3) + added).channels
    (step,) = channel.steps
    assert (channel.verdict, step.effect.name) == ("explained", "outliers")
    size = np.sqrt(np.mean(added[added != 0.0] ** 2))
    assert step.effect.effect.rate == pytest.approx(np.mean(added != 0.0), rel=0.15)
    assert step.effect.effect.scale == pytest.approx(size, rel=0.15)


def test_hits_as_many_as_one_in_forty_are_told_from_long_tails_where_none_is_small() -> None:
    (channel,) = reconciled(positions(4) + hits(0.025, 0.3, 4)).channels
    assert [step.effect.name for step in channel.steps] == ["outliers"]


def test_a_jump_of_the_level_is_a_step_of_its_height_and_no_hits() -> None:
    (channel,) = reconciled(positions(5) + 0.5 * (np.arange(COUNT) >= JUMP)).channels
    (step,) = channel.steps
    assert (channel.verdict, step.effect.name) == ("explained", "bias_step")
    assert step.effect.effect.time_s == pytest.approx(JUMP / RATE_HZ, abs=1.0)
    assert step.effect.effect.height == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("edge_s", [0.3, 1.0, 2.0])
def test_a_step_with_an_edge_is_one_step_of_its_whole_height(edge_s: float) -> None:
    since = (np.arange(COUNT) - JUMP) / RATE_HZ
    (channel,) = reconciled(positions(7) + 0.25 * (1.0 + np.tanh(since / (2.0 * edge_s)))).channels
    (step,) = channel.steps
    assert (channel.verdict, step.effect.name) == ("explained", "bias_step")
    assert step.effect.effect.time_s == pytest.approx(JUMP / RATE_HZ, abs=2.0)
    assert step.effect.effect.height == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("added_m", [0.02, 0.045])
def test_white_noise_for_a_while_on_slow_positions_is_one_change_of_variance(
    added_m: float,
) -> None:
    within = slice(3500, 5000)
    values = positions(8)
    values[within] += added_m * np.random.default_rng(80).standard_normal(1500)
    (channel,) = reconciled(values).channels
    (step,) = channel.steps
    assert (channel.verdict, step.effect.name) == ("explained", "variance_change")
    burst = step.effect.effect
    assert burst.from_s == pytest.approx(within.start / RATE_HZ, abs=5.0)
    assert burst.to_s == pytest.approx(within.stop / RATE_HZ, abs=5.0)
    assert burst.ratio > 1.5
