"""A page in a real headless Chromium: what it logged, its document, its picture."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import pytest

_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--no-first-run", "--hide-scrollbars"),
    *("--enable-logging=stderr", "--v=0", "--virtual-time-budget=20000"),
)


@dataclass(frozen=True)
class Visit:
    """What a browser made of a page: its console's errors and warnings, and the document."""

    complaints: tuple[str, ...]
    document: str

    def attribute(self, name: str) -> str:
        """Value of an attribute of the root element, or an empty text."""
        found = re.search(rf'<html[^>]* {name}="([^"]*)"', self.document)
        return found.group(1) if found else ""


def chromium() -> str:
    """Path of the browser; skips the test where there is none."""
    for name in ("chromium", "chromium-browser", "google-chrome"):
        if (path := shutil.which(name)) is not None:
            return path
    pytest.skip("no chromium on the PATH (apt-get install chromium)")


def visit(page: Path, width: int = 1280, height: int = 1600) -> Visit:
    """Open a page, wait until it is idle, and read it."""
    browser = chromium()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        done = subprocess.run(
            [
                *(browser, *_FLAGS, f"--user-data-dir={profile}"),
                *(f"--window-size={width},{height}", "--dump-dom", page.as_uri()),
            ],
            capture_output=True,
            text=True,
            timeout=240,
        )
    logged = [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
    return Visit(tuple(logged), done.stdout)
