"""Hits are counted right whatever their own law, and heavy tails are not hits."""

from dataclasses import replace

import numpy as np
import pytest
from imu_noise_id.hits import Normal
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import reconcile_recording
from imu_noise_id.reconcile.contamination import find_hits
from imu_noise_id.recording import Channel, Recording

COUNT, RATE_HZ = 60_000, 100.0
NAME, SIGMA = "linear_acceleration.y", 0.02


def magnitudes(law: str, rng: np.random.Generator) -> np.ndarray:
    """Of hits, in deviations of the noise."""
    if law == "gaussian":
        return np.abs(rng.standard_normal(COUNT)) * 5.0
    return rng.uniform(*{"hollow": (3.5, 7.0), "even": (0.0, 9.0), "far": (9.0, 25.0)}[law], COUNT)


def hit_noise(law: str, rate: float, seed: int) -> tuple[np.ndarray, float, float]:
    """Unit noise with hits, and the share and root mean square of those that fell."""
    rng = np.random.default_rng([seed, len(law)])
    hit = rng.random(COUNT) < rate
    sizes = magnitudes(law, rng) * rng.choice([-1.0, 1.0], COUNT)
    fallen = sizes[hit]
    return rng.standard_normal(COUNT) + hit * sizes, hit.mean(), float(np.sqrt(np.mean(fallen**2)))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("law", ["gaussian", "hollow", "even", "far"])
def test_rate_and_scale_of_hits_are_right_whatever_their_law(law: str, seed: int) -> None:
    noise, rate, scale = hit_noise(law, 0.004, seed)
    found = find_hits(noise).answer
    assert abs(np.log(found.rate / rate)) < 2.5 * found.rate_error < 1.3
    assert abs(np.log(found.scale / scale)) < 2.5 * found.scale_error < 0.6


def test_what_is_left_without_the_drawn_hits_has_the_variance_and_the_tails_of_the_noise() -> None:
    noise, _, _ = hit_noise("hollow", 0.01, 7)
    hits = find_hits(noise)
    rng = np.random.default_rng(1)
    mask = hits.drawn(rng)
    noise[mask] = rng.standard_normal(int(mask.sum()))
    assert noise.var() == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / COUNT))
    assert np.mean(noise**4) == pytest.approx(3.0, abs=4.0 * np.sqrt(96.0 / COUNT))


@pytest.mark.parametrize("step", [0.3, 0.7])
def test_rounded_noise_with_gaussian_hits_keeps_their_law(step: float) -> None:
    noise, rate, scale = hit_noise("gaussian", 0.004, 3)
    found = find_hits(step * np.rint(noise / step), step).answer
    assert isinstance(found.best.law, Normal)
    assert found.rate == pytest.approx(rate, rel=0.3)
    assert found.scale == pytest.approx(scale, rel=0.15)


def one_channel(noise: np.ndarray) -> Recording:
    stamp_ns = np.arange(COUNT) * round(1e9 / RATE_HZ)
    still = np.ones(COUNT, dtype=bool)
    channel = Channel("/imu/data", NAME, "m/s^2", stamp_ns, SIGMA * noise, still, RATE_HZ)
    return Recording("hit", 0, (channel,), None)


def its_model() -> NoiseModel:
    white = typed_effect("white_noise", NAME, {"density": SIGMA / np.sqrt(RATE_HZ)})
    return NoiseModel((ChannelModel(NAME, "", "m/s^2", None, 0.0, (white,)),))


@pytest.mark.parametrize("seed", range(2))
def test_hollow_hits_are_outliers_and_leave_nothing_to_explain(seed: int) -> None:
    noise, rate, scale = hit_noise("hollow", 0.003, 20 + seed)
    (channel,) = reconcile_recording(one_channel(noise), its_model()).channels
    assert channel.verdict == "explained"
    (step,) = channel.steps
    assert step.effect.name == "outliers"
    for said, true in zip(step.effect.estimates, (rate, SIGMA * scale), strict=True):
        assert said.lower is not None
        assert said.upper is not None
        assert said.lower < true < said.upper


@pytest.mark.parametrize(("least", "said"), [(None, ["outliers"]), (2e-6, [])])
def test_hits_that_do_not_come_are_taken_back_if_their_rate_was_known(
    least: float | None, said: list[str]
) -> None:
    hits = typed_effect("outliers", NAME, {"rate": 3e-4, "scale": 12.0 * SIGMA})
    rate = replace(hits.estimates[0], lower=least, upper=least and 2e-3)
    model = its_model()
    (channel,) = model.channels
    known = replace(hits, estimates=(rate, hits.estimates[1]))
    model = replace(model, channels=(replace(channel, effects=(*channel.effects, known)),))
    noise = np.random.default_rng(30).standard_normal(COUNT)
    (found,) = reconcile_recording(one_channel(noise), model).channels
    assert [step.effect.name for step in found.steps] == said


@pytest.mark.parametrize("degrees", [4, 8])
def test_heavy_tails_stay_unexplained(degrees: int) -> None:
    tails = np.random.default_rng([degrees, 1]).standard_t(degrees, COUNT)
    tails *= np.sqrt((degrees - 2.0) / degrees)
    (channel,) = reconcile_recording(one_channel(tails), its_model()).channels
    assert channel.verdict == "unexplained"
    assert channel.steps == ()
