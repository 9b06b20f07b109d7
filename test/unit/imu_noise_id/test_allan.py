"""The Allan curve equals its definition, keeps its digits, and its intervals mean what they say."""

import allantools
import numpy as np
import pytest
from imu_noise_id.allan import allan, allan_exact, curve, degrees_of_freedom
from imu_noise_id.pyramid import CHUNK, empty_pyramid, feed
from imu_noise_id.series import Series

from imu_noise_id import allan as allan_module


def series_of(values, observed=None, sample_time_s=1.0):
    observed = np.ones(values.size, dtype=bool) if observed is None else observed
    return Series(np.where(observed, values, 0.0), observed, sample_time_s)


def oadev(values, sample_time_s, tau_s):
    _, deviation, _, _ = allantools.oadev(
        values, rate=1.0 / sample_time_s, data_type="freq", taus=tau_s
    )
    return deviation


def brute_force(values, observed, m):
    """Mean squared difference of adjacent window means, as the definition says, in plain numpy."""
    squares = []
    for i in range(values.size - 2 * m + 1):
        left, right = observed[i : i + m], observed[i + m : i + 2 * m]
        if left.sum() >= 0.75 * m and right.sum() >= 0.75 * m:
            a, b = values[i : i + m][left], values[i + m : i + 2 * m][right]
            excess = sum(
                (1 / part.size - 1 / m) * part.var(ddof=1) for part in (a, b) if part.size < m
            )
            squares.append(((b.mean() - a.mean()) ** 2, excess))
    total = np.sum(squares, axis=0)
    return np.sqrt((total[0] - total[1]) / len(squares) / 2)


NOISES = {
    "white": lambda w, k: w,
    "walk": lambda w, k: np.cumsum(w),
    "quantization": lambda w, k: np.diff(w, prepend=0.0),
    "quantization and white": lambda w, k: np.diff(w, prepend=0.0) + 0.03 * w[::-1],
    "line": lambda w, k: np.sin(2 * np.pi * 0.0431 * k) + 0.1 * w,
    "line at a quarter of the rate": lambda w, k: np.sin(np.pi / 2 * k + 0.3) + 0.1 * w,
    "line at an eighth of the rate": lambda w, k: np.sin(np.pi / 4 * k + 0.3) + 0.1 * w,
}


@pytest.mark.parametrize("size", [40_000, 150_000])
@pytest.mark.parametrize("name", NOISES)
def test_agrees_with_allantools_within_a_tenth_of_the_interval(name, size):
    rng = np.random.default_rng(1)
    values = 9.81 + NOISES[name](rng.standard_normal(size), np.arange(size))
    found = allan(series_of(values, sample_time_s=0.005))
    expected = oadev(values, 0.005, found.tau_s)
    assert np.all(np.abs(found.deviation - expected) < 0.1 * (found.upper - found.lower))
    every_sample = found.averaging_factor < 32
    np.testing.assert_allclose(found.deviation[every_sample], expected[every_sample], rtol=1e-9)


def test_exact_estimator_equals_allantools_to_1e_9():
    values = np.cumsum(np.random.default_rng(2).standard_normal(30_000)) + 1e4
    found = allan_exact(series_of(values, sample_time_s=0.01))
    np.testing.assert_allclose(found.deviation, oadev(values, 0.01, found.tau_s), rtol=1e-9)


def test_taus_run_from_the_sample_period_to_a_third_of_the_record_evenly_in_log():
    found = allan(series_of(np.random.default_rng(3).standard_normal(100_000), sample_time_s=0.01))
    assert found.tau_s[0] == 0.01
    assert 0.9 * 1000.0 / 3.0 < found.tau_s[-1] <= 1000.0 / 3.0
    ratio = found.tau_s[1:] / found.tau_s[:-1]
    assert np.all(ratio[found.averaging_factor[:-1] >= 8] < 1.26)
    assert 70 < found.tau_s.size < 100


@pytest.mark.parametrize("m", [1, 2, 7, 40, 333])
def test_gaps_follow_the_stated_rule(m):
    rng = np.random.default_rng(4)
    values = np.cumsum(rng.standard_normal(2000)) + rng.standard_normal(2000)
    observed = rng.random(2000) > 0.08
    observed[700:860] = False
    found = allan_exact(series_of(values, observed), np.array([m]))
    assert found.deviation[0] == pytest.approx(brute_force(values, observed, m), rel=1e-9)


def test_fast_and_exact_agree_across_gaps():
    rng = np.random.default_rng(5)
    values = rng.standard_normal(30_000) + 1e3
    observed = rng.random(30_000) > 0.05
    observed[10_000:13_000] = False
    series = series_of(values, observed)
    fast = allan(series)
    exact = allan_exact(series, fast.averaging_factor)
    assert np.all(np.abs(fast.deviation - exact.deviation) < 0.1 * (exact.upper - exact.lower))
    dense = fast.averaging_factor < 32
    np.testing.assert_allclose(fast.deviation[dense], exact.deviation[dense], rtol=1e-9)


