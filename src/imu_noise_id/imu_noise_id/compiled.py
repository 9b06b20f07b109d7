"""Compiled functions, also where there is no place to keep what was compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def njit(**options: Any) -> Callable[[F], F]:
    """Decorate as ``numba.njit(**options)``.

    Numba refuses to cache where neither the package nor the user's home can be written, as in a
    read-only container: the function is then compiled anew by each process that calls it.
    """

    def compiled(function: F) -> F:
        try:
            made: F = numba.njit(**options)(function)
        except RuntimeError:
            made = numba.njit(**{**options, "cache": False})(function)
        return made

    return compiled
