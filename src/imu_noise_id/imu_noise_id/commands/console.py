"""What every command shares: arguments, errors as one line, progress on a terminal only."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NoReturn

from imu_noise_id.errors import InputError, OutputError

BAD_INPUT = 2
INTERRUPTED = 130


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line, and where the examples are."""

    def __init__(self, command: str, purpose: str, examples: str) -> None:
        super().__init__(
            prog=f"ros2 run {command}",
            description=purpose,
            epilog=f"examples:\n{examples}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )

    def error(self, message: str) -> NoReturn:
        """Print one line on stderr and exit 2."""
        print(f"error: {message} (--help shows examples)", file=sys.stderr)
        raise SystemExit(BAD_INPUT)


def run(
    parser: argparse.ArgumentParser,
    work: Callable[[argparse.Namespace], int | None],
    arguments: list[str] | None,
) -> int:
    """Parse, work, and turn what a user can cause into one line on stderr and exit 2."""
    # read when numpy is imported, after this: our threads go over channels, and BLAS's own would
    # spin beside them
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    _open_closed_streams()
    try:
        status = work(parser.parse_args(arguments)) or 0
        sys.stdout.flush()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return BAD_INPUT
    except MemoryError:
        print("error: not enough memory: take a shorter time (--last, --duration)", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # the reader of our output went away (| head): nothing is left to be said
        _silence_output()
        return 0
    except OSError as error:
        if error.filename is not None:
            raise
        _silence_output()
        print(f"error: standard output: cannot be written ({error.strerror})", file=sys.stderr)
        return BAD_INPUT
    return status


def _open_closed_streams() -> None:
    """Let what is printed go nowhere where the caller has closed a stream (``>&-``)."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115 - stays open


def _silence_output() -> None:
    """Leave nothing that the end of the process would try to write again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def positive(text: str) -> float:
    """Return a finite number above zero, for argparse."""
    number = float(text)
    if not 0.0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"must be a number above 0, not '{text}'")
    return number


positive.__name__ = "number"


def seed(text: str) -> int:
    """Return a whole number from zero, for argparse."""
    number = int(text)
    if number < 0:
        raise argparse.ArgumentTypeError(f"must be 0 or more, not '{text}'")
    return number


seed.__name__ = "whole number"


@contextlib.contextmanager
def progress(total: int, what: str) -> Iterator[Callable[[str], None]]:
    """Yield a function that tells of a step done: a bar with time left, on a terminal only."""
    if not sys.stderr.isatty():
        yield lambda step: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.progress import TimeRemainingColumn as TimeLeft

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TimeLeft())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)

        def advance(step: str) -> None:
            bar.update(task, advance=1, description=step)

        yield advance


def warn(notes: tuple[str, ...] | list[str]) -> None:
    """Print notes on stderr, one line each."""
    for note in notes:
        print(f"note: {' '.join(note.split())}", file=sys.stderr)


def check_folder(folder: Path) -> None:
    """Find out that a folder cannot be written before the long work, not after it.

    Raises
    ------
    OutputError
        When it cannot be made or written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({error.strerror}): free the place or name another"
        ) from error
