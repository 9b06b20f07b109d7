"""Lost samples are filled with what the model has there, and so leave no trace."""

from dataclasses import replace

import numpy as np
import pytest
from imu_noise_id.effects.bandwidth_limit import DigitalBandwidthLimit
from imu_noise_id.model import ChannelModel, FittedEffect, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import Reconciliation, reconcile_recording
from imu_noise_id.reconcile.filling import filled
from imu_noise_id.recording import Channel, Recording
from scipy.signal import butter, lfilter

NAME, RATE_HZ, COUNT = "angular_velocity.x", 100.0, 30_000
SIGMA, MEMORY_S = 0.2, 20.0


def course(rng: np.random.Generator) -> np.ndarray:
    """Exponentially correlated noise of a fifth of the white noise's deviation, as a recursion."""
    a = np.exp(-1.0 / RATE_HZ / MEMORY_S)
    x, out = SIGMA * rng.standard_normal(), []
    for w in (rng.standard_normal(COUNT) * SIGMA * np.sqrt(1.0 - a * a)).tolist():
        x = a * x + w
        out.append(x)
    return np.array(out)


def reconciled(
    values: np.ndarray,
    kept: np.ndarray,
    slow: bool = True,
    *more: FittedEffect,
) -> Reconciliation:
    stamps = np.rint(np.arange(COUNT) / RATE_HZ * 1e9).astype(np.int64)[kept]
    still = np.ones(stamps.size, dtype=bool)
    channel = Channel("/imu/data", NAME, "rad/s", stamps, values[kept], still, RATE_HZ)
    effects = [typed_effect("white_noise", NAME, {"density": 1.0 / np.sqrt(RATE_HZ)})]
    if slow:
        numbers = {"sigma": SIGMA, "correlation_time_s": MEMORY_S}
        effects.append(typed_effect("gauss_markov", NAME, dict(numbers)))
    effects += more
    given = ChannelModel(NAME, "/imu/data", "rad/s", RATE_HZ, 0.0, tuple(effects))
    return reconcile_recording(Recording("made", 0, (channel,)), NoiseModel((given,)), 0, 1)


def lost(rng: np.random.Generator, share: float, together: bool) -> np.ndarray:
    """Samples that are there: each lost on its own, or in runs of 20 on the average."""
    if not together:
        return rng.random(COUNT) > share
    there, at = np.ones(COUNT, dtype=bool), 0
    while at < COUNT:
        gap = 1 + int(rng.exponential(20.0))
        at += 1 + int(rng.exponential(20.0 * (1.0 - share) / share))
        there[at : at + gap] = False
        at += gap
    return there


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize("share", [0.1, 0.4, 0.6])
def test_of_lost_samples_only_the_loss_is_named(share: float, together: bool) -> None:
    rng = np.random.default_rng([round(10.0 * share), together])
    values = rng.standard_normal(COUNT) + course(rng)
    result = reconciled(values, lost(rng, share, together)).channel(NAME)
    assert [s.effect.name for s in result.steps] == ["dropouts"]
    assert result.verdict == "explained"


def test_what_the_model_lacks_is_seen_between_lost_samples() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(COUNT) / RATE_HZ
    values = rng.standard_normal(COUNT) + course(rng) + 0.3 * np.sin(2.0 * np.pi * 11.0 * t)
    result = reconciled(values, lost(rng, 0.4, together=False)).channel(NAME)
    assert [s.effect.name for s in result.steps] == ["dropouts", "periodic"]
    assert result.steps[1].effect.effect.frequency_hz == pytest.approx(11.0, abs=1e-3)
    drifting = reconciled(values - 0.3 * np.sin(2.0 * np.pi * 11.0 * t) + course(rng),
                          lost(rng, 0.4, together=True), slow=False).channel(NAME)  # fmt: skip
    slow = {"gauss_markov", "bias_instability", "rate_random_walk"}
    assert slow & {s.effect.name for s in drifting.steps}
    assert "variance_change" not in {s.effect.name for s in drifting.steps}


def test_a_draw_has_the_models_power_at_all_frequencies() -> None:
    rng = np.random.default_rng(3)
    k = np.arange(COUNT)
    f = k * RATE_HZ / (2.0 * COUNT)
    slow = 2.0 * SIGMA**2 * MEMORY_S / (1.0 + (2.0 * np.pi * f * MEMORY_S) ** 2)
    values = rng.standard_normal(COUNT) + course(rng)
    missing = rng.random(COUNT) < 0.4
    whole = filled(values, missing, 1.0 / RATE_HZ + slow, 1.0 / RATE_HZ, rng)
    assert np.array_equal(whole[~missing], values[~missing])
    mirrored = np.fft.rfft(np.concatenate((whole, whole[::-1])))[:COUNT]
    power = np.abs(mirrored) ** 2 / (2.0 * COUNT) / RATE_HZ / (1.0 / RATE_HZ + slow)
    for low, high in ((8, 200), (200, 1_000), (1_000, 5_000), (5_000, COUNT)):
        share = power[low:high].mean()
        assert abs(share - 1.0) < 4.0 * np.sqrt(2.0 / (high - low))  # standard errors


@pytest.mark.parametrize("together", [True, False])
@pytest.mark.parametrize("known", [True, False])
def test_a_low_passed_record_with_losses_is_held_against_its_spectrum(
    together: bool, known: bool
) -> None:
    """A digital low pass has a double zero at half the rate, where a white fill stood out."""
    values = lfilter(*butter(2, 0.4), np.random.default_rng([3, known]).standard_normal(COUNT))
    kept = np.ones(COUNT, dtype=bool)
    if together:
        kept[11_000:11_300] = False
    else:
        kept = lost(np.random.default_rng(4), 0.01, False)
    analog = typed_effect("bandwidth_limit", NAME, {"cutoff_hz": 20.0, "order": 2, "damping": 0.7})
    low_pass = replace(analog, effect=DigitalBandwidthLimit(20.0, 2.0, 0.7071))
    (channel,) = reconciled(np.asarray(values), kept, False, *[low_pass] * known).channels
    said = ["dropouts"] if known else ["dropouts", "bandwidth_limit"]
    assert [step.effect.name for step in channel.steps if step.action == "add"] == said
    assert channel.verdict == "explained"
    assert channel.after.score < 1.3
