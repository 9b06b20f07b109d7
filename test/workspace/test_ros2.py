"""The stand-in for `ros2` behaves as ros2cli does: what it finds, what it says, how it exits."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

import pytest


class Index:
    """Two prefixes with packages of shell scripts, as colcon would install them."""

    def __init__(self, folder: Path, ros2: Path) -> None:
        self.prefixes = [folder / "upper", folder / "lower"]
        self.ros2 = ros2
        self.env = {"PATH": os.environ["PATH"]}
        self.env["AMENT_PREFIX_PATH"] = ":".join(map(str, self.prefixes))

    def add(self, package: str, program: str = "", text: str = "", prefix: int = 0) -> Path:
        markers = self.prefixes[prefix] / "share/ament_index/resource_index/packages"
        markers.mkdir(parents=True, exist_ok=True)
        (markers / package).touch()
        path = self.prefixes[prefix] / "lib" / package / program
        if program:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"#!/bin/sh\n{text}\n")
            path.chmod(0o755)
        return path

    def call(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        command = [str(self.ros2), *arguments]
        return subprocess.run(command, env=self.env, capture_output=True, text=True, check=False)


@pytest.fixture
def index(tmp_path: Path, root: Path) -> Index:
    return Index(tmp_path, root / "tools/bin/ros2")


def test_run_passes_arguments_output_and_exit_code(index: Index):
    index.add("robot", "move", 'printf "<%s>" "$@"; exit 3')
    done = index.call("run", "robot", "move", "--bag", "a b", "", "--ros-args", "-p", "x:=*")
    assert done.stdout == "<--bag><a b><><--ros-args><-p><x:=*>"
    assert done.returncode == 3


@pytest.mark.parametrize(
    ("package", "program", "message"),
    [
        ("nowhere", "move", "Package 'nowhere' not found\n"),
        ("robot", "fly", "No executable found\n"),
        ("empty", "move", "No executable found\n"),
    ],
)
def test_run_says_what_is_missing_as_ros2cli_does(index, package, program, message):
    index.add("robot", "move")
    index.add("empty")
    done = index.call("run", package, program)
    assert (done.returncode, done.stdout, done.stderr) == (1, "", message)


def test_run_does_not_choose_between_two(index: Index):
    first = index.add("robot", "a/move")
    second = index.add("robot", "b/move")
    done = index.call("run", "robot", "move")
    assert done.returncode == 1
    assert done.stderr == f"Multiple executables found:\n- {first}\n- {second}\n"


def test_run_without_a_program_is_a_usage_error(index: Index):
    index.add("robot", "move")
    done = index.call("run", "robot")
    assert done.returncode == 2
    assert "the following arguments are required: executable_name" in done.stderr


def test_run_with_a_prefix_command(index: Index):
    index.add("robot", "move", 'echo "$GREETING $1"')
    done = index.call("run", "--prefix", "env GREETING='good day'", "robot", "move", "all")
    assert done.stdout == "good day all\n"


def test_the_upper_prefix_wins(index: Index):
    index.add("robot", "move", "echo lower", prefix=1)
    index.add("robot", "move", "echo upper", prefix=0)
    assert index.call("run", "robot", "move").stdout == "upper\n"


def test_signals_reach_the_program_itself(index: Index):
    index.add(
        "robot", "wait", "trap 'echo bye; exit 7' TERM\necho ready\nwhile :; do sleep 0.01; done"
    )
    command = [str(index.ros2), "run", "robot", "wait"]
    with subprocess.Popen(command, env=index.env, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        assert program.stdout.readline() == "ready\n"
        program.send_signal(signal.SIGTERM)
        assert program.stdout.readline() == "bye\n"
        assert program.wait(timeout=10) == 7


def test_executables_are_listed_by_package_and_name(index: Index):
    move = index.add("robot", "move")
    fly = index.add("robot", "fly", prefix=0)
    index.add("arm", "grip", prefix=1)
    index.add("robot", "hidden", prefix=1)
    (move.parent / "data.txt").write_text("not executable")
    assert index.call("pkg", "executables").stdout == "arm grip\nrobot fly\nrobot move\n"
    assert index.call("pkg", "executables", "robot").stdout == "robot fly\nrobot move\n"
    listed = index.call("pkg", "executables", "--full-path", "robot")
    assert listed.stdout == f"{fly}\n{move}\n"


def test_executables_of_an_unknown_package(index: Index):
    done = index.call("pkg", "executables", "nowhere")
    assert (done.returncode, done.stderr) == (1, "Package 'nowhere' not found\n")


@pytest.mark.parametrize(
    ("verb", "package"),
    [
        ("topic list", "ros-jazzy-ros2topic"),
        ("bag play x", "ros-jazzy-ros2bag"),
        ("launch a b", "ros-jazzy-ros2launch"),
        ("node list", "ros-jazzy-ros2node"),
        ("param get a b", "ros-jazzy-ros2param"),
        ("service call a", "ros-jazzy-ros2service"),
        ("interface show a", "ros-jazzy-ros2interface"),
        ("doctor", "ros-jazzy-ros2doctor"),
        ("pkg list", "ros-jazzy-ros2pkg"),
        ("security create_keystore a", "ros-jazzy-sros2"),
    ],
)
def test_every_other_verb_names_its_apt_package(index: Index, verb: str, package: str):
    done = index.call(*verb.split())
    assert done.returncode == 1
    assert package in done.stderr
    assert done.stderr.count("\n") == 1


def test_an_unknown_verb_is_a_usage_error(index: Index):
    done = index.call("dance")
    assert done.returncode == 2
    assert "invalid choice: 'dance'" in done.stderr


def test_help(index: Index):
    for call in (["--help"], [], ["run", "--help"], ["pkg", "executables", "-h"]):
        done = index.call(*call)
        assert done.returncode == 0
        assert done.stdout.startswith("usage: ros2")
