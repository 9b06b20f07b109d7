"""``model.yaml``, format ``model/1``: a noise model as a file that people read and type.

Written by :func:`save_model`, every number has all its digits and comes back to the last bit.  A
hand-typed file needs only channel names and effects with values::

    format: model/1
    channels:
      - name: angular_velocity.x
        effects:
          - name: white_noise
            one_sided: true          # a data sheet's density
            parameters: {density: 1.0e-4}
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from imu_noise_id.effects import CATALOGUE, kind_of
from imu_noise_id.effects.base import Effect, Parameter
from imu_noise_id.files import write_text
from imu_noise_id.model import (
    ChannelModel,
    Estimate,
    FittedEffect,
    NoiseModel,
    TemperatureCourse,
    UpperBound,
)
from imu_noise_id.recording import Floats, unit_of
from imu_noise_id.yaml_tree import Node, read_yaml

FORMAT = "model/1"

CHANNEL_TOPICS = {
    **{f"angular_velocity.{axis}": "/imu/data" for axis in "xyz"},
    **{f"linear_acceleration.{axis}": "/imu/data" for axis in "xyz"},
    **{f"position.{axis}": "/gps/fix" for axis in ("east", "north", "up")},
    **{f"velocity.{axis}": "/gps/vel" for axis in ("east", "north", "up")},
    **{f"magnetic_field.{axis}": "/imu/mag" for axis in "xyz"},
    "heading": "/imu/mag",
}
"""Every channel name, with the topic that a file which does not say means."""

RANGES: dict[tuple[str, str], tuple[float, float]] = {
    ("outliers", "rate"): (0.0, 1.0),
    ("cross_axis", "correlation"): (-1.0, 1.0),
    ("held_samples", "factor"): (1.0, 1e6),
    ("bandwidth_limit", "order"): (1.0, 8.0),
    ("bandwidth_limit", "damping"): (0.0, 100.0),
    ("bias_step", "time_s"): (0.0, math.inf),
    ("variance_change", "from_s"): (0.0, math.inf),
    ("variance_change", "to_s"): (0.0, math.inf),
}
"""What a parameter may be beyond positive or finite."""

_ROOT = ("format", "source", "notes", "one_sided", "channels", "temperature")
_CHANNEL = (
    *("name", "topic", "unit", "rate_hz", "duration_s", "mean", "one_sided"),
    *("effects", "log_covariance", "bounds"),
)
_EFFECT = ("name", "form", "parameters", "note", "one_sided")
_ESTIMATE = ("value", "std_error", "lower", "upper", "unit")
_BOUND = ("name", "parameter", "unit", "upper", "note")
_TEMPERATURE = ("time_s", "temperature_degc")


def load_model(path: Path | str) -> NoiseModel:
    """Read a model file.

    Raises
    ------
    InputError
        Naming file and line: not YAML, another format, unknown keys, channels or effects, units
        that do not match, numbers out of range.
    """
    node = read_yaml(path)
    root = node.mapping("a model file", _ROOT)
    _check_format(node, root)
    if "channels" not in root:
        raise node.error("no 'channels': list the channels with their effects")
    one_sided = _one_sided(root, False)
    channels = tuple(
        _read_channel(item, one_sided) for item in root["channels"].items("'channels'")
    )
    if not channels:
        raise root["channels"].error("'channels' is empty: list at least one channel")
    seen: set[tuple[str, str]] = set()
    for item, channel in zip(root["channels"].items(""), channels, strict=True):
        if (channel.topic, channel.name) in seen:
            raise item.error(f"the channel {channel.name} stands twice")
        seen.add((channel.topic, channel.name))
    notes = root["notes"].items("'notes'") if "notes" in root else []
    return NoiseModel(
        channels,
        _read_temperature(root["temperature"]) if _given(root, "temperature") else None,
        root["source"].text("'source'") if _given(root, "source") else str(path),
        tuple(note.text("a note") for note in notes),
    )


def save_model(model: NoiseModel, path: Path | str) -> None:
    """Write a model file whole, every float with all its digits.

    Raises
    ------
    InputError
        When it cannot be written.
    """
    write_text(path, model_text(model))


def model_text(model: NoiseModel) -> str:
    """Return the text of a model file."""
    tree: dict[str, Any] = {"format": FORMAT, "source": model.source}
    if model.notes:
        tree["notes"] = list(model.notes)
    tree["channels"] = [_channel_tree(channel) for channel in model.channels]
    if model.temperature is not None:
        tree["temperature"] = {
            "time_s": _floats(model.temperature.time_s),
            "temperature_degc": _floats(model.temperature.temperature_degc),
        }
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    text = yaml.dump(
        tree, Dumper=dumper, sort_keys=False, default_flow_style=None, width=100, allow_unicode=True
    )
    return "# Noise model of imu_noise_id: SI units, densities two-sided per sqrt(Hz)\n" + text


def effect_tree(fitted: FittedEffect) -> dict[str, Any]:
    """EFFECT of the files' contract: name and parameters with intervals and units."""
    parameters = {
        parameter.name: {
            "value": _plain(estimate.value),
            "std_error": _plain(estimate.std_error),
            "lower": _plain(estimate.lower),
            "upper": _plain(estimate.upper),
            "unit": estimate.unit,
        }
        for parameter, estimate in zip(fitted.effect.parameters, fitted.estimates, strict=True)
    }
    tree: dict[str, Any] = {"name": fitted.name}
    if fitted.effect.form:
        tree["form"] = fitted.effect.form
    tree["parameters"] = parameters
    if fitted.note:
        tree["note"] = fitted.note
    return tree


