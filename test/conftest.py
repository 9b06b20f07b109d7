"""What every test may ask for: the built workspace's environment, a ROS domain of its own, data."""

from __future__ import annotations

import fcntl
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
LAST_DOMAIN = 101  # beyond, DDS's ports run into those that Linux gives to outgoing connections


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep all tests with live nodes on one xdist worker: they need a core to be in time."""
    for item in items:
        if "ros_domain_id" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.xdist_group("live"))


@pytest.fixture(scope="session")
def root() -> Path:
    """Return the workspace's folder."""
    return ROOT


@pytest.fixture(scope="session")
def workspace_env() -> dict[str, str]:
    """Return the environment that ``source env.sh`` makes of this one."""
    sourced = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", "source ./env.sh && env -0"],
        cwd=ROOT,
        capture_output=True,
        check=False,
    )
    assert sourced.returncode == 0, sourced.stderr.decode()
    entries = sourced.stdout.decode().split("\0")
    return dict(entry.split("=", 1) for entry in entries if entry)


@pytest.fixture
def ros_domain_id() -> Iterator[int]:
    """Hold a ROS domain that no other test of this user has, in any worker, run or clone."""
    folder = Path(tempfile.gettempdir()) / f"ros_domains_{os.getuid()}"
    folder.mkdir(exist_ok=True)
    first = os.getpid() % LAST_DOMAIN
    for step in range(LAST_DOMAIN):
        domain = 1 + (first + step) % LAST_DOMAIN
        with open(folder / str(domain), "w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    pytest.fail(f"all {LAST_DOMAIN} ROS domains are in use (locks in {folder})")


@pytest.fixture
def ros_env(workspace_env: dict[str, str], ros_domain_id: int, tmp_path: Path) -> dict[str, str]:
    """Return the environment for nodes that a test starts as processes: a domain of their own."""
    return workspace_env | ros_settings(ros_domain_id, tmp_path)


@pytest.fixture
def ros_here(ros_domain_id: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """Put this process on a ROS domain of its own before it calls ``rclpy.init``; return the id."""
    for name, value in ros_settings(ros_domain_id, tmp_path).items():
        monkeypatch.setenv(name, value)
    return ros_domain_id


def ros_settings(domain: int, folder: Path) -> dict[str, str]:
    """Return the variables that keep a test's nodes to themselves, and their logs in its folder."""
    return {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(folder / "ros_log"),
    }


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """Return a function from a file name to its path in ``../shared/data``; skips without it."""

    def find(name: str) -> Path:
        path = ROOT.parent / "shared" / "data" / name
        if not path.exists():
            pytest.skip(f"needs the recording {name}, which is not in ../shared/data")
        return path

    return find