@pytest.mark.parametrize("walk", [0.0, 0.02])
def test_scattered_loss_leaves_no_bias(walk):
    rng = np.random.default_rng(6)
    variance = []
    for _ in range(80):
        values = rng.standard_normal(4096) + walk * np.cumsum(rng.standard_normal(4096))
        found = allan_exact(series_of(values, rng.random(4096) > 0.1), np.array([10, 40, 160]))
        variance.append(found.deviation**2)
    m = np.array([10, 40, 160])
    truth = 1 / m + walk**2 * (2 * m**2 + 1) / (6 * m)
    error = np.std(variance, axis=0) / np.sqrt(80)
    assert np.all(np.abs(np.mean(variance, axis=0) - truth) < 4 * error)
    assert np.all(4 * error < 0.2 * truth)


def test_a_gap_of_a_tenth_of_the_record_costs_no_bias_in_a_random_walk():
    rng = np.random.default_rng(7)
    ratio = []
    observed = np.ones(4096, dtype=bool)
    observed[1800:2200] = False
    for _ in range(100):
        values = np.cumsum(rng.standard_normal(4096))
        cut = allan_exact(series_of(values, observed), np.array([50, 500, 1000]))
        m = cut.averaging_factor
        ratio.append(cut.deviation**2 * 6 * m / (2 * m**2 + 1))
    error = np.std(ratio, axis=0) / 10
    assert np.all(np.abs(np.mean(ratio, axis=0) - 1) < 4 * error + 0.03)


def test_a_large_mean_loses_no_digits():
    noise = np.round(np.random.default_rng(8).standard_normal(300_000) * 2**20) / 2**20
    small, large = allan(series_of(noise)), allan(series_of(noise + 2.0**25))
    np.testing.assert_allclose(large.deviation, small.deviation, rtol=1e-9)


def test_a_stream_gives_the_same_bits_in_batches_of_any_size():
    rng = np.random.default_rng(9)
    values = rng.standard_normal(5 * CHUNK + 777)
    observed = rng.random(values.size) > 0.01
    whole = feed(empty_pyramid(), values, observed)
    grown = empty_pyramid()
    position = 0
    while position < values.size:
        size = int(rng.integers(1, 3000))
        part = slice(position, position + size)
        grown = feed(grown, values[part], observed[part])
        position += size
    a, b = curve(whole, 0.01), curve(grown, 0.01)
    np.testing.assert_array_equal(a.deviation, b.deviation)
    np.testing.assert_array_equal(a.upper, b.upper)


def test_feeding_leaves_the_argument_unchanged():
    first = feed(empty_pyramid(), np.arange(3.0 * CHUNK))
    before = curve(first, 1.0).deviation
    feed(first, np.random.default_rng(10).standard_normal(3 * CHUNK))
    np.testing.assert_array_equal(curve(first, 1.0).deviation, before)


@pytest.mark.parametrize("alpha", [0, -1, -2])
def test_degrees_of_freedom_are_those_of_greenhall_and_riley(alpha):
    m = np.array([1, 2, 8, 31, 200, 3000, 30_000])
    size = 100_000
    expected = [
        allantools.edf_greenhall(alpha, 2, int(f), size + 1, overlapping=True, modified=False)
        for f in m
    ]
    one = np.ones(m.size)
    found = degrees_of_freedom(m, one.astype(int), size - 2 * m + 1, alpha * one, 0 * one)
    np.testing.assert_allclose(found, expected, rtol=0.02)


@pytest.mark.parametrize("name", ["white", "walk", "quantization"])
def test_intervals_cover_what_they_promise(name):
    rng = np.random.default_rng(11)
    runs, size = 300, 2048
    inside = []
    for _ in range(runs):
        found = allan(series_of(NOISES[name](rng.standard_normal(size), np.arange(size))))
        m = found.averaging_factor
        truth = {"white": 1 / m, "walk": (2 * m**2 + 1) / (6 * m), "quantization": 3 / m**2}[name]
        inside.append((found.lower**2 <= truth) & (truth <= found.upper**2))
    long = found.averaging_factor >= 32
    covered = np.mean(inside, axis=0)[long]
    assert np.all(covered > 0.95 - 4 * np.sqrt(0.95 * 0.05 / runs))
    assert 0.93 < covered.mean() < 0.985


@pytest.mark.parametrize("size", [0, 1, 2])
def test_a_series_too_short_gives_an_empty_curve_and_says_so(size):
    found = allan(series_of(np.zeros(size)))
    assert found.tau_s.size == 0
    assert "too short" in found.note


def test_nothing_observed_gives_an_empty_curve():
    found = allan(series_of(np.zeros(5000), np.zeros(5000, dtype=bool)))
    assert found.tau_s.size == 0
    assert found.note


@pytest.mark.parametrize("values", [np.full(5000, 9.81), np.arange(5000.0), np.eye(1, 5000)[0]])
def test_no_number_is_ever_nan(values):
    found = allan(series_of(values))
    for column in (found.deviation, found.lower, found.upper, found.degrees_of_freedom):
        assert np.all(np.isfinite(column))
    assert np.all(found.lower <= found.deviation)
    assert np.all(found.deviation <= found.upper)


def test_warm_up_runs():
    allan_module.warm_up()
