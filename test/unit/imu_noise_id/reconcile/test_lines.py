"""Lines that are not alone, or do not stand still, and the triangular law of a rounded angle."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import ChannelReconciliation, Reconciliation, reconcile_recording
from imu_noise_id.reconcile.result import Where, distinct
from imu_noise_id.recording import Channel, Recording, unit_of

RATE_HZ, COUNT = 100.0, 24_000
NAME = "angular_velocity.x"
T = np.arange(COUNT) / RATE_HZ
DURATION_S = COUNT / RATE_HZ


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


WHITE = typed_effect("white_noise", NAME, {"density": 1.0 / np.sqrt(RATE_HZ)})
MODEL = NoiseModel((ChannelModel(NAME, "/imu/data", unit_of(NAME), RATE_HZ, 0.0, (WHITE,)),))


def reconciliation(hidden: np.ndarray, seed: int, model: NoiseModel = MODEL) -> Reconciliation:
    """White noise of unit deviation, known to the model, with what is hidden in it."""
    values = np.random.default_rng([seed, 5]).standard_normal(COUNT) + hidden
    stamps = np.rint(T * 1e9).astype(np.int64)
    still = np.ones(COUNT, dtype=bool)
    channel = Channel("/imu/data", NAME, unit_of(NAME), stamps, values, still, RATE_HZ)
    return reconcile_recording(Recording("hidden", 0, (channel,)), model)


def reconciled(hidden: np.ndarray, seed: int) -> ChannelReconciliation:
    return reconciliation(hidden, seed).channel(NAME)


def random_frequency(rng: np.random.Generator, mean_hz: float, spread_hz: float) -> np.ndarray:
    """Phase of a line whose frequency walks ``spread_hz`` away in the record."""
    walk = np.cumsum(rng.standard_normal(COUNT)) * spread_hz / np.sqrt(COUNT)
    return 2.0 * np.pi * np.cumsum(mean_hz + walk) / RATE_HZ


def test_the_harmonics_of_a_square_wave_are_lines_too() -> None:
    result = reconciled(0.8 * np.sign(np.sin(2.0 * np.pi * 4.3 * T)), seed=1)
    assert result.verdict == "explained"
    assert {s.effect.name for s in result.steps} == {"periodic"}
    lines = {s.effect.effect.frequency_hz: s.effect.effect.amplitude for s in result.steps}
    for order in (1, 3, 5, 7):
        (amplitude,) = [a for f, a in lines.items() if abs(f - 4.3 * order) < 1.0 / DURATION_S]
        assert amplitude == pytest.approx(3.2 / np.pi / order, abs=0.05)
    assert result.after.score < 1.3


@pytest.mark.parametrize("span", [(0.5, 1.0), (0.0, 0.4), (0.3, 0.6)])
def test_a_line_that_is_there_for_a_while_is_one_line_and_from_when_to_when(
    span: tuple[float, float],
) -> None:
    from_s, to_s = (share * DURATION_S for share in span)
    hidden = 0.4 * np.sin(2.0 * np.pi * 17.3 * T) * ((from_s <= T) & (to_s > T))
    result = reconciliation(hidden, seed=3)
    channel = result.channel(NAME)
    (step,) = channel.steps
    assert (channel.verdict, step.action, step.effect.name) == ("explained", "add", "periodic")
    assert step.effect.effect.frequency_hz == pytest.approx(17.3, abs=0.5 / DURATION_S)
    assert step.effect.effect.amplitude == pytest.approx(0.4, abs=0.04)
    seen = [
        float(number) for number in re.findall(r"from ([\d.]+) to ([\d.]+) s", step.evidence)[0]
    ]
    assert seen == pytest.approx((from_s, to_s), abs=4.0)
    again = reconciliation(hidden, 3, result.model).channel(NAME)
    assert (again.verdict, again.steps) == ("agrees", ())
    assert again.before.score < 1.3


def test_a_line_of_the_model_that_begins_half_way_does_not_agree_and_is_no_smaller_line() -> None:
    line = typed_effect("periodic", NAME, {"frequency_hz": 17.3, "amplitude": 0.4})
    model = NoiseModel((replace(MODEL.channels[0], effects=(WHITE, line)),))
    hidden = 0.4 * np.sin(2.0 * np.pi * 17.3 * T) * (T > 0.5 * DURATION_S)
    result = reconciliation(hidden, 4, model).channel(NAME)
    assert (result.verdict, result.steps) == ("unexplained", ())
    assert any(w.domain == "time" and w.z < 0.0 for w in result.after.where)


@pytest.mark.parametrize("seed", range(3))
def test_a_line_whose_frequency_wanders_is_a_line(seed: int) -> None:
    phase = random_frequency(np.random.default_rng(seed), 18.5, 8.0 / DURATION_S)
    result = reconciled(0.3 * np.sin(phase), seed)
    assert [s.effect.name for s in result.steps] == ["periodic"]
    assert result.steps[0].effect.effect.amplitude == pytest.approx(0.3, abs=0.06)


@pytest.mark.parametrize("seed", range(3))
def test_a_band_a_few_spacings_wide_is_a_band(seed: int) -> None:
    rng = np.random.default_rng(seed)
    decay = np.exp(-np.pi * 6.0 / COUNT)
    drive = rng.standard_normal((2, COUNT)) * np.sqrt(1.0 - decay**2)
    envelope = np.zeros(COUNT, dtype=complex)
    last = complex(*rng.standard_normal(2))
    for k, (x, y) in enumerate(drive.T):
        last = decay * last + complex(x, y)
        envelope[k] = last
    hidden = 0.2 * np.real(envelope * np.exp(2j * np.pi * 18.5 * T))
    assert [s.effect.name for s in reconciled(hidden, seed).steps] == ["narrow_band"]


@pytest.mark.parametrize("law", ["uniform", "normal"])
def test_quantization_noise_may_be_triangular(law: str) -> None:
    rng = np.random.default_rng(7)
    error = getattr(rng, law)(size=COUNT + 1)
    result = reconciled(2.0 * np.diff(error) / error.std(), seed=7)
    assert [s.effect.name for s in result.steps if s.action == "add"] == ["quantization"]
    assert result.verdict == "explained"


def test_a_law_flatter_than_its_rounding_is_not_explained() -> None:
    rng = np.random.default_rng(8)
    error = np.sign(rng.standard_normal(COUNT + 1))
    assert reconciled(2.0 * np.diff(error), seed=8).verdict == "unexplained"


def test_a_place_that_several_statistics_see_is_listed_once() -> None:
    one = Where("spectrum", 27.899, 27.901, "Hz", 9.0)
    places = (
        one,
        Where("spectrum", 27.8999, 27.9003, "Hz", 8.0),
        Where("time", 1.0, 2.0, "s", 7.0),
    )
    assert distinct(places) == (one, places[2])


def test_a_short_record_with_a_line_at_half_the_rate_is_compared() -> None:
    for count in (260, 342):
        values = np.random.default_rng(count).standard_normal(count)
        values += 2.0 * (-1.0) ** np.arange(count)
        stamps = np.rint(T[:count] * 1e9).astype(np.int64)
        still = np.ones(count, dtype=bool)
        channel = Channel("/imu/data", NAME, unit_of(NAME), stamps, values, still, RATE_HZ)
        result = reconcile_recording(Recording("short", 0, (channel,)), MODEL).channel(NAME)
        assert result.verdict != "agrees"
