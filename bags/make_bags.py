"""Make the recordings of this folder anew: ``python bags/make_bags.py``.

The noises are filtered white noise, by numpy and scipy alone: nothing of the package's effects or
simulation takes part, so that identifying these bags tests it.  The same seeds give the same
values.  Beside each bag lies ``NAME.truth.yaml`` with what was put in.
"""

from __future__ import annotations

import argparse
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from imu_noise_id.bag_writer import TopicBytes, write_bag
from numpy.typing import NDArray
from scipy.signal import bilinear, lfilter

from imu_noise_id import cdr

Floats = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
START_NS = 1_700_000_000_000_000_000
G = 9.80665
TO_SI = {"deg/s": np.deg2rad(1.0), "g": G, "m": 1.0, "m/s": 1.0, "rad": 1.0}
ORIGIN = (39.8686, 32.7347, 900.0)
METRES_PER_DEGREE = (111_028.0, 85_580.0)
"""North and east at the origin's latitude, to 0.1 %: what is written, not what must come back."""
HORIZONTAL_T, VERTICAL_T = 2.5e-5, -4.0e-5
LSB_PER_SIGMA = 8.0
WARM_UP = 5000


@dataclass
class Bag:
    """Topics and truth of one recording."""

    name: str
    about: str
    duration_s: float
    topics: list[TopicBytes] = field(default_factory=list)
    truth: dict[str, Any] = field(default_factory=dict)

    def stamps(self, rate_hz: float) -> NDArray[np.int64]:
        """Stamps of a topic at its rate."""
        count = round(self.duration_s * rate_hz)
        return START_NS + np.rint(np.arange(count) * (1e9 / rate_hz)).astype(np.int64)

    def rng(self, channel: str) -> np.random.Generator:
        """A generator that depends on the bag's and the channel's name only."""
        return np.random.default_rng(zlib.crc32(f"{self.name} {channel}".encode()))

    def add(self, topic: str, msgtype: str, rate_hz: float, frame: str, **members: Floats) -> None:
        """Add a topic; ``angular_velocity_x`` stands for ``angular_velocity.x``."""
        named = {k.replace("__", "."): v for k, v in members.items()}
        stamp_ns = self.stamps(rate_hz)
        rows = cdr.encode(msgtype, stamp_ns, named, frame)
        self.topics.append(TopicBytes(topic, msgtype, stamp_ns, rows))

    def write(self) -> None:
        """Write the bag and its truth."""
        write_bag(HERE / self.name, self.topics)
        content = {"bag": self.name, "about": self.about, "channels": self.truth}
        text = yaml.safe_dump(content, sort_keys=False, width=100)
        (HERE / f"{self.name}.truth.yaml").write_text(text)


def coefficients(sensor: dict[str, Any]) -> tuple[list[float], list[float]]:
    """Numerator and denominator in z^-1 of a sensor's model, in SI units."""
    if "H_z" in sensor:
        a0, a1, b0, b1 = sensor["H_z"]
        numerator, denominator = [a0 / b0, a1 / b0], [1.0, b1 / b0]
    else:
        n1, n0, p = sensor["H_s"]
        numerator, denominator = (
            x.tolist() for x in bilinear([n1, n0], [1.0, p], sensor["rate_hz"])
        )
    return [float(x * TO_SI[sensor["unit"]]) for x in numerator], [float(x) for x in denominator]


def model_noise(bag: Bag, channel: str, sensor: dict[str, Any], mean: float = 0.0) -> Floats:
    """The output of a sensor's model, with its truth noted under the channel's name."""
    numerator, denominator = coefficients(sensor)
    count = round(bag.duration_s * sensor["rate_hz"])
    white = bag.rng(channel).standard_normal(count + WARM_UP)
    noise = lfilter(numerator, denominator, white)[WARM_UP:]
    gain = sum(numerator) / sum(denominator)
    bag.truth[channel] = {
        "sensor": sensor["name"],
        "rate_hz": sensor["rate_hz"],
        "H_z": {"numerator": numerator, "denominator": denominator},
        "innovation_std": abs(numerator[0]),
        "pole": -denominator[1],
        "zero": -numerator[1] / numerator[0],
        "density_at_zero_hz": abs(gain) / sensor["rate_hz"] ** 0.5,
        "std": float(np.sqrt(variance(numerator, denominator))),
        "mean": mean,
    }
    return mean + noise


