"""What a fuzzer calls: bytes in, ``read`` or ``refused`` out, anything else an exception."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from imu_noise_id.errors import InputError
from imu_noise_id.model_file import load_model, model_text
from mcap.writer import CompressionType

from helpers import damaged_bags as damaged
from imu_noise_id import cdr

READERS = ("mcap", "metadata", "messages", "model")

_METADATA = b"""rosbag2_bagfile_information:
  version: 9
  storage_identifier: mcap
  compression_format: ''
  compression_mode: ''
  relative_file_paths:
  - bag.mcap
  files:
  - path: bag.mcap
    message_count: 6
"""
_MODEL = b"""format: model/1
channels:
- name: angular_velocity.x
  rate_hz: 100
  effects:
  - name: white_noise
    one_sided: true
    parameters: {density: 1e-4}
  - name: gauss_markov
    parameters: {sigma: {value: 1e-3, std_error: 1e-4, lower: 0, upper: 1}, correlation_time_s: 9}
"""


def starting_points(reader: str) -> list[bytes]:
    """Return whole inputs for a fuzzer to begin with."""
    if reader == "mcap":
        kinds = (CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD)
        whole = [damaged.tiny_mcap(kind) for kind in kinds]
        return [*whole, damaged.tiny_mcap(chunked=False)]
    if reader == "metadata":
        return [_METADATA]
    if reader == "messages":
        return [
            bytes([k]) + rows.shape[1].to_bytes(2, "little") + 2 * rows.tobytes()
            for k, rows in enumerate(_one_of_each_type())
        ]
    return [_MODEL]


def _one_of_each_type() -> list[cdr.Bytes]:
    one = np.array([1_700_000_000_000_000_000])
    return [cdr.encode(kind, one, {}, "imu_link") for kind in cdr.LAYOUTS]


def reader(name: str, folder: Path) -> Callable[[bytes], str]:
    """Return the function that tries an input of a reader; `folder` is its own."""
    if name == "mcap":
        return lambda data: damaged.read_or_refuse(_written(folder / "bag.mcap", data))
    if name == "metadata":
        bag = folder / "bag"
        bag.mkdir()
        (bag / "bag.mcap").write_bytes(damaged.tiny_mcap())

        def with_metadata(data: bytes) -> str:
            _written(bag / "metadata.yaml", data)
            return damaged.read_or_refuse(bag, judged=False)

        return with_metadata
    if name == "messages":
        return decode_messages
    return lambda data: read_model(_written(folder / "model.yaml", data))


def _written(path: Path, data: bytes) -> Path:
    path.write_bytes(data)
    return path


def decode_messages(data: bytes) -> str:
    """Decode bytes as messages of a type (byte 0) and a length (bytes 1 and 2)."""
    if len(data) < 3:
        return "refused"
    kinds = list(cdr.LAYOUTS)
    length = max(int.from_bytes(data[1:3], "little"), 1)
    messages = [data[k : k + length] for k in range(3, len(data), length)]
    decoded = cdr.decode_batch(kinds[data[0] % len(kinds)], messages)
    count = int(decoded.valid.sum())
    assert decoded.valid.shape == (len(messages),)
    assert decoded.stamp_ns.shape == (count,)
    assert decoded.values.shape[1] == count
    return "read" if count else "refused"


def read_model(path: Path) -> str:
    """Read a model file, write it and read it again: the same text."""
    try:
        text = model_text(load_model(path))
    except InputError as error:
        line = str(error)
        assert "\n" not in line, line
        assert str(path) in line, line
        return "refused"
    again = _written(path.with_name("again.yaml"), text.encode())
    assert model_text(load_model(again)) == text, "comes back otherwise"
    return "read"
