"""Values that the model has wrong are refitted, effects that are not there are removed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import Reconciliation, reconcile_recording
from imu_noise_id.recording import Channel, Floats, Recording, unit_of
from scipy.signal import lfilter

NAMES = ("linear_acceleration.x", "linear_acceleration.y")
RATE_HZ, N = 100.0, 12_000
DENSITY = 1e-3
SIGMA = DENSITY * np.sqrt(RATE_HZ)


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


def noise(seed: int = 0) -> Floats:
    return np.asarray(np.random.default_rng(seed).normal(0.0, SIGMA, (2, N)))


def wandering_line(amplitude: float, frequency_hz: float = 23.0) -> Floats:
    """A line whose phase walks by a third of a radian over the recording."""
    t = np.arange(N) / RATE_HZ
    walk = np.cumsum(np.random.default_rng(7).normal(0.0, 0.33 / np.sqrt(N), N))
    return np.asarray(amplitude * np.cos(2.0 * np.pi * frequency_hz * t + walk))


def narrow_noise(sigma: float) -> Floats:
    """Noise between 20 and 22 Hz, by its Fourier transform."""
    spectrum = np.fft.rfft(np.random.default_rng(8).normal(size=N))
    f = np.fft.rfftfreq(N, 1.0 / RATE_HZ)
    spectrum[(f < 20.0) | (f > 22.0)] = 0.0
    band = np.fft.irfft(spectrum, N)
    return np.asarray(sigma * band / band.std())


def hits(rate: float, scale: float) -> Floats:
    rng = np.random.default_rng(9)
    return np.asarray(rng.normal(0.0, scale, N) * (rng.random(N) < rate))


def reconciled(values: Floats, *extra: tuple[str, dict[str, Any]]) -> Reconciliation:
    """Of two channels with a typed model of white noise, the first with more effects."""
    stamps = np.arange(N) * 10_000_000
    still = np.ones(N, dtype=bool)
    channels = tuple(
        Channel("/imu/data", name, unit_of(name), stamps, v, still, RATE_HZ)
        for name, v in zip(NAMES, values, strict=True)
    )
    white: tuple[str, dict[str, Any]] = ("white_noise", {"density": DENSITY})
    models = []
    for name, effects in zip(NAMES, ((white, *extra), (white,)), strict=True):
        typed = tuple(typed_effect(e, name, p) for e, p in effects)
        models.append(ChannelModel(name, "/imu/data", unit_of(name), RATE_HZ, 0.0, typed))
    return reconcile_recording(Recording("typed", 0, channels), NoiseModel(tuple(models)))


def steps(result: Reconciliation, name: str = NAMES[0]) -> list[tuple[str, str]]:
    return [(s.action, s.effect.name) for s in result.channel(name).steps]


LINE = {"frequency_hz": 23.0, "amplitude": 1e-5}
BAND = {"frequency_hz": 21.0, "bandwidth_hz": 1.2, "sigma": 1e-3}
HITS = {"rate": 2e-4, "scale": 0.2}
STEP = {"time_s": 60.0, "height": 0.003}


def test_a_line_of_another_amplitude_is_refitted() -> None:
    values = noise() + np.stack((wandering_line(4e-3), np.zeros(N)))
    result = reconciled(values, ("periodic", LINE))
    assert steps(result) == [("refit", "periodic")]
    assert result.channel(NAMES[0]).verdict == "explained"
    line = result.model.channel(NAMES[0]).find("periodic")
    assert line is not None
    assert line.estimates[1].value == pytest.approx(4e-3, rel=0.1)


def test_a_line_whose_phase_wanders_has_one_name() -> None:
    values = noise() + np.stack((wandering_line(2e-2), np.zeros(N)))
    result = reconciled(values)
    assert steps(result) == [("add", "periodic")]
    assert result.channel(NAMES[0]).after.score < 1.3


def test_a_line_as_given_agrees() -> None:
    values = noise() + np.stack((wandering_line(4e-3), np.zeros(N)))
    result = reconciled(values, ("periodic", {"frequency_hz": 23.0, "amplitude": 4e-3}))
    assert steps(result) == []


def test_a_line_a_little_off_its_typed_frequency_is_the_same_line() -> None:
    values = noise() + np.stack((wandering_line(4e-3, 23.1), np.zeros(N)))
    result = reconciled(values, ("periodic", {"frequency_hz": 23.0, "amplitude": 1e-3}))
    assert steps(result) == [("refit", "periodic")]


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("periodic", {"frequency_hz": 23.0, "amplitude": 4e-3}),
        ("narrow_band", {"frequency_hz": 21.0, "bandwidth_hz": 1.2, "sigma": 4e-3}),
        ("outliers", {"rate": 2e-3, "scale": 0.2}),
        ("bias_step", STEP),
        ("held_samples", {"factor": 2.0}),
    ],
)
def test_what_is_not_there_is_removed(name: str, parameters: dict[str, Any]) -> None:
    result = reconciled(noise(), (name, parameters))
    assert steps(result) == [("remove", name)]
    assert result.model.channel(NAMES[0]).find(name) is None


def test_a_louder_band_is_refitted() -> None:
    values = noise() + np.stack((narrow_noise(5e-3), np.zeros(N)))
    assert steps(reconciled(values, ("narrow_band", BAND)))[0] == ("refit", "narrow_band")


def test_more_outliers_are_refitted() -> None:
    values = noise() + np.stack((hits(2e-3, 0.2), np.zeros(N)))
    result = reconciled(values, ("outliers", HITS))
    assert steps(result) == [("refit", "outliers")]


def test_a_higher_step_is_refitted() -> None:
    t = np.arange(N) / RATE_HZ
    values = noise() + np.stack((np.where(t < 60.0, 0.0, 0.006), np.zeros(N)))
    result = reconciled(values, ("bias_step", STEP))
    assert steps(result) == [("refit", "bias_step")]
    step = result.model.channel(NAMES[0]).find("bias_step")
    assert step is not None
    assert step.estimates[1].value == pytest.approx(0.006, rel=0.2)


def test_a_coarser_comb_is_refitted() -> None:
    values = noise()
    values[0] = np.round(values[0] / 8e-3) * 8e-3
    result = reconciled(values, ("output_rounding", {"step": 4e-3}))
    assert steps(result) == [("refit", "output_rounding")]


def test_another_hold_is_refitted() -> None:
    values = np.repeat(noise()[:, ::3], 3, axis=1)
    result = reconciled(values, ("held_samples", {"factor": 2.0}))
    assert ("refit", "held_samples") in steps(result)


@pytest.mark.parametrize(("shared", "action"), [(0.0, "remove"), (0.6, "refit")])
def test_another_correlation_is_refitted_or_removed(shared: float, action: str) -> None:
    values = noise()
    values[1] = shared * values[0] + np.sqrt(1.0 - shared**2) * values[1]
    result = reconciled(values, ("cross_axis", {"other": NAMES[1], "correlation": 0.2}))
    assert (action, "cross_axis") in steps(result)


def test_a_level_that_jumps_and_comes_back_is_two_steps_and_no_walk() -> None:
    values = noise()
    values[0, 4_000:7_500] += 0.01
    assert steps(reconciled(values)) == [("add", "bias_step"), ("add", "bias_step")]


def test_a_burst_louder_than_given_is_refitted() -> None:
    values = noise()
    values[0, 4_000:6_000] *= np.sqrt(1.6)
    given = {"from_s": 40.0, "to_s": 60.0, "ratio": 1.25}
    assert steps(reconciled(values, ("variance_change", given))) == [("refit", "variance_change")]


def test_a_faster_memory_of_another_size_is_refitted_and_not_doubled() -> None:
    decay = float(np.exp(-0.01 / 0.5))
    kicks = np.random.default_rng(10).uniform(-1.0, 1.0, N) * np.sqrt(3.0 * (1.0 - decay**2))
    slow = np.asarray(lfilter([1.0], [1.0, -decay], kicks)) * 4e-3
    values = noise() + np.stack((slow, np.zeros(N)))
    slower = ("gauss_markov", {"sigma": 1e-4, "correlation_time_s": 20.0})
    faster = ("gauss_markov", {"sigma": 2e-3, "correlation_time_s": 0.5})
    result = reconciled(values, slower, faster)
    assert steps(result) == [("refit", "gauss_markov")]
    (step,) = result.channel(NAMES[0]).steps
    assert step.effect.estimates[0].value == pytest.approx(4e-3, rel=0.2)


def test_one_sample_that_chance_allows_is_no_rest_of_outliers_that_are_gone() -> None:
    values = noise()
    values[0, 777] = 5.3 * SIGMA
    result = reconciled(values, ("outliers", {"rate": 2e-3, "scale": 0.2}))
    assert steps(result) == [("remove", "outliers")]


def test_outliers_too_small_to_be_seen_are_not_removed() -> None:
    given = {"rate": 5e-4, "scale": 2.0 * SIGMA}
    assert steps(reconciled(noise(), ("outliers", given))) == []


def test_what_is_removed_is_told_as_the_model_has_it() -> None:
    given = {"cutoff_hz": 12.0, "order": 2.0, "damping": 0.7}
    (step,) = reconciled(noise(), ("bandwidth_limit", given)).channel(NAMES[0]).steps
    assert (step.action, step.effect.name) == ("remove", "bandwidth_limit")
    assert [e.value for e in step.effect.estimates] == [12.0, 2.0, 0.7]
    assert step.held_out.gap_before > 10.0


def test_a_model_without_noise_is_given_the_recordings() -> None:
    stamps = np.arange(N) * 10_000_000
    still = np.ones(N, dtype=bool)
    channels = tuple(
        Channel("/imu/data", name, unit_of(name), stamps, v, still, RATE_HZ)
        for name, v in zip(NAMES, noise(), strict=True)
    )
    silent = tuple(ChannelModel(n, "/imu/data", unit_of(n), RATE_HZ, 0.0, ()) for n in NAMES)
    result = reconcile_recording(Recording("silent", 0, channels), NoiseModel(silent))
    for name in NAMES:
        channel = result.channel(name)
        assert channel.verdict == "explained"
        assert steps(result, name) == [("add", "white_noise")]
        assert channel.steps[0].effect.estimates[0].value == pytest.approx(DENSITY, rel=0.03)
        assert "no noise" in channel.notes[0]


@pytest.mark.parametrize("window_s", [0.014, 0.040])
def test_a_window_far_from_the_given_one_is_found(window_s: float) -> None:
    """The likelihood of a window has several maxima: from the given one there is no way uphill."""
    fine = np.random.default_rng(11).normal(0.0, SIGMA * np.sqrt(10.0), 10 * N + 24)
    total = np.cumsum(fine)
    values = noise()
    values[0] = ((total[24:] - total[:-24]) / 24.0)[::10]
    (step, *rest) = (
        reconciled(values, ("averaging", {"window_s": window_s})).channel(NAMES[0]).steps
    )
    assert (step.action, step.effect.name) == ("refit", "averaging")
    assert step.effect.estimates[0].value == pytest.approx(0.024, rel=0.02)
    assert [s.effect.name for s in rest] in ([], ["white_noise"])
