"""Effects on stamps: jitter and dropouts."""

from __future__ import annotations

import numpy as np
import pytest
from imu_noise_id.effects.dropouts import Dropouts, dropout_parameters, without_pauses
from imu_noise_id.effects.timestamp_jitter import TimestampJitter, jitter_std

RATE_HZ = 200.0
STAMPS = np.arange(60_000) / RATE_HZ


def in_ns(stamp_s: np.ndarray) -> np.ndarray:
    return np.rint(stamp_s * 1e9).astype(np.int64)


def test_jitter_gives_back_its_deviation_and_keeps_the_order() -> None:
    sent, index = TimestampJitter(3e-4).transport(STAMPS, 1.0 / RATE_HZ, np.random.default_rng(0))
    assert np.all(np.diff(sent) >= 0.0)
    assert np.array_equal(index, np.arange(STAMPS.size))
    assert jitter_std(in_ns(sent), RATE_HZ) == pytest.approx(3e-4, rel=0.02)


def test_a_drifting_clock_is_no_jitter() -> None:
    drifting = STAMPS * (1.0 + 1e-4) + 1e-8 * STAMPS**2
    assert jitter_std(in_ns(drifting), RATE_HZ) < 1e-8


def test_dropouts_give_back_rate_and_length() -> None:
    sent, index = Dropouts(0.5, 0.06).transport(STAMPS, 1.0 / RATE_HZ, np.random.default_rng(1))
    rate, length_s = dropout_parameters(in_ns(sent), RATE_HZ)
    assert np.array_equal(sent, STAMPS[index])
    assert rate == pytest.approx(0.5, rel=0.3)
    assert length_s == pytest.approx(0.06, rel=0.3)
    assert dropout_parameters(in_ns(STAMPS), RATE_HZ) == (0.0, 0.0)


def test_late_stamps_are_no_lost_messages() -> None:
    rng = np.random.default_rng(2)
    late = np.clip(rng.laplace(0.0, 3e-4, STAMPS.size), -2e-3, 2e-3)
    stamps = STAMPS + late
    assert np.any(np.diff(stamps) > 1.5 / RATE_HZ)
    assert dropout_parameters(in_ns(stamps), RATE_HZ) == (0.0, 0.0)


def test_lost_messages_are_counted_among_late_stamps() -> None:
    rng = np.random.default_rng(3)
    late = np.clip(rng.laplace(0.0, 3e-4, STAMPS.size), -2e-3, 2e-3)
    sent, index = Dropouts(0.5, 0.06).transport(STAMPS, 1.0 / RATE_HZ, rng)
    lost = int(np.sum(np.diff(index) - 1))
    rate, length_s = dropout_parameters(in_ns(sent + late[index]), RATE_HZ)
    assert rate * STAMPS[-1] * length_s * RATE_HZ == pytest.approx(lost, abs=2.0)


def test_a_pause_of_the_driver_is_no_dropout() -> None:
    """1 % lost one by one, and two minutes without a message: the law is that of the losses."""
    rng = np.random.default_rng(8)
    sent = STAMPS[rng.random(STAMPS.size) > 0.01]
    rate, length_s = dropout_parameters(in_ns(sent), RATE_HZ)
    later = np.concatenate((sent[: sent.size // 2], sent[sent.size // 2 :] + 120.0))
    paused_rate, paused_length_s = dropout_parameters(in_ns(later), RATE_HZ)
    assert paused_length_s == pytest.approx(length_s, rel=1e-3)
    assert paused_rate * (STAMPS[-1] + 120.0) == pytest.approx(rate * STAMPS[-1], rel=1e-3)


def test_long_gaps_that_belong_to_their_law_stay() -> None:
    rng = np.random.default_rng(9)
    for mean in (1.0, 5.0, 100.0):
        missing = rng.geometric(1.0 / mean, 300)
        assert without_pauses(missing).size == 300
    assert without_pauses(np.array([700, 800, 900, 9000])).size == 4
