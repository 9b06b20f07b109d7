"""What a live run must not lose, in one file.

It holds, topic by topic, the buffered messages as columns (stamps, times of reception, values as
received) and the block averages of what the buffer has forgotten, so that a restarted run
identifies what the first one would have.  A reader sees the old or the new whole file; nothing in
it is ever executed.
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from imu_noise_id.cdr import LAYOUTS
from imu_noise_id.columns import TopicColumns
from imu_noise_id.errors import InputError
from imu_noise_id.files import replacing
from imu_noise_id.longrun import LongRun

FORMAT = "checkpoint/1"
_DAMAGED = (
    *(OSError, ValueError, KeyError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error),
    *(NotImplementedError, RuntimeError),  # what zipfile says of other compressions and of ciphers
)


@dataclass(frozen=True)
class Checkpoint:
    """Buffered columns of the topics of a live run, and what was before them."""

    columns: tuple[TopicColumns, ...]
    before: tuple[LongRun, ...] = ()


def save_checkpoint(checkpoint: Checkpoint, path: Path | str) -> None:
    """Replace a checkpoint file.

    Raises
    ------
    InputError
        When it cannot be written; the old file is untouched.
    """
    arrays: dict[str, np.ndarray] = {"format": np.array(FORMAT)}
    for k, columns in enumerate(checkpoint.columns):
        arrays |= _arrays(f"topic{k}", columns)
    for k, run in enumerate(run for run in checkpoint.before if not run.empty):
        arrays |= {f"before{k}.{f.name}": _array(getattr(run, f.name)) for f in fields(run)}
    with replacing(path) as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]


def load_checkpoint(path: Path | str) -> Checkpoint:
    """Read a checkpoint file.

    Raises
    ------
    InputError
        When it is missing, damaged or not a checkpoint.
    """
    try:
        with open(path, "rb") as stream, np.lib.npyio.NpzFile(stream) as arrays:
            if str(arrays["format"]) != FORMAT:
                raise InputError(f"{path}: not a {FORMAT} file: name another or remove it")
            names = sorted({key.split(".")[0] for key in arrays if "." in key})
            topics = tuple(_columns(n, arrays) for n in names if n.startswith("topic"))
            runs = tuple(_run(n, arrays) for n in names if n.startswith("before"))
            return Checkpoint(topics, runs)
    except _DAMAGED as error:
        raise InputError(
            f"{path}: no checkpoint can be read from it ({error}): remove it or name another"
        ) from error


def _member(arrays: np.lib.npyio.NpzFile, name: str) -> np.ndarray:
    """Return an array of the file; what is no array comes as bytes."""
    array = arrays[name]
    if not isinstance(array, np.ndarray):
        raise ValueError(f"{name} is no array")
    return array


def _array(value: object) -> np.ndarray:
    if isinstance(value, frozenset):
        return np.array(sorted(value), dtype=np.bytes_)
    return np.asarray(value)


def _run(name: str, arrays: np.lib.npyio.NpzFile) -> LongRun:
    parts: dict[str, Any] = {f.name: _member(arrays, f"{name}.{f.name}") for f in fields(LongRun)}
    for key, kind in (("topic", str), ("type", str), ("block_s", float), ("most", int)):
        parts[key] = kind(parts[key])
    for key in ("start_ns", "elapsed_ns", "newest_ns", "newest_log_ns"):
        parts[key] = int(parts[key])
    parts["frame_ids"] = frozenset(parts["frame_ids"].tolist())
    sums, counts, centre = parts["sums"], parts["counts"], parts["centre"]
    if sums.shape != (centre.size, counts.size) or parts["type"] not in LAYOUTS:
        raise ValueError(f"the averages of {name} do not fit {parts['type']}")
    return LongRun(**parts)


def _arrays(name: str, columns: TopicColumns) -> dict[str, np.ndarray]:
    return {
        f"{name}.topic": np.array(columns.topic),
        f"{name}.type": np.array(columns.type),
        f"{name}.stamp_ns": columns.stamp_ns,
        f"{name}.log_ns": columns.log_ns,
        f"{name}.values": columns.values,
        f"{name}.frame_ids": np.array(sorted(columns.frame_ids), dtype=np.bytes_),
        f"{name}.invalid": np.array(columns.invalid),
    }


def _columns(name: str, arrays: np.lib.npyio.NpzFile) -> TopicColumns:
    def get(part: str) -> np.ndarray:
        return _member(arrays, f"{name}.{part}")

    msgtype = str(get("type"))
    stamp_ns, log_ns, values = get("stamp_ns"), get("log_ns"), get("values")
    if msgtype not in LAYOUTS or values.shape != (len(LAYOUTS[msgtype].columns), stamp_ns.size):
        raise ValueError(f"the columns of {name} do not fit {msgtype}")
    if (stamp_ns.dtype, log_ns.dtype, values.dtype, log_ns.shape) != (
        np.dtype(np.int64),
        np.dtype(np.int64),
        np.dtype(np.float64),
        stamp_ns.shape,
    ):
        raise ValueError(f"the columns of {name} have other types than they should")
    frames: Sequence[bytes] = get("frame_ids").tolist()
    return TopicColumns(
        str(get("topic")), msgtype, stamp_ns, log_ns, values, frozenset(frames), int(get("invalid"))
    )
