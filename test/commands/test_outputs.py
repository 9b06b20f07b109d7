"""Where results cannot be written after the long work, every command keeps them and says where."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.bag_writer import write_bag
from imu_noise_id.commands import identify, reconcile, simulate
from nav_fusion.commands import budget, fuse

from helpers import bag_making as make

RESULTS = {
    "identify": {"identify.json", "model.yaml", "report.html"},
    "reconcile": {"reconcile.json", "model.yaml", "report.html"},
    "fuse": {"filtered", "fuse.json", "report.html"},
    "budget": {"budget.json", "report.html"},
    "simulate": {"metadata.yaml", "out.mcap"},
}
MAIN: dict[str, Callable[[list[str]], int]] = {
    "identify": identify.main,
    "reconcile": reconcile.main,
    "fuse": fuse.main,
    "budget": budget.main,
    "simulate": simulate.main,
}


@pytest.fixture
def still_bag(tmp_path: Path) -> Path:
    rng = np.random.default_rng(0)
    slow = make.uniform(300, 10.0)
    llh = rng.normal((45.0, 7.0, 200.0), (3e-6, 3e-6, 0.3), (slow.size, 3))
    write_bag(tmp_path / "bag", [make.still_imu(rng, 3000, 100.0), make.fixes(slow, llh)])
    return tmp_path / "bag"


@pytest.mark.parametrize("command", RESULTS)
def test_results_are_kept_where_the_output_became_unwritable(
    still_bag: Path,
    model_path: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    command: str,
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    output = tmp_path / "out"
    # a folder in a file's place lets the first look pass and the writing fail
    for name in RESULTS[command]:
        (output / name / "in the way").mkdir(parents=True)
    arguments = ["--output", str(output)]
    if command in ("identify", "reconcile", "fuse"):
        arguments += ["--bag", str(still_bag)]
    if command != "identify":
        arguments += ["--model", str(model_path)]
    if command == "simulate":
        arguments += ["--duration", "5", "--seed", "1"]
    assert MAIN[command](arguments) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert "cannot be written" in said
    kept = Path(said.rsplit("the results are kept in ", 1)[1])
    assert set(os.listdir(kept)) >= RESULTS[command]
