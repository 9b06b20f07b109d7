"""Many recordings over a cluster: nothing is lost when a worker is killed in the middle."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from threading import Event, Thread

import distributed
import pytest

from helpers.commands import Run

NAMES = ("unit_a", "unit_b", "unit_c")


def test_without_a_scheduler_the_next_step_is_said(run: Run, bag: Path, tmp_path: Path) -> None:
    done = run(
        *("identify", "--bag", bag, bag, "--last", 5, "--output", tmp_path),
        *("--scheduler", "tcp://127.0.0.1:9"),
    )
    assert done.status == 2
    assert done.err.count("\n") == 1
    assert "dask scheduler" in done.err


def _importing(pid: int) -> bool:
    """Whether a worker of a command has begun to import."""
    children = " ".join(f.read_text() for f in Path(f"/proc/{pid}/task").glob("*/children"))
    for child in children.split():
        process = Path(f"/proc/{child}")
        if "spawn_main" in (process / "cmdline").read_text():
            return "numpy" in (process / "maps").read_text()
    return False


def test_an_interrupt_ends_all_workers_without_a_word(bag: Path, tmp_path: Path) -> None:
    for name in NAMES:
        shutil.copytree(bag, tmp_path / "bags" / name)
    code = "import sys; from imu_noise_id.commands.identify import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "--bag", tmp_path / "bags", "--output", tmp_path / "out"]
    with subprocess.Popen(
        command,
        env={**os.environ, "PYTHONPATH": ":".join(sys.path)},
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        waiting = Event()
        while process.poll() is None and not _importing(process.pid):
            waiting.wait(0.01)
        os.killpg(process.pid, signal.SIGINT)
        _, said = process.communicate()
    assert said == b""
    assert process.returncode == 130


def _kill_after_first_result(victim: int, output: Path) -> None:
    waiting = Event()
    while not list(output.glob("*/identify.json")):
        waiting.wait(0.02)
    os.kill(victim, signal.SIGKILL)


@pytest.mark.timeout(300)
def test_a_killed_worker_loses_nothing(run: Run, bag: Path, tmp_path: Path) -> None:
    for name in NAMES:
        shutil.copytree(bag, tmp_path / "bags" / name)
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        victim = next(iter(client.run(os.getpid).values()))
        first = Thread(target=_kill_after_first_result, args=(victim, tmp_path / "out"))
        first.start()
        done = run(
            *("identify", "--bag", tmp_path / "bags", "--output", tmp_path / "out"),
            *("--scheduler", cluster.scheduler_address),
        )
    first.join()
    assert done.status == 0, done.err
    tree = json.loads((tmp_path / "out" / "fleet.json").read_text(encoding="utf-8"))
    assert [unit["name"] for unit in tree["units"]] == list(NAMES)
    assert all(unit["status"] == "identified" for unit in tree["units"])
