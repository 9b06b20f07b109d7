"""``budget``: two files, sensors side by side, and one line for what cannot be computed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from nav_fusion.commands.budget import main

from helpers.commands import model_text


def call(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """Run the command; return its status and what it said on stderr."""
    capsys.readouterr()
    try:
        status = main([str(a) for a in arguments])
    except SystemExit as leaving:
        status = int(leaving.code or 0)
    return status, capsys.readouterr().err


def test_models_stand_side_by_side_in_both_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, poor = tmp_path / "good.yaml", tmp_path / "poor.yaml"
    good.write_text(model_text(100.0), encoding="utf-8")
    poor.write_text(model_text(100.0).replace("0.002", "0.02"), encoding="utf-8")
    out = tmp_path / "out"
    status, _ = call(capsys, "--model", good, poor, "--output", out, "--duration", 20)
    assert status == 0
    tree = json.loads((out / "budget.json").read_text(encoding="utf-8"))
    assert [m["model"] for m in tree["models"]] == [str(good), str(poor)]
    for scenario in (s for m in tree["models"] for s in m["scenarios"]):
        for name in ("position_sigma_m", "velocity_sigma_m_s", "heading_sigma_rad"):
            assert len(scenario[name]) == len(scenario["time_s"])
        shares = np.sum([s["position"] for s in scenario["shares"]], axis=0)
        np.testing.assert_allclose(shares[1:], 1.0, rtol=1e-9)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert str(good) in page
    assert str(poor) in page


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--model", "{model}"), "--output"),
        (("--output", "{out}"), "--model"),
        (("--model", "{none}", "--output", "{out}"), "none.yaml"),
        (("--model", "{bad}", "--output", "{out}"), "bad.yaml"),
        (("--model", "{half}", "--output", "{out}"), "angular_velocity.x"),
        (("--model", "{model}", "--output", "{out}", "--vibration", "-1"), "--vibration"),
        (("--model", "{model}", "--output", "{out}", "--duration", "0"), "--duration"),
        (("--model", "{model}", "--output", "{out}", "--duration", "0.01"), "--duration"),
        (("--model", "{model}", "--output", "{out}", "--duration", "1e9"), "--duration"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], says: str
) -> None:
    paths = {name: tmp_path / f"{name}.yaml" for name in ("model", "none", "bad", "half")}
    paths["model"].write_text(model_text(100.0), encoding="utf-8")
    paths["bad"].write_text("channels: [", encoding="utf-8")
    half = model_text(100.0).replace("angular_velocity", "magnetic_field")
    paths["half"].write_text(half, encoding="utf-8")
    out = tmp_path / "out"
    status, error = call(capsys, *(a.format(**paths, out=out) for a in arguments))
    assert status == 2
    assert error.count("\n") == 1
    assert says in error
    assert not (out / "budget.json").exists()
