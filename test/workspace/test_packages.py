"""What only a machine with apt's ROS runs (rosdep, launch, /opt/ros) is checked by its structure.

Not run here: `rosdep install`, `ros2 launch` and a build on /opt/ros/jazzy.  Checked instead: every
executable, package and file that they name exists (parameters: test_parameter_files.py).
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ["noise_msgs", "imu_noise_id", "nav_fusion"]
PYTHON_PACKAGES = PACKAGES[1:]
LAUNCH_FILES = sorted(ROOT.glob("src/*/launch/*.launch.py"))

# what is imported under another name than the one that rosdep knows (checked against the rosdep
# database of ros/rosdistro); mcap and rosbags bring zstandard and lz4, which have no key
ROSDEP_KEYS = {
    "bokeh": "python3-bokeh-pip",
    "jinja2": "python3-jinja2",
    "llvmlite": "python3-numba",
    "lz4": "python3-mcap-pip",
    "mcap": "python3-mcap-pip",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "rich": "python3-rich",
    "rosbags": "python3-rosbags-pip",
    "scipy": "python3-scipy",
    "yaml": "python3-yaml",
    "zstandard": "python3-mcap-pip",
}
OPTIONAL = {"distributed", "dask"}  # the dependency group `fleet`, imported where it is asked for


def manifest(package: str) -> ET.Element:
    return ET.parse(ROOT / "src" / package / "package.xml").getroot()


def named(package: str, *tags: str) -> set[str]:
    return {str(element.text) for tag in tags for element in manifest(package).iter(tag)}


def sources(package: str) -> list[Path]:
    return sorted((ROOT / "src" / package / package).rglob("*.py"))


def imported(path: Path) -> set[str]:
    """Return the top-level names that a file imports, at its top or in a function."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module.split(".")[0])
    return names


def by_name(path: Path) -> set[str]:
    """Return the packages that a file names as text: "sensor_msgs/msg/Imu", find_spec("bokeh")."""
    text = path.read_text()
    types = re.findall(r"\b([a-z_]+_msgs)/(?:msg/)?[A-Z]", text)
    return {*types, *re.findall(r'find_spec\("(\w+)"\)', text)}


def commands(package: str) -> list[str]:
    listed = re.search(r"commands = \[(.*)\]", (ROOT / "src" / package / "setup.py").read_text())
    assert listed is not None
    return [str(name) for name in ast.literal_eval(f"[{listed[1]}]")]


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_has_what_ros_asks_of_it(package: str):
    element = manifest(package)
    assert element.findtext("name") == package
    assert element.findtext("license") == "Apache-2.0"
    assert re.fullmatch(r"\d+\.\d+\.\d+", str(element.findtext("version")))
    changes = (ROOT / "src" / package / "CHANGELOG.rst").read_text().splitlines()
    assert changes[1] == f"Changelog for package {package}"


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_every_import_is_a_declared_dependency(package: str):
    declared = named(package, "depend", "exec_depend") | {package}
    used = set().union(*(imported(path) for path in sources(package)))
    outside = used - set(sys.stdlib_module_names) - OPTIONAL
    missing = {name for name in outside if ROSDEP_KEYS.get(name, name) not in declared}
    assert missing == set()


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_every_declared_dependency_is_used(package: str):
    used = set().union(*(imported(path) | by_name(path) for path in sources(package)))
    keys = {ROSDEP_KEYS.get(name, name) for name in used} | {"launch", "launch_ros"}
    assert named(package, "depend", "exec_depend") - keys == set()


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_versions_agree(package: str):
    setup = (ROOT / "src" / package / "setup.py").read_text()
    assert f'version="{manifest(package).findtext("version")}"' in setup


@pytest.mark.parametrize(
    ("package", "command"), [(p, c) for p in PYTHON_PACKAGES for c in commands(p)]
)
def test_every_listed_executable_runs(package: str, command: str, workspace_env: dict[str, str]):
    done = subprocess.run(
        ["ros2", "run", package, command, "--help"],
        env=workspace_env,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "usage" in done.stdout.lower()


def test_the_index_lists_the_executables_and_no_other(workspace_env: dict[str, str]):
    done = subprocess.run(
        ["ros2", "pkg", "executables"],
        env=workspace_env,
        capture_output=True,
        text=True,
        check=True,
    )
    ours = [line for line in done.stdout.splitlines() if line.split()[0] in PYTHON_PACKAGES]
    assert sorted(ours) == sorted(f"{p} {c}" for p in PYTHON_PACKAGES for c in commands(p))


# ------------------------------------------------------------------------------------- messages

INTERFACES = sorted(
    [*ROOT.glob("src/noise_msgs/msg/*.msg"), *ROOT.glob("src/noise_msgs/srv/*.srv")]
)
FIELD = re.compile(r"^\S+ +[a-z][a-z0-9_]* +# \[(?P<unit>[^;\]]+); (?P<frame>[^\]]+)\] \S")


@pytest.mark.parametrize("path", INTERFACES, ids=lambda path: path.name)
def test_every_field_states_its_unit_and_frame(path: Path):
    lines = [line for line in path.read_text().splitlines() if line not in ("", "---")]
    assert lines[0].startswith("# "), "a first line says what the message is"
    for line in lines:
        if not line.startswith("#"):
            assert FIELD.match(line), f"{path.name}: no '# [unit; frame] meaning' in: {line}"


def test_every_interface_is_built(root: Path):
    listed = re.findall(r"^  ((?:msg|srv)/\w+\.(?:msg|srv))$", cmake(root), re.MULTILINE)
    assert listed == [f"{path.parent.name}/{path.name}" for path in INTERFACES]


def cmake(root: Path) -> str:
    return (root / "src/noise_msgs/CMakeLists.txt").read_text()


# --------------------------------------------------------------------------------------- launch


def calls(path: Path, name: str) -> list[dict[str, ast.expr]]:
    """Return the keyword arguments of every call of ``name`` in a launch file."""
    return [
        {str(keyword.arg): keyword.value for keyword in node.keywords}
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == name
    ]


def strings(path: Path, function: str) -> list[str]:
    """Return the first argument of every call of ``function`` that is written as a string."""
    return [
        node.args[0].value
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == function
        and node.args
        and isinstance(node.args[0], ast.Constant)
    ]


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_a_launch_file_names_what_exists(path: Path):
    nodes = calls(path, "Node")
    assert nodes
    for node in nodes:
        assert ast.literal_eval(node["executable"]) in commands(ast.literal_eval(node["package"]))
    package = path.parents[1]
    shares = re.findall(r'FindPackageShare\("(\w+)"\), "(\w+)", "([\w.]+)"', path.read_text())
    assert shares
    for share, folder, file in shares:
        assert share == package.name
        assert (package / folder / file).is_file()


@pytest.mark.parametrize("path", LAUNCH_FILES, ids=lambda path: path.name)
def test_launch_arguments_are_described_and_used(path: Path):
    declared = strings(path, "DeclareLaunchArgument")
    assert {"namespace", "use_sim_time", "params_file", "log_level", "bag"} <= set(declared)
    assert sorted(set(strings(path, "LaunchConfiguration"))) == sorted(declared)
    for argument in calls(path, "DeclareLaunchArgument"):
        assert len(str(ast.literal_eval(argument["description"]))) > 10
