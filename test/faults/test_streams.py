"""Whatever drivers and clocks do to a stream: the noise is found as it is, or it is said why not.

``study/study_streams.py`` counts how often the intervals hold; here each fault comes once.  The
live node hands its buffer to the same function.
"""

import functools

import numpy as np
import pytest
from imu_noise_id.cdr import Decoded
from imu_noise_id.live import identify_columns
from imu_noise_id.watch import StreamWatch

from helpers import bad_streams as bad

COUNT = 8000


def arrived(fault, seed=5):
    rng = np.random.default_rng(seed)
    return fault(bad.still(rng, COUNT), rng)


@functools.cache
def identified(fault):
    return identify_columns([arrived(fault).columns()])


def said(found):
    return " ".join([*found.notes, *(n for c in found.channels for n in c.quality.notes)])


@pytest.mark.parametrize("fault", bad.HARMLESS, ids=lambda f: f.__name__)
def test_the_noise_of_a_bad_stream_is_found_as_it_is(fault):
    found = identified(fault)
    errors = bad.errors(found.model)
    assert len(errors) == 6
    assert np.abs(errors).max() < 4.5, errors  # the largest of six, in standard errors


@pytest.mark.parametrize("fault", bad.NAMED, ids=lambda f: f.__name__)
def test_what_the_stream_suffered_is_said(fault):
    words = bad.NAMED[fault]
    assert words in said(identified(fault))


@pytest.mark.parametrize("fault", [bad.drops, bad.duplicates, bad.out_of_order, bad.not_finite])
@pytest.mark.parametrize("size", [1, 50])
def test_the_watch_counts_what_the_stream_suffered(fault, size):
    stream, watch = arrived(fault), StreamWatch()
    for begin in range(0, stream.stamp_ns.size, size):
        part = slice(begin, begin + size)
        valid = np.ones(stream.stamp_ns[part].size, dtype=bool)
        decoded = Decoded(stream.stamp_ns[part], stream.values[:, part], valid, frozenset())
        watch.feed(decoded, stream.log_ns[part])
    counted = {
        "drops": watch.missing,
        "duplicates": watch.duplicates,
        "out_of_order": watch.out_of_order,
        "not_finite": watch.non_finite,
    }
    whole = {name: count for name, count in counted.items() if name != "drops" or count > 1000}
    assert whole[fault.__name__] > 50
