"""What a model plays is what it says."""

from __future__ import annotations

import numpy as np
import pytest
from imu_noise_id.effects.cross_axis import correlation
from imu_noise_id.model import ChannelModel, NoiseModel, TemperatureCourse
from imu_noise_id.model_file import typed_effect
from imu_noise_id.recording import Recording, unit_of
from imu_noise_id.simulate import simulate_recording

X, Y, Z = (f"angular_velocity.{axis}" for axis in "xyz")
WHITE = ("white_noise", {"density": 1e-3})


def channel(
    name: str, *effects: tuple[str, dict], rate_hz: float | None = 100.0, **rest: object
) -> ChannelModel:
    fitted = tuple(typed_effect(effect, name, values) for effect, values in effects)
    topic = "/gps/fix" if name.startswith("position") else "/imu/data"
    mean = float(rest.pop("mean", 0.0))  # type: ignore[arg-type]
    return ChannelModel(name, topic, unit_of(name), rate_hz, mean, fitted, **rest)  # type: ignore[arg-type]


def play(*channels: ChannelModel, duration_s: float = 200.0, seed: int = 0) -> Recording:
    return simulate_recording(NoiseModel(channels), duration_s, np.random.default_rng(seed))


@pytest.mark.parametrize("rate_hz", [50.0, 400.0])
def test_white_noise_has_its_density_at_any_rate(rate_hz: float) -> None:
    values = play(channel(X, WHITE, rate_hz=rate_hz)).channel(X).values
    assert values.std() / np.sqrt(rate_hz) == pytest.approx(1e-3, rel=0.03)


def test_every_channel_has_its_own_rate_mean_and_topic() -> None:
    made = play(channel(X, WHITE, mean=0.5), channel("position.up", rate_hz=None, mean=30.0))
    assert made.channel(X).values.size == 20_000
    assert made.channel(X).values.mean() == pytest.approx(0.5, abs=1e-3)
    up = made.channel("position.up")
    assert (up.rate_hz, up.values.size, up.topic) == (10.0, 2000, "/gps/fix")
    assert np.all(up.values == 30.0)


def test_the_same_seed_gives_the_same_samples() -> None:
    first, second = (play(channel(X, WHITE), seed=4).channel(X) for _ in range(2))
    assert np.array_equal(first.values, second.values)
    assert np.array_equal(first.stamp_ns, second.stamp_ns)


def test_cross_axis_noise_is_drawn_once_for_both_channels() -> None:
    tied = play(
        channel(X, WHITE, ("cross_axis", {"other": Y, "correlation": -0.5})),
        channel(Y, WHITE, ("cross_axis", {"other": X, "correlation": -0.5})),
        channel(Z, WHITE),
    )
    x, y, z = (tied.channel(name).values for name in (X, Y, Z))
    assert correlation(x, y)[0] == pytest.approx(-0.5, abs=0.03)
    assert correlation(x, z)[0] == pytest.approx(0.0, abs=0.03)
    assert x.std() == pytest.approx(1e-2, rel=0.03)


def test_a_course_comes_at_its_times_about_the_mean_of_its_recording() -> None:
    steps = (("bias_step", {"time_s": 50.0, "height": 1.0}),)
    typed = play(channel(X, *steps, mean=3.0)).channel(X).values
    assert (typed[0], typed[-1]) == (3.0, 4.0)
    known = play(channel(X, *steps, mean=3.0, duration_s=200.0)).channel(X).values
    assert known.mean() == pytest.approx(3.0, abs=1e-9)
    assert np.flatnonzero(np.diff(known)) == [4999]


def test_a_burst_scales_white_noise_and_leaves_slow_terms() -> None:
    made = play(
        channel(
            X,
            WHITE,
            ("rate_random_walk", {"coefficient": 1e-2}),
            ("variance_change", {"from_s": 50.0, "to_s": 100.0, "ratio": 100.0}),
        )
    )
    jumps = np.abs(np.diff(made.channel(X).values))
    assert jumps[5000:10000].std() / jumps[:4999].std() > 5.0
    assert jumps[[4999, 9999]].max() < 0.6  # no step at the edges


def test_the_temperature_is_held_at_its_end_and_written() -> None:
    model = NoiseModel(
        (channel(X, ("temperature", {"coefficient": 0.1})),),
        TemperatureCourse(np.array([0.0, 100.0]), np.array([20.0, 30.0])),
    )
    made = simulate_recording(model, 200.0, np.random.default_rng(0))
    assert made.temperature is not None
    assert made.temperature.topic == "/imu/temperature"
    assert made.temperature.values[-1] == 30.0
    assert made.channel(X).values[-1] == pytest.approx(1.0)


def test_transport_acts_on_all_channels_of_a_topic_alike() -> None:
    made = play(
        channel(X, WHITE, ("held_samples", {"factor": 2.0})),
        channel(Y, WHITE, ("dropouts", {"rate": 0.2, "mean_length_s": 0.1})),
        channel("position.up", WHITE, rate_hz=10.0),
    )
    x, y = made.channel(X), made.channel(Y)
    assert np.array_equal(x.stamp_ns, y.stamp_ns)
    assert x.values.size < 20_000
    assert np.array_equal(np.diff(x.values) == 0.0, np.diff(y.values) == 0.0)
    assert made.channel("position.up").values.size == 2000


def test_rounding_comes_after_saturation_and_after_the_mean() -> None:
    made = play(
        channel(
            X,
            ("white_noise", {"density": 0.1}),
            ("output_rounding", {"step": 0.25}),
            ("saturation", {"limit": 10.3}),
            mean=10.0,
        )
    )
    values = made.channel(X).values
    assert values.max() == 10.25
    assert np.all(values / 0.25 == np.rint(values / 0.25))


def test_too_short_a_duration_is_refused() -> None:
    with pytest.raises(ValueError, match="no sample"):
        play(channel(X, WHITE), duration_s=0.001)
