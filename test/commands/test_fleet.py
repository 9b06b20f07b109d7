"""Many recordings over a cluster: nothing is lost when a worker is killed in the middle."""

from __future__ import annotations

import json
import os
import shutil
import signal
from pathlib import Path
from threading import Event, Thread

import pytest

from helpers.commands import Run

NAMES = ("unit_a", "unit_b", "unit_c")


def test_without_a_scheduler_the_next_step_is_said(run: Run, bag: Path, tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="Dask is an optional extra (pip install distributed)")
    done = run(
        *("identify", "--bag", bag, bag, "--last", 5, "--output", tmp_path),
        *("--scheduler", "tcp://127.0.0.1:9"),
    )
    assert done.status == 2
    assert done.err.count("\n") == 1
    assert "dask scheduler" in done.err


def _kill_after_first_result(victim: int, output: Path) -> None:
    waiting = Event()
    while not list(output.glob("*/identify.json")):
        waiting.wait(0.02)
    os.kill(victim, signal.SIGKILL)


@pytest.mark.timeout(300)
def test_a_killed_worker_loses_nothing(run: Run, bag: Path, tmp_path: Path) -> None:
    distributed = pytest.importorskip(
        "distributed", reason="Dask is an optional extra (pip install distributed)"
    )
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
