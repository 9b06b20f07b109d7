"""Motion told from noise, on simulated noises and on recordings that really moved."""

import numpy as np
import pytest
from imu_noise_id.bags import read_recording
from imu_noise_id.motion import Intervals, moving_intervals
from scipy.signal import lfilter

from helpers.bag_making import npz_bag

RATE = 100
COUNT = 30_000
STAMPS = 10**18 + (10**9 // RATE) * np.arange(COUNT, dtype=np.int64)
TIME = np.arange(COUNT) / RATE
IMU = tuple(f"{s}.{a}" for s in ("angular_velocity", "linear_acceleration") for a in "xyz")
FIELD = tuple(f"magnetic_field.{a}" for a in "xyz")
SIGMA = np.array([0.003] * 3 + [0.03] * 3)[:, np.newaxis]


@pytest.fixture
def rng():
    return np.random.default_rng(11)


@pytest.fixture
def resting(rng):
    values = SIGMA * rng.normal(size=(6, COUNT))
    values[5] += 9.81
    return values


def moved(values):
    return moving_intervals([(IMU, STAMPS, values)]).seconds_since(int(STAMPS[0]))


def gauss_markov(rng, sigma, correlation_time_s):
    pole = np.exp(-1.0 / (RATE * correlation_time_s))
    return lfilter([sigma * np.sqrt(1 - pole**2)], [1, -pole], rng.normal(size=COUNT))


def test_white_noise_is_no_motion(resting):
    assert moved(resting) == ()


def test_loud_white_noise_is_no_motion(resting):
    resting[:5] *= 50
    assert moved(resting) == ()


@pytest.mark.parametrize("correlation_time_s", [0.3, 1.0, 3.0, 10.0, 100.0])
@pytest.mark.parametrize("axes", [slice(0, 3), slice(3, 6), slice(0, 6)])
def test_loud_coloured_noise_is_no_motion(rng, resting, correlation_time_s, axes):
    loud = [gauss_markov(rng, sigma, correlation_time_s) for sigma in 15 * SIGMA[axes, 0]]
    resting[axes] += np.array(loud)
    still = moving_intervals([(IMU, STAMPS, resting)]).still(STAMPS)
    assert still.mean() > 0.98


def test_drift_of_all_axes_is_no_motion(resting):
    resting += TIME / TIME[-1] * np.array([0.1] * 3 + [1.0] * 3)[:, np.newaxis]
    assert moved(resting) == ()


def test_random_walks_are_no_motion(rng, resting):
    resting += 0.1 * SIGMA * np.cumsum(rng.normal(size=(6, COUNT)), axis=1) / np.sqrt(RATE)
    assert moved(resting) == ()


@pytest.mark.parametrize(("axis", "height"), [(0, 0.3), (2, -0.1), (3, 1.0), (5, 0.5)])
def test_a_bias_step_of_one_axis_is_no_motion(resting, axis, height):
    resting[axis, COUNT // 2 :] += height
    assert moved(resting) == ()


def test_a_burst_of_noise_on_all_axes_is_no_motion(rng, resting):
    resting[:, 10_000:15_000] += 30 * SIGMA * rng.normal(size=(6, 5000))
    assert moved(resting) == ()


def test_vibration_that_sets_in_is_no_motion(resting):
    wave = np.sin(2 * np.pi * 38.0 * TIME) * (TIME > 150)
    resting += np.array([0.5] * 3 + [5.0] * 3)[:, np.newaxis] * wave
    assert moved(resting) == ()


def test_outliers_are_no_motion(rng, resting):
    resting[rng.random((6, COUNT)) < 1e-3] += 5.0
    assert moved(resting) == ()


def test_held_samples_are_no_motion(resting):
    assert moved(np.repeat(resting[:, ::20], 20, axis=1)) == ()


def test_what_moves_is_found_and_no_more(resting):
    part = (TIME > 200) & (TIME < 230)
    resting[0] += part * 0.2 * np.sin(2 * TIME)
    resting[3] += part * 1.0 * np.sin(2 * TIME)
    resting[4] += part * 0.7 * np.cos(2 * TIME)
    ((begin, end),) = moved(resting)
    assert 196 <= begin <= 200
    assert 230 <= end <= 234


def test_what_lies_turned_is_left_out(resting):
    resting[3, 20_000:] += 9.81 * np.sin(0.3)
    resting[5, 20_000:] -= 9.81 * (1 - np.cos(0.3))
    parts = moved(resting)
    assert parts[0][0] >= 195
    assert parts[-1][1] > 299


def test_gaps_and_missing_values_are_no_motion(resting):
    resting[1, 4000:4500] = np.nan
    there = (TIME < 100) | (TIME > 160)
    assert moving_intervals([(IMU, STAMPS[there], resting[:, there])]).begin_ns.size == 0


def test_a_magnetometer_alone_shows_motion(rng):
    values = np.array((2e-5, 0.0, -4e-5))[:, np.newaxis] + 1e-7 * rng.normal(size=(3, COUNT))
    values[0] += np.where(TIME > 250, 5e-6 * np.sin(TIME), 0.0)
    values[1] += np.where(TIME > 250, 5e-6 * np.cos(TIME), 0.0)
    ((begin, end),) = moving_intervals([(FIELD, STAMPS, values)]).seconds_since(int(STAMPS[0]))
    assert 246 <= begin <= 250
    assert end > 299


def test_a_receiver_that_drives_steadily_moves(rng):
    stamp_ns = STAMPS[::10]
    east = 15.0 * TIME[::10] + rng.normal(size=stamp_ns.size)
    values = np.array((east, 0 * east, 0 * east))
    still = moving_intervals([(("position.east",), stamp_ns, values)]).still(stamp_ns)
    assert not still.any()


def test_a_receiver_that_wanders_by_metres_stands(rng):
    stamp_ns = STAMPS[::10]
    values = np.array([gauss_markov(rng, 2.0, 60.0)[::10] for _ in range(3)])
    values[:, 1000:1010] += 40.0  # a glitch of one second
    assert moving_intervals([(("position.east",), stamp_ns, values)]).begin_ns.size == 0


def test_velocity_shows_motion_whatever_the_imu_says(resting):
    stamp_ns = STAMPS[::10]
    speed = np.where((TIME[::10] > 100) & (TIME[::10] < 150), 3.0, 0.0)
    velocity = np.array((speed, speed, 0 * speed))
    found = moving_intervals(
        [(IMU, STAMPS, resting), (("velocity.east",), stamp_ns, velocity)]
    ).seconds_since(int(STAMPS[0]))
    assert found[0] == pytest.approx((100.0, 149.9), abs=1.1)


def test_intervals_know_what_is_still():
    parts = Intervals(np.array([10, 50]), np.array([20, 60]))
    assert parts.still(np.array([9, 10, 15, 20, 21, 49, 50, 60, 61])).tolist() == [
        True, False, False, False, True, True, False, False, True
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "begin_s", "end_s"),
    [
        ("xio_fusion", 13.6, None),
        ("broad_01_undisturbed_slow_rotation_A", 33.8, 159.8),
        ("qmc5883_calib_50hz", 63.0, None),
        ("mpu6050_static_100hz", None, None),
        ("swift_static10hz", None, None),
    ],
)
def test_real_recordings(shared_data, tmp_path, name, begin_s, end_s):
    recording = read_recording(npz_bag(shared_data(f"{name}.npz"), tmp_path))
    parts = recording.channels[0].quality.moving_s
    if begin_s is None:
        assert parts == ()
        return
    # samples beside a motion may go, and a hand at rest for seconds may pass for a table; the
    # magnetometer is handled in its first 4 s too, where two axes change by a tenth
    starts = [begin for begin, _ in parts if begin > 5.0]
    assert begin_s - 4 <= starts[0] <= begin_s + 6
    if end_s is not None:
        assert end_s - 1 <= parts[-1][1] <= end_s + 4


@pytest.mark.parametrize("name", ["comma2k19_ex1", "inav_f450_glitch_log"])
def test_what_moves_throughout_has_no_still_sample(shared_data, tmp_path, name):
    recording = read_recording(npz_bag(shared_data(f"{name}.npz"), tmp_path))
    channel = recording.channel("angular_velocity.x")
    assert not channel.quality.static
    assert channel.still.mean() < 0.05
    assert any("moved" in note for note in channel.quality.notes)


def test_knocks_are_left_out_where_the_platform_moved(rng):
    count = 12000
    gyro, accel = rng.normal(0.0, 0.002, (count, 3)), rng.normal(0.0, 0.02, (count, 3))
    accel[:, 2] += 9.81
    gyro[2000:3000] += rng.normal(0.0, 0.5, (10, 3)).repeat(100, axis=0)
    knock = slice(7000, 7040)
    gyro[knock] += rng.normal(0.0, 0.02, (40, 3))
    accel[knock] += rng.normal(0.0, 0.3, (40, 3))
    stamps = np.arange(count) * 10_000_000
    moving = moving_intervals([(IMU, stamps, np.vstack((gyro.T, accel.T)))])
    still = moving.still(stamps)
    assert not still[knock].any()
    assert still[4000:6800].all()
    assert still[7300:].all()
