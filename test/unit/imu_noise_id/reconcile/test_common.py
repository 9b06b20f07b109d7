"""Slow noise that a short recording of a simulator could not show is no difference."""

from __future__ import annotations

import numpy as np
import pytest
from imu_noise_id.identify import identify_recording
from imu_noise_id.reconcile import ChannelReconciliation, reconcile_recording
from imu_noise_id.reconcile.common import COMMON_NOISE
from imu_noise_id.recording import Channel, Floats, Recording
from scipy.signal import lfilter

NAME, RATE_HZ, DENSITY = "linear_acceleration.x", 50.0, 1e-3


def recorded(values: Floats) -> Recording:
    stamp_ns = np.arange(values.size) * 20_000_000
    still = np.ones(values.size, dtype=bool)
    return Recording("", 0, (Channel("/imu", NAME, "m/s^2", stamp_ns, values, still, RATE_HZ),))


def white_and_flicker(duration_s: float, rng: np.random.Generator, flicker: float) -> Floats:
    """Flicker as a sum of exponentials, an octave apart."""
    n = round(duration_s * RATE_HZ)
    out = rng.normal(0.0, DENSITY * np.sqrt(RATE_HZ), n)
    for octave in range(-3, 14):
        a = np.exp(-1.0 / RATE_HZ / 2.0**octave)
        sigma = flicker * np.sqrt(np.log(2.0) / np.pi)
        kicks = sigma * np.sqrt(1.0 - a * a) * rng.standard_normal(n)
        out += lfilter([1.0], [1.0, -a], kicks, zi=[a * sigma * rng.standard_normal()])[0]
    return np.asarray(out)


def held_against(recording: Recording, simulation: Recording, told: bool) -> ChannelReconciliation:
    model = identify_recording(simulation, 1).model
    result = reconcile_recording(recording, model, 0, 1, simulation=simulation if told else None)
    return result.channel(NAME)


@pytest.mark.parametrize("seed", [2, 6])  # two in five: what makes a difference without it
def test_flicker_that_the_simulation_was_too_short_to_show_is_no_difference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    simulation = recorded(white_and_flicker(120.0, rng, 0.5e-3))
    recording = recorded(white_and_flicker(1200.0, rng, 0.5e-3))
    alone = held_against(recording, simulation, told=False)
    assert alone.verdict != "agrees"
    both = held_against(recording, simulation, told=True)
    assert both.verdict == "agrees"
    assert COMMON_NOISE in both.notes


@pytest.mark.parametrize("seed", range(3))
def test_a_walk_that_the_simulation_has_not_is_named(seed: int) -> None:
    rng = np.random.default_rng([seed, 5])
    simulation = recorded(white_and_flicker(600.0, rng, 0.0))
    values = white_and_flicker(600.0, rng, 0.0)
    values += np.cumsum(rng.normal(0.0, 0.15e-3 / np.sqrt(RATE_HZ), values.size))
    found = held_against(recorded(values), simulation, told=True)
    assert found.verdict == "explained"
    assert found.steps
