"""Parameters with units, ranges and what they mean; one table a node."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter


@dataclass(frozen=True)
class Setting:
    """One parameter of a node.

    Attributes
    ----------
    name : str
    default : bool, int, float, str or list of float
    meaning : str
        With the unit.
    lower, upper : float, optional
        Ends of the range, included.
    fixed : bool
        Read at the start only.
    """

    name: str
    default: Any
    meaning: str
    lower: float | None = None
    upper: float | None = None
    fixed: bool = True


def declare(node: Node, settings: Sequence[Setting]) -> None:
    """Declare all parameters of a node with their descriptors."""
    for setting in settings:
        node.declare_parameter(setting.name, setting.default, _descriptor(setting))


def value(node: Node, name: str) -> Any:
    """Return the present value of a parameter."""
    return node.get_parameter(name).value


def refuse_non_finite(parameters: Sequence[Parameter]) -> SetParametersResult:
    """Refuse NaN and infinities, which a range lets pass."""
    for parameter in parameters:
        if parameter.type_ == Parameter.Type.DOUBLE and not abs(parameter.value) < float("inf"):
            return SetParametersResult(
                successful=False, reason=f"{parameter.name} must be a finite number"
            )
    return SetParametersResult(successful=True)


def _descriptor(setting: Setting) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=setting.meaning, read_only=setting.fixed)
    if setting.lower is None or setting.upper is None:
        return descriptor
    if isinstance(setting.default, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(setting.lower), to_value=float(setting.upper))
        ]
    else:
        descriptor.integer_range = [
            IntegerRange(from_value=int(setting.lower), to_value=int(setting.upper), step=1)
        ]
    return descriptor
