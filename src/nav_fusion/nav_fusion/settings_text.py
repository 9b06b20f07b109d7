"""Parameters of the filter typed as text: ``lever_arm_m=[0.1, 0, 0.5]``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import yaml
from imu_noise_id.errors import InputError

from nav_fusion.parameters import Parameters


def parameters_from(settings: Sequence[str]) -> Parameters:
    """Parameters with those that are given as ``name=value``.

    Raises
    ------
    InputError
        When a name is unknown or a value is not of its type or range.
    """
    defaults = {f.name: f.default for f in fields(Parameters)}
    given: dict[str, Any] = {}
    for text in settings:
        name, equals, value = text.partition("=")
        if not equals or name not in defaults:
            raise InputError(
                f"--set {text}: NAME=VALUE is needed, NAME one of {', '.join(sorted(defaults))}"
            )
        try:
            given[name] = _value(yaml.safe_load(value), defaults[name], name)
        except (yaml.YAMLError, TypeError, ValueError) as error:
            raise InputError(f"--set {text}: {' '.join(str(error).split())}") from error
    return Parameters(**given)


def _value(read: Any, default: Any, name: str) -> Any:
    """Value of the same shape as the default."""
    if isinstance(default, bool):
        if not isinstance(read, bool):
            raise TypeError("true or false is needed")
        return read
    if isinstance(default, int):
        return int(read)
    if isinstance(default, float):
        return float(read)
    if name == "soft_iron":
        flat = [float(v) for row in read for v in (row if isinstance(row, list) else [row])]
        if len(flat) != 9:
            raise ValueError("nine numbers are needed, row by row")
        return tuple(flat[0:3]), tuple(flat[3:6]), tuple(flat[6:9])
    vector = tuple(float(v) for v in read)
    if len(vector) != 3:
        raise ValueError("three numbers are needed")
    return vector
