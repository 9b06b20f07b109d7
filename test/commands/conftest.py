"""Small bags for the commands, written once, and a way to run a command inside the test."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import pytest

from helpers.commands import Result, Run, model_text


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Return a function that runs a command of imu_noise_id as its console script does."""

    def call(command: str, *arguments: object) -> Result:
        module = import_module(f"imu_noise_id.commands.{command}")
        capsys.readouterr()
        try:
            status = module.main([str(a) for a in arguments])
        except SystemExit as leaving:
            status = leaving.code
        printed = capsys.readouterr()
        return Result(status, printed.out, printed.err)

    return call


@pytest.fixture(scope="session")
def model_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a hand-typed model file."""
    path = tmp_path_factory.mktemp("model") / "model.yaml"
    path.write_text(model_text(100.0), encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def bag(model_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of 60 s of white noise at 100 Hz."""
    from imu_noise_id.commands import simulate

    path = tmp_path_factory.mktemp("bags") / "still"
    arguments = ["--model", model_path, "--duration", 60, "--seed", 1, "--output", path]
    assert simulate.main([str(a) for a in arguments]) == 0
    return path
