"""Tustin's pairs, step responses and bandwidths are those of the thesis where it is right."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from imu_noise_id.transfer_function import (
    ContinuousTransfer,
    DiscreteTransfer,
    bandwidth_3db_hz,
    drive,
    frequency_response,
    output_sigma,
    random_walk,
    rise_time_s,
    settling_time_s,
    stationary_covariance,
    step_response,
    to_continuous,
    to_discrete,
)
from scipy import signal

MODELS = {
    row["name"]: row
    for row in yaml.safe_load(
        (Path(__file__).parents[2] / "data" / "thesis_models.yaml").read_text(encoding="utf-8")
    )
}
TUSTIN_PAIRS = [name for name in MODELS if name != "sensor_8"]
DEGREES_OR_MILLI_G = {"deg/sec/sqrt(Hz)": 1.0, "mg/sqrt(Hz)": 1e3}


def discrete(name):
    row = MODELS[name]
    return DiscreteTransfer(*(np.array(side) for side in row["H_z"]), 1.0 / row["rate_hz"])


def continuous(name):
    return ContinuousTransfer(*(np.array(side, dtype=float) for side in MODELS[name]["H_s"]))


@pytest.mark.parametrize("name", TUSTIN_PAIRS)
def test_tustin_takes_each_printed_h_z_to_its_h_s(name):
    found, printed = to_continuous(discrete(name)), continuous(name)
    np.testing.assert_allclose(found.numerator, printed.numerator, rtol=2.5e-3)
    np.testing.assert_allclose(found.denominator, printed.denominator, rtol=2.5e-3)
    assert found.minimum_phase == MODELS[name]["minimum_phase"]
    assert discrete(name).minimum_phase == MODELS[name]["minimum_phase"]


@pytest.mark.parametrize("name", MODELS)
def test_poles_and_zeros_are_those_printed(name):
    row, found = MODELS[name], continuous(name)
    assert found.poles.real == pytest.approx([row["pole"]], rel=1e-3)
    assert abs(found.zeros[0]) == pytest.approx(abs(row["zero"]), rel=5e-3)


@pytest.mark.parametrize("name", MODELS)
def test_settling_and_rise_bandwidth_are_those_of_table_5_3(name):
    row, found = MODELS[name], continuous(name)
    assert settling_time_s(found) == pytest.approx(row["settling_time_s"], rel=3.2e-3, abs=6e-5)
    assert 0.35 / rise_time_s(found) == pytest.approx(row["bandwidth_rise_hz"], rel=2.6e-3)


@pytest.mark.parametrize("name", MODELS)
def test_true_bandwidth_agrees_with_the_audit_or_is_said_not_to_exist(name):
    expected = MODELS[name]["bandwidth_3db_hz"]
    found = bandwidth_3db_hz(continuous(name))
    assert found == (None if expected is None else pytest.approx(expected, rel=1e-4))


@pytest.mark.parametrize(
    ("name", "tolerance"),
    [(f"sensor_{i}", 0.03) for i in (1, 2, 3, 5, 6, 7)] + [("sensor_8", 0.035), ("sensor_4", 0.16)],
)
def test_random_walk_of_the_models_is_what_the_thesis_read_off_their_output(name, tolerance):
    row = MODELS[name]
    transfer = discrete(name)
    if name == "sensor_8":
        transfer = to_discrete(continuous(name), transfer.sample_time_s)
    found = random_walk(transfer) * DEGREES_OR_MILLI_G[row["random_walk_unit"]]
    assert found == pytest.approx(row["random_walk"], rel=tolerance)


@pytest.mark.parametrize("name", MODELS)
def test_unit_variance_scaling_of_the_numerator_within_sampling_error(name):
    a = np.array(MODELS[name]["H_z"][0])
    assert np.sum(a**2) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("name", MODELS)
def test_output_sigma_equals_that_of_a_long_impulse_response(name):
    transfer = discrete(name)
    impulse = drive(transfer, np.eye(1, 5000)[0])
    assert output_sigma(transfer) == pytest.approx(np.sqrt(np.sum(impulse**2)), rel=1e-9)
    if name not in {"sensor_8"}:
        assert output_sigma(transfer) == pytest.approx(MODELS[name]["output_sigma"], rel=1e-3)


HIGHER = {
    "two slow poles": ([0.4, 1.0], [1.0, 3.1, 0.3]),
    "resonance": ([100.0], [1.0, 0.6, 100.0]),
    "equal poles": ([5.0], [1.0, 4.0, 4.0]),
    "third order": ([1.0, 2.0, 5.0], [1.0, 6.0, 11.0, 6.0]),
    "undershoot": ([-1.0, 2.0], [1.0, 3.0, 2.0]),
}


@pytest.mark.parametrize("name", HIGHER)
def test_step_response_of_higher_orders_equals_scipys(name):
    transfer = ContinuousTransfer(*(np.array(side) for side in HIGHER[name]))
    slowest = 1.0 / np.min(np.abs(transfer.poles.real))
    time_s = np.linspace(0.0, 25.0 * slowest, 20_001)
    _, expected = signal.step((transfer.numerator, transfer.denominator), T=time_s)
    np.testing.assert_allclose(step_response(transfer, time_s), expected, atol=1e-6)
    outside = np.abs(expected - expected[-1]) > 0.02 * abs(expected[-1] - expected[0])
    last = time_s[np.flatnonzero(outside)[-1]]
    assert settling_time_s(transfer) == pytest.approx(last, abs=4 * time_s[1])


@pytest.mark.parametrize("name", HIGHER)
def test_tustin_there_and_back_and_frequency_warping(name):
    transfer = ContinuousTransfer(*(np.array(side) for side in HIGHER[name]))
    sampled = to_discrete(transfer, 0.02)
    back = to_continuous(sampled)
    np.testing.assert_allclose(back.denominator, transfer.denominator, rtol=1e-8)
    frequency_hz = np.array([0.01, 0.3, 5.0])
    warped_hz = np.tan(np.pi * frequency_hz * 0.02) / (np.pi * 0.02)
    np.testing.assert_allclose(
        frequency_response(sampled, frequency_hz),
        frequency_response(transfer, warped_hz),
        rtol=1e-8,
    )


def test_bandwidth_of_a_resonance_is_where_it_first_falls_through_3_db():
    transfer = ContinuousTransfer(*(np.array(side) for side in HIGHER["resonance"]))
    found = bandwidth_3db_hz(transfer)
    gain = np.abs(frequency_response(transfer, np.array([0.0, found])))
    assert gain[1] / gain[0] == pytest.approx(np.sqrt(0.5))
    assert found > 10.0 / (2 * np.pi)


def test_an_unstable_function_settles_never_and_says_none():
    transfer = ContinuousTransfer(np.array([1.0, 1.0]), np.array([1.0, -2.0]))
    assert settling_time_s(transfer) is None
    assert rise_time_s(transfer) is None
    assert output_sigma(DiscreteTransfer(np.ones(1), np.array([1.0, -1.1]), 1.0)) is None


def test_a_constant_gain_has_settled_at_once_and_has_no_bandwidth():
    transfer = to_continuous(DiscreteTransfer(np.array([2.0]), np.array([1.0]), 0.01))
    assert settling_time_s(transfer) == 0.0
    assert rise_time_s(transfer) is None
    assert bandwidth_3db_hz(transfer) is None


def test_a_zero_denominator_is_refused():
    with pytest.raises(ValueError, match="denominator"):
        to_continuous(DiscreteTransfer(np.ones(1), np.zeros(2), 0.01))


def test_a_pole_beyond_one_has_no_stationary_covariance_and_no_warning() -> None:
    P = stationary_covariance(np.array([[1.0 + 1e-9]]), np.eye(1))
    assert np.isinf(P).all()
