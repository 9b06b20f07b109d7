"""The axes of a sensor are put on one grid, modelled together, and compared with Allan."""

import dataclasses

import numpy as np
import pytest
from imu_noise_id.axes_together import aligned, modes
from imu_noise_id.canonical_variates import StateSpace
from imu_noise_id.identify import identify_recording
from imu_noise_id.recording import Channel, Quality, Recording, unit_of
from imu_noise_id.report.identification import identification_page
from imu_noise_id.results_file import identification_tree
from imu_noise_id.series import Series
from scipy.signal import lfilter

RATE_HZ = 100.0
START_NS = 10**18


def channel(name, values):
    stamp_ns = START_NS + np.rint(np.arange(values.size) * 1e9 / RATE_HZ).astype(np.int64)
    still = np.ones(values.size, dtype=bool)
    return Channel("/imu/data", name, unit_of(name), stamp_ns, values, still, RATE_HZ, Quality())


@pytest.fixture(scope="module")
def identification():
    rng = np.random.default_rng(1)
    size, pole = 40_000, np.exp(-0.01 / 4.0)
    drive = rng.standard_normal(size + 4000) * np.sqrt(1.0 - pole**2)
    slow = lfilter([1.0], [1.0, -pole], drive)[-size:]
    shares = {"x": 0.15, "y": -0.1, "z": 0.2}
    channels = [
        channel(f"angular_velocity.{axis}", share * slow + rng.standard_normal(size))
        for axis, share in shares.items()
    ]
    channels.append(channel("linear_acceleration.x", rng.standard_normal(size)))
    return identify_recording(Recording("made", START_NS, tuple(channels)))


def test_a_shared_state_is_one_state_and_agrees_with_allan(identification):
    (sensor,) = identification.sensors
    assert sensor.names == tuple(f"angular_velocity.{axis}" for axis in "xyz")
    assert sensor.model.order == 1
    alone = [identification.channel(name) for name in sensor.names]
    assert sum(result.cca.order for result in alone) == 3
    for result, joint_distance in zip(alone, sensor.distances, strict=True):
        assert joint_distance < 0.15  # the measured curve's own scatter is about a tenth
        assert joint_distance < result.cca_distance + 0.05
    (mode,) = modes(sensor.model.state_space)
    np.testing.assert_allclose(mode.sigma, [0.15, 0.1, 0.2], rtol=0.3)
    assert mode.time_constant_s == pytest.approx(4.0, rel=0.5)
    np.testing.assert_allclose(sensor.innovation_correlation, np.eye(3), atol=0.03)


def test_modes_of_a_resonance_are_one_pair():
    turn = 0.98 * np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    space = StateSpace(turn, np.array([[1.0, 0.0]]), np.array([[0.3], [0.0]]), np.eye(1), 0.01)
    (mode,) = modes(space)
    rng = np.random.default_rng(2)
    b, a = [0.0, 0.3, -0.3 * turn[0, 0]], [1.0, -2 * turn[0, 0], 0.98**2]
    assert mode.sigma[0] == pytest.approx(
        lfilter(b, a, rng.standard_normal(400_000)).std(), rel=0.03
    )
    assert mode.frequency_hz == pytest.approx(0.5 / (2 * np.pi * 0.01))
    assert mode.time_constant_s == pytest.approx(-0.01 / np.log(0.98))


def test_axes_are_cut_to_what_they_have_in_common():
    whole = Series(np.arange(10.0), np.ones(10, dtype=bool), 0.01, 1.0)
    late = dataclasses.replace(
        whole, values=np.arange(2.0, 9.0), observed=whole.observed[:7], start_s=1.02
    )
    cut = aligned([whole, late])
    assert cut is not None
    for series in cut:
        np.testing.assert_array_equal(series.values, np.arange(2.0, 9.0))
        assert series.start_s == pytest.approx(1.02)
    apart = dataclasses.replace(late, start_s=9.0)
    assert aligned([whole, apart]) is None
    assert aligned([whole, dataclasses.replace(late, sample_time_s=0.02)]) is None


def test_the_report_and_the_results_say_what_the_axes_share(identification):
    html = identification_page(identification)
    assert "Gyroscope: axes together" in html
    assert "Axes share states" in html
    assert "CCA of all axes, order 1" in html
    assert "has nothing to do with the sensor" in html  # what an independent input cannot find
    tree = identification_tree(identification)
    (sensor,) = tree["sensors"]
    assert np.shape(sensor["C"]) == (3, 1)
    assert sensor["allan_distance"] == list(identification.sensors[0].distances)
    for channel_tree in tree["channels"][:3]:
        assert 0.0 < channel_tree["cca"]["allan_distance"] < 0.15
