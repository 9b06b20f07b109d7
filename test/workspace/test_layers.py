"""Data flows one way: cores know no ROS, imu_noise_id does not know nav_fusion."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ["imu_noise_id", "nav_fusion"]
ROS = ("rclpy", "ament_index_python", "builtin_interfaces", "rosidl_runtime_py")
LONGEST_FUNCTION = 60

BLOCK_ROS = """
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        top = name.split(".")[0]
        if top in {ros!r} or top.endswith("_msgs"):
            raise ImportError(name + " is not for a core")
sys.meta_path.insert(0, Blocked())
import importlib
for name in {modules!r}:
    importlib.import_module(name)
"""


def modules(package: str) -> list[Path]:
    return sorted((ROOT / "src" / package / package).rglob("*.py"))


def is_node(path: Path) -> bool:
    return "ros" in path.parts[len(ROOT.parts) + 3 :]


def dotted(path: Path) -> str:
    parts = path.relative_to(ROOT / "src" / path.relative_to(ROOT).parts[1]).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
    return found


@pytest.mark.parametrize("package", PACKAGES)
def test_only_the_ros_folder_imports_ros(package: str):
    guilty = {
        f"{path.relative_to(ROOT)} imports {name}"
        for path in modules(package)
        if not is_node(path)
        for name in imports(path)
        if name.split(".")[0] in ROS or name.split(".")[0].endswith("_msgs")
    }
    assert guilty == set()


@pytest.mark.parametrize("package", PACKAGES)
def test_the_core_can_be_imported_without_ros(package: str):
    names = [dotted(path) for path in modules(package) if not is_node(path)]
    code = BLOCK_ROS.format(ros=ROS, modules=names)
    paths = [str(ROOT / "src" / name) for name in PACKAGES]
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:0] = {paths!r}\n{code}"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_imu_noise_id_does_not_know_nav_fusion():
    for path in modules("imu_noise_id"):
        assert not any(name.split(".")[0] == "nav_fusion" for name in imports(path)), path


def test_functions_fit_on_a_screen():
    too_long = []
    for path in [path for package in PACKAGES for path in modules(package)]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                body = node.body[1:] if ast.get_docstring(node) else node.body
                lines = node.end_lineno - body[0].lineno + 1 if body and node.end_lineno else 0
                if lines > LONGEST_FUNCTION:
                    too_long.append(f"{path.relative_to(ROOT)}:{node.lineno} {node.name}: {lines}")
    assert too_long == []


def test_no_test_sleeps_instead_of_waiting_for_what_it_needs():
    for path in (ROOT / "test").rglob("test_*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and node.attr == "sleep":
                raise AssertionError(f"{path.relative_to(ROOT)}:{node.lineno} sleeps")
