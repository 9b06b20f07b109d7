"""No code is ever loaded from data: no pickle, no eval, no unsafe YAML, in any module."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MODULES = sorted((ROOT / "src").rglob("*.py"))
CALLS = {"eval", "exec", "compile", "__import__"}
MEMBERS = {
    *(("yaml", "load"), ("yaml", "unsafe_load"), ("yaml", "full_load"), ("os", "system")),
    *(("os", "popen"), ("pickle", "load"), ("marshal", "loads"), ("joblib", "load")),
}
IMPORTS = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "runpy"}
LISTENERS = {"socket", "socketserver", "http", "xmlrpc", "asyncio", "aiohttp", "flask", "tornado"}
OWN_PIPE = "imu_noise_id/ros/worker.py"
"""Sends arrays to its own child by a pipe that nobody else can open; its one use of pickle."""


def imported(tree: ast.AST) -> set[str]:
    """Names of the packages that a module imports, anywhere in it."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add((node.module or "").split(".")[0])
    return names


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT / "src")))
def test_a_module_runs_nothing_that_it_reads(path):
    tree = ast.parse(path.read_text())
    own_pipe = str(path).endswith(OWN_PIPE)
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        called = node.func
        if isinstance(called, ast.Name):
            assert called.id not in CALLS, f"line {node.lineno}: {called.id}"
        elif isinstance(called, ast.Attribute) and isinstance(called.value, ast.Name):
            member = (called.value.id, called.attr)
            assert member not in MEMBERS, f"line {node.lineno}: {'.'.join(member)}"
        for keyword in node.keywords:
            allowed = isinstance(keyword.value, ast.Constant) and keyword.value.value is False
            assert keyword.arg not in ("allow_pickle", "shell") or allowed, f"line {node.lineno}"
    assert not imported(tree) & (IMPORTS - ({"pickle"} if own_pipe else set()))


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT / "src")))
def test_no_module_opens_a_port(path):
    assert not imported(ast.parse(path.read_text())) & LISTENERS
