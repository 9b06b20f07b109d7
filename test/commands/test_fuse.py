"""``fuse --bag``: one line for what cannot be run, and real recordings end to end."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from nav_fusion.commands.fuse import main
from rosbags.highlevel import AnyReader

from helpers.bag_making import npz_bag
from helpers.commands import model_text

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--output", "{out}"), "--bag"),
        (("--bag", "{none}"), "--output"),
        (("--bag", "{none}", "--output", "{out}"), "none"),
        (("--bag", "{none}", "--model", "{bad}", "--output", "{out}"), "bad.yaml"),
        (("--bag", "{none}", "--output", "{out}", "--set", "lateness_s=9"), "lateness_s"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], says: str
) -> None:
    paths = {"none": tmp_path / "none", "bad": tmp_path / "bad.yaml", "out": tmp_path / "out"}
    paths["bad"].write_text("channels: [", encoding="utf-8")
    assert main([a.format(**paths) for a in arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert says in error
    assert not (paths["out"] / "fuse.json").exists()


@pytest.mark.parametrize("name", ["comma2k19_ex1", "rtkx_walk0827"])
def test_a_real_recording_gives_a_bag_and_a_page_of_figures(name: str, tmp_path: Path) -> None:
    source = DATA / f"{name}.npz"
    if not source.exists():
        pytest.skip(f"no {source}: recordings are not part of the project")
    model = tmp_path / "model.yaml"
    model.write_text(model_text(100.0), encoding="utf-8")
    bag, out = npz_bag(source, tmp_path), tmp_path / "out"
    assert main(["--bag", str(bag), "--model", str(model), "--output", str(out)]) == 0
    tree = json.loads((out / "fuse.json").read_text(encoding="utf-8"))
    fixes = tree["fixes"]
    assert tree["format"] == "fuse/1"
    assert fixes["used"] > 500
    assert fixes["gated"] < 0.02 * fixes["used"]
    with AnyReader([out / "filtered"]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
    assert counts["/odometry/filtered"] == counts["/gps/filtered"] > 2000
