"""``identify``: its files, its table, and one clear line for whatever cannot be used."""

from __future__ import annotations

import json
import math
import os
import shutil
from pathlib import Path
from typing import Any

import pytest
from imu_noise_id.commands import identify
from imu_noise_id.model_file import load_model

from helpers.commands import DENSITIES, Run

CHANNEL_KEYS = {
    *("topic", "name", "unit", "rate_hz", "samples", "duration_s", "mean"),
    *("quality", "allan", "effects", "cca"),
}
QUALITY_KEYS = {
    *("gaps", "missing", "duplicates", "out_of_order", "non_finite", "held", "static", "notes"),
}
CCA_KEYS = {
    *("method", "order", "canonical_correlations", "chance_level", "significant", "H_z", "H_s"),
    *("poles", "zeros", "minimum_phase", "settling_time_s", "rise_time_s", "bandwidth_rise_hz"),
    *("bandwidth_3db_hz", "innovation_variance"),
}


def _refuse(constant: str) -> None:
    raise AssertionError(f"{constant} is not strict JSON")


def _strict(text: str) -> Any:
    return json.loads(text, parse_constant=_refuse)


@pytest.fixture(scope="module")
def output(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    assert identify.main(["--bag", str(bag), "--output", str(folder)]) == 0
    return folder


def test_a_link_to_itself_gets_one_line(run: Run, tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    result = run("identify", "--bag", tmp_path / "loop", "--output", tmp_path / "out")
    assert result.status == 2
    assert result.err.count("\n") == 1


def test_the_results_file_keeps_its_contract(output: Path, bag: Path) -> None:
    tree = _strict((output / "identify.json").read_text(encoding="utf-8"))
    assert tree["format"] == "identify/1"
    assert tree["bag"] == str(bag)
    assert len(tree["channels"]) == 6
    for channel in tree["channels"]:
        assert set(channel) >= CHANNEL_KEYS
        assert set(channel["quality"]) >= QUALITY_KEYS
        curve = channel["allan"]
        assert curve["confidence"] == 0.95
        assert (
            len(curve["tau_s"])
            == len(curve["deviation"])
            == len(curve["lower"])
            == len(curve["upper"])
            > 10
        )
        if channel["cca"] is not None:
            assert set(channel["cca"]) >= CCA_KEYS
        for effect in channel["effects"]:
            for parameter in effect["parameters"].values():
                assert set(parameter) == {"value", "std_error", "lower", "upper", "unit"}


def test_the_white_noise_that_was_put_in_is_inside_its_interval(output: Path) -> None:
    tree = _strict((output / "identify.json").read_text(encoding="utf-8"))
    for channel in tree["channels"]:
        density = channel["effects"][0]["parameters"]["density"]
        truth = DENSITIES[channel["name"].split(".")[0]]
        assert abs(density["value"] - truth) < 5.0 * density["std_error"]


def test_the_model_file_is_the_same_model(output: Path) -> None:
    tree = _strict((output / "identify.json").read_text(encoding="utf-8"))
    model = load_model(output / "model.yaml")
    for channel in tree["channels"]:
        for effect, fitted in zip(
            channel["effects"], model.channel(channel["name"]).effects, strict=True
        ):
            assert effect["name"] == fitted.name
            values = [p["value"] for p in effect["parameters"].values()]
            assert values == [e.value for e in fitted.estimates]


def test_json_goes_to_stdout_and_nothing_else_does(run: Run, bag: Path, output: Path) -> None:
    done = run("identify", "--bag", bag, "--json")
    assert done.status == 0
    assert _strict(done.out) == _strict((output / "identify.json").read_text(encoding="utf-8"))


def test_the_table_has_units_and_no_colours_in_a_pipe(run: Run, bag: Path, tmp_path: Path) -> None:
    done = run("identify", "--bag", bag, "--output", tmp_path)
    assert "rad/s/sqrt(Hz)" in done.out
    assert " .. " in done.out
    assert "\x1b" not in done.out + done.err
    assert "report.html" in done.out


def test_last_uses_the_end_only(run: Run, bag: Path) -> None:
    done = run("identify", "--bag", bag, "--last", 20, "--json")
    duration_s = _strict(done.out)["channels"][0]["duration_s"]
    assert math.isclose(duration_s, 20.0, abs_tol=0.03)


@pytest.mark.parametrize("topic", ["imu=/imu/data", "/imu/data"])
def test_a_topic_can_be_named(run: Run, bag: Path, topic: str) -> None:
    assert run("identify", "--bag", bag, "--topic", topic, "--last", 10, "--json").status == 0


def test_a_folder_of_bags_becomes_a_fleet(run: Run, bag: Path, tmp_path: Path) -> None:
    for name in ("unit_a", "unit_b"):
        shutil.copytree(bag, tmp_path / "bags" / name)
    (tmp_path / "bags" / "broken").mkdir()
    (tmp_path / "bags" / "broken" / "metadata.yaml").write_text("not a bag", encoding="utf-8")
    out = tmp_path / "out"
    done = run("identify", "--bag", tmp_path / "bags", "--output", out)
    tree = _strict((out / "fleet.json").read_text(encoding="utf-8"))
    assert [unit["name"] for unit in tree["units"]] == ["broken", "unit_a", "unit_b"]
    assert [unit["status"] for unit in tree["units"]] == ["failed", "identified", "identified"]
    for name in ("unit_a", "unit_b"):
        for file in ("identify.json", "model.yaml", "report.html"):
            assert (out / name / file).is_file()
    row = tree["parameters"][0]
    assert len(row["units"]) == 2
    assert row["spread"] == 0.0
    assert done.status == 2
    assert "broken" in done.err


@pytest.mark.parametrize("between", [[], ["--bag"]])
def test_bags_of_one_name_get_folders_of_their_own(
    bag: Path, tmp_path: Path, between: list[str]
) -> None:
    given = ["--bag", str(bag), *between, str(bag), "--output", str(tmp_path)]
    options = identify.parser().parse_args(given)
    jobs, fleet = identify.jobs_of(options)
    assert fleet
    assert [Path(job.output).name for job in jobs] == ["still", "still_2"]


def _refused(done: Any, *says: str) -> None:
    assert done.status == 2
    assert done.out == ""
    lines = done.err.strip().splitlines()
    assert len(lines) == 1, done.err
    assert lines[0].startswith("error: ")
    for text in says:
        assert text in lines[0]


def test_what_cannot_be_used_gets_one_line_and_exit_2(run: Run, bag: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    wrong = tmp_path / "wrong.mcap"
    wrong.write_bytes(b"")
    file = tmp_path / "file"
    file.write_text("", encoding="utf-8")
    out = tmp_path / "out"
    _refused(run("identify", "--bag", tmp_path / "none", "--output", out), "none")
    _refused(run("identify", "--bag", empty, "--output", out), "empty")
    _refused(run("identify", "--bag", wrong, "--output", out), "wrong.mcap")
    _refused(run("identify", "--bag", bag), "--output")
    _refused(run("identify", "--output", out), "--bag")
    _refused(run("identify", "--bag", bag, "--output", file), "file")
    _refused(run("identify", "--bag", bag, "--output", out, "--last", -1), "--last")
    _refused(
        run("identify", "--bag", bag, "--output", out, "--topic", "/nope"), "/nope", "/imu/data"
    )
    _refused(
        run("identify", "--bag", bag, "--output", out, "--topic", "fix=/imu/data"), "/imu/data"
    )
    _refused(run("identify", "--bag", bag, "--output", out, "--topic", "what=/imu/data"), "what")
    _refused(
        run("identify", "--bag", bag, "--output", out, "--topic", "imu=/a", "--topic", "imu=/b"),
        "imu is already '/a'",
    )
    _refused(run("identify", "--bag", bag, "--output", out, "--nonsense"), "--nonsense")


def test_an_unwritable_folder_is_found_out_before_the_work(
    run: Run, bag: Path, tmp_path: Path
) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    _refused(run("identify", "--bag", bag, "--output", locked / "out"), "locked")


def test_three_seconds_of_data_give_what_can_be_had(
    run: Run, model_path: Path, tmp_path: Path
) -> None:
    short = tmp_path / "short"
    simulated = run(
        "simulate", "--model", model_path, "--duration", 3, "--seed", 2, "--output", short
    )
    assert simulated.status == 0
    done = run("identify", "--bag", short, "--output", tmp_path / "out")
    assert done.status == 0
    assert _strict((tmp_path / "out" / "identify.json").read_text(encoding="utf-8"))["channels"]


def test_help_teaches_with_an_example(run: Run) -> None:
    for command in ("identify", "simulate", "reconcile", "export"):
        done = run(command, "--help")
        assert done.status == 0
        assert f"ros2 run imu_noise_id {command} --" in done.out
