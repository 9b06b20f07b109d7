"""nav_fusion.engine: same bits whatever order and blocks; bad input is left out and said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from nav_fusion.consistency import covariance_of, innovations_of, is_symmetric_positive, mean_band
from nav_fusion.engine import Engine
from nav_fusion.noise import AidNoise, mems_defaults
from nav_fusion.parameters import Parameters
from nav_fusion.solution import solve

from helpers.drive import (
    ALTITUDE,
    EAST_M,
    LATITUDE,
    LONGITUDE,
    START_NS,
    Drive,
    drive,
    play,
    until,
    without_fixes,
)
from helpers.headed import HEADED, NOISE, fused


def test_the_position_is_found_and_its_sigma_is_true() -> None:
    d = drive(seed=3)
    engine, rows = fused(d)
    solution = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    moving = 30.0 - 0.01 - 5.0
    east = 1.5 / 0.4 * moving - 1.5 / 0.16 * np.sin(0.4 * moving)
    error = solution.position[-1] - [east, 0, 0]
    sigma = np.sqrt(np.diag(solution.pose_covariance[-1]))[:3]
    assert np.all(np.abs(error[:2]) < 4 * sigma[:2] + 0.02)
    status = engine.status()
    assert status.nis_lower is not None
    assert status.nis_mean is not None
    assert 0.8 * status.nis_lower < status.nis_mean < 1.2 * status.nis_upper
    assert status.white
    assert is_symmetric_positive(covariance_of(engine.state(), engine.layout.slow.target.size))


@pytest.mark.parametrize("block", [1, 7, 64])
def test_the_size_of_the_blocks_changes_no_bit(block: int) -> None:
    d = drive(12.0)
    whole, rows = fused(d)
    parts, pieces = fused(d, block=block)
    assert np.array_equal(whole.state(), parts.state())
    assert np.array_equal(rows.stamp_ns, pieces.stamp_ns)
    assert np.array_equal(rows.values, pieces.values)


@pytest.mark.parametrize("parameters", [HEADED, replace(HEADED, initial_heading_rad=float("nan"))])
def test_late_fixes_end_in_the_state_of_fixes_in_order(parameters: Parameters) -> None:
    d = drive(20.0)
    in_order, _ = fused(d, parameters)
    late_s = np.random.default_rng(3).choice([0.0, 0.05, 0.2, 0.45], d.fix_ns.size)
    late, _ = fused(d, parameters, late_s=late_s)
    # until the last fix has come the two know different things
    assert late_s[-1] <= 0.2
    assert np.array_equal(in_order.state(), late.state())
    assert late.status().late > 20


def test_a_row_uses_nothing_that_came_after_it() -> None:
    d = drive(15.0)
    _, rows = fused(d)
    cut = int(np.searchsorted(d.stamp_ns, rows.stamp_ns[300], side="right"))
    until = int(d.stamp_ns[cut - 1])
    known = d.fix_ns <= until
    short = Drive(d.stamp_ns[:cut], d.rate[:cut], d.force[:cut], d.fix_ns[known], d.fix[known])
    _, fewer = fused(short)
    assert np.array_equal(fewer.values, rows.values[:301])


@pytest.mark.parametrize("heading", [0.0, 1.7, 3.0, -1.2])
def test_any_start_heading_is_found_once_moving(heading: float) -> None:
    d = drive(40.0)
    c, s = np.cos(heading), np.sin(heading)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])  # body axes at that heading
    turned = replace(d, force=d.force @ turn.T, rate=d.rate @ turn.T)
    engine, rows = fused(turned, replace(HEADED, initial_heading_rad=float("nan")))
    solution = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    error = np.angle(np.exp(1j * (solution.heading[-1] - heading)))
    assert engine.status().aligned
    assert abs(error) < 4 * solution.heading_sigma[-1]
    assert solution.heading_sigma[-1] < 0.1


def test_standing_without_magnetometer_the_heading_is_not_observable() -> None:
    engine, rows = fused(
        drive(10.0, rest_s=100.0), replace(HEADED, initial_heading_rad=float("nan"))
    )
    solution = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    assert solution.heading_sigma[-1] > 1.5
    assert any("not observable" in note for note in engine.status().notes)


def test_the_covariance_of_several_headings_together_is_a_covariance() -> None:
    d = drive(25.0, rest_s=15.0)
    _, rows = fused(d, replace(HEADED, initial_heading_rad=float("nan")))
    s = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE), (1.0, 0.5, 1.5))
    many = s.hypotheses > 1
    assert 100 < many.sum() < many.size
    for P in (s.pose_covariance, s.twist_covariance[:, :3, :3], s.antenna_covariance):
        sigma = np.sqrt(np.einsum("kii->ki", P))
        correlation = P / (sigma[:, :, None] * sigma[:, None, :])
        assert np.linalg.eigvalsh(correlation).min() > -1e-6


def test_every_fix_is_told_with_its_innovation_in_time_late_or_kept_out() -> None:
    d = drive(60.0)
    far = d.fix.copy()
    far[50] += [0.09, 0.0, 0.0]
    d = replace(d, fix=far)
    in_order, late = Engine(NOISE, HEADED), Engine(NOISE, HEADED)
    play(in_order, d)
    late_s = np.random.default_rng(3).choice([0.0, 0.2, 0.45], d.fix_ns.size)
    late_s[-5:] = 0.0
    play(late, d, late_s=late_s)
    told = innovations_of(in_order)
    for name, values in vars(innovations_of(late)).items():
        assert np.array_equal(values, getattr(told, name)), name
    status = in_order.status()
    assert (told.used.sum(), (~told.used).sum()) == (status.used, status.gated)
    assert not told.used[told.stamp_ns == d.fix_ns[50]].any()
    scored = told.used & (told.sigma[:, 0] < 50)
    assert told.nis[scored].mean() == pytest.approx(status.nis_mean)
    shares = (told.innovation[scored] / told.sigma[scored]) ** 2
    assert np.all(np.abs(shares.mean(axis=0) - 1) < 4 * np.sqrt(2 / scored.sum()))


def test_an_outage_widens_the_sigma_and_ends() -> None:
    d = without_fixes(drive(40.0), 15.0, 35.0)
    _, rows = fused(d)
    sigma = np.sqrt(
        np.trace(
            solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE)).pose_covariance[
                :, :3, :3
            ],
            axis1=1,
            axis2=2,
        )
    )
    t = (rows.stamp_ns - START_NS) * 1e-9
    assert sigma[t < 34.9][-1] > 3 * sigma[t < 15][-1]
    assert sigma[-1] < 1.5 * sigma[t < 15][-1]


# ---------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("sigma_m", "said"),
    [(1.5, "too careful"), (0.15, "not to be trusted"), (0.03, "not to be trusted"), (0.3, None)],
)
def test_a_covariance_that_the_fixes_contradict_is_said_to_be_false(
    sigma_m: float, said: str | None
) -> None:
    engine = Engine(replace(NOISE, position=(AidNoise(sigma_m),) * 3), HEADED)
    play(engine, drive(40.0, seed=8))
    verdicts = [n for n in engine.status().notes if n.startswith("the covariance is")]
    assert bool(verdicts) == (said is not None)
    assert all(said is not None and said in v for v in verdicts)


def test_a_sigma_that_is_wrong_by_three_in_a_hundred_is_no_false_covariance() -> None:
    engine = Engine(replace(NOISE, position=(AidNoise(1.03 * 0.3),) * 3), HEADED)
    play(engine, drive(600.0, seed=8))
    status = engine.status()
    low, _ = mean_band(3, status.nis_dof // 3, 0.999)
    assert status.nis_mean is not None
    assert status.nis_mean < low  # significant, and of no consequence
    assert not [n for n in status.notes if n.startswith("the covariance is")]


def test_no_fix_nan_and_places_off_the_earth_are_left_out() -> None:
    d = drive(10.0)
    engine = Engine(NOISE, HEADED)
    play(engine, d)
    before, used = engine.state(), engine.status().used
    at = int(d.stamp_ns[-1])
    engine.add_fix(at, LATITUDE, LONGITUDE, ALTITUDE, None, status=-1)
    engine.add_fix(at, float("nan"), LONGITUDE, ALTITUDE)
    engine.add_fix(at, 91.0, LONGITUDE, ALTITUDE)
    assert np.array_equal(engine.state(), before)
    assert engine.status().used == used
    assert engine.counts.rejected >= 3


def test_a_fix_without_altitude_is_left_out_and_said() -> None:
    engine = Engine(NOISE, HEADED)
    play(engine, drive(10.0))
    before = engine.status().rejected
    engine.add_fix(START_NS + 9_990_000_000, LATITUDE, LONGITUDE, float("nan"))
    assert engine.status().rejected == before + 1
    assert "left out: fixes without an altitude (NaN)" in engine.status().notes


def test_a_status_that_was_never_set_is_no_fix_by_the_message_and_said() -> None:
    engine = Engine(NOISE, HEADED)
    d = drive(10.0)
    play(engine, d)
    before = engine.status()
    engine.add_fix(int(d.stamp_ns[-1]), LATITUDE, LONGITUDE, ALTITUDE, None, status=-2)
    status = engine.status()
    assert (status.used, status.rejected) == (before.used, before.rejected + 1)
    assert any("never set" in note and "driver" in note for note in status.notes)


@pytest.mark.parametrize("diagonal", [0.0, -1.0, float("nan")])
def test_a_covariance_that_is_none_is_said_and_not_used(diagonal: float) -> None:
    engine = Engine(mems_defaults(), HEADED)
    play(engine, drive(10.0), covariance=diagonal * np.eye(3))
    status = engine.status()
    assert status.used > 20
    assert any("not used" in note for note in status.notes)


def test_a_fix_10_km_off_is_gated() -> None:
    d = drive(15.0)
    far = d.fix.copy()
    far[50] += [0.09, 0.0, 0.0]
    engine, rows = fused(replace(d, fix=far))
    status = engine.status()
    assert status.gated == 1
    solution = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    assert np.max(np.abs(solution.position[:, 1])) < 5.0


@pytest.mark.parametrize("bad", [[1], [2], [3], [4], [1, 2], [1, 3]])
@pytest.mark.parametrize("each", [50, 150])
def test_early_fixes_10_km_off_are_soon_given_up_though_fixes_are_slow(
    bad: list[int], each: int
) -> None:
    """One fix in 10 or 30 seconds, the filter starts from number 1: the first may be in error."""
    d = drive(600.0, rest_s=600.0, seed=4)
    fix = d.fix[::each].copy()
    fix[bad, 0] += 0.1
    engine, rows = fused(replace(d, fix_ns=d.fix_ns[::each], fix=fix))
    solution = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    assert np.all(np.abs(solution.position[-1]) < 5.0)
    assert np.all(np.abs(solution.velocity[-1]) < 1.0)
    assert engine.status().gated <= 4


def test_a_platform_faster_than_was_thought_is_followed_in_the_end() -> None:
    d = drive(240.0, rest_s=240.0, seed=4)
    fix = d.fix[::50].copy()
    fix[:, 1] += np.degrees(10.0 * 900.0 / EAST_M / np.cos(np.radians(LATITUDE))) * np.arange(24)
    engine, _ = fused(replace(d, fix_ns=d.fix_ns[::50], fix=fix))
    assert engine.status().used >= 5


def test_a_frozen_receiver_is_left_out() -> None:
    d = drive(20.0)
    frozen = d.fix.copy()
    frozen[50:] = frozen[50]
    engine, _ = fused(replace(d, fix=frozen))
    status = engine.status()
    assert status.used <= 50
    assert any("frozen" in note for note in status.notes)


def test_a_jump_of_the_fixes_is_followed_after_recovery() -> None:
    d = drive(30.0)
    moved = d.fix.copy()
    moved[50:, 0] += 0.001  # 111 m north, for good
    engine, rows = fused(replace(d, fix=moved))
    solution = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    assert engine.status().recovered == 1
    assert solution.position[-1, 1] == pytest.approx(111.2, abs=2.0)


def lost_drive() -> Drive:
    """Fixes jump 1.1 km for good before the filter has agreed with 20 of them."""
    d = drive(40.0, rest_s=40.0)
    moved = d.fix.copy()
    moved[15:, 0] += 0.01
    return replace(d, fix=moved)


def test_a_lost_filter_is_aligned_anew_and_says_so() -> None:
    engine, rows = fused(lost_drive())
    solution = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    status = engine.status()
    assert (status.recovered, engine.counts.restarts) == (0, 1)
    assert status.gated == 26  # of 5 seconds
    assert any("lost" in note for note in status.notes)
    assert solution.position[-1, 1] == pytest.approx(1112.0, abs=5.0)
    assert engine.origin == pytest.approx((LATITUDE, LONGITUDE, ALTITUDE), abs=1.5)


@pytest.mark.parametrize("block", [1, 37, 1000])
def test_a_lost_filter_ends_in_the_same_bits_whatever_the_blocks(block: int) -> None:
    whole, rows = fused(lost_drive())
    parted, others = fused(lost_drive(), block=block)
    assert np.array_equal(whole.state(), parted.state())
    assert np.array_equal(rows.stamp_ns, others.stamp_ns)
    assert np.array_equal(rows.values, others.values)
    assert replace(whole.status(), notes=()) == replace(parted.status(), notes=())


@pytest.mark.parametrize("block", [12_000, 50])
def test_a_filter_lost_at_the_begin_of_a_very_large_block_waits_with_its_rest(block: int) -> None:
    """More samples than the filter takes in one pass, and it is lost in the first of them."""
    d = drive(120.0, rest_s=120.0)
    moved = d.fix.copy()
    moved[15:, 0] += 0.01
    last = 40  # of the 5 a second, by which it is lost
    engine = Engine(NOISE, HEADED)
    play(engine, until(replace(d, fix=moved), last / 5.0))
    engine.add_fix(int(d.fix_ns[last]), *moved[last])
    first = last * 20
    for k in range(first, d.stamp_ns.size, block):
        part = slice(k, k + block)
        engine.add_imu(d.stamp_ns[part], d.rate[part], d.force[part])
    assert engine.counts.restarts == 1
    assert engine.counts.imu_samples == d.stamp_ns.size
    assert not engine.running  # no fix has come since


def test_late_fixes_lose_and_align_the_filter_as_fixes_in_order() -> None:
    late_s = np.random.default_rng(3).uniform(0.0, 0.4, lost_drive().fix_ns.size)
    prompt, _ = fused(lost_drive())
    late, _ = fused(lost_drive(), late_s=late_s)
    assert late.counts.restarts == 1
    assert np.array_equal(prompt.state(), late.state())


def test_five_silent_seconds_are_propagated_with_unknown_motion() -> None:
    d = drive(25.0)
    t = (d.stamp_ns - START_NS) * 1e-9
    keep = (t < 12) | (t > 17)
    silent = Drive(d.stamp_ns[keep], d.rate[keep], d.force[keep], d.fix_ns, d.fix)
    engine, rows = fused(silent)
    status = engine.status()
    assert status.gaps == 1
    assert status.gap_s == pytest.approx(5.0, abs=0.05)
    assert any("silent" in note for note in status.notes)
    solution = solve(rows.stamp_ns, rows.values, (LATITUDE, LONGITUDE, ALTITUDE))
    assert np.all(np.isfinite(solution.pose_covariance))
    assert status.gated <= 2


@pytest.mark.parametrize(("apart_s", "word"), [(3600.0, "ahead"), (-3600.0, "behind")])
def test_clocks_an_hour_apart_are_said(apart_s: float, word: str) -> None:
    d = drive(10.0)
    engine = Engine(NOISE, HEADED)
    for k in range(40):
        part = slice(20 * k, 20 * (k + 1))
        engine.add_imu(d.stamp_ns[part], d.rate[part], d.force[part])
        engine.add_fix(int(d.fix_ns[k] + apart_s * 1e9), *d.fix[k])
    assert not engine.running
    assert any("3600 s" in note and word in note for note in engine.status().notes)


def test_a_clock_set_back_starts_the_filter_anew() -> None:
    d = drive(10.0)
    engine, _ = fused(d)
    shifted = replace(d, stamp_ns=d.stamp_ns - 60_000_000_000, fix_ns=d.fix_ns - 60_000_000_000)
    rows = play(engine, shifted)
    assert engine.counts.restarts == 1
    assert rows.stamp_ns.size > 300
    assert any("started anew" in note for note in engine.status().notes)


def test_duplicates_disorder_and_nan_change_nothing_but_the_counts() -> None:
    d = drive(10.0)
    clean, _ = fused(d)
    order = np.arange(d.stamp_ns.size)
    messy = np.insert(order, [300, 600], [299, 580])
    rate, force = d.rate[messy], d.force[messy].copy()
    stamp_ns = d.stamp_ns[messy]
    stamp_ns = np.insert(stamp_ns, 400, stamp_ns[400] - 5_000_000)
    rate, force = np.insert(rate, 400, np.nan, axis=0), np.insert(force, 400, np.nan, axis=0)
    dirty, _ = fused(Drive(stamp_ns, rate, force, d.fix_ns, d.fix), block=1)
    assert np.array_equal(clean.state(), dirty.state())
    counts = dirty.counts
    assert (counts.imu_duplicates, counts.imu_out_of_order, counts.imu_non_finite) == (1, 1, 1)


def test_an_accelerometer_in_g_is_refused_with_its_reason() -> None:
    d = drive(10.0)
    engine, rows = fused(replace(d, force=d.force / 9.80665))
    assert rows.stamp_ns.size == 0
    assert engine.fault is not None
    assert "is g" in engine.fault


def test_a_gyro_in_degrees_at_rest_is_refused_with_its_reason() -> None:
    d = drive(10.0)
    engine, _ = fused(replace(d, rate=np.degrees(d.rate + 0.01)))
    assert engine.fault is not None
    assert "degrees" in engine.fault


def test_a_gyro_in_degrees_in_a_turn_is_noticed() -> None:
    d = drive(20.0)
    turning = d.rate.copy()
    turning[800:] += [0, 0, np.degrees(0.3)]
    engine, _ = fused(replace(d, rate=turning))
    assert engine.turns_too_fast()
    assert any("degrees" in note for note in engine.status().notes)
