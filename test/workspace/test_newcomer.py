"""The script that follows the README knows every command of the suite."""

from __future__ import annotations

import re
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_it_asks_every_command_for_help() -> None:
    loader = SourceFileLoader("newcomer", str(ROOT / "tools" / "newcomer"))
    spec = spec_from_loader("newcomer", loader)
    assert spec is not None
    newcomer = module_from_spec(spec)
    loader.exec_module(newcomer)
    known = set()
    for package in ("imu_noise_id", "nav_fusion"):
        text = (ROOT / "src" / package / "setup.py").read_text(encoding="utf-8")
        (listed,) = re.findall(r"^commands = \[(.*)\]", text, re.MULTILINE)
        known |= {f"{package} {name}" for name in re.findall(r'"(\w+)"', listed)}
    assert set(newcomer.COMMANDS) == known


def test_the_readme_begins_with_the_lines_that_it_follows() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    first = re.findall(r"```\n(.*?)```", text, re.DOTALL)[0]
    assert first.splitlines()[0].startswith("git clone THIS_REPOSITORY")
    assert first.splitlines()[1:] == ["make demo"]