def bound_tree(bound: UpperBound) -> dict[str, Any]:
    """Return an upper bound as plain data."""
    tree = dataclasses.asdict(bound)
    tree["upper"] = _plain(bound.upper)
    return tree


def typed_effect(
    name: str, channel_name: str, values: dict[str, float | str], note: str = ""
) -> FittedEffect:
    """Return an effect of given values without intervals, as a hand-typed file gives it."""
    kind = CATALOGUE[name]
    unit = unit_of(channel_name)
    estimates = tuple(
        Estimate(values[p.name], None, None, None, p.unit_for(unit)) for p in kind.parameters
    )
    return FittedEffect(kind(**values), estimates, note)


def _plain(value: Any) -> Any:
    """Numpy scalars as Python's; what is not finite as None."""
    if value is None or isinstance(value, str | bool):
        return value
    number = float(value)
    return number if math.isfinite(number) else None


def _floats(values: Floats) -> list[float]:
    return [float(v) for v in values]


def _channel_tree(channel: ChannelModel) -> dict[str, Any]:
    tree: dict[str, Any] = {
        "name": channel.name,
        "topic": channel.topic,
        "unit": channel.unit,
        "rate_hz": _plain(channel.rate_hz),
        "duration_s": _plain(channel.duration_s),
        "mean": _plain(channel.mean),
        "effects": [effect_tree(fitted) for fitted in channel.effects],
    }
    if channel.bounds:
        tree["bounds"] = [bound_tree(bound) for bound in channel.bounds]
    if channel.log_covariance is not None:
        tree["log_covariance"] = [_floats(row) for row in channel.log_covariance]
    return tree


def _given(mapping: dict[str, Node], key: str) -> bool:
    return key in mapping and not mapping[key].is_null()


def _one_sided(mapping: dict[str, Node], outer: bool) -> bool:
    return mapping["one_sided"].flag("'one_sided'") if "one_sided" in mapping else outer


def _check_format(node: Node, root: dict[str, Node]) -> None:
    if "format" not in root:
        return  # typed by hand
    found = root["format"].text("'format'")
    if found != FORMAT:
        raise root["format"].error(
            f"format '{found}' is not {FORMAT}: write the model with this version of the suite"
        )


def _optional_number(mapping: dict[str, Node], key: str, above: float) -> float | None:
    if not _given(mapping, key):
        return None
    number = mapping[key].number(f"'{key}'")
    if not number > above:
        raise mapping[key].error(f"'{key}' must be above {above:g}, not {number:g}")
    return number


