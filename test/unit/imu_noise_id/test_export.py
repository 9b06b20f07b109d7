"""Every target's file, read back as that tool reads it, says the model at two rates."""

from __future__ import annotations

import math
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from imu_noise_id.errors import InputError
from imu_noise_id.export import FORMATS
from imu_noise_id.model import ChannelModel, NoiseModel, UpperBound
from imu_noise_id.model_file import CHANNEL_TOPICS, typed_effect
from imu_noise_id.recording import unit_of

RATES = (100.0, 1000.0)
GYRO, ACCEL = "angular_velocity", "linear_acceleration"
NOISE = {GYRO: 1.0e-4, ACCEL: 2.0e-3, "position": 0.3, "velocity": 0.05, "magnetic_field": 4e-8}


def _channel(
    name: str, effects: dict[str, dict[str, float | str]], mean: float = 0.0
) -> ChannelModel:
    fitted = tuple(typed_effect(effect, name, values) for effect, values in effects.items())
    return ChannelModel(name, CHANNEL_TOPICS[name], unit_of(name), 200.0, mean, fitted)


def _model(**more: dict[str, float | str]) -> NoiseModel:
    """Every three-axis channel with white noise; axis z or up twice as loud; ``more`` on all."""
    channels = []
    for name in CHANNEL_TOPICS:
        if name == "heading":
            continue
        density = NOISE[name.split(".")[0]] * (2.0 if name[-1] in "zp" else 1.0)
        channels.append(_channel(name, {"white_noise": {"density": density}, **more}, 0.01))
    return NoiseModel(tuple(channels), source="test")


WALK = {"rate_random_walk": {"coefficient": 3.0e-6}}
MARKOV = {"gauss_markov": {"sigma": 2.0e-4, "correlation_time_s": 80.0}}


@pytest.mark.parametrize("rate_hz", RATES)
def test_kalibr_gets_continuous_densities_whatever_the_rate(rate_hz: float) -> None:
    imu = yaml.safe_load(FORMATS["kalibr"](_model(**WALK), rate_hz).text)
    assert imu["update_rate"] == rate_hz
    assert imu["rostopic"] == "/imu/data"
    assert imu["gyroscope_noise_density"] == 2.0e-4
    assert imu["accelerometer_noise_density"] == 4.0e-3
    assert imu["gyroscope_random_walk"] == pytest.approx(3.0e-6, rel=1e-15)
    assert all(isinstance(v, float) for k, v in imu.items() if k != "rostopic")


@pytest.mark.parametrize("rate_hz", RATES)
def test_kalibr_takes_a_gauss_markov_term_as_its_short_time_walk(
    rate_hz: float,
) -> None:
    exported = FORMATS["kalibr"](_model(**MARKOV), rate_hz)
    walk = yaml.safe_load(exported.text)["gyroscope_random_walk"]
    assert walk == pytest.approx(2.0e-4 * math.sqrt(2.0 / 80.0), rel=1e-12)
    assert any("gauss_markov" in note for note in exported.notes)


@pytest.mark.parametrize("rate_hz", RATES)
def test_flicker_becomes_the_walk_that_meets_its_floor_where_white_noise_does(
    rate_hz: float,
) -> None:
    floor = 5.0e-5
    flicker = {"bias_instability": {"coefficient": floor / math.sqrt(2 * math.log(2) / math.pi)}}
    walk = yaml.safe_load(FORMATS["kalibr"](_model(**flicker), rate_hz).text)[
        "gyroscope_random_walk"
    ]
    onset_s = (1.0e-4 / floor) ** 2  # axes x and y: their onset is earlier, so their walk is larger
    assert walk * math.sqrt(onset_s / 3.0) == pytest.approx(floor, rel=1e-12)


@pytest.mark.parametrize("rate_hz", RATES)
def test_gtsam_gets_squared_densities_per_axis(rate_hz: float) -> None:
    values = yaml.safe_load(FORMATS["gtsam"](_model(**WALK), rate_hz).text)
    np.testing.assert_allclose(
        values["gyroscope_covariance"], np.diag([1e-8, 1e-8, 4e-8]), rtol=1e-14
    )
    np.testing.assert_allclose(
        values["accelerometer_covariance"], np.diag([4e-6, 4e-6, 16e-6]), rtol=1e-14
    )
    np.testing.assert_allclose(values["bias_omega_covariance"], 9e-12 * np.eye(3), rtol=1e-14)
    assert values["rate_hz"] == rate_hz


@pytest.mark.parametrize("rate_hz", RATES)
def test_robot_localization_gets_variances_per_message_and_noise_per_second(
    rate_hz: float,
) -> None:
    tree = yaml.safe_load(FORMATS["robot_localization"](_model(**MARKOV), rate_hz).text)
    measured = tree["measurement_covariances"]["ros__parameters"]
    gyro = np.array(measured["angular_velocity_covariance"]).reshape(3, 3)
    expected = np.array([1e-8, 1e-8, 4e-8]) * rate_hz + 4e-8
    np.testing.assert_allclose(gyro, np.diag(expected), rtol=1e-12)
    assert set(measured) == {
        *("angular_velocity_covariance", "linear_acceleration_covariance"),
        *("position_covariance", "velocity_covariance"),
    }
    process = np.array(tree["ekf_filter_node"]["ros__parameters"]["process_noise_covariance"])
    assert process.size == 225
    diagonal = np.diag(process.reshape(15, 15))
    np.testing.assert_allclose(diagonal[3:9], [1e-8, 1e-8, 4e-8, 4e-6, 4e-6, 16e-6], rtol=1e-12)


