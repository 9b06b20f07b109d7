"""Programs and a listener on a ROS domain of the test's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from helpers.live import Listener, Program


@pytest.fixture
def listener(ros_here: int) -> Iterator[Listener]:
    """Return a node that listens on the test's domain."""
    node = Listener()
    yield node
    node.close()


@pytest.fixture
def start(ros_env: dict[str, str], tmp_path: Path) -> Iterator[Callable[..., Program]]:
    """Return a function that starts a program on the test's domain; all end with the test."""
    programs: list[Program] = []

    def begin(*command: str) -> Program:
        program = Program(ros_env, tmp_path / f"program{len(programs)}.log", command)
        programs.append(program)
        return program

    yield begin
    for program in programs:
        program.kill()
