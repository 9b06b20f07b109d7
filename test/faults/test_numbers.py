"""What must not change a model: units, an offset, the pace of the clock, the order, the cores."""

import dataclasses

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from imu_noise_id.allan import allan_exact
from imu_noise_id.identify import identify_recording
from imu_noise_id.model_file import model_text
from imu_noise_id.recording import Channel, Recording
from imu_noise_id.results_file import identification_tree, json_text
from imu_noise_id.series import Series
from imu_noise_id.stamps import examine

COUNT = 4000
PERIOD_NS = 10_000_000
NAMES = tuple(f"angular_velocity.{axis}" for axis in "xyz")
few = settings(
    max_examples=5,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def channel(name, values, period_ns=PERIOD_NS):
    stamp_ns = 10**18 + period_ns * np.arange(values.size)
    still = np.ones(values.size, dtype=bool)
    return Channel("/imu/data", name, "rad/s", stamp_ns, values, still, 1e9 / period_ns)


def recording(*channels):
    return Recording("test", 10**18, channels)


def noise(seed, count=COUNT):
    rng = np.random.default_rng(seed)
    return 1e-3 * rng.standard_normal(count) + 2e-5 * np.cumsum(rng.standard_normal(count))


def parameters(found):
    """Effects with their parameters: {(effect, parameter): (value, std_error)}."""
    return {
        (fitted.name, parameter.name): (estimate.value, estimate.std_error)
        for fitted in found.model.channels[0].effects
        for parameter, estimate in zip(fitted.effect.parameters, fitted.estimates, strict=True)
    }


def same(found, expected, scale):
    """Assert that two models differ by a scale of the signal and by nothing that matters."""
    assert found.keys() == expected.keys()
    for key, (value, std_error) in expected.items():
        factor = 1.0 if key[1].endswith(("_s", "_hz")) else scale
        assert abs(found[key][0] / factor - value) < 0.02 * std_error, key


@pytest.fixture(scope="module")
def reference():
    return parameters(identify_recording(recording(channel(NAMES[0], noise(1))), 1))


@few
@given(st.sampled_from([np.pi / 180, 180 / np.pi, 1e3, 2.0**-20]))
def test_a_model_is_the_same_in_any_unit(reference, scale):
    scaled = identify_recording(recording(channel(NAMES[0], scale * noise(1))), 1)
    same(parameters(scaled), reference, scale)


@few
@given(st.floats(-20.0, 20.0))
def test_an_offset_changes_the_mean_and_nothing_else(reference, offset):
    found = identify_recording(recording(channel(NAMES[0], noise(1) + offset)), 1)
    same(parameters(found), reference, 1.0)
    assert found.model.channels[0].mean == pytest.approx(noise(1).mean() + offset, abs=1e-12)


@few
@given(st.sampled_from([250_000, 1_000_000, 5_000_000, 100_000_000]))
def test_densities_follow_the_pace_of_the_clock(reference, period_ns):
    found = parameters(identify_recording(recording(channel(NAMES[0], noise(1), period_ns)), 1))
    ratio = np.sqrt(period_ns / PERIOD_NS)
    powers = {"density": 1.0, "rate_random_walk": -1.0}  # N sigma sqrt(dt), K of a step over it
    assert found.keys() == reference.keys()
    for (effect, name), (value, std_error) in reference.items():
        power = powers.get(name, powers.get(effect))
        if power is not None:
            assert abs(found[effect, name][0] / ratio**power - value) < 0.02 * std_error


@few
@given(st.permutations(range(3)))
def test_the_order_of_the_channels_changes_nothing(order):
    channels = [channel(name, noise(k)) for k, name in enumerate(NAMES)]
    straight = identify_recording(recording(*channels), 1).model
    other = identify_recording(recording(*(channels[k] for k in order)), 1).model
    by_name = {c.name: c for c in other.channels}
    for expected in straight.channels:
        found = by_name[expected.name]
        assert [e.name for e in found.effects] == [e.name for e in expected.effects]
        np.testing.assert_array_equal(found.log_covariance, expected.log_covariance)
        assert found.effects == expected.effects


def test_one_core_or_two_write_the_same_bytes():
    whole = recording(*(channel(name, noise(k)) for k, name in enumerate(NAMES)))
    found = [identify_recording(whole, workers) for workers in (1, 2, 1)]
    assert len({model_text(f.model) for f in found}) == 1
    assert len({json_text(identification_tree(f)) for f in found}) == 1


@settings(max_examples=200, deadline=None, derandomize=True)
@given(
    scale=st.floats(1e-9, 1e9),
    offset=st.floats(-1e3, 1e3),
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(3, 300),
)
def test_an_allan_deviation_scales_with_the_signal_and_knows_no_offset(scale, offset, seed, count):
    values = np.random.default_rng(seed).standard_normal(count)
    seen = np.ones(count, dtype=bool)
    expected = allan_exact(Series(values, seen, 0.01))
    found = allan_exact(Series(scale * (values + offset), seen, 0.01))
    np.testing.assert_array_equal(found.tau_s, expected.tau_s)
    np.testing.assert_allclose(found.deviation, scale * expected.deviation, rtol=1e-6)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.lists(st.integers(0, 2**62 - 1), max_size=200))
def test_any_stamps_at_all_are_put_in_order_or_refused(stamps):
    timing = examine(np.array(stamps, np.int64))
    assert (np.diff(timing.stamp_ns) > 0).all()
    assert timing.kept.sum() == timing.stamp_ns.size
    assert timing.missing >= 0
    assert np.isfinite(timing.rate_hz)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.data(), st.integers(2, 400), st.integers(-(2**61), 2**61))
def test_stamps_mean_the_same_whenever_they_begin(data, count, begin):
    steps = data.draw(st.lists(st.integers(1, 10**9), min_size=count, max_size=count))
    stamp_ns = 2**61 + np.cumsum(steps)
    found, shifted = examine(stamp_ns), examine(stamp_ns + begin)
    assert dataclasses.replace(
        shifted, kept=found.kept, stamp_ns=found.stamp_ns
    ) == dataclasses.replace(found)
    np.testing.assert_array_equal(shifted.stamp_ns - begin, found.stamp_ns)
