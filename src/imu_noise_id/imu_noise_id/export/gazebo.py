"""Gazebo's SDF ``<noise>``: what gz-sensors and Gazebo classic play per sample."""

from __future__ import annotations

import math
from xml.etree import ElementTree

from imu_noise_id.errors import InputError
from imu_noise_id.export.reduction import (
    WHITE_AND_DRIFT,
    Drift,
    Exported,
    channels_of,
    drift,
    has_axes,
    joined,
    left_out,
    slower_sensors,
)
from imu_noise_id.model import ChannelModel, NoiseModel

_SMALLEST_PRECISION = 1.0e-6  # gz-sensors takes a smaller one for none
_HEAD = """ Noise of the real sensor for Gazebo, written by imu_noise_id.
     stddev: per sample, density*sqrt(rate), for sensors that run at {rate:g} Hz only; SI units.
     dynamic_bias_stddev: Gazebo takes a diffusion density here, unit/s/sqrt(Hz): the bias has the
     sigma dynamic_bias_stddev*sqrt(dynamic_bias_correlation_time/2), and starts at 0.
     mean: the recorded turn-on bias of gyros (accelerometers show gravity, so theirs is left out).
{notes}"""


def export(model: NoiseModel, rate_hz: float) -> Exported:
    """Write one ``<sensor>`` a sensor, to be merged into a model's SDF.

    Raises
    ------
    InputError
        When the model has no sensor that Gazebo knows.
    """
    notes = slower_sensors(model, rate_hz)
    root = ElementTree.Element("sdf", version="1.9")
    if has_axes(model, "angular_velocity") or has_axes(model, "linear_acceleration"):
        imu = ElementTree.SubElement(_sensor(root, "imu", rate_hz), "imu")
        for quantity in ("angular_velocity", "linear_acceleration"):
            if has_axes(model, quantity):
                _add_axes(imu, quantity, model, rate_hz, notes)
    if has_axes(model, "magnetic_field"):
        _add_axes(_sensor(root, "magnetometer", rate_hz), "magnetometer", model, rate_hz, notes)
    navsat = [q for q in ("position", "velocity") if has_axes(model, q)]
    if navsat:
        parent = ElementTree.SubElement(_sensor(root, "navsat", rate_hz), "navsat")
        for quantity in navsat:
            _add_sensing(parent, quantity, model, rate_hz, notes)
    if len(root) == 0:
        raise InputError(
            f"{model.source}: no IMU, magnetometer or GNSS with three axes: nothing for gazebo"
        )
    notes = joined(notes)
    ElementTree.indent(root)
    said = "".join(f"     {note.replace('--', '- -')}.\n" for note in notes)
    head = _HEAD.format(rate=rate_hz, notes=said)
    body = ElementTree.tostring(root, encoding="unicode")
    return Exported(f'<?xml version="1.0"?>\n<!--{head}-->\n{body}\n', tuple(notes))


def _sensor(root: ElementTree.Element, kind: str, rate_hz: float) -> ElementTree.Element:
    sensor = ElementTree.SubElement(root, "sensor", name=kind, type=kind)
    ElementTree.SubElement(sensor, "update_rate").text = repr(float(rate_hz))
    return sensor


def _add_axes(
    parent: ElementTree.Element, tag: str, model: NoiseModel, rate_hz: float, notes: list[str]
) -> None:
    quantity = "magnetic_field" if tag == "magnetometer" else tag
    group = ElementTree.SubElement(parent, tag)
    for axis, channel in channels_of(model, quantity, "gazebo").items():
        noise = _noise(channel, rate_hz, notes)
        ElementTree.SubElement(group, axis).append(noise)


def _add_sensing(
    parent: ElementTree.Element, quantity: str, model: NoiseModel, rate_hz: float, notes: list[str]
) -> None:
    """East and north share one block in SDF: the larger of the two is written."""
    axes = channels_of(model, quantity, "gazebo")
    sensing = ElementTree.SubElement(parent, f"{quantity}_sensing")
    horizontal = max(axes["east"], axes["north"], key=lambda channel: _stddev(channel, rate_hz))
    for tag, channel in (("horizontal", horizontal), ("vertical", axes["up"])):
        ElementTree.SubElement(sensing, tag).append(_noise(channel, rate_hz, notes))


def _stddev(channel: ChannelModel, rate_hz: float) -> float:
    densities = [e.effect.values()[0] for e in channel.effects if e.name == "white_noise"]
    return math.sqrt(sum(float(density) ** 2 for density in densities) * rate_hz)


def _noise(channel: ChannelModel, rate_hz: float, notes: list[str]) -> ElementTree.Element:
    notes += left_out(channel, WHITE_AND_DRIFT, "gazebo")
    values = {"stddev": _stddev(channel, rate_hz)}
    gyro = channel.name.startswith("angular_velocity")
    values["mean"] = channel.mean if gyro else 0.0
    term: Drift | None = drift(channel, notes)
    if term is not None:
        values["dynamic_bias_stddev"] = term.diffusion
        values["dynamic_bias_correlation_time"] = term.correlation_time_s
    kind = "gaussian"
    rounding = channel.find("output_rounding")
    if rounding is not None:
        step = float(rounding.effect.values()[0])
        if step > _SMALLEST_PRECISION:
            kind, values["precision"] = "gaussian_quantized", step
        else:
            notes.append(
                f"{channel.name}: output_rounding (step {step:.3g} {channel.unit}) is below the "
                "1e-6 that Gazebo can hold"
            )
    noise = ElementTree.Element("noise", type=kind)
    for key, value in values.items():
        ElementTree.SubElement(noise, key).text = repr(float(value))
    return noise