def _played_by_gazebo(noise: ElementTree.Element, rate_hz: float) -> tuple[float, float]:
    """Allan's N of the white part and the bias's stationary sigma, as gz-sensors plays them."""
    values = {child.tag: float(child.text or "nan") for child in noise}
    diffusion = values.get("dynamic_bias_stddev", 0.0)
    time_s = values.get("dynamic_bias_correlation_time", 1.0)
    dt = 1.0 / rate_hz
    per_step = diffusion**2 * time_s / 2.0 * -math.expm1(-2.0 * dt / time_s)
    stationary = math.sqrt(per_step / -math.expm1(-2.0 * dt / time_s))
    return values["stddev"] * math.sqrt(dt), stationary


@pytest.mark.parametrize("rate_hz", RATES)
def test_gazebo_plays_the_model_at_the_rate_it_was_written_for(rate_hz: float) -> None:
    root = ElementTree.fromstring(FORMATS["gazebo"](_model(**MARKOV), rate_hz).text)
    for sensor in root.findall("sensor"):
        assert float(sensor.findtext("update_rate", "")) == rate_hz
    for quantity in (GYRO, ACCEL):
        for axis, factor in (("x", 1.0), ("y", 1.0), ("z", 2.0)):
            noise = root.find(f"./sensor[@type='imu']/imu/{quantity}/{axis}/noise")
            assert noise is not None
            density, sigma = _played_by_gazebo(noise, rate_hz)
            assert density == pytest.approx(NOISE[quantity] * factor, rel=1e-12)
            assert sigma == pytest.approx(2.0e-4, rel=1e-9)
            mean = 0.01 if quantity == GYRO else 0.0
            assert float(noise.findtext("mean", "")) == mean
    up = root.find("./sensor[@type='navsat']/navsat/position_sensing/vertical/noise")
    assert up is not None
    assert float(up.findtext("stddev", "")) == pytest.approx(0.6 * math.sqrt(rate_hz))


def test_gazebo_rounds_where_its_own_limit_allows() -> None:
    for step, kind in ((1.0e-3, "gaussian_quantized"), (1.0e-7, "gaussian")):
        exported = FORMATS["gazebo"](_model(output_rounding={"step": step}), 100.0)
        root = ElementTree.fromstring(exported.text)
        noise = root.find(f"./sensor[@type='imu']/imu/{GYRO}/x/noise")
        assert noise is not None
        assert noise.get("type") == kind
        assert any("output_rounding" in note for note in exported.notes) == (kind == "gaussian")


@pytest.mark.parametrize("target", sorted(FORMATS))
def test_what_a_target_cannot_hold_is_named(target: str) -> None:
    line = {"periodic": {"frequency_hz": 43.0, "amplitude": 0.02}}
    exported = FORMATS[target](_model(**line), 200.0)
    assert any("periodic" in n and "43" in n and target in n for n in exported.notes)
    assert "periodic" in exported.text


@pytest.mark.parametrize("target", ["gazebo", "robot_localization"])
def test_a_sensor_written_for_another_rate_than_its_own_is_named(target: str) -> None:
    notes = FORMATS[target](_model(), 100.0).notes
    assert any("position: recorded at 200 Hz, written for 100 Hz" in note for note in notes)
    assert not FORMATS[target](_model(), 200.0).notes


@pytest.mark.parametrize("target", ["kalibr", "gtsam"])
def test_a_model_without_a_needed_channel_or_white_noise_is_refused(target: str) -> None:
    model = _model()
    without = NoiseModel(tuple(c for c in model.channels if c.name != f"{GYRO}.y"), source="m.yaml")
    with pytest.raises(InputError, match=r"angular_velocity\.y"):
        FORMATS[target](without, 200.0)
    silent = NoiseModel(
        tuple(_channel(c.name, WALK) for c in model.channels if c.topic == "/imu/data")
    )
    with pytest.raises(InputError, match="white_noise"):
        FORMATS[target](silent, 200.0)


def test_a_channel_of_correlated_noise_alone_still_has_a_variance() -> None:
    channels = tuple(_channel(f"position.{axis}", MARKOV) for axis in ("east", "north", "up"))
    text = FORMATS["robot_localization"](NoiseModel(channels), 10.0).text
    measured = yaml.safe_load(text)["measurement_covariances"]["ros__parameters"]
    np.testing.assert_allclose(
        np.array(measured["position_covariance"]).reshape(3, 3), 4e-8 * np.eye(3), rtol=1e-12
    )


@pytest.mark.parametrize("target", sorted(FORMATS))
def test_hostile_names_stay_inside_comments(target: str) -> None:
    channels = tuple(
        ChannelModel(
            c.name, "/imu'\n-->evil: {x}", c.unit, c.rate_hz, c.mean, c.effects, None, 600.0,
            (UpperBound("rate_random_walk", "coefficient", "", 1e-7, "--><evil/>\nevil: 1"),),
        )
        for c in _model().channels
    )  # fmt: skip
    text = FORMATS[target](NoiseModel(channels, source="x\ny: 1"), 200.0).text
    if target == "gazebo":
        assert ElementTree.fromstring(text).find("evil") is None
    else:
        assert "evil" not in yaml.safe_load(text)


@pytest.mark.parametrize("target", sorted(FORMATS))
def test_what_holds_for_all_axes_is_said_once(target: str) -> None:
    line = {"periodic": {"frequency_hz": 43.0, "amplitude": 1e-3}}
    exported = FORMATS[target](_model(**line), 200.0)
    about = [note for note in exported.notes if "periodic" in note]
    axes = f"{GYRO}.x, {GYRO}.y, {GYRO}.z"
    assert sum(axes in note for note in about) == 1
    assert sum("periodic" in line for line in exported.text.splitlines()) == len(about)
