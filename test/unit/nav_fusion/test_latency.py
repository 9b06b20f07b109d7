"""Waiting times of samples, as diagnostics tell them."""

import pytest
from nav_fusion.ros.latency import KEPT, Latency


def test_before_the_first_output_there_is_nothing_to_tell():
    latency = Latency()
    assert (latency.numbers(), latency.median_s(), latency.worst_s()) == ({}, 0.0, 0.0)


def test_percentiles_are_of_all_that_are_kept_and_in_milliseconds():
    latency = Latency()
    for k in range(101):
        latency.count(k * 1e-3)
    told = latency.numbers()
    assert told["latency_median_ms"] == pytest.approx(50.0)
    assert told["latency_p99_ms"] == pytest.approx(99.0)
    assert told["latency_max_ms"] == pytest.approx(100.0)


def test_the_worst_is_since_it_was_last_asked():
    latency = Latency()
    latency.count(3.0)
    assert latency.worst_s() == 3.0
    latency.count(1.0)
    assert latency.worst_s() == 1.0


def test_the_oldest_give_way():
    latency = Latency()
    latency.count(100.0)
    for _ in range(KEPT):
        latency.count(1.0)
    assert latency.numbers()["latency_max_ms"] == pytest.approx(1000.0)
