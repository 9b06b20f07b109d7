"""imu_noise_id.threads: the same as without threads."""

import pytest
from imu_noise_id.threads import cores, ordered_map


@pytest.mark.parametrize("threads", [1, 3])
def test_ordered_map_keeps_the_order(threads):
    assert list(ordered_map(lambda x: x * x, range(50), threads)) == [x * x for x in range(50)]


def test_there_is_a_thread_at_least():
    assert 1 <= cores() <= 4
