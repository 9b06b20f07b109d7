"""A noise model survives its message to the last bit."""

from dataclasses import replace

import numpy as np
import pytest
from imu_noise_id.effects.bandwidth_limit import DigitalBandwidthLimit
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.live import ChannelFindings, Findings, Span
from imu_noise_id.model import ChannelModel, Estimate, FittedEffect, NoiseModel, UpperBound
from imu_noise_id.recording import Quality
from imu_noise_id.ros.messages import model_message, to_model, to_ns, to_time

WHITE = FittedEffect(WhiteNoise(1e-3), (Estimate(1e-3, 1e-5, 0.98e-3, 1.02e-3, "rad/s/sqrt(Hz)"),))
SLOW = FittedEffect(
    GaussMarkov(1e-4, 300.0),
    (Estimate(1e-4, 1e-5, 0.8e-4, 1.2e-4, "rad/s"), Estimate(300.0, None, None, None, "s")),
    "between gauss_markov and rate_random_walk",
)


DIGITAL = FittedEffect(
    DigitalBandwidthLimit(30.1, 2, 0.7),
    tuple(Estimate(v, None, None, None, u) for v, u in ((30.1, "Hz"), (2.0, "1"), (0.7, "1"))),
)


def found(*effects: FittedEffect) -> Findings:
    channel = ChannelModel(
        "angular_velocity.x",
        "/imu/data",
        "rad/s",
        100.0,
        0.1,
        effects,
        np.eye(sum(len(e.estimates) for e in effects)) / 3,
        60.0,
        (UpperBound("rate_ramp", "slope", "rad/s^2", 1e-7, "600 s would show it"),),
    )
    findings = ChannelFindings(channel.name, 2 * 10**18, 6000, Quality(gaps=2), None, None)
    return Findings(
        10**18, "imu", Span(0.0, 60.0, "all"), NoiseModel((channel,), None, "live"), (findings,)
    )


def test_a_model_comes_back_to_the_last_bit() -> None:
    given = found(WHITE, SLOW, DIGITAL)
    again = to_model(model_message(given))
    (channel,), (expected,) = again.channels, given.model.channels
    assert np.array_equal(channel.log_covariance, expected.log_covariance)
    assert replace(channel, log_covariance=None) == replace(expected, log_covariance=None)


def test_a_term_that_is_only_bounded_is_left_out_and_no_nan_is_sent() -> None:
    unknown = replace(SLOW, estimates=(replace(SLOW.estimates[0], value=None), SLOW.estimates[1]))
    message = model_message(found(WHITE, unknown))
    assert message.channels[0].effects[1].parameters[0].value == 0.0
    assert not message.channels[0].effects[1].parameters[0].value_known
    (channel,) = to_model(message).channels
    assert [effect.name for effect in channel.effects] == ["white_noise"]
    assert channel.log_covariance is None


def test_what_is_no_effect_is_refused_by_name() -> None:
    message = model_message(found(WHITE))
    message.channels[0].effects[0].name = "magic"
    with pytest.raises(ValueError, match="magic"):
        to_model(message)


@pytest.mark.parametrize("stamp_ns", [0, 1, 10**18 + 1, -1, -(10**9) - 1])
def test_stamps_come_back(stamp_ns: int) -> None:
    assert to_ns(to_time(stamp_ns)) == stamp_ns
