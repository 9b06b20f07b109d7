"""Recordings with hidden effects, by code that knows nothing of the catalogue: are they named?

The seeded subset of ``study/study_reconcile.py``: six channels, 100 Hz, 120 s, clearly present.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from imu_noise_id.effects.bandwidth_limit import DigitalBandwidthLimit
from imu_noise_id.identify import identify_recording
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import compare_recording, loop, reconcile_recording, reconciliation_tree
from imu_noise_id.reconcile.loop import lying_otherwise, of_the_stamps
from imu_noise_id.reconcile.result import HeldOut
from imu_noise_id.recording import Channel, Quality, Recording, unit_of
from imu_noise_id.simulate import simulate_recording
from scipy.signal import butter, lfilter

from helpers import hidden_effects as hidden

SENSOR = 3
DURATION_S, RATE_HZ = 120.0, 100.0
CLEAR = 120.0
NAMES = hidden.IMU_CHANNELS


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def model() -> NoiseModel:
    return identify_recording(made("nothing", seed=10**6)).model


def made(kind: str, seed: int = 0, nats: float = CLEAR) -> Recording:
    """One recording as the readers give it."""
    arrays = hidden.recording(kind, nats, seed, DURATION_S, RATE_HZ, sensor_seed=SENSOR)

    def channel(name: str, stamps: np.ndarray, values: np.ndarray, topic: str) -> Channel:
        still = np.ones(values.size, dtype=bool)
        return Channel(topic, name, unit_of(name), stamps, values, still, RATE_HZ)

    channels = tuple(channel(n, arrays.stamp_ns, v, "/imu/data") for n, v in arrays.values.items())
    assert arrays.temperature_ns is not None
    assert arrays.temperature is not None
    warm = channel("temperature", arrays.temperature_ns, arrays.temperature, "/imu/temperature")
    return Recording("hidden", 0, channels, replace(warm, rate_hz=1.0))


def truth(kind: str, seed: int = 0) -> dict[str, tuple[str, ...]]:
    return hidden.recording(kind, CLEAR, seed, DURATION_S, RATE_HZ, sensor_seed=SENSOR).truth


@pytest.mark.parametrize(
    "kind",
    [
        "periodic",
        "narrow_band",
        "rate_ramp",
        "variance_change",
        "outliers",
        "output_rounding",
        "saturation",
        "bandwidth_limit",
        "averaging",
        "held_samples",
        "timestamp_jitter",
        "dropouts",
        "cross_axis",
        "temperature",
    ],
)
def test_what_is_hidden_is_named_on_its_channel(kind: str, model: NoiseModel) -> None:
    result = reconcile_recording(made(kind), model)
    for name in NAMES:
        steps = result.channel(name).steps
        if name in truth(kind):
            assert steps[0].action == "add"
            first = steps[0].effect
            assert kind == first.name or kind in first.note.split()
            assert result.channel(name).after.score < 1.3
        else:
            assert steps == ()


def test_a_walk_beyond_the_models_own_bound_is_named_and_is_a_gap(model: NoiseModel) -> None:
    name = NAMES[0]
    quiet = made("nothing", seed=6)
    (bound,) = [b.upper for b in channel_of(model, name).bounds if b.name == "rate_random_walk"]
    steps = np.random.default_rng(3).laplace(size=quiet.channels[0].values.size)
    steps *= 12.0 * bound / np.sqrt(2.0 * RATE_HZ)
    walked = replace(quiet.channels[0], values=quiet.channels[0].values + np.cumsum(steps))
    result = reconcile_recording(replace(quiet, channels=(walked, *quiet.channels[1:])), model)
    (step,) = result.channel(name).steps
    assert (step.action, step.effect.name) == ("add", "rate_random_walk")
    assert result.channel(name).before.score > 1.3
    assert result.channel(name).after.score < 1.2


def channel_of(model: NoiseModel, name: str) -> ChannelModel:
    return next(c for c in model.channels if c.name == name)


def test_a_low_pass_in_the_sensors_own_samples_is_named_with_its_corner(model: NoiseModel) -> None:
    recording = made("nothing", seed=6)
    first = recording.channels[0]
    slow = lfilter(*butter(2, 20.0, fs=RATE_HZ), first.values - first.values.mean())
    filtered = replace(first, values=first.values.mean() + slow)
    hidden_there = replace(recording, channels=(filtered, *recording.channels[1:]))
    result = reconcile_recording(hidden_there, model)
    channel = result.channel(first.name)
    (step,) = channel.steps
    assert (channel.verdict, step.action) == ("explained", "add")
    assert isinstance(step.effect.effect, DigitalBandwidthLimit)
    assert abs(step.effect.effect.cutoff_hz / 20.0 - 1.0) < 0.05
    assert all(c.steps == () for c in result.channels if c.name != first.name)


def test_louder_noise_is_a_refit(model: NoiseModel) -> None:
    result = reconcile_recording(made("white_noise"), model)
    (name,) = truth("white_noise")
    step = result.channel(name).steps[0]
    assert (step.action, step.effect.name) == ("refit", "white_noise")


def test_nothing_hidden_changes_nothing(model: NoiseModel) -> None:
    result = reconcile_recording(made("nothing", seed=5), model)
    assert [c.name for c in result.channels] == list(NAMES)
    assert all(c.verdict == "agrees" for c in result.channels)
    assert result.model == model


@pytest.mark.parametrize("kind", ["breathing", "lopsided"])
def test_what_is_in_no_catalogue_gets_no_name(kind: str, model: NoiseModel) -> None:
    result = reconcile_recording(made(kind), model)
    (name,) = truth(kind)
    channel = result.channel(name)
    assert channel.verdict == "unexplained"
    assert channel.after.where
    assert channel.steps == ()


def test_a_typed_effect_that_is_not_there_is_removed(model: NoiseModel) -> None:
    name = NAMES[0]
    extra = typed_effect("output_rounding", name, {"step": 2e-4})
    channels = tuple(
        replace(c, effects=(*c.effects, extra), log_covariance=None) if c.name == name else c
        for c in model.channels
    )
    result = reconcile_recording(made("nothing", seed=5), replace(model, channels=channels))
    steps = result.channel(name).steps
    assert [(s.action, s.effect.name) for s in steps] == [("remove", "output_rounding")]
    assert result.model.channel(name).find("output_rounding") is None


def test_a_constant_where_the_model_has_noise_is_unexplained(model: NoiseModel) -> None:
    recording = made("nothing")
    frozen = replace(recording.channels[0], values=np.full(recording.channels[0].values.size, 0.5))
    result = reconcile_recording(
        replace(recording, channels=(frozen, *recording.channels[1:])), model
    )
    first = result.channels[0]
    assert first.verdict == "unexplained"
    assert "a sensor that hangs?" in first.notes[0]
    assert not first.steps
    json.dumps(reconciliation_tree(result), allow_nan=False)


def test_the_mended_model_agrees_with_another_recording_and_plays(model: NoiseModel) -> None:
    mended = reconcile_recording(made("periodic"), model).model
    (name,) = truth("periodic")
    line = mended.channel(name).find("periodic")
    assert line is not None
    assert line.estimates[1].lower < line.estimates[1].value < line.estimates[1].upper
    again = simulate_recording(mended, DURATION_S, np.random.default_rng(1))
    assert all(c.verdict == "agrees" for c in reconcile_recording(again, mended).channels)


def test_results_do_not_depend_on_workers_and_are_plain_data(model: NoiseModel) -> None:
    first = reconciliation_tree(reconcile_recording(made("periodic"), model, workers=1))
    second = reconciliation_tree(reconcile_recording(made("periodic"), model, workers=2))
    text = json.dumps(first, allow_nan=False)
    assert text == json.dumps(second, allow_nan=False)
    (name,) = truth("periodic")
    (step,) = next(c for c in first["channels"] if c["name"] == name)["steps"]
    assert "vibration" in step["evidence"]
    assert "was missing (gap" in step["evidence"]
    assert set(step) >= {"action", "effect", "gap_before", "gap_after", "p_value", "held_out"}


def test_comparing_alone_says_where_and_changes_nothing(model: NoiseModel) -> None:
    (name,) = truth("periodic")
    found = {c.name: c for c in compare_recording(made("periodic"), model)}
    assert found[name].verdict == "unexplained"
    assert found[name].after.where[0].domain == "spectrum"
    assert [n for n in NAMES if found[n].verdict != "agrees"] == [name]


def test_channels_without_a_model_are_listed_with_the_reason(model: NoiseModel) -> None:
    part = replace(model, channels=model.channels[:5])
    result = reconcile_recording(made("nothing", seed=5), part)
    assert result.channel(NAMES[5]).notes == ("the model has no such channel",)
    assert result.channel(NAMES[5]).verdict == "agrees"


def test_gravity_of_the_other_sign_is_said() -> None:
    """It is no noise, so that all may agree; but somebody compares a simulator with a sensor."""

    def recording(mean: float) -> Recording:
        name, n = "linear_acceleration.z", 10
        stamps, still = np.arange(n), np.ones(n, bool)
        values = np.full(n, mean)
        return Recording("r", 0, (Channel("/imu", name, "m/s^2", stamps, values, still, 1.0),))

    def models(mean: float) -> dict[str, ChannelModel]:
        name = "linear_acceleration.z"
        return {name: ChannelModel(name, "", "m/s^2", 1.0, mean, ())}

    (note,) = lying_otherwise(recording(-9.79), models(9.79))
    assert note.startswith("linear_acceleration.z: a mean of -9.79 m/s^2 and +9.79 in the model")
    assert lying_otherwise(recording(9.9), models(9.79)) == []
    assert lying_otherwise(recording(9.9), models(0.0)) == []


def test_what_the_reader_left_out_is_said_once_a_topic() -> None:
    stamps = np.arange(100, dtype=np.int64) * 10_000_000
    back = "the clock was set once, by -1 s"
    quality = Quality(duplicates=200, notes=(back,))

    def channel(axis: str, notes: tuple[str, ...]) -> Channel:
        held = replace(quality, notes=(*quality.notes, *notes))
        still = np.ones(100, dtype=bool)
        name = f"angular_velocity.{axis}"
        return Channel("/imu", name, "rad/s", stamps, np.zeros(100), still, 100.0, held)

    channels = channel("x", ()), channel("y", ("it hangs",))
    said = of_the_stamps(Recording("made", 0, channels))
    assert said[0] == f"/imu: {back}"
    assert len(said) == 2
    assert "200 samples with the stamp of another" in said[1]
    assert not of_the_stamps(Recording("made", 0, (replace(channels[0], quality=Quality()),)))


def left(before: float, after: float) -> bool:
    """Whether one step that leaves this gap on unseen data closed it."""
    draft = SimpleNamespace(held_out=HeldOut(before, after))
    works = (SimpleNamespace(drafts=()), SimpleNamespace(drafts=(draft,)))
    return loop._closed([(work, None) for work in works])


def test_half_of_a_large_gap_is_not_closed():
    assert left(2.0, 1.4)
    assert left(30.0, 1.9)
    assert not left(2.0, 1.9)
    assert not left(3.2, 2.2)
