"""``reconcile``: three files, every channel listed, and the mended model can be used at once."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.bag_writer import write_bag
from imu_noise_id.model_file import load_model

from helpers.bag_making import imu, still_imu, uniform
from helpers.commands import Run, model_text

VERDICTS = {"agrees", "explained", "unexplained"}


def test_a_model_reconciled_with_its_own_bag_agrees(
    run: Run, bag: Path, model_path: Path, tmp_path: Path
) -> None:
    done = run("reconcile", "--bag", bag, "--model", model_path, "--output", tmp_path)
    assert done.status == 0, done.err
    tree = json.loads((tmp_path / "reconcile.json").read_text(encoding="utf-8"))
    assert tree["format"] == "reconcile/1"
    assert [c["verdict"] for c in tree["channels"]] == ["agrees"] * 6
    assert (tmp_path / "report.html").stat().st_size < 3_000_000
    assert len(load_model(tmp_path / "model.yaml").channels) == 6


def test_a_louder_recording_is_named_and_the_mended_model_simulates(
    run: Run, model_path: Path, tmp_path: Path
) -> None:
    loud = tmp_path / "loud.yaml"
    loud.write_text(model_text(100.0).replace("density: 0.00012", "density: 0.00018"), "utf-8")
    bag = tmp_path / "bag"
    assert (
        run("simulate", "--model", loud, "--duration", 60, "--seed", 5, "--output", bag).status == 0
    )
    out = tmp_path / "out"
    done = run("reconcile", "--bag", bag, "--model", model_path, "--output", out)
    assert done.status == 0, done.err
    tree = json.loads((out / "reconcile.json").read_text(encoding="utf-8"))
    channels = {c["name"]: c for c in tree["channels"]}
    gyro = channels["angular_velocity.x"]
    assert gyro["verdict"] == "explained"
    assert (gyro["steps"][0]["action"], gyro["steps"][0]["effect"]["name"]) == (
        "refit",
        "white_noise",
    )
    assert {c["verdict"] for c in tree["channels"]} <= VERDICTS
    again = tmp_path / "again"
    mended = out / "model.yaml"
    assert (
        run("simulate", "--model", mended, "--duration", 5, "--seed", 1, "--output", again).status
        == 0
    )


def test_a_simulators_recording_stands_in_for_the_model(
    run: Run, bag: Path, tmp_path: Path
) -> None:
    done = run("reconcile", "--bag", bag, "--simulation", bag, "--output", tmp_path)
    assert done.status == 0, done.err
    tree = json.loads((tmp_path / "reconcile.json").read_text(encoding="utf-8"))
    assert {c["verdict"] for c in tree["channels"]} == {"agrees"}


def test_the_topic_asked_for_is_read_from_the_simulators_bag(run: Run, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    write_bag(tmp_path / "real", [still_imu(rng, 6000)])
    two = [still_imu(rng, 6000, topic=topic) for topic in ("/sim/imu", "/sim/other")]
    write_bag(tmp_path / "played", two)
    bags = ("--bag", tmp_path / "real", "--simulation", tmp_path / "played")
    done = run("reconcile", *bags, "--output", tmp_path / "out")
    assert done.status == 2
    assert "--topic imu=NAME" in done.err
    done = run("reconcile", *bags, "--topic", "imu=/sim/imu", "--output", tmp_path / "out")
    assert done.status == 0, done.err


def test_a_simulator_without_noise_gets_the_recordings(run: Run, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    stamp_ns = uniform(6000, 200.0)
    write_bag(tmp_path / "real", [still_imu(rng, 6000)])
    silent = np.zeros((6000, 3))
    write_bag(tmp_path / "played", [imu(stamp_ns, silent, silent + np.array((0.0, 0.0, 9.8)))])
    out = tmp_path / "out"
    bags = ("--bag", tmp_path / "real", "--simulation", tmp_path / "played")
    done = run("reconcile", *bags, "--output", out)
    assert done.status == 0, done.err
    tree = json.loads((out / "reconcile.json").read_text(encoding="utf-8"))
    for channel in tree["channels"]:
        first = channel["steps"][0]
        assert (first["action"], first["effect"]["name"]) == ("add", "white_noise")
        assert channel["verdict"] == "explained"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--model", "MODEL"), "--bag"),
        (("--bag", "BAG"), "--model"),
        (("--bag", "BAG", "--model", "MODEL", "--simulation", "BAG"), "not allowed"),
        (("--bag", "none", "--model", "MODEL"), "none"),
        (("--bag", "BAG", "--model", "none.yaml"), "none.yaml"),
    ],
)
def test_what_cannot_be_compared_gets_one_line(
    run: Run, bag: Path, model_path: Path, tmp_path: Path, arguments: tuple[str, ...], says: str
) -> None:
    given = [{"BAG": str(bag), "MODEL": str(model_path)}.get(a, a) for a in arguments]
    done = run("reconcile", *given, "--output", tmp_path / "out")
    assert done.status == 2
    assert done.err.count("\n") == 1
    assert says in done.err
