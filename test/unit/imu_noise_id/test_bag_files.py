"""Which files a path means, and that none outside the bag is read."""

import os

import numpy as np
import pytest
import yaml
import zstandard
from imu_noise_id.bag_files import find_bags, is_bag, open_bag_files
from imu_noise_id.bag_writer import write_bag
from imu_noise_id.bags import read_recording
from imu_noise_id.errors import InputError

from helpers import bag_making as make


@pytest.fixture
def bag(tmp_path):
    write_bag(tmp_path / "bag", [make.still_imu(np.random.default_rng(0), 500)])
    return tmp_path / "bag"


def rename_in_metadata(bag, name):
    path = bag / "metadata.yaml"
    content = yaml.safe_load(path.read_text())
    content["rosbag2_bagfile_information"]["relative_file_paths"] = [name]
    path.write_text(yaml.safe_dump(content))


def error_of(path):
    with pytest.raises(InputError) as caught:
        read_recording(path)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_a_missing_path(tmp_path):
    assert "no such file or folder" in error_of(tmp_path / "nothing")


def test_an_empty_folder(tmp_path):
    assert "no metadata.yaml, and no .mcap file in it" in error_of(tmp_path)


def test_a_folder_without_metadata_is_read_with_a_note(bag):
    (bag / "metadata.yaml").unlink()
    recording = read_recording(bag)
    assert len(recording.channels) == 6
    assert "has no metadata.yaml; bag.mcap in it is read" in recording.notes[0]


def test_two_files_without_metadata_are_a_question(bag):
    (bag / "metadata.yaml").unlink()
    (bag / "second.mcap").write_bytes((bag / "bag.mcap").read_bytes())
    assert "bag.mcap, second.mcap" in error_of(bag)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "a: b",
        "- &a [*a]",
        "rosbag2_bagfile_information: 3",
        "rosbag2_bagfile_information: {relative_file_paths: [[]]}",
        "\x00",
        "!!python/object/apply:os.system ['true']",
    ],
)
def test_unusable_metadata_is_noted_and_the_file_beside_it_read(bag, text):
    (bag / "metadata.yaml").write_text(text)
    recording = read_recording(bag)
    assert len(recording.channels) == 6
    assert "metadata.yaml" in recording.notes[0]


def test_metadata_beyond_its_limit_is_not_parsed(bag):
    (bag / "metadata.yaml").write_text("#" * (2 << 20))
    assert "larger than 1 MB" in read_recording(bag).notes[0]


@pytest.mark.parametrize("opening", ["[", "{", "- ", "? ", "a: ["])
def test_metadata_nested_without_end_is_left_at_its_sixteenth_level(bag, opening):
    (bag / "metadata.yaml").write_text(opening * ((1 << 20) // len(opening)))
    assert "metadata.yaml" in read_recording(bag).notes[0]


@pytest.mark.parametrize("name", ["../../etc/passwd", "/etc/passwd", "missing.mcap", "..", ".", ""])
def test_metadata_that_names_what_is_not_in_the_folder(bag, name):
    rename_in_metadata(bag, name)
    assert "which is no file of this folder" in error_of(bag)


def test_a_link_out_of_the_folder_is_not_followed(bag, tmp_path):
    outside = tmp_path / "outside.mcap"
    (bag / "bag.mcap").rename(outside)
    (bag / "bag.mcap").symlink_to(outside)
    assert "is a link out of the folder" in error_of(bag)


def test_names_with_the_folder_s_own_are_those_of_old_bags(bag):
    rename_in_metadata(bag, "bag/bag.mcap")
    assert len(read_recording(bag).channels) == 6


def test_a_pipe_is_no_bag(tmp_path):
    os.mkfifo(tmp_path / "pipe.mcap")
    assert "not a regular file" in error_of(tmp_path / "pipe.mcap")


def test_a_file_of_another_kind(tmp_path):
    (tmp_path / "notes.mcap").write_text("no bag")
    assert "not an MCAP file" in error_of(tmp_path / "notes.mcap")


def test_a_compressed_file_that_unpacks_without_end(tmp_path):
    packed = zstandard.ZstdCompressor(level=19).compress(bytes(300 << 20))
    (tmp_path / "bomb.mcap.zstd").write_bytes(packed)
    assert "unpacks to more than 100 times its size" in error_of(tmp_path / "bomb.mcap.zstd")


def test_a_compressed_file_that_ends_early(bag, tmp_path):
    packed = zstandard.ZstdCompressor().compress((bag / "bag.mcap").read_bytes())
    (tmp_path / "half.mcap.zstd").write_bytes(packed[:9])
    assert "half.mcap.zstd" in error_of(tmp_path / "half.mcap.zstd")


def test_nothing_unpacked_stays_behind(bag, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    packed = tmp_path / "bag.mcap.zstd"
    packed.write_bytes(zstandard.ZstdCompressor().compress((bag / "bag.mcap").read_bytes()))
    with open_bag_files(packed) as files:
        assert files.paths[0].is_relative_to(tmp_path)
        assert files.paths[0].exists()
    assert not files.paths[0].exists()


def test_bags_in_a_folder_are_found_by_name(bag, tmp_path):
    write_bag(tmp_path / "another", [make.still_imu(np.random.default_rng(1), 10)])
    (tmp_path / "empty").mkdir()
    assert find_bags(tmp_path) == (tmp_path / "another", bag)
    assert find_bags(bag) == (bag,)
    assert is_bag(bag / "bag.mcap")
    assert not is_bag(tmp_path / "empty")


def test_a_stray_file_beside_bags_does_not_make_their_folder_a_bag(bag, tmp_path):
    stray = tmp_path / "stray.mcap"
    stray.write_bytes((bag / "bag.mcap").read_bytes())
    assert not is_bag(tmp_path)
    assert find_bags(tmp_path) == (bag, stray)