def variance(numerator: list[float], denominator: list[float]) -> float:
    """Variance of an ARMA(1,1): (b0^2 + b1^2 - 2 b0 b1 a1) / (1 - a1^2)."""
    b0, b1, a1 = numerator[0], numerator[1], denominator[1]
    return (b0**2 + b1**2 - 2 * b0 * b1 * a1) / (1 - a1**2)


def allan_noise(
    bag: Bag, channel: str, rate_hz: float, effects: dict[str, dict[str, float]], mean: float
) -> Floats:
    """White noise, a Gauss-Markov process and a line, rounded to a step."""
    rng = bag.rng(channel)
    count = round(bag.duration_s * rate_hz)
    values = mean + effects["white_noise"]["density"] * rate_hz**0.5 * rng.standard_normal(count)
    slow = effects["gauss_markov"]
    pole = np.exp(-1.0 / (rate_hz * slow["correlation_time_s"]))
    start = slow["sigma"] * rng.standard_normal()
    drive = slow["sigma"] * np.sqrt(1 - pole**2) * rng.standard_normal(count)
    values += lfilter([1.0], [1.0, -pole], drive, zi=[pole * start])[0]
    if "periodic" in effects:
        line = effects["periodic"]
        phase = 2 * np.pi * line["frequency_hz"] * np.arange(count) / rate_hz
        values += line["amplitude"] * np.sin(phase + 2 * np.pi * rng.random())
    step = effects["output_rounding"]["step"]
    bag.truth[channel] = {"rate_hz": rate_hz, "mean": mean, "effects": effects}
    return step * np.rint(values / step)


def rounded(values: Floats, step: float) -> Floats:
    """Values in whole steps, as a converter gives them."""
    return step * np.rint(values / step)


def add_model_imu(bag: Bag, sensors: list[dict[str, Any]]) -> None:
    """An Imu topic of three gyro and three accelerometer models, rounded to an eighth of sigma."""
    members = {}
    names = [f"{s}.{a}" for s in ("angular_velocity", "linear_acceleration") for a in "xyz"]
    for channel, sensor in zip(names, sensors, strict=True):
        mean = G if channel == "linear_acceleration.z" else 0.0
        values = model_noise(bag, channel, sensor, mean)
        step = bag.truth[channel]["std"] / LSB_PER_SIGMA
        bag.truth[channel]["output_rounding_step"] = step
        members[channel.replace(".", "__")] = rounded(values, step)
    bag.add("/imu/data", cdr.IMU, sensors[0]["rate_hz"], "imu_link", **members)


def add_receiver(bag: Bag, sensors: dict[str, Any]) -> None:
    """Fixes and velocities of the receiver's six models."""
    position = {
        axis: model_noise(bag, f"position.{axis}", sensors[name])
        for axis, name in (("north", "latitude"), ("east", "longitude"), ("up", "altitude"))
    }
    covariance = {
        f"position_covariance__{k}": np.array(bag.truth[f"position.{axis}"]["std"] ** 2)
        for k, axis in ((0, "east"), (4, "north"), (8, "up"))
    }
    bag.add(
        "/gps/fix",
        cdr.NAV_SAT_FIX,
        10.0,
        "gps_antenna",
        latitude=rounded(ORIGIN[0] + position["north"] / METRES_PER_DEGREE[0], 1e-9),
        longitude=rounded(ORIGIN[1] + position["east"] / METRES_PER_DEGREE[1], 1e-9),
        altitude=rounded(ORIGIN[2] + position["up"], 1e-4),
        covariance_type=np.array(2.0),
        **covariance,
    )
    velocity = {
        f"linear__{axis}": rounded(
            model_noise(bag, f"velocity.{name}", sensors[f"velocity_{name}"]), 1e-3
        )
        for axis, name in (("x", "east"), ("y", "north"), ("z", "up"))
    }
    bag.add("/gps/vel", cdr.TWIST, 10.0, "enu", **velocity)


def add_magnetometer(bag: Bag, sensor: dict[str, Any]) -> None:
    """A level field whose heading has the magnetometer model's noise."""
    angle = model_noise(bag, "heading", sensor, 0.6)
    count = angle.size
    bag.add(
        "/imu/mag",
        cdr.MAGNETIC_FIELD,
        sensor["rate_hz"],
        "imu_link",
        magnetic_field__x=rounded(HORIZONTAL_T * np.cos(angle), 1e-9),
        magnetic_field__y=rounded(-HORIZONTAL_T * np.sin(angle), 1e-9),
        magnetic_field__z=rounded(VERTICAL_T + 5e-8 * bag.rng("z").standard_normal(count), 1e-9),
    )


