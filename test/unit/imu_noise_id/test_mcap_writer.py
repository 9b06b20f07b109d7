"""imu_noise_id.mcap_writer: the files are read back by the format's own library, index and all."""

import io

import numpy as np
import pytest
from imu_noise_id.mcap_writer import TopicBytes, write_mcap
from mcap.reader import SeekingReader, make_reader
from mcap.records import Statistics

DEFINITIONS = {"std_msgs/msg/String": "string data", "sensor_msgs/msg/Fast": "float64 x"}


def topics(rng, count=30_000, size=96):
    fast = np.arange(count, dtype=np.int64) * 1_000_000
    slow = fast[::700] + 500
    texts = [bytes(rng.integers(0, 256, rng.integers(0, 3000), dtype=np.uint8)) for _ in slow]
    rows = rng.integers(0, 256, (count, size), dtype=np.uint8)
    return [
        TopicBytes("/slow", "std_msgs/msg/String", slow[::-1].copy(), texts),
        TopicBytes("/fast", "sensor_msgs/msg/Fast", fast, rows),
    ]


def written(given, compressed=True):
    file = io.BytesIO()
    write_mcap(file, given, DEFINITIONS, "version: 9", compressed)
    file.seek(0)
    return file


@pytest.mark.parametrize("compressed", [True, False])
def test_every_message_comes_back_in_the_order_of_time(compressed):
    given = topics(np.random.default_rng(0))
    reader = make_reader(written(given, compressed), validate_crcs=True)
    assert isinstance(reader, SeekingReader)
    found = [(c.topic, s.name, m.log_time, m.data) for s, c, m in reader.iter_messages()]
    expected = sorted(
        (int(ns), t.topic, t.type, bytes(m))
        for t in given
        for ns, m in zip(t.log_ns, t.messages, strict=True)
    )
    assert [(ns, topic, kind, data) for topic, kind, ns, data in found] == expected


@pytest.mark.filterwarnings("ignore:.*deprecated")
def test_a_stretch_is_found_by_the_index():
    given = topics(np.random.default_rng(1))
    reader = make_reader(written(given), validate_crcs=True)
    found = reader.iter_messages(["/fast"], 5_000_000_000, 5_100_000_000)
    times = [m.log_time for _, _, m in found]
    assert times == list(range(5_000_000_000, 5_100_000_000, 1_000_000))


def test_the_summary_counts_what_is_there():
    given = topics(np.random.default_rng(2))
    reader = make_reader(written(given))
    summary = reader.get_summary()
    assert isinstance(summary.statistics, Statistics)
    counts = {
        summary.channels[k].topic: n for k, n in summary.statistics.channel_message_counts.items()
    }
    assert counts == {t.topic: t.log_ns.size for t in given}
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 3
    assert {s.name: s.data.decode() for s in summary.schemas.values()} == DEFINITIONS
    assert [m.metadata for m in reader.iter_metadata()] == [{"serialized_metadata": "version: 9"}]


def test_a_topic_without_messages_is_named_all_the_same():
    empty = TopicBytes("/none", "std_msgs/msg/String", np.empty(0, np.int64), [])
    summary = make_reader(written([empty])).get_summary()
    assert [c.topic for c in summary.channels.values()] == ["/none"]
    assert summary.statistics.message_count == 0
