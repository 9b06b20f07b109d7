"""Files are written whole or not at all."""

from __future__ import annotations

import contextlib
import glob
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from imu_noise_id.errors import InputError, OutputError


@contextlib.contextmanager
def replacing(path: Path | str) -> Iterator[BinaryIO]:
    """Write a file anew, so that a reader sees the old or the new whole file.

    The bytes go to a temporary file of the same folder (made where it is missing), which is then
    renamed.  What a process left that was killed while it wrote is removed.

    Raises
    ------
    OutputError
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
        raise OutputError(
            f"{path}: cannot be written ({error.strerror}): free the place or name another"
        ) from error


def write_or_keep(write: Callable[[Path], None], place: Path) -> None:
    """Write the results of long work; where they cannot be written, keep them in a temporary place.

    Parameters
    ----------
    write : callable
        Writes them all at the path that it is given.
    place : Path

    Raises
    ------
    OutputError
        When the place cannot be written (any more); says where the results are instead: in the
        folder for temporary files, or in memory (``/dev/shm``) where that has no room either.
    """
    try:
        write(place)
    except OutputError as error:
        raise OutputError(f"{error}; {_kept(write, place.absolute().name)}") from error


def _kept(write: Callable[[Path], None], name: str) -> str:
    for temporary in (tempfile.gettempdir(), "/dev/shm"):  # noqa: S108 - made by mkdtemp
        try:
            folder = Path(tempfile.mkdtemp(prefix="imu_noise_id_", dir=temporary))
        except OSError:
            continue
        try:
            write(folder / name)
        except OutputError:
            shutil.rmtree(folder, ignore_errors=True)
        else:
            return f"the results are kept in {folder / name}"
    return "the results are lost: no other place has room for them"


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
