"""A bag's messages come back as they were recorded, in their order."""

from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.bag_writer import TopicBytes, write_bag
from imu_noise_id.errors import InputError
from nav_fusion.replay import Timetable, choose, read_messages

from imu_noise_id import cdr

START_NS = 10**18


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    imu_ns = START_NS + np.arange(3000) * 10**6
    fix_ns = START_NS + 500_000 + np.arange(30) * 10**8
    imu = cdr.encode(cdr.IMU, imu_ns, {"angular_velocity.x": np.arange(3000.0)}, "imu")
    fix = cdr.encode(cdr.NAV_SAT_FIX, fix_ns, {"latitude": np.arange(30.0)}, "gps")
    write_bag(
        tmp_path / "bag",
        [
            TopicBytes("/imu/data", cdr.IMU, imu_ns, imu),
            TopicBytes("/gps/fix", cdr.NAV_SAT_FIX, fix_ns, fix),
        ],
    )
    return tmp_path / "bag"


def test_every_byte_comes_back_in_the_order_of_reception(bag: Path) -> None:
    topics = choose(bag, [])
    assert topics == {"/imu/data": cdr.IMU, "/gps/fix": cdr.NAV_SAT_FIX}
    messages = [m for batch in read_messages(bag, list(topics)) for m in batch]
    assert len(messages) == 3030
    times = [log_ns for log_ns, _, _ in messages]
    assert times == sorted(times)
    samples = cdr.decode_batch(cdr.IMU, [data for _, name, data in messages if name == "/imu/data"])
    assert np.array_equal(samples.values[0], np.arange(3000.0))


def test_only_what_was_asked_for_is_read(bag: Path) -> None:
    assert list(choose(bag, ["/gps/fix"])) == ["/gps/fix"]
    names = {name for batch in read_messages(bag, ["/gps/fix"]) for _, name, _ in batch}
    assert names == {"/gps/fix"}


def test_a_topic_that_is_not_there_is_named_with_those_that_are(bag: Path) -> None:
    with pytest.raises(InputError, match=r"no topic /nothing; it holds .*/imu/data"):
        choose(bag, ["/nothing"])


def test_a_timetable_keeps_the_spacing_and_divides_it_by_the_rate() -> None:
    table = Timetable(first_ns=START_NS, begin_ns=7, rate=4.0)
    assert table.due(START_NS) == 7
    assert table.due(START_NS + 10**9) == 7 + 250_000_000
