"""A recording becomes a model: accurate, with intervals that hold, whatever was lost on the way."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.curves import model_allan_variance
from imu_noise_id.identify import identify_recording
from imu_noise_id.recording import Channel, Recording, unit_of
from numpy.testing import assert_allclose

from helpers.noise_records import DT, markov, recording, walk, white

N = 30000
DATA = Path(__file__).resolve().parents[4] / "shared" / "data"


SLOW = ("scipy.stats", "scipy.signal", "scipy.ndimage", "scipy.optimize")
"""Each takes a quarter of a second to a second to import."""


def density(result):
    return result.model.find("white_noise").effect.density


def names(result):
    return sorted(e.name for e in result.model.effects)


def test_number_of_workers_does_not_matter():
    rng = np.random.default_rng(61)
    axes = {f"angular_velocity.{a}": white(N, rng) + walk(N, rng, 0.5) for a in "xyz"}
    one, two = (identify_recording(recording(axes), workers) for workers in (1, 2))
    for a, b in zip(one.model.channels, two.model.channels, strict=True):
        assert (a.effects, a.bounds, a.mean) == (b.effects, b.bounds, b.mean)


def test_it_starts_without_what_is_slow_to_import():
    modules = "imu_noise_id.bags, imu_noise_id.identify, imu_noise_id.report.identification"
    code = f"import sys, {modules}; print([name for name in {SLOW} if name in sys.modules])"
    command = [sys.executable, "-c", code]
    told = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    assert told.strip() == "[]"


def test_it_tells_of_every_channel_that_is_through():
    rng = np.random.default_rng(64)
    axes = {f"angular_velocity.{a}": white(2000, rng) for a in "xyz"}
    told = []
    identify_recording(recording(axes), 2, told.append)
    assert sorted(told) == sorted(axes)


def test_unit_scales_the_model():
    values = white(N, np.random.default_rng(62)) + walk(N, np.random.default_rng(63), 0.5)
    one = identify_recording(recording({"angular_velocity.x": values}), 1).channels[0]
    scaled = recording({"angular_velocity.x": values * 1e-4})
    other = identify_recording(scaled, 1).channels[0]
    assert names(one) == names(other)
    assert_allclose(density(other), 1e-4 * density(one), rtol=1e-6)


def test_constant_and_short_channels_say_why_they_have_no_model():
    rng = np.random.default_rng(64)
    found = identify_recording(
        recording({"angular_velocity.x": np.full(N, 1.5), "angular_velocity.y": white(N, rng)}), 1
    )
    assert "constant" in found.channels[0].notes[0]
    assert found.channels[0].model.effects == ()
    assert found.channels[0].model.mean == 1.5
    assert names(found.channels[1]) == ["white_noise"]
    short = identify_recording(recording({"angular_velocity.x": white(9, rng)}), 1)
    assert "too few" in short.channels[0].notes[0]


def test_shared_noise_is_named_on_both_axes():
    rng = np.random.default_rng(65)
    x, y = white(N, rng), white(N, rng)
    both = {"angular_velocity.x": x, "angular_velocity.y": 0.4 * x + y}
    found = identify_recording(recording(both), 1)
    for result, other in zip(
        found.channels, ("angular_velocity.y", "angular_velocity.x"), strict=True
    ):
        effect = result.model.find("cross_axis").effect
        assert effect.other == other
        assert_allclose(effect.correlation, 0.4 / np.sqrt(1.16), atol=0.03)


def test_held_samples_are_named_and_the_white_noise_is_of_each_sample():
    rng = np.random.default_rng(66)
    axes = {f"angular_velocity.{a}": np.repeat(white(N // 2, rng), 2) for a in "xyz"}
    for result in identify_recording(recording(axes), 1).channels:
        assert names(result) == ["held_samples", "white_noise"]
        assert_allclose(density(result), 1.0, rtol=0.02)
        model = np.sqrt(model_allan_variance(result.model, result.allan.tau_s, DT))
        inside = (result.allan.lower <= model) & (model <= result.allan.upper)
        assert inside.mean() > 0.85


def with_loss(values, kept):
    whole = recording({"angular_velocity.x": values}).channels[0]
    channel = Channel(
        whole.topic,
        whole.name,
        unit_of(whole.name),
        whole.stamp_ns[kept],
        whole.values[kept],
        whole.still[kept],
        whole.rate_hz,
    )
    return Recording("test", 0, (channel,))


def test_lost_samples_and_a_gap_cost_no_accuracy():
    errors = []
    for seed in range(4):
        rng = np.random.default_rng([67, seed])
        kept = rng.random(N) > 0.05
        kept[8000:14000] = False
        values = white(N, rng) + walk(N, rng, 0.3)
        result = identify_recording(with_loss(values, kept), 1).channels[0]
        errors.append(density(result) - 1.0)
    assert np.abs(np.mean(errors)) < 0.01


def test_outliers_cost_no_accuracy():
    rng = np.random.default_rng(68)
    values = white(N, rng)
    values[rng.integers(0, N, 6)] += 200.0
    result = identify_recording(recording({"angular_velocity.x": values}), 1).channels[0]
    assert names(result) == ["outliers", "white_noise"]
    assert_allclose(density(result), 1.0, rtol=0.02)


def test_intervals_cover():
    covered = []
    for seed in range(8):
        rng = np.random.default_rng([69, seed])
        values = white(N, rng) + markov(N, rng, 5.0, 1.0)
        result = identify_recording(recording({"angular_velocity.x": values}), 1).channels[0]
        effect = result.model.find("gauss_markov")
        assert effect is not None
        for estimate, truth in zip(effect.estimates, (5.0, 1.0), strict=True):
            covered.append(estimate.lower < truth < estimate.upper)
    assert np.mean(covered) > 0.75


def test_what_does_not_show_is_bounded():
    result = identify_recording(
        recording({"angular_velocity.x": white(N, np.random.default_rng(70))}), 1
    ).channels[0]
    bounds = {b.name: b.upper for b in result.model.bounds}
    assert set(bounds) == {"rate_random_walk", "bias_instability", "quantization"}
    assert 0.0 < bounds["rate_random_walk"] < 0.1


@pytest.mark.skipif(
    not (DATA / "mpu6050_static_100hz.npz").exists(), reason="the shared recordings are not here"
)
def test_mpu6050_has_its_line_and_its_author_s_noise():
    file = np.load(DATA / "mpu6050_static_100hz.npz")
    axes = {f"angular_velocity.{a}": file["gyro"][:, i] for i, a in enumerate("xyz")}
    axes |= {f"linear_acceleration.{a}": file["accel"][:, i] for i, a in enumerate("xyz")}
    found = identify_recording(recording(axes), 2)
    published = np.sqrt(
        np.array([2.830e-6, 4.934e-6, 3.320e-6, 1.0907e-3, 9.280e-4, 2.1464e-3]) * DT
    )
    ratio = np.array([density(r) for r in found.channels]) / published
    assert np.all((ratio > 0.7) & (ratio < 1.02))
    line = found.channels[1].model.find("periodic") or found.channels[1].model.find("narrow_band")
    assert abs(line.effect.frequency_hz - 38.0) < 0.1
    for result in found.channels:
        model = np.sqrt(model_allan_variance(result.model, result.allan.tau_s, DT))
        assert np.mean((result.allan.lower <= model) & (model <= result.allan.upper)) >= 0.9


def test_a_rest_between_moves_is_not_mixed_with_other_attitudes():
    rng = np.random.default_rng(73)
    values = white(N, rng)
    values[: N // 4] += 500.0
    still = np.ones(N, dtype=bool)
    still[N // 4 : N // 2] = False
    whole = recording({"linear_acceleration.x": values})
    handled = dataclasses.replace(
        whole, channels=tuple(dataclasses.replace(c, still=still) for c in whole.channels)
    )
    (result,) = identify_recording(handled, 1).channels
    assert result.series.observed.sum() == N // 2
    assert result.channel.quality.notes[-1].endswith("15000 of 22500 still samples")
    assert names(result) == ["white_noise"]


def test_axes_that_lost_the_same_samples_do_not_seem_to_share_their_noise():
    rng = np.random.default_rng(67)
    whole = recording({f"angular_velocity.{a}": white(20_000, rng) for a in "xyz"})
    kept = rng.random(20_000) > 0.2
    lossy = tuple(
        dataclasses.replace(
            c, stamp_ns=c.stamp_ns[kept], values=c.values[kept], still=c.still[kept]
        )
        for c in whole.channels
    )
    found = identify_recording(dataclasses.replace(whole, channels=lossy))
    assert found.channels[0].series.observed.mean() < 0.85
    assert all("cross_axis" not in names(r) for r in found.channels)
