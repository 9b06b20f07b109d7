"""The one family of errors that a user can cause; commands turn it into one line and exit 2."""

from __future__ import annotations


class InputError(Exception):
    """Input that cannot be used.

    The message is a single line that names the file or topic, what is wrong with it and what to do.
    """
