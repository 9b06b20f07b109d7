"""Write docs/messages.md from the comments of noise_msgs; ``python tools/make_message_docs.py``."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def text() -> str:
    """Return the page: every message and service with its comments, as they stand."""
    parts = [
        "# Messages and services of noise_msgs\n",
        "Unit and frame stand in brackets behind each field.",
        "Made by `tools/make_message_docs.py`.\n",
    ]
    for kind in ("msg", "srv"):
        for path in sorted((ROOT / "src" / "noise_msgs" / kind).glob(f"*.{kind}")):
            definition = path.read_text(encoding="utf-8").rstrip()
            parts.append(f"## {path.stem} ({kind})\n\n```text\n{definition}\n```\n")
    return "\n".join(parts)


if __name__ == "__main__":
    (ROOT / "docs" / "messages.md").write_text(text(), encoding="utf-8")
