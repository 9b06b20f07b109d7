"""A bag's path to the files that hold its messages, without leaving the bag."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import zstandard

from imu_noise_id.errors import InputError
from imu_noise_id.yaml_tree import read_yaml

SQLITE_MAGIC = b"SQLite format 3\0"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
METADATA_LIMIT = 1 << 20
UNPACKED_LIMIT = 100
"""A compressed file may unpack to this many times its size (and 64 MiB)."""


@dataclass(frozen=True)
class BagFiles:
    """The files of a bag in their order.

    Attributes
    ----------
    name : str
        The path as the user gave it.
    paths : tuple of Path
        MCAP or sqlite3 files, unpacked.
    labels : tuple of str
        The files as the bag names them, for messages.
    message_compression : str
        ``zstd`` where each message is compressed by itself.
    notes : tuple of str
    """

    name: str
    paths: tuple[Path, ...]
    labels: tuple[str, ...]
    message_compression: str = ""
    notes: tuple[str, ...] = ()


def is_bag(path: Path) -> bool:
    """Whether a path looks like a bag: a folder with metadata.yaml or one .mcap, or an .mcap.

    A folder with bags in it is none, whatever stray file lies beside them.
    """
    if path.is_dir():
        if (path / "metadata.yaml").is_file():
            return True
        beside = any((entry / "metadata.yaml").is_file() for entry in path.iterdir())
        return not beside and len(list(path.glob("*.mcap"))) == 1
    return path.is_file() and path.suffix in (".mcap", ".db3")


def find_bags(path: Path) -> tuple[Path, ...]:
    """The bag at `path`, or the bags that lie in that folder, sorted by name."""
    if is_bag(path) or not path.is_dir():
        return (path,)
    return tuple(sorted(entry for entry in path.iterdir() if is_bag(entry)))


@contextmanager
def open_bag_files(bag: str | Path) -> Iterator[BagFiles]:
    """Find a bag's files; what has to be unpacked lives in a temporary folder until the end.

    Raises
    ------
    InputError
    """
    path = Path(bag)
    if not path.exists():
        raise InputError(f"{bag}: no such file or folder; give a rosbag2 folder or an .mcap file")
    names, mode, notes = _listed(path) if path.is_dir() else ([path], "", ())
    with ExitStack() as stack:
        folder: Path | None = None
        paths = []
        for k, file in enumerate(names):
            if not _magic(file).startswith(ZSTD_MAGIC):
                paths.append(file)
                continue
            folder = folder or Path(stack.enter_context(tempfile.TemporaryDirectory()))
            paths.append(_unpacked(file, folder / f"{k}-{file.stem}"))
        compression = "zstd" if mode == "message" else ""
        yield BagFiles(str(bag), tuple(paths), tuple(str(n) for n in names), compression, notes)


def _listed(folder: Path) -> tuple[list[Path], str, tuple[str, ...]]:
    """Files, compression mode and notes of a bag folder."""
    metadata = folder / "metadata.yaml"
    loose = sorted(f for f in folder.iterdir() if f.suffix == ".mcap")
    if not metadata.is_file():
        if len(loose) == 1:
            note = f"{folder} has no metadata.yaml; {loose[0].name} in it is read"
            return [_inside(folder, loose[0].name)], "", (note,)
        found = ", ".join(f.name for f in loose[:5]) or "no .mcap file"
        raise InputError(
            f"{folder}: no metadata.yaml, and {found} in it; give a rosbag2 folder or one .mcap "
            "file ('ros2 bag reindex' makes the metadata anew)"
        )
    try:
        listed, mode = _information(metadata)
    except InputError as error:
        if len(loose) != 1:
            raise InputError(f"{error}; 'ros2 bag reindex' makes it anew") from error
        note = f"{error}; {loose[0].name} beside it is read"
        return [_inside(folder, loose[0].name)], "", (note,)
    return [_inside(folder, name) for name in listed], mode, ()


def _information(metadata: Path) -> tuple[list[str], str]:
    """File names and compression mode of metadata.yaml; an InputError says what is wrong."""
    root = read_yaml(metadata, METADATA_LIMIT)
    top = root.value if isinstance(root.value, dict) else {}
    found = top.get("rosbag2_bagfile_information")
    if found is None or not isinstance(found.value, dict):
        raise root.error("not the metadata of a rosbag2 folder")
    listed = found.value.get("relative_file_paths")
    if listed is None or not isinstance(listed.value, list) or not listed.value:
        raise found.error("it names no file ('relative_file_paths')")
    names = [name.text("a file's name") for name in listed.value]
    mode = found.value.get("compression_mode")
    return names, mode.value.lower() if mode and isinstance(mode.value, str) else ""


def _inside(folder: Path, name: str) -> Path:
    """The file of that name in the folder; neither ``..`` nor a link leads out of it.

    Old bags prefix the name with the folder's own; only the last part counts.
    """
    path = folder / PurePosixPath(name).name
    if not path.is_file():
        raise InputError(f"{folder}: metadata.yaml names {name!r}, which is no file of this folder")
    if folder.resolve() not in path.resolve().parents:
        raise InputError(f"{folder}: {name!r} is a link out of the folder; copy the file into it")
    return path


def _magic(path: Path) -> bytes:
    if not path.is_file():
        raise InputError(f"{path}: not a regular file; give a rosbag2 folder or an .mcap file")
    with path.open("rb") as file:
        return file.read(16)


def _unpacked(path: Path, target: Path) -> Path:
    """Unpack a file that rosbag2 compressed whole."""
    limit = UNPACKED_LIMIT * path.stat().st_size + (64 << 20)
    try:
        with zstandard.open(path, "rb") as source, target.open("wb") as file:
            while block := source.read(1 << 20):
                file.write(block)
                if file.tell() > limit:
                    raise InputError(
                        f"{path}: unpacks to more than {UNPACKED_LIMIT} times its size; "
                        "unpack it with zstd and give the folder of the result"
                    )
    except (zstandard.ZstdError, EOFError) as error:
        if not target.stat().st_size:  # else what came before the damage is read
            raise InputError(f"{path}: cannot be unpacked ({error}); copy it again") from error
    except OSError as error:
        free = shutil.disk_usage(target.parent).free
        raise InputError(
            f"{path}: cannot be unpacked into {target.parent} ({error}; {free >> 20} MiB free)"
        ) from error
    if not target.stat().st_size:
        raise InputError(f"{path}: unpacks to nothing; copy it again")
    return target