def demo_mems(sensors: dict[str, Any], allan: dict[str, Any]) -> Bag:
    """A MEMS IMU, magnetometer and receiver left on a bench for nine minutes."""
    bag = Bag(
        "demo_mems",
        "Over eight minutes at rest. Imu: white noise and bias instability (as a Gauss-Markov "
        "process of 60 s whose Allan maximum, 0.617 sigma, is the flat part's 0.664 B) of Thales "
        "NavChip 3 as its Allan deviation shows them, a fan's 21.5 Hz on linear_acceleration.y, "
        "rounding. Magnetometer and receiver: chapter 5's models.",
        520.0,
    )
    gyro, force = allan["sensor_4"], allan["sensor_8"]
    kinds = {
        "angular_velocity": (
            np.deg2rad(gyro["random_walk_deg_s_rt_hz"]),
            np.deg2rad(gyro["bias_instability_deg_h"]) / 3600,
            np.deg2rad(0.005),
        ),
        "linear_acceleration": (
            1e-3 * G * force["random_walk_mg_rt_hz"],
            1e-3 * G * force["bias_instability_mg"],
            1e-3 * G / 32,
        ),
    }
    means = {"linear_acceleration.x": 0.08, "linear_acceleration.y": -0.05,
             "linear_acceleration.z": 9.82, "angular_velocity.x": 1.1e-3,
             "angular_velocity.y": -7e-4, "angular_velocity.z": 2e-4}  # fmt: skip
    members = {}
    for channel, mean in means.items():
        density, instability, step = (float(x) for x in kinds[channel.split(".")[0]])
        effects = {
            "white_noise": {"density": density},
            "gauss_markov": {"sigma": 0.664 / 0.617 * instability, "correlation_time_s": 60.0},
            "output_rounding": {"step": step},
        }
        if channel == "linear_acceleration.y":
            effects["periodic"] = {"frequency_hz": 21.5, "amplitude": 2e-3}
        members[channel.replace(".", "__")] = allan_noise(bag, channel, 100.0, effects, mean)
    bag.add("/imu/data", cdr.IMU, 100.0, "imu_link", **members)
    time_s = np.arange(bag.duration_s)
    warming = (
        31.0 + 2.5 * (1 - np.exp(-time_s / 200)) + 0.02 * bag.rng("t").standard_normal(time_s.size)
    )
    bag.add(
        "/imu/temperature", cdr.TEMPERATURE, 1.0, "imu_link", temperature=rounded(warming, 0.01)
    )
    add_magnetometer(bag, sensors["magnetometer"])
    add_receiver(bag, sensors)
    return bag


def thesis_1khz(sensors: dict[str, Any]) -> Bag:
    """Chapter 5's six sensors at 1 kHz, one an axis."""
    about = "The models of sensors 1, 2, 3 (gyro x, y, z) and 5, 6, 7 (accelerometer x, y, z)."
    bag = Bag("thesis_1khz", about, 72.0)
    add_model_imu(bag, [sensors[f"sensor_{k}"] for k in (1, 2, 3, 5, 6, 7)])
    return bag


def thesis_100hz(sensors: dict[str, Any]) -> Bag:
    """Chapter 5's MEMS IMU at 100 Hz, its magnetometer and the receiver."""
    about = (
        "The models of sensors 4 and 8 (three realisations each, of all axes), of the magnetometer "
        "(heading) and of the receiver's six channels."
    )
    bag = Bag("thesis_100hz", about, 300.0)
    add_model_imu(bag, [sensors["sensor_4"]] * 3 + [sensors["sensor_8"]] * 3)
    add_magnetometer(bag, sensors["magnetometer"])
    add_receiver(bag, sensors)
    return bag


def main() -> None:
    """Write all bags."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    content = yaml.safe_load((HERE / "sensors.yaml").read_text())
    sensors = content["sensors"]
    for bag in (
        demo_mems(sensors, content["allan"]),
        thesis_1khz(sensors),
        thesis_100hz(sensors),
    ):
        bag.write()
        size = sum(f.stat().st_size for f in (HERE / bag.name).iterdir())
        print(
            f"{bag.name}: {sum(t.log_ns.size for t in bag.topics)} messages, {size / 2**20:.2f} MB"
        )


if __name__ == "__main__":
    main()
