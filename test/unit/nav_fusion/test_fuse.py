"""nav_fusion.fuse and its command on small bags."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.bags import read_topics
from nav_fusion.commands.fuse import main
from nav_fusion.engine import Engine
from nav_fusion.fuse import STEPS, fuse_bag, rates_of
from nav_fusion.noise import from_model
from nav_fusion.parameters import Parameters
from rosbags.highlevel import AnyReader

from helpers.drive import Drive, drive, play, write
from imu_noise_id import cdr

MODEL = """\
format: model/1
channels:
""" + "".join(
    f"  - name: {name}.{axis}\n    effects:\n"
    f"      - {{name: white_noise, parameters: {{density: {density}}}}}\n"
    for name, density in (("angular_velocity", 1e-4), ("linear_acceleration", 2e-3))
    for axis in "xyz"
)


def test_a_bag_ends_in_the_engines_own_state(tmp_path: Path) -> None:
    d = drive(15.0)
    bag = write(d, tmp_path / "bag", 0.213)
    from imu_noise_id.model_file import load_model

    (tmp_path / "model.yaml").write_text(MODEL)
    model = load_model(tmp_path / "model.yaml")
    parameters = Parameters(initial_heading_rad=0.0)
    result = fuse_bag(bag, model, parameters)
    engine = Engine(from_model(model), parameters)
    play(engine, d, 0.213, covariance=0.09 * np.eye(3))
    assert np.array_equal(result.engine.state(), engine.state())
    assert result.status.late > 50


def test_it_tells_how_far_it_is_as_often_as_it_says(tmp_path: Path) -> None:
    told: list[str] = []
    fuse_bag(write(drive(12.0), tmp_path / "bag"), done=told.append)
    assert len(told) == STEPS


@pytest.mark.parametrize(
    ("d", "late_ns", "asked"),
    [
        (drive(60.0), 0, False),
        (drive(60.0), 200_000_000, True),
        (drive(60.0, noise_m=0.05), 0, False),
        (drive(60.0, rest_s=100.0, noise_m=1.5), 0, False),
    ],
    ids=["true", "late", "too careful", "loud at rest"],
)
def test_another_delay_is_sought_where_it_can_be_why_the_fixes_differ(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, d: Drive, late_ns: int, asked: bool
) -> None:
    from imu_noise_id.model_file import load_model

    (tmp_path / "model.yaml").write_text(MODEL)
    calls: list[Parameters] = []
    monkeypatch.setattr("nav_fusion.fuse.likelier", lambda _, p: calls.append(p))
    bag = write(replace(d, fix_ns=d.fix_ns + late_ns), tmp_path / "bag")
    fuse_bag(bag, load_model(tmp_path / "model.yaml"), Parameters(initial_heading_rad=0.0))
    assert bool(calls) == asked


def test_the_command_writes_what_the_contract_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write(drive(12.0), tmp_path / "bag")
    (tmp_path / "model.yaml").write_text(MODEL)
    out = tmp_path / "out"
    assert (
        main(["--bag", str(bag), "--model", str(tmp_path / "model.yaml"), "--output", str(out)])
        == 0
    )
    tree = json.loads((out / "fuse.json").read_text())
    assert tree["format"] == "fuse/1"
    assert set(tree["origin"]) == {"latitude_deg", "longitude_deg", "altitude_m"}
    assert set(tree["fixes"]) == {"used", "gated", "late", "rejected"}
    assert {"mean", "dof", "lower", "upper"} <= set(tree["nis"])
    assert isinstance(tree["white"], bool)
    assert tree["imu_samples"] == 1200
    with AnyReader([out / "filtered"]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        messages = [
            reader.deserialize(raw, c.msgtype)
            for c, _, raw in reader.messages()
            if c.topic == "/odometry/filtered"
        ]
    assert counts["/odometry/filtered"] == counts["/gps/filtered"] > 400
    pose = messages[-1].pose.covariance.reshape(6, 6)
    twist = messages[-1].twist.covariance.reshape(6, 6)
    assert np.all(np.diag(pose) > 0)
    assert np.all(np.diag(twist) > 0)
    assert "NIS" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda d: replace(d, force=d.force / 9.80665), "is g"),
        (lambda d: replace(d, rate=np.degrees(d.rate + 0.01)), "degrees"),
        (lambda d: replace(d, fix_ns=d.fix_ns + 3_600_000_000_000), "3600 s"),
        (lambda d: replace(d, fix_ns=d.fix_ns - 3_600_000_000_000), "3600 s"),
        (lambda d: replace(d, fix=d.fix * np.nan), "NaN"),
    ],
)
def test_what_cannot_be_fused_is_one_line_and_exit_2(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change,
    word: str,  # type: ignore[no-untyped-def]
) -> None:
    bag = write(change(drive(10.0)), tmp_path / "bag")
    assert main(["--bag", str(bag), "--output", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert word in error
    assert not (tmp_path / "out" / "fuse.json").exists()


def test_a_model_without_a_gyro_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write(drive(10.0), tmp_path / "bag")
    model = tmp_path / "model.yaml"
    model.write_text(
        "format: model/1\nchannels:\n"
        + "".join(MODEL.split("channels:\n")[1].partition("  - name: linear_acceleration.x")[1:])
    )
    assert main(["--bag", str(bag), "--model", str(model), "--output", str(tmp_path / "o")]) == 2
    assert "angular_velocity.x" in capsys.readouterr().err


@pytest.mark.parametrize("setting", ["lateness_s=9", "nonsense=1", "lever_arm_m=[1, 2]"])
def test_a_parameter_out_of_range_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], setting: str
) -> None:
    assert main(["--bag", "x", "--output", str(tmp_path), "--set", setting]) == 2
    assert setting.split("=")[0] in capsys.readouterr().err


def test_stamps_survive_the_bag(tmp_path: Path) -> None:
    d = drive(5.0)
    columns, _ = read_topics(write(d, tmp_path / "bag"))
    imu = next(c for c in columns if c.type == cdr.IMU)
    assert np.array_equal(imu.stamp_ns, d.stamp_ns)


def test_the_rate_of_each_aid_is_that_of_its_own_stamps(tmp_path: Path) -> None:
    columns, _ = read_topics(write(drive(10.0), tmp_path / "bag"))
    rates = rates_of(columns)
    assert rates.position_hz == pytest.approx(5.0)
    assert (rates.velocity_hz, rates.heading_hz) == (10.0, 10.0)


CALLED = """
import ast, inspect
from nav_fusion import consistency, core, engine, fuse, hypotheses
fuse.warm_up()
called = {
    getattr(globals()[node.func.value.id], node.func.attr)
    for module in (engine, consistency)
    for node in ast.walk(ast.parse(inspect.getsource(module)))
    if isinstance(node, ast.Call)
    and isinstance(node.func, ast.Attribute)
    and getattr(node.func.value, "id", "") in ("core", "hypotheses")
}
kernels = [kernel for kernel in called if hasattr(kernel, "signatures")]
assert {core.feed, core.insert, core.settled, hypotheses.heaviest} <= set(kernels)
print(*sorted(kernel.__name__ for kernel in kernels if not kernel.signatures))
"""


def test_the_builds_warm_up_leaves_no_kernel_to_be_compiled_while_a_robot_drives() -> None:
    """Two that are called first at the 1025th measurement took 1.9 s then."""
    done = subprocess.run(
        [sys.executable, "-c", CALLED],
        env={**os.environ, "PYTHONPATH": ":".join(sys.path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
