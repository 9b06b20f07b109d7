"""Files that are there whole or not at all, whatever happens while they are written."""

import os
import resource
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.bag_writer import write_bag
from imu_noise_id.bags import read_recording
from imu_noise_id.errors import InputError, OutputError
from imu_noise_id.files import replacing, write_or_keep, write_text

from helpers import bag_making as make

OLD, NEW = "old" * 100_000, "new" * 100_000


@pytest.fixture
def dead():
    """Return the id of a process that has ended."""
    process = subprocess.Popen(["true"])
    process.wait()
    return process.pid


def test_a_file_is_replaced_whole(tmp_path):
    write_text(tmp_path / "new" / "a.txt", OLD)
    write_text(tmp_path / "new" / "a.txt", NEW)
    assert (tmp_path / "new" / "a.txt").read_text() == NEW
    assert os.listdir(tmp_path / "new") == ["a.txt"]


def test_what_a_killed_process_left_is_removed_by_the_next(tmp_path, dead):
    (tmp_path / f".a.txt.{dead}.part").write_text("half")
    (tmp_path / f".bag.{dead}.part").mkdir()
    (tmp_path / f".bag.{dead}.part" / "half.mcap").write_text("half")
    (tmp_path / f".b.txt.{dead}.part").write_text("of another file")
    running = tmp_path / ".a.txt.1.part"
    running.write_text("of a process that runs")
    write_text(tmp_path / "a.txt", NEW)
    write_bag(tmp_path / "bag", [make.still_imu(np.random.default_rng(0), 10)])
    left = {".a.txt.1.part", f".b.txt.{dead}.part"}
    assert set(os.listdir(tmp_path)) == {"a.txt", "bag", *left}


def test_a_writer_that_is_killed_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.txt"
    write_text(path, OLD)
    child = os.fork()
    if child == 0:
        with replacing(path) as stream:
            stream.write(NEW.encode()[:1000])
            stream.flush()
            os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    assert path.read_text() == OLD


@pytest.fixture
def full_disk():
    """Let no file of this process grow beyond 10 kB, as a full disk would."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_is_one_line_and_leaves_the_old_file(tmp_path, full_disk):
    path = tmp_path / "a.txt"
    write_text(path, "old")
    with pytest.raises(InputError, match=r"cannot be written .*: free the place or name another"):
        write_text(path, NEW)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_full_disk_leaves_the_old_bag(tmp_path, request):
    rng = np.random.default_rng(0)
    write_bag(tmp_path / "bag", [make.still_imu(rng, 10)])
    request.getfixturevalue("full_disk")
    with pytest.raises(InputError, match="cannot be written"):
        write_bag(tmp_path / "bag", [make.still_imu(rng, 4000)])
    assert read_recording(tmp_path / "bag").channels[0].values.size == 10
    assert os.listdir(tmp_path) == ["bag"]


def results(place):
    """Two files, as a command's results are."""
    write_text(place / "a.json", "{}")
    write_text(place / "b.html", "page")


def test_results_that_cannot_be_written_are_kept_where_the_message_says(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    blocked = tmp_path / "out"
    (blocked / "b.html").mkdir(parents=True)
    with pytest.raises(OutputError, match=r"b\.html: cannot be written") as caught:
        write_or_keep(results, blocked)
    kept = Path(str(caught.value).rsplit("kept in ", 1)[1])
    assert {file.name: file.read_text() for file in kept.iterdir()} == {
        "a.json": "{}",
        "b.html": "page",
    }


def test_results_go_into_memory_where_temporary_files_have_no_room(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    with pytest.raises(OutputError, match=r"kept in /dev/shm/imu_noise_id_\w+/out") as caught:
        write_or_keep(results, Path("/proc/out"))
    shutil.rmtree(str(caught.value).rsplit("kept in ", 1)[1].removesuffix("/out"))


def test_results_that_fit_nowhere_are_said_to_be_lost(tmp_path, monkeypatch, full_disk):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with pytest.raises(OutputError, match="the results are lost"):
        write_or_keep(lambda place: write_text(place / "a", NEW), tmp_path / "out")
    assert os.listdir(tmp_path) == ["out"]
