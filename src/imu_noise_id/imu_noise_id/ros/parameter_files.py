"""Parameter files checked before a node starts: ROS itself passes over what it does not know."""

from __future__ import annotations

import fnmatch
import itertools
from collections.abc import Iterator, Sequence

from imu_noise_id.errors import InputError
from imu_noise_id.ros.parameters import Setting
from imu_noise_id.yaml_tree import Node, read_yaml

OF_RCLPY = ("use_sim_time", "start_type_description_service")
_SECTION = "ros__parameters"
_LIMIT_BYTES = 1 << 20


def check_arguments(
    arguments: Sequence[str], name: str, settings: Sequence[Setting]
) -> tuple[str, ...]:
    """Check ``--params-file`` and ``-p`` of a node's arguments.

    Parameters
    ----------
    arguments : sequence of str
        ``--ros-args ...``.
    name : str
        The node's, unless ``__node:=`` gives another.
    settings : sequence of Setting

    Returns
    -------
    tuple of str
        Parameters that the node does not have, in sections for any node (``/**``): they may be
        meant for another.

    Raises
    ------
    InputError
        Naming file and line: not YAML, a parameter that the node does not have in a section of its
        own or by ``-p``, one of another type or outside its range.
    """
    known = {setting.name: setting for setting in settings}
    full = _full_name(arguments, name)
    said: list[str] = []
    for flag, given in _pairs(arguments):
        if flag == "--params-file":
            said += _check_file(read_yaml(given, _LIMIT_BYTES), full, known)
        elif flag in ("-p", "--param"):
            parameter = given.split(":=")[0].split(":")[-1]
            if not _is_known(parameter, known):
                raise InputError(f"-p {given}: {_unknown(parameter, known)}")
    return tuple(said)


def _pairs(arguments: Sequence[str]) -> Iterator[tuple[str, str]]:
    return itertools.pairwise(arguments)


def _full_name(arguments: Sequence[str], name: str) -> str:
    rules = dict(given.split(":=", 1) for _, given in _pairs(arguments) if ":=" in given)
    return f"{rules.get('__ns', '').rstrip('/')}/{rules.get('__node', name)}"


def _check_file(root: Node, full: str, known: dict[str, Setting]) -> list[str]:
    said = []
    sections = root.value if isinstance(root.value, dict) else {}
    for pattern, section in _sections(sections):
        if not fnmatch.fnmatchcase(full, f"/{pattern.lstrip('/')}".replace("/**", "*")):
            continue
        given = section.value
        for key, node in given.items() if isinstance(given, dict) else ():
            if _is_known(key, known):
                _check_value(node, known.get(key))
            elif "*" in pattern:
                said.append(str(node.error(_unknown(key, known))))
            else:
                raise node.error(_unknown(key, known))
    return said


def _sections(nodes: dict[str, Node], before: str = "") -> Iterator[tuple[str, Node]]:
    """Patterns of nodes, which may be nested as namespaces, and their parameters."""
    for key, node in nodes.items():
        if key == _SECTION:
            yield before, node
        elif isinstance(node.value, dict):
            yield from _sections(node.value, f"{before.rstrip('/')}/{key.lstrip('/')}")
        else:
            raise node.error(f"'{key}' is no section: a node's parameters stand in '{_SECTION}'")


def _is_known(parameter: str, known: dict[str, Setting]) -> bool:
    return parameter in known or parameter in OF_RCLPY or parameter.startswith("qos_overrides")


def _unknown(parameter: str, known: dict[str, Setting]) -> str:
    return f"unknown parameter '{parameter}': known are {', '.join(known)}"


def _check_value(node: Node, setting: Setting | None) -> None:
    if setting is None or not isinstance(node.value, str):
        return
    what = f"'{setting.name}' ({setting.meaning})"
    if isinstance(setting.default, bool):
        node.flag(what)
    elif isinstance(setting.default, int | float):
        number = node.number(what)
        whole = node.value.lstrip("+-").isdecimal()
        if whole != isinstance(setting.default, int):
            kind = "a whole number" if isinstance(setting.default, int) else "decimal, as 100.0 is"
            raise node.error(f"{what} must be {kind}, not {node.value}")
        if setting.lower is None or setting.upper is None:
            return
        if not setting.lower <= number <= setting.upper:
            low, high = setting.lower, setting.upper
            raise node.error(f"{what} must be between {low:g} and {high:g}, not {number:g}")
