"""The one family of errors that a user can cause; commands turn it into one line and exit 2."""

from __future__ import annotations


class InputError(Exception):
    """Input that cannot be used.

    The message is a single line that names the file or topic, what is wrong with it and what to do.
    What it quotes may be anything: a value of several lines, a topic with control characters.
    """

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


class OutputError(InputError):
    """A place that cannot be written."""


def one_line(text: str) -> str:
    """A text from outside with what cannot be printed marked, so that it fits into a message."""
    return text if text.isprintable() else "".join(c if c.isprintable() else "\ufffd" for c in text)
