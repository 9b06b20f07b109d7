"""A rosbag2 database: what is in it, and that nothing in it runs."""

import sqlite3
import struct

import numpy as np
import pytest
from imu_noise_id.bags import read_recording
from imu_noise_id.errors import InputError

from helpers import bag_making as make
from helpers.damaged_bags import sqlite_bytes
from imu_noise_id import cdr, sqlite_file

OLD_TOPICS = "CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format)"
MESSAGES = "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)"


@pytest.fixture
def path(tmp_path):
    (tmp_path / "bag.db3").write_bytes(sqlite_bytes(tmp_path))
    return tmp_path / "bag.db3"


def old_bag(path, rows, messages_table=MESSAGES):
    """Write a database as the first rosbag2 did, without definitions."""
    with sqlite3.connect(path) as database:
        database.execute(OLD_TOPICS)
        database.execute(messages_table)
        database.execute("INSERT INTO topics VALUES(1, '/imu', ?, 'cdr')", (cdr.IMU,))
        if rows:
            database.executemany("INSERT INTO messages VALUES(?, 1, ?, ?)", rows)
    return path


def test_topics_with_their_counts_and_definitions(path):
    with sqlite_file.open_sqlite(path) as database:
        imu, fix = sqlite_file.topics(database)
        assert (imu.name, imu.type, imu.count) == ("/imu/data", cdr.IMU, 40)
        assert "angular_velocity" in imu.definition
        assert fix.count == 10


def test_messages_come_from_a_time_on(path):
    with sqlite_file.open_sqlite(path) as database:
        last = sqlite_file.last_ns(database)
        batches = list(sqlite_file.messages(database, 1, last - 50_000_000))
    assert [len(times) for times, _ in batches] == [6]


def test_a_bag_without_definitions_is_read(tmp_path):
    imu = make.still_imu(np.random.default_rng(0), 30, 100.0)
    rows = [(k, int(t), r.tobytes()) for k, (t, r) in enumerate(zip(imu.log_ns, imu.messages,
                                                                   strict=True))]  # fmt: skip
    recording = read_recording(old_bag(tmp_path / "old.db3", rows))
    assert recording.channels[0].values.size == 30


def test_rows_of_other_types_are_no_messages(tmp_path):
    imu = make.still_imu(np.random.default_rng(0), 2, 100.0)
    good = [(k, int(imu.log_ns[k]), imu.messages[k].tobytes()) for k in range(2)]
    rows = [*good, (7, "noon", b"x"), (8, 5, "text"), (9, None, None)]
    assert read_recording(old_bag(tmp_path / "odd.db3", rows)).channels[0].values.size == 2


def test_a_view_in_place_of_a_table_is_not_run(tmp_path):
    endless = (
        "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id+1 FROM n) "
        "SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM n"
    )
    with pytest.raises(InputError, match="it has no table messages"):
        read_recording(old_bag(tmp_path / "view.db3", [], endless))


def test_a_database_of_something_else_is_a_clear_line(tmp_path):
    with sqlite3.connect(tmp_path / "other.db3") as database:
        database.execute("CREATE TABLE friends(name)")
    with pytest.raises(InputError, match="not readable as a rosbag2 database"):
        read_recording(tmp_path / "other.db3")


def interior_page(size, child, cells):
    """A page of a table's tree whose every child is the same page."""
    page = bytearray(size)
    places = range(size - 5 * cells, size, 5)
    struct.pack_into(">BHHHBI", page, 0, 5, 0, cells, places[0], 0, child)
    for k, at in enumerate(places):
        struct.pack_into(">H", page, 12 + 2 * k, at)
        struct.pack_into(">IB", page, at, child, min(k, 127))
    return bytes(page)


def test_pages_that_name_each_other_are_not_read_for_ever(tmp_path):
    imu = make.still_imu(np.random.default_rng(0), 5, 100.0)
    rows = [(k, int(imu.log_ns[k]), imu.messages[k].tobytes()) for k in range(5)]
    path = old_bag(tmp_path / "maze.db3", rows)
    with sqlite3.connect(path) as database:
        root = database.execute("SELECT rootpage FROM sqlite_master WHERE name='messages'")
        (at,) = root.fetchone()
    data = bytearray(path.read_bytes())
    size, count = struct.unpack_from(">H", data, 16)[0], struct.unpack_from(">I", data, 28)[0]
    leaf = data[(at - 1) * size : at * size]
    levels = 10  # of a hundred children each: 10^20 rows in a file of 60 kB
    data[(at - 1) * size : at * size] = interior_page(size, count + 1, 100)
    for level in range(2, levels + 1):
        data += interior_page(size, count + level, 100)
    data += leaf
    struct.pack_into(">I", data, 28, count + levels)
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"rosbag2 database \(interrupted"):
        read_recording(path)


def test_a_computed_column_is_refused(tmp_path):
    endless = (
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, "
        "data AS (zeroblob(1000000000)))"
    )
    with pytest.raises(InputError, match="messages has a computed column"):
        read_recording(old_bag(tmp_path / "computed.db3", [], endless))


def test_a_message_longer_than_any_is_none(tmp_path):
    imu = make.still_imu(np.random.default_rng(0), 2, 100.0)
    good = [(k, int(imu.log_ns[k]), imu.messages[k].tobytes()) for k in range(2)]
    path = old_bag(tmp_path / "long.db3", good)
    with sqlite3.connect(path) as database:
        database.execute(f"INSERT INTO messages VALUES(2, 1, 5, zeroblob({2**21}))")
    recording = read_recording(path)
    assert "1 messages of topic /imu are no sensor_msgs/Imu" in recording.notes[0]
