"""``export``: a file for another tool, and on stderr what that tool cannot hold."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from helpers.commands import Run, model_text


@pytest.mark.parametrize("target", ["kalibr", "robot_localization", "gtsam", "gazebo"])
@pytest.mark.parametrize("rate_hz", [100.0, 400.0])
def test_every_target_gets_a_file_that_it_can_read(
    run: Run, model_path: Path, tmp_path: Path, target: str, rate_hz: float
) -> None:
    path = tmp_path / "exported"
    done = run(
        "export", "--model", model_path, "--format", target, "--rate", rate_hz, "--output", path
    )
    assert done.status == 0, done.err
    text = path.read_text(encoding="utf-8")
    if target == "gazebo":
        assert ElementTree.fromstring(text).tag == "sdf"
    else:
        assert yaml.safe_load(text)
    assert "sqrt" in text or "Hz" in text


def test_what_the_target_cannot_hold_is_said_on_stderr(run: Run, tmp_path: Path) -> None:
    model = tmp_path / "model.yaml"
    line = "  - {name: periodic, parameters: {frequency_hz: 43.0, amplitude: 0.02}}\n"
    model.write_text(model_text(100.0) + line, encoding="utf-8")
    output = tmp_path / "imu.yaml"
    done = run("export", "--model", model, "--format", "kalibr", "--rate", 100, "--output", output)
    assert done.status == 0
    assert "periodic" in done.err
    assert "43" in done.err


def test_what_cannot_be_exported_gets_one_line(run: Run, model_path: Path, tmp_path: Path) -> None:
    output = tmp_path / "out.yaml"
    good = ("--model", model_path, "--output", output)
    for arguments, says in (
        ((*good, "--format", "matlab", "--rate", 100), "matlab"),
        ((*good, "--format", "kalibr", "--rate", 0), "--rate"),
        ((*good, "--format", "kalibr"), "--rate"),
        (("--model", output, "--output", output, "--format", "kalibr", "--rate", 1), "out.yaml"),
    ):
        done = run("export", *arguments)
        assert done.status == 2
        assert done.err.count("\n") == 1
        assert says in done.err
    assert not output.exists()
