"""YAML typed by a person: a tree of texts with their lines, and checked access to it.

Only the parser of PyYAML is used: no tag constructs anything, an alias is refused (so a small file
cannot unfold into a large one), depth and size are bounded, a repeated key is an error, and every
complaint names the file and the line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from imu_noise_id.errors import InputError
from imu_noise_id.files import read_text

LARGEST_FILE_BYTES = 64 * 2**20
LARGEST_DEPTH = 16

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


@dataclass(frozen=True)
class Node:
    """One piece of a YAML file.

    Attributes
    ----------
    value : dict of Node, list of Node, or str
        A scalar stays the text that stands in the file.
    plain : bool
        Whether a scalar stands without quotes.
    path : str
        The file, for messages.
    line : int
        Counted from 1.
    """

    value: dict[str, Node] | list[Node] | str
    plain: bool
    path: str
    line: int

    def error(self, message: str) -> InputError:
        """Return the error that names file and line; the caller raises it."""
        return InputError(f"{self.path}, line {self.line}: {message}")

    def mapping(self, what: str, known: tuple[str, ...]) -> dict[str, Node]:
        """Return the keys of a mapping, all of which must be known."""
        if not isinstance(self.value, dict):
            raise self.error(f"{what} must be a mapping with the keys {', '.join(known)}")
        for key, node in self.value.items():
            if key not in known:
                raise node.error(f"unknown key '{key}' in {what}: known are {', '.join(known)}")
        return self.value

    def items(self, what: str) -> list[Node]:
        """Return the items of a list."""
        if not isinstance(self.value, list):
            raise self.error(f"{what} must be a list (lines that start with '- ')")
        return self.value

    def is_null(self) -> bool:
        """Whether the scalar is empty, ``~`` or ``null``."""
        return self.plain and isinstance(self.value, str) and self.value in _NULL

    def text(self, what: str) -> str:
        """Return a scalar as it stands."""
        if not isinstance(self.value, str) or self.is_null():
            raise self.error(f"{what} must be a text")
        return self.value

    def number(self, what: str) -> float:
        """Return a finite number; ``1e-4``, which YAML 1.1 takes for a text, is one."""
        text = self.value if isinstance(self.value, str) else ""
        try:
            number = float(text) if "_" not in text else math.nan
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            shown = text if isinstance(self.value, str) else "a list or mapping"
            raise self.error(f"{what} must be a finite number, not '{shown}'")
        return number

    def flag(self, what: str) -> bool:
        """Return a yes or no."""
        if isinstance(self.value, str) and self.value.lower() in _FLAGS:
            return _FLAGS[self.value.lower()]
        raise self.error(f"{what} must be true or false")


_NULL = frozenset(("", "~", "null", "Null", "NULL"))
_FLAGS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}


def read_yaml(path: Path | str, limit_bytes: int = LARGEST_FILE_BYTES) -> Node:
    """Read one YAML document.

    Raises
    ------
    InputError
        When the file cannot be read, is not YAML, is empty, too deep, has aliases or repeats a key.
    """
    name = str(path)
    text = read_text(path, limit_bytes)
    try:
        root = _Builder(name).build(yaml.parse(text, Loader=_Loader))
    except yaml.MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        raise InputError(f"{name}, line {line}: not YAML ({error.problem})") from error
    except yaml.YAMLError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{name}: not YAML ({reason})") from error
    if root is None:
        raise InputError(f"{name}: the file is empty")
    return root


class _Builder:
    """Turns the parser's events into nodes without recursion."""

    def __init__(self, path: str) -> None:
        self.path = path
        self.open: list[tuple[Node, list[Node]]] = []  # the collection, and a key that waits
        self.root: Node | None = None

    def build(self, events: Any) -> Node | None:
        for event in events:
            line = event.start_mark.line + 1
            if isinstance(event, yaml.ScalarEvent):
                self.add(Node(event.value, event.style in (None, ""), self.path, line))
            elif isinstance(event, yaml.CollectionStartEvent):
                self.enter(event, line)
            elif isinstance(event, yaml.CollectionEndEvent):
                self.open.pop()
            elif isinstance(event, yaml.AliasEvent):
                raise InputError(f"{self.path}, line {line}: aliases are not read: repeat the text")
            elif isinstance(event, yaml.DocumentStartEvent) and self.root is not None:
                break
        return self.root

    def enter(self, event: yaml.CollectionStartEvent, line: int) -> None:
        empty: Any = {} if isinstance(event, yaml.MappingStartEvent) else []
        node = Node(empty, False, self.path, line)
        self.add(node)
        self.open.append((node, []))
        if len(self.open) > LARGEST_DEPTH:
            raise node.error(f"nested deeper than {LARGEST_DEPTH} levels")

    def add(self, node: Node) -> None:
        if not self.open:
            self.root = node
            return
        parent, waiting = self.open[-1]
        if isinstance(parent.value, list):
            parent.value.append(node)
        elif isinstance(parent.value, dict):
            self.add_to_mapping(parent.value, waiting, node)

    @staticmethod
    def add_to_mapping(mapping: dict[str, Node], waiting: list[Node], node: Node) -> None:
        if not waiting:
            waiting.append(node)
            return
        key = waiting.pop()
        if not isinstance(key.value, str):
            raise key.error("a key must be a word")
        if key.value in mapping:
            raise key.error(f"the key '{key.value}' stands twice")
        mapping[key.value] = node
