"""`source env.sh`: from anywhere, under strict shells, and other Pythons stay as they were."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

import pytest

STRICT = ["-euo", "pipefail", "-c"]


def run(*command: str, cwd: Path | str = "/", env: dict[str, str] | None = None):
    clean = {"PATH": os.environ["PATH"], "HOME": "/nonexistent"} | (env or {})
    return subprocess.run(command, cwd=cwd, env=clean, capture_output=True, text=True, check=False)


def test_sourcing_from_another_folder_in_a_strict_bash_says_nothing(root: Path):
    done = run("bash", *STRICT, f"source {root}/env.sh")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.parametrize("shell", ["zsh", "sh"])
def test_other_shells_can_source_it(root: Path, shell: str):
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell} on this machine")
    done = run(shell, "-euc", ". ./env.sh; ros2 pkg executables nav_fusion", cwd=root)
    assert (done.returncode, done.stderr) == (0, "")
    assert "nav_fusion play" in done.stdout


def test_sourcing_twice_is_sourcing_once(root: Path):
    show = 'echo "$PATH $PYTHONPATH $LD_LIBRARY_PATH $AMENT_PREFIX_PATH"'
    once = run("bash", *STRICT, f"source {root}/env.sh; {show}")
    twice = run("bash", *STRICT, f"source {root}/env.sh; source {root}/env.sh; {show}")
    assert once.stdout == twice.stdout


def test_ros2_is_a_program_on_the_path(root: Path):
    done = run("bash", *STRICT, f"source {root}/env.sh; type -t ros2; env -i PATH=$PATH which ros2")
    assert done.stdout.splitlines()[0] == "file"
    assert Path(done.stdout.splitlines()[1]).is_file()


def test_a_ros2_that_is_there_is_not_replaced(root: Path, tmp_path: Path):
    real = tmp_path / "ros2"
    real.write_text("#!/bin/sh\n")
    real.chmod(0o755)
    path = f"{tmp_path}:{os.environ['PATH'].replace(f'{root}/tools/bin', '')}"
    done = run("bash", *STRICT, f"source {root}/env.sh; command -v ros2", env={"PATH": path})
    assert done.stdout.strip() == str(real)


def test_the_wheels_are_not_put_on_the_path_of_other_pythons(root: Path, tmp_path: Path):
    venv.create(tmp_path / "other", with_pip=False, symlinks=True)
    show = "import os, sys; print(sys.path, os.environ['LD_LIBRARY_PATH'], os.environ['PATH'])"
    done = run("bash", *STRICT, f'source {root}/env.sh; {tmp_path}/other/bin/python -c "{show}"')
    assert done.returncode == 0, done.stderr
    assert f"{root}/install/lib" in done.stdout
    assert ".venv" not in done.stdout


def test_an_environment_of_other_wheels_is_left_behind(root: Path):
    left = {"_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1", "LD_LIBRARY_PATH": "/other/lib"}
    code = "import rclpy, noise_msgs.msg; print('imported')"
    done = run(
        "bash", *STRICT, f'source {root}/env.sh; {root}/.venv/bin/python -c "{code}"', env=left
    )
    assert done.stdout == "imported\n", done.stderr


def test_an_unbuilt_workspace_names_the_next_step(root: Path, tmp_path: Path):
    shutil.copy(root / "env.sh", tmp_path)
    done = run("bash", "-c", f"source {tmp_path}/env.sh")
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert f"make -C {tmp_path} build" in done.stderr


def test_ros_of_apt_is_the_underlay_where_it_is_installed(root: Path, tmp_path: Path):
    """Not run here: the real /opt/ros/jazzy; its setup.sh reads variables that are not set, too."""
    (tmp_path / "setup.sh").write_text("export AMENT_PREFIX_PATH=/opt/it; echo $NOT_SET; false\n")
    show = "echo $AMENT_PREFIX_PATH; set -o | grep -E 'errexit|nounset'"
    done = run("bash", *STRICT, f"source {root}/env.sh; {show}", env={"ROS_JAZZY": str(tmp_path)})
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [f"{root}/install:/opt/it", "errexit", "on", "nounset", "on"]


def test_programs_run_with_the_python_of_the_workspace(root: Path):
    for program in (root / "install/lib/imu_noise_id").iterdir():
        assert program.read_text().splitlines()[0].startswith(f"#!{root}/.venv/bin/python")


def test_colcons_own_setup_chains_the_wheels(root: Path):
    if not (root / ".venv/local_setup.bash").exists():
        pytest.skip("ROS is not used as wheels here")
    done = run("bash", "-c", f"source {root}/install/setup.bash && echo $AMENT_PREFIX_PATH")
    assert done.stdout.strip() == f"{root}/install:{root}/.venv"


def test_the_tests_themselves_run_in_the_workspace(root: Path):
    assert Path(sys.prefix) == root / ".venv"
