"""Curves for pictures lose no extreme and add up to what the model predicts."""

from __future__ import annotations

import numpy as np
from imu_noise_id.curves import model_allan_variance
from imu_noise_id.model import ChannelModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.report.curves import allan_parts, envelope, psd_parts
from imu_noise_id.series import Series

NAME = "angular_velocity.x"


def test_an_envelope_keeps_every_extreme_and_marks_what_was_not_seen() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=10_007)
    values[4321] = 50.0
    values[8765] = -40.0
    observed = np.ones(values.size, dtype=bool)
    observed[2000:4000] = False
    course = envelope(Series(np.where(observed, values, 0.0), observed, 0.01, 3.0), 100)
    assert course.time_s.size <= 100
    assert np.nanmax(course.high) == 50.0
    assert np.nanmin(course.low) == -40.0
    unseen = np.isnan(course.mean)
    assert np.all((course.time_s[unseen] > 23.0) & (course.time_s[unseen] < 43.0))
    assert unseen.sum() >= 18
    seen = ~unseen
    assert np.all(course.low[seen] <= course.mean[seen])
    assert np.all(course.mean[seen] <= course.high[seen])


def test_shares_add_up_to_the_whole_model() -> None:
    fitted = (
        typed_effect("white_noise", NAME, {"density": 1e-4}),
        typed_effect("gauss_markov", NAME, {"sigma": 1e-4, "correlation_time_s": 10.0}),
        typed_effect("gauss_markov", NAME, {"sigma": 3e-4, "correlation_time_s": 300.0}),
        typed_effect("rate_random_walk", NAME, {"coefficient": 1e-6}),
    )
    model = ChannelModel(NAME, "/imu/data", "rad/s", 100.0, 0.0, fitted)
    tau_s = np.geomspace(0.01, 1000.0, 30)
    parts = allan_parts(model, tau_s, 0.01)
    assert [p.label for p in parts] == [
        "white_noise",
        "gauss_markov",
        "gauss_markov 2",
        "rate_random_walk",
    ]
    total = np.sum([part.values**2 for part in parts], axis=0)
    np.testing.assert_allclose(total, model_allan_variance(model, tau_s, 0.01), rtol=1e-12)


def test_a_bandwidth_shapes_every_source_and_has_no_share_of_its_own() -> None:
    white = typed_effect("white_noise", NAME, {"density": 1e-4})
    limit = typed_effect("bandwidth_limit", NAME, {"cutoff_hz": 5.0, "order": 2.0, "damping": 0.7})
    model = ChannelModel(NAME, "/imu/data", "rad/s", 100.0, 0.0, (white, limit))
    frequency_hz = np.geomspace(0.1, 50.0, 20)
    (part,) = psd_parts(model, frequency_hz, 0.01)
    assert part.values[0] > 0.99e-8
    assert part.values[-1] < 0.01e-8
    (share,) = allan_parts(model, np.array([0.01, 10.0]), 0.01)
    assert share.label == "white_noise"
    assert share.values[0] < 0.5 * 1e-4 / np.sqrt(0.01)
    assert np.isclose(share.values[1], 1e-4 / np.sqrt(10.0), rtol=0.02)


def test_courses_rounding_and_outliers_have_shares_too() -> None:
    fitted = (
        typed_effect("white_noise", NAME, {"density": 1e-4}),
        typed_effect("bias_step", NAME, {"time_s": 300.0, "height": 1e-3}),
        typed_effect("outliers", NAME, {"rate": 1e-3, "scale": 0.1}),
        typed_effect("output_rounding", NAME, {"step": 1e-5}),
    )
    model = ChannelModel(NAME, "/imu/data", "rad/s", 100.0, 0.0, fitted, None, 600.0)
    tau_s = np.geomspace(0.01, 100.0, 20)
    parts = allan_parts(model, tau_s, 0.01)
    assert [part.label for part in parts] == [f.name for f in fitted]
    assert all(np.all(part.values > 0.0) for part in parts)
    total = np.sum([part.values**2 for part in parts], axis=0)
    np.testing.assert_allclose(total, model_allan_variance(model, tau_s, 0.01), rtol=0.02)