def _read_channel(node: Node, one_sided: bool) -> ChannelModel:
    keys = node.mapping("a channel", _CHANNEL)
    if "name" not in keys:
        raise node.error("a channel without 'name'")
    name = keys["name"].text("'name'")
    if name not in CHANNEL_TOPICS:
        known = ", ".join(CHANNEL_TOPICS)
        raise keys["name"].error(f"unknown channel '{name}': known are {known}")
    unit = unit_of(name)
    _check_unit(keys, unit, f"channel {name}")
    one_sided = _one_sided(keys, one_sided)
    effects = tuple(
        _read_effect(item, name, one_sided)
        for item in (keys["effects"].items("'effects'") if _given(keys, "effects") else [])
    )
    bounds = keys["bounds"].items("'bounds'") if _given(keys, "bounds") else []
    return ChannelModel(
        name=name,
        topic=keys["topic"].text("'topic'") if _given(keys, "topic") else CHANNEL_TOPICS[name],
        unit=unit,
        rate_hz=_optional_number(keys, "rate_hz", 0.0),
        mean=keys["mean"].number("'mean'") if _given(keys, "mean") else 0.0,
        effects=effects,
        log_covariance=_read_covariance(keys, effects),
        duration_s=_optional_number(keys, "duration_s", 0.0),
        bounds=tuple(_read_bound(item, unit) for item in bounds),
    )


def _check_unit(keys: dict[str, Node], unit: str, what: str) -> None:
    if _given(keys, "unit") and (found := keys["unit"].text("'unit'")) != unit:
        raise keys["unit"].error(f"{what} is in {unit}, not '{found}': convert the number")


def _read_effect(node: Node, channel_name: str, one_sided: bool) -> FittedEffect:
    if isinstance(node.value, dict) and "name" not in node.value:
        raise node.error("an effect without 'name'")
    keys = node.mapping("an effect (its values stand under 'parameters')", _EFFECT)
    name = keys["name"].text("'name'")
    if name not in CATALOGUE:
        raise keys["name"].error(f"unknown effect '{name}': known are {', '.join(CATALOGUE)}")
    kind = _read_kind(keys, name)
    if "parameters" not in keys:
        wanted = ", ".join(p.name for p in kind.parameters)
        raise node.error(f"{name} without 'parameters' ({wanted})")
    estimates = _read_parameters(keys["parameters"], kind, channel_name)
    if _one_sided(keys, one_sided) and name == "white_noise":
        estimates = [_to_two_sided(estimate) for estimate in estimates]
    note = keys["note"].text("'note'") if _given(keys, "note") else ""
    return FittedEffect(_construct(node, kind, estimates), tuple(estimates), note)


def _read_kind(keys: dict[str, Node], name: str) -> type[Effect]:
    if not _given(keys, "form"):
        return CATALOGUE[name]
    try:
        return kind_of(name, keys["form"].text("'form'"))
    except ValueError as error:
        raise keys["form"].error(str(error)) from error


def _read_parameters(node: Node, kind: type[Effect], channel_name: str) -> list[Estimate]:
    wanted = tuple(p.name for p in kind.parameters)
    given = node.mapping(f"the parameters of {kind.name}", wanted)
    estimates = []
    defaults = _defaults(kind)
    for parameter in kind.parameters:
        if parameter.name not in given:
            if parameter.name not in defaults:
                raise node.error(f"{kind.name} without its parameter '{parameter.name}'")
            unit = parameter.unit_for(unit_of(channel_name))
            estimates.append(Estimate(defaults[parameter.name], None, None, None, unit))
            continue
        estimates.append(_read_estimate(given[parameter.name], kind.name, parameter, channel_name))
    return estimates


def _defaults(kind: type[Effect]) -> dict[str, Any]:
    """Return the parameters that an effect fills in itself."""
    fields = dataclasses.fields(kind)
    return {f.name: f.default for f in fields if f.default is not dataclasses.MISSING}


def _construct(node: Node, kind: type[Effect], estimates: list[Estimate]) -> Effect:
    kinds = {field.name: field.type for field in dataclasses.fields(kind)}
    values: dict[str, Any] = {}
    for parameter, estimate in zip(kind.parameters, estimates, strict=True):
        value = estimate.value
        if kinds.get(parameter.name) in ("int", int) and isinstance(value, float):
            if value != round(value):
                raise node.error(f"{kind.name} {parameter.name} must be a whole number")
            value = round(value)
        values[parameter.name] = value
    try:
        return kind(**values)
    except ValueError as error:
        raise node.error(f"{kind.name}: {error}") from error


def _to_two_sided(estimate: Estimate) -> Estimate:
    """Divide a data sheet's one-sided density, and its interval, by sqrt(2)."""

    def halve(value: Any) -> Any:
        return value / math.sqrt(2.0) if isinstance(value, float) else value

    return Estimate(
        halve(estimate.value),
        halve(estimate.std_error),
        halve(estimate.lower),
        halve(estimate.upper),
        estimate.unit,
    )


