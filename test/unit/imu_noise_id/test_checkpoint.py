"""A checkpoint gives back what it was given, or one clear line."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from imu_noise_id.columns import TopicColumns
from imu_noise_id.errors import InputError

from imu_noise_id import cdr


def some(rng: np.random.Generator) -> Checkpoint:
    stamps = np.arange(100, dtype=np.int64)
    return Checkpoint(
        (
            TopicColumns("/imu", cdr.IMU, stamps, stamps + 1, rng.normal(size=(6, 100))),
            TopicColumns(
                "/t",
                cdr.TEMPERATURE,
                stamps,
                stamps,
                rng.normal(size=(1, 100)),
                frozenset({b"a"}),
                3,
            ),
        )
    )


def test_it_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    kept = some(np.random.default_rng(1))
    save_checkpoint(kept, tmp_path / "new" / "file")
    found_again = load_checkpoint(tmp_path / "new" / "file").columns
    for given, found in zip(kept.columns, found_again, strict=True):
        assert (found.topic, found.type, found.invalid) == (given.topic, given.type, given.invalid)
        assert found.frame_ids == given.frame_ids
        assert np.array_equal(found.stamp_ns, given.stamp_ns)
        assert np.array_equal(found.log_ns, given.log_ns)
        assert found.values.tobytes() == given.values.tobytes()


def test_a_file_cut_anywhere_is_refused_in_one_line(tmp_path: Path) -> None:
    file = tmp_path / "file"
    save_checkpoint(some(np.random.default_rng(1)), file)
    whole = file.read_bytes()
    for size in (0, 1, 100, len(whole) // 2, len(whole) - 1):
        file.write_bytes(whole[:size])
        with pytest.raises(InputError) as refused:
            load_checkpoint(file)
        assert str(file) in str(refused.value)
        assert "\n" not in str(refused.value)


def test_a_place_that_cannot_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "file").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        save_checkpoint(some(np.random.default_rng(1)), tmp_path / "file")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("at", [6, 8])
def test_a_compression_or_cipher_that_zip_files_may_have_is_refused(tmp_path, at):
    path = tmp_path / "checkpoint"
    save_checkpoint(Checkpoint(()), path)
    data = bytearray(path.read_bytes())
    for head, offset in ((b"PK\x03\x04", at), (b"PK\x01\x02", at + 2)):
        data[data.index(head) + offset] = 99
    path.write_bytes(data)
    with pytest.raises(InputError, match="no checkpoint can be read"):
        load_checkpoint(path)


def test_one_array_by_itself_is_no_checkpoint(tmp_path):
    path = tmp_path / "array.npy"
    np.save(path, np.zeros(3))
    with pytest.raises(InputError, match="no checkpoint can be read"):
        load_checkpoint(path)


def test_a_member_that_is_no_array_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint"
    save_checkpoint(some(np.random.default_rng(1)), path)
    with zipfile.ZipFile(path) as whole, zipfile.ZipFile(tmp_path / "changed", "w") as changed:
        for name in whole.namelist():
            data = whole.read(name)
            changed.writestr(name, data[1:] if name.startswith("topic0.stamp_ns") else data)
    with pytest.raises(InputError, match="is no array"):
        load_checkpoint(tmp_path / "changed")
