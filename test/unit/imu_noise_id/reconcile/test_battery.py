"""The battery, its null and the score on white records, and on records that are not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.effects.rate_ramp import RateRamp
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.ordinates import Ordinates
from imu_noise_id.reconcile import null as null_module
from imu_noise_id.reconcile.battery import NAMES, battery, normal_of_kurtosis, white_record
from imu_noise_id.reconcile.compare import combined, examine
from imu_noise_id.reconcile.gap import deviates_of_power, held_out_score, whole_score
from imu_noise_id.reconcile.null import Null, load_null, log_p_of, simulate_null, z_of
from imu_noise_id.reconcile.prior import FREE_STD_ERROR, Prior, map_fit, without
from imu_noise_id.reconcile.state import Column, State, analyse
from imu_noise_id.reconcile.steps import step_scores
from scipy import stats

N, DT = 6000, 0.01
EFFECTS = (WhiteNoise(1e-3), GaussMarkov(1e-3, 2.0))
PRIOR = Prior(np.log([1e-3, 1e-3, 2.0]), np.eye(3), np.array([0.01, 0.2, 0.3]))


@pytest.fixture(scope="module")
def null() -> Null:
    return simulate_null(N, DT, 2, 200)


def state_of(seed: int, extra: np.ndarray | float = 0.0) -> State:
    rng = np.random.default_rng(seed)
    values = sum(e.simulate(N, DT, rng) for e in EFFECTS) + extra
    return State(values, DT, 0.0, None, EFFECTS, PRIOR)


def test_the_null_does_not_depend_on_the_number_of_workers(null: Null) -> None:
    assert np.array_equal(simulate_null(N, DT, 1, 200).nats, null.nats)


def test_the_null_is_simulated_once_and_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    first = load_null(1000, DT, 1, 20)
    (stored,) = tmp_path.rglob("*.npz")
    changed = stored.stat().st_mtime_ns
    null_module._stored_or_simulated.cache_clear()  # as another process
    assert np.array_equal(load_null(1010, DT, 1, 20).nats, first.nats)
    assert stored.stat().st_mtime_ns == changed


def test_the_tails_of_the_null_are_those_of_records_it_was_not_made_of() -> None:
    """1000 fresh records: the chance said of what is seen falls below 1 % in 1 % of them."""
    rng = np.random.default_rng(11)
    null = simulate_null(3400, DT, 2, 700)
    seen = np.zeros((1000, len(NAMES)))
    for row in seen:
        statistics = battery(white_record(rng.standard_normal(3400), DT))
        row[:] = [null.log_p(s.name, s.nats) < np.log(0.01) for s in statistics]
    share = seen.mean(axis=0)
    assert np.all(share > 0.002)  # 3 standard errors and the 90 % point's own
    assert np.all(share < 0.022)


def test_the_kurtosis_of_few_samples_becomes_a_normal_deviate() -> None:
    rng = np.random.default_rng(2)
    for samples in (rng.standard_normal(200), rng.uniform(size=2000), rng.laplace(size=300)):
        expected = stats.kurtosistest(samples).statistic
        found = normal_of_kurtosis(stats.kurtosis(samples, fisher=False), samples.size)
        assert found == pytest.approx(expected, rel=1e-9)
    assert normal_of_kurtosis(1.0, 200) < -20.0  # two levels and nothing else


def test_a_cache_that_cannot_be_written_costs_only_the_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert load_null(1000, DT, 1, 20).nats.shape == (20, len(NAMES))


def test_a_band_shows_by_at_least_what_its_true_law_gains() -> None:
    truth = NarrowBand(18.0, 1.0, 0.25)
    rng = np.random.default_rng(4)
    record = white_record(rng.standard_normal(N) + truth.simulate(N, DT, rng), DT)
    seen = {s.name: s for s in battery(record)}["band"]
    law = 1.0 + truth.psd(record.frequency_hz, DT) / DT
    true_gain = 0.5 * record.dof @ (record.ratio - record.ratio / law - np.log(law))
    places = np.log(0.5 / DT / (seen.where.to - seen.where.from_))  # what the search is charged
    assert seen.nats + places >= true_gain > 20.0
    assert seen.where.from_ < 18.0 < seen.where.to


def test_a_course_of_the_model_that_the_record_does_not_show_is_seen(null: Null) -> None:
    slope, t = 3e-4, DT * np.arange(N)
    for shown in (0.0, slope):
        state = state_of(2, shown * t)
        ramp = Column(RateRamp(1.0), t, slope, 0.1 * slope, given=True)
        state = replace(state, columns=(ramp,))
        found = {f.name: f for f in examine(state, analyse(state), null, frozenset()).all}
        assert (found["refit rate_ramp"].log_p < -8.0) == (shown == 0.0)


@pytest.mark.parametrize("between", [0.0, 0.25, 0.5])
def test_a_line_shows_alike_between_two_ordinates_and_on_one(between: float) -> None:
    phase = 2.0 * np.pi * (700.0 + between) / N * np.arange(N)
    seen = battery(white_record(0.1 * np.cos(phase), DT))[NAMES.index("line")]
    assert seen.nats > 0.8 * 0.25 * N * 0.1**2
    assert seen.where.from_ <= (700.0 + between) / (N * DT) <= seen.where.to


def test_p_values_are_uniform_in_the_middle_and_exponential_in_the_tail(null: Null) -> None:
    column = null.nats[:, null.names.index("line")]
    assert np.exp(null.log_p("line", float(np.median(column)))) == pytest.approx(0.5, abs=0.02)
    far = null.log_p("line", float(column.max()) + 20.0)
    assert far < null.log_p("line", float(column.max()) + 10.0) < np.log(1e-3)


def test_deviates_and_p_values_are_each_others_inverse() -> None:
    for z in (0.5, 3.0, 8.0, 40.0, 300.0):
        assert z_of(log_p_of(z)) == pytest.approx(z, rel=1e-4)


def test_the_smallest_of_many_p_values_is_corrected() -> None:
    assert np.exp(combined(float(np.log(0.01)), 10)) == pytest.approx(1.0 - 0.99**10)
    assert combined(-50.0, 10) == pytest.approx(-50.0 + np.log(10.0))


def test_powers_become_normal_deviates() -> None:
    dof = np.array([1.0, 4.0, 1000.0])
    ratio = stats.chi2.ppf(stats.norm.cdf(2.0), dof) / dof
    np.testing.assert_allclose(deviates_of_power(ratio, dof), 2.0, rtol=1e-9)
    assert np.all(np.isfinite(deviates_of_power(np.array([0.0, 1e6]), np.array([50.0, 50.0]))))


def test_white_records_pass_and_a_line_a_burst_and_hits_do_not(null: Null) -> None:
    rng = np.random.default_rng(3)
    clean = rng.standard_normal(N)
    burst, hit = clean.copy(), clean.copy()
    burst[2000:3000] *= 1.5
    hit[::500] += 12.0
    line = clean + 0.2 * np.sin(0.8 * np.arange(N))

    def worst(samples: np.ndarray) -> str:
        found = battery(white_record(samples, DT))
        return min(found, key=lambda s: null.log_p(s.name, s.nats)).name

    quiet = battery(white_record(clean, DT))
    assert all(null.log_p(s.name, s.nats) > np.log(1e-3) for s in quiet)
    assert worst(line) == "line"
    assert worst(burst) == "burst"
    assert worst(hit) in ("kurtosis", "extreme")


def test_step_scores_are_those_of_least_squares() -> None:
    state = state_of(5)
    found = analyse(state)
    z, power, _ = step_scores(found.coefficients, found.inverse_psd, DT)
    from scipy import fft

    for t in (1, 777, 3000, N - 2):
        shape = fft.dct((np.arange(N) >= t).astype(float), norm="ortho")
        weight = found.inverse_psd * DT
        energy = float(shape @ (weight * shape))
        direct = float(shape @ (weight * found.coefficients)) / np.sqrt(energy)
        assert power[t - 1] == pytest.approx(energy, rel=1e-6)
        assert z[t - 1] == pytest.approx(direct, abs=1e-6)


def test_scores_are_one_under_the_model_and_more_without_it(null: Null) -> None:
    whole, unseen, local = [], [], []
    for seed in range(12):
        state = state_of(seed)
        found = analyse(state)
        whole.append(whole_score(found, null, frozenset()))
        unseen.append(held_out_score(state, found, null, frozenset()))
        local.append(held_out_score(state, found, null, frozenset(), local=True))
    for scores in (whole, unseen, local):
        assert np.mean(scores) == pytest.approx(1.0, abs=0.08)
        assert np.max(scores) < 1.5
    line = 0.01 * np.sin(2.0 * np.pi * 20.0 * np.arange(N) * DT)
    state = state_of(1, line)
    assert held_out_score(state, analyse(state), null, frozenset()) > 2.0


def test_the_prior_holds_what_is_known_and_lets_the_rest_go() -> None:
    state = state_of(7, 2e-3 * np.cumsum(np.random.default_rng(1).standard_normal(N)) * 0.1)
    found = analyse(state)
    assert found.fit.effects[0].density == pytest.approx(1e-3, rel=0.03)  # type: ignore[attr-defined]
    free = map_fit(state.effects, found.ordinates, without(PRIOR, [0, 1, 2]))
    assert free.objective > found.fit.objective
    assert np.all(without(PRIOR, [0, 1, 2]).std_error == FREE_STD_ERROR)
    partly = without(PRIOR, [1])
    moved = PRIOR.centre + np.array([0.0, 5.0, 0.0])
    assert partly.cost(moved) < 1e-4 < PRIOR.cost(moved)


def test_the_map_fit_climbs_to_where_the_gradient_is_zero() -> None:
    state = state_of(9)
    bins: Ordinates = analyse(state).ordinates
    fitted = map_fit(EFFECTS, bins, PRIOR)
    again = map_fit(fitted.effects, bins, PRIOR)
    assert again.objective == pytest.approx(fitted.objective, abs=1e-3)


def test_a_null_that_cannot_be_stored_is_simulated_once_for_all_channels(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/not to be written")
    first = load_null(1000, DT, simulations=30)
    assert load_null(1000, DT, simulations=30) is first
