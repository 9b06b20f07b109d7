"""Files are written whole or not at all."""

from __future__ import annotations

import contextlib
import glob
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from imu_noise_id.errors import InputError


@contextlib.contextmanager
def replacing(path: Path | str) -> Iterator[BinaryIO]:
    """Write a file anew, so that a reader sees the old or the new whole file.

    The bytes go to a temporary file of the same folder (made where it is missing), which is then
    renamed.  What a process left that was killed while it wrote is removed.

    Raises
    ------
    InputError
        When the disk is full, the place is read-only or not a folder; the old file is untouched.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        remove_leftovers(path.parent, f".{path.name}.", ".part")
        with open(temporary, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise InputError(
            f"{path}: cannot be written ({error.strerror}): free the place or name another"
        ) from error


def remove_leftovers(folder: Path, before: str, after: str) -> None:
    """Remove what is named ``before PID after`` in a folder where no such process runs any more."""
    for entry in folder.glob(f"{glob.escape(before)}*{glob.escape(after)}"):
        owner = entry.name.removeprefix(before).removesuffix(after)
        if not owner.isdecimal() or Path("/proc", owner).exists():
            continue
        with contextlib.suppress(OSError):
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()


@contextlib.contextmanager
def scratch_folder(path: Path) -> Iterator[Path]:
    """Yield a new folder beside a place; it is removed, by a later run where this one is killed."""
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_leftovers(path.parent, f".{path.name}.", ".part")
    folder = path.with_name(f".{path.name}.{os.getpid()}.part")
    folder.mkdir()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def write_text(path: Path | str, text: str) -> None:
    """Replace a file by a text, whole or not at all; raises as `replacing` does."""
    with replacing(path) as stream:
        stream.write(text.encode("utf-8"))


def read_text(path: Path | str, limit_bytes: int) -> str:
    """Read a text file of bounded size.

    Raises
    ------
    InputError
        When it is missing, a folder, unreadable, larger than the limit or not UTF-8.
    """
    try:
        with open(path, "rb") as stream:
            raw = stream.read(limit_bytes + 1)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}): check the path") from error
    if len(raw) > limit_bytes:
        raise InputError(f"{path}: larger than {limit_bytes // 2**20} MB: not a file of this suite")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: not a text file in UTF-8: check the path") from error
