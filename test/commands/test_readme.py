"""The README's command lines run as printed, and what it and docs/ name really exists."""

from __future__ import annotations

import json
import re
import shlex
import signal
import subprocess
from pathlib import Path

import pytest
import yaml
from imu_noise_id.commands import export, identify, reconcile, simulate
from imu_noise_id.effects import CATALOGUE
from imu_noise_id.model_file import load_model
from nav_fusion.commands import budget, fuse, play

from helpers.live import Listener, Program

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
DOCS = sorted((ROOT / "docs").glob("*.md"))


def blocks(language: str) -> list[str]:
    """Return the fenced blocks of a language."""
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def lines(language: str) -> list[str]:
    return [line for block in blocks(language) for line in block.splitlines() if line]


@pytest.mark.timeout(1200)
def test_every_command_runs_as_printed(workspace_env: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    for line in lines("bash"):
        if line == "source env.sh":
            continue  # the environment is what it makes
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", line],
            cwd=tmp_path,
            env=workspace_env,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, f"{line}\n{done.stderr}"
        output = shlex.split(line)[shlex.split(line).index("--output") + 1]
        assert (tmp_path / output).exists(), line
    assert (tmp_path / "out" / "demo" / "report.html").is_file()


def in_place(words: list[str]) -> list[str]:
    """Return the arguments with the README's paths as seen from the workspace's folder."""
    return [str(ROOT / word) if word.startswith("bags/") else word for word in words]


@pytest.mark.timeout(300)
@pytest.mark.parametrize("line", lines("live"))
def test_every_live_line_starts_and_ends_cleanly(
    line: str,
    ros_env: dict[str, str],
    ros_here: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(ROOT)
    words = shlex.split(line)
    assert words[:2] == ["ros2", "run"]
    program, listener = Program(ros_env, tmp_path / "log", in_place(words[2:])), Listener()
    try:
        listener.until(
            lambda: set(listener.node.get_node_names()) & {"identify", "play", "fuse"},
            f"the node of: {line}",
        )
        assert program.end(signal.SIGINT) == 0, program.output
        assert "Traceback" not in program.output
    finally:
        program.kill()
        listener.close()


def test_the_model_typed_by_hand_is_one(tmp_path: Path) -> None:
    (text,) = blocks("yaml")
    path = tmp_path / "model.yaml"
    path.write_text(text, encoding="utf-8")
    model = load_model(path)
    assert [e.name for e in model.channels[0].effects] == ["white_noise", "gauss_markov"]


@pytest.mark.parametrize("page", [ROOT / "README.md", *DOCS], ids=lambda page: page.name)
def test_every_link_leads_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_every_effect_has_its_page_part_and_picture() -> None:
    text = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
    for name, kind in CATALOGUE.items():
        assert f"## {name}\n" in text
        assert (ROOT / "docs" / "pictures" / f"{name}.png").is_file()
        for parameter in kind.parameters:
            assert f"| `{parameter.name}` |" in text


def test_the_message_page_is_up_to_date() -> None:
    namespace: dict[str, object] = {"__file__": str(ROOT / "tools" / "make_message_docs.py")}
    source = (ROOT / "tools" / "make_message_docs.py").read_text(encoding="utf-8")
    exec(compile(source, "make_message_docs.py", "exec"), namespace)
    made = namespace["text"]
    assert callable(made)
    assert (ROOT / "docs" / "messages.md").read_text(encoding="utf-8") == made()


def test_completion_knows_every_flag() -> None:
    text = (ROOT / "tools" / "completion.bash").read_text(encoding="utf-8")
    for name, command in (
        ("imu_noise_id identify", identify),
        ("imu_noise_id simulate", simulate),
        ("imu_noise_id reconcile", reconcile),
        ("imu_noise_id export", export),
        ("nav_fusion fuse", fuse),
        ("nav_fusion budget", budget),
        ("nav_fusion play", play),
    ):
        (known,) = re.findall(rf'"{name}"\) echo (.*) ;;', text)
        flags = {a for action in command.parser()._actions for a in action.option_strings}
        assert set(known.split()) - {"--ros-args"} == flags - {"-h"}


def test_layouts_name_topics_that_the_nodes_publish() -> None:
    layout = json.loads((ROOT / "docs" / "foxglove_layout.json").read_text(encoding="utf-8"))
    rviz = yaml.safe_load((ROOT / "docs" / "fuse.rviz").read_text(encoding="utf-8"))
    named = set(re.findall(r'"(/[a-z/]+)', json.dumps(layout)))
    shown = [d for d in rviz["Visualization Manager"]["Displays"] if "Topic" in d]
    named |= {d["Topic"]["Value"] for d in shown}
    assert any(d["Covariance"]["Position"]["Value"] for d in shown)
    known = {"/odometry/filtered", "/gps/filtered", "/gps/fix", "/imu/data", "/identify/model"}
    assert named <= known | {"/diagnostics"}
    panels = set(layout["configById"])
    used = set(re.findall(r'"([A-Za-z]+![a-z]+)"', json.dumps(layout["layout"])))
    assert used == panels