def _read_estimate(node: Node, effect: str, parameter: Parameter, channel_name: str) -> Estimate:
    unit = parameter.unit_for(unit_of(channel_name))
    what = f"{effect} {parameter.name}"
    keys = {"value": node}
    if isinstance(node.value, dict):
        keys = node.mapping(what, _ESTIMATE)
        _check_unit(keys, unit, what)
    if "value" not in keys or keys["value"].is_null():
        raise node.error(f"{what} has no value")
    if CATALOGUE[effect].__annotations__.get(parameter.name) == "str":
        other = keys["value"].text(what)
        if other not in CHANNEL_TOPICS or other == channel_name:
            raise keys["value"].error(f"{what} must name another channel, not '{other}'")
        return Estimate(other, None, None, None, unit)
    value = keys["value"].number(what)
    _check_range(keys["value"], effect, parameter, value)
    std_error, lower, upper = (
        keys[key].number(f"{what} {key}") if _given(keys, key) else None
        for key in ("std_error", "lower", "upper")
    )
    if std_error is not None and std_error < 0.0:
        raise keys["std_error"].error(f"{what} std_error must be 0 or more, not {std_error:g}")
    if lower is not None and upper is not None and lower > upper:
        raise keys["lower"].error(f"{what}: lower {lower:g} is above upper {upper:g}")
    return Estimate(value, std_error, lower, upper, unit)


def _check_range(node: Node, effect: str, parameter: Parameter, value: float) -> None:
    what = f"{effect} {parameter.name}"
    if parameter.positive and not value > 0.0:
        raise node.error(f"{what} must be above 0, not {value:g}: leave an absent effect out")
    low, high = RANGES.get((effect, parameter.name), (-math.inf, math.inf))
    if not low <= value <= high:
        raise node.error(f"{what} must be between {low:g} and {high:g}, not {value:g}")


def _read_covariance(keys: dict[str, Node], effects: tuple[FittedEffect, ...]) -> Floats | None:
    if not _given(keys, "log_covariance"):
        return None
    node = keys["log_covariance"]
    rows = [
        [cell.number("log_covariance") for cell in row.items("a row of log_covariance")]
        for row in node.items("'log_covariance'")
    ]
    most = sum(not isinstance(e.value, str) for fitted in effects for e in fitted.estimates)
    if len(rows) > most or any(len(row) != len(rows) for row in rows):
        raise node.error(
            f"'log_covariance' must be square, one row an estimated parameter (at most {most})"
        )
    return np.array(rows, dtype=float).reshape(len(rows), len(rows))


def _read_bound(node: Node, unit: str) -> UpperBound:
    keys = node.mapping("a bound", _BOUND)
    for key in ("name", "parameter", "upper"):
        if key not in keys:
            raise node.error(f"a bound without '{key}'")
    name, parameter_name = keys["name"].text("'name'"), keys["parameter"].text("'parameter'")
    if name not in CATALOGUE:
        raise keys["name"].error(f"unknown effect '{name}': known are {', '.join(CATALOGUE)}")
    found = [p for p in CATALOGUE[name].parameters if p.name == parameter_name]
    if not found:
        raise keys["parameter"].error(f"{name} has no parameter '{parameter_name}'")
    _check_unit(keys, found[0].unit_for(unit), f"{name} {parameter_name}")
    note = keys["note"].text("'note'") if _given(keys, "note") else ""
    upper = keys["upper"].number("'upper'")
    return UpperBound(name, parameter_name, found[0].unit_for(unit), upper, note)


def _read_temperature(node: Node) -> TemperatureCourse:
    keys = node.mapping("'temperature'", _TEMPERATURE)
    columns = []
    for key in _TEMPERATURE:
        if key not in keys:
            raise node.error(f"'temperature' without '{key}'")
        columns.append(np.array([cell.number(key) for cell in keys[key].items(f"'{key}'")]))
    time_s, temperature_degc = columns
    if time_s.size != temperature_degc.size or np.any(np.diff(time_s) <= 0.0):
        raise node.error("'temperature' needs rising times and as many temperatures")
    return TemperatureCourse(time_s, temperature_degc)
