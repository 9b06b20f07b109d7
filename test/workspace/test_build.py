"""`make build`: says which ROS it uses, is quick when nothing changed, and what is missing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SYSTEM_TOOLS = ["sh", "dirname", "sed", "uname", "cat", "find", "sort", "mkdir", "flock", "rm"]
BUILD_TOOLS = ["cmake", "make", "c++", "g++", "cc", "gcc"]


@pytest.fixture
def machine(tmp_path: Path, root: Path):
    """Return a function that runs tools/build of a copy on a machine that has only some tools."""
    copy = tmp_path / "workspace"
    shutil.copytree(root / "tools", copy / "tools")
    shutil.copy(root / "pyproject.toml", copy)
    bin_folder = tmp_path / "bin"
    bin_folder.mkdir()

    def run(tools: list[str], python: str | None, ros: Path = Path("/nonexistent")):
        for tool in [*SYSTEM_TOOLS, *tools]:
            found = shutil.which(tool)
            if found is not None:
                (bin_folder / tool).symlink_to(found)
        if python is not None:
            (bin_folder / "python3").write_text(f"#!/bin/sh\n{python}\n")
            (bin_folder / "python3").chmod(0o755)
        env = {"PATH": str(bin_folder), "ROS_JAZZY": str(ros)}
        return subprocess.run(
            [str(copy / "tools/build")], env=env, capture_output=True, text=True, check=False
        )

    return run


def this_python() -> str:
    return f'exec {sys.executable} "$@"'


def old_python(facts: str) -> str:
    return f"echo {facts}"


@pytest.mark.parametrize(
    ("tools", "python", "named"),
    [
        (BUILD_TOOLS, None, "no Python: 'python3' is not on the PATH"),
        (BUILD_TOOLS, old_python("cpython 3.9 linux"), "cpython 3.9 linux; CPython 3.10 to 3.14"),
        (BUILD_TOOLS, old_python("pypy 3.10 linux"), "pypy 3.10 linux; CPython 3.10 to 3.14"),
        (BUILD_TOOLS, "exit 1", "'python3' does not run"),
        (["make", "c++", "cc"], this_python(), "no cmake on the PATH (apt-get install cmake)"),
        (["cmake", "c++", "cc"], this_python(), "no make on the PATH (apt-get install make)"),
        (
            ["cmake", "make", "cc"],
            this_python(),
            "no C++ compiler on the PATH (apt-get install g++)",
        ),
        (
            ["cmake", "make", "c++"],
            this_python(),
            "no C compiler on the PATH (apt-get install gcc)",
        ),
    ],
)
def test_what_is_missing_gets_one_line(machine, tools, python, named):
    done = machine(tools, python)
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert named in done.stderr


def test_a_python_that_is_not_the_one_of_ros_is_told(machine, tmp_path: Path):
    (tmp_path / "ros").mkdir()
    (tmp_path / "ros/setup.sh").touch()
    python = f'case $2 in "import rclpy") exit 1;; esac; {this_python()}'
    done = machine(BUILD_TOOLS, python, ros=tmp_path / "ros")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "cannot import rclpy" in done.stderr


def test_a_second_build_does_nothing_and_names_the_ros_it_uses(root: Path):
    state = root / "build/state"
    before = state.stat().st_mtime_ns
    done = subprocess.run(
        [str(root / "tools/build")],
        capture_output=True,
        text=True,
        check=True,
        env=dict(os.environ),
    )
    assert done.stdout.startswith("make build: up to date, with ROS 2 Jazzy")
    assert state.stat().st_mtime_ns == before


def test_an_edited_module_needs_no_build(root: Path):
    for package in ("imu_noise_id", "nav_fusion"):
        assert (root / "build" / package / package).resolve() == root / "src" / package / package


def test_only_dependency_groups_hold_lower_bounds(root: Path):
    for setup in root.glob("src/*/setup.py"):
        assert 'install_requires=["setuptools"]' in setup.read_text()
