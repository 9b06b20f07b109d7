"""nav_fusion.noise: effects become what the filter takes, and what it cannot take is said."""

from __future__ import annotations

import math

import numpy as np
import pytest
from imu_noise_id.curves import model_psd
from imu_noise_id.effects.bandwidth_limit import BandwidthLimit
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.effects.quantization import Quantization
from imu_noise_id.effects.rate_random_walk import RateRandomWalk
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.errors import InputError
from imu_noise_id.model import ChannelModel, FittedEffect, NoiseModel
from nav_fusion.colour import grid, sampled_psd
from nav_fusion.noise import LEVEL, AidRates, TurnOn, flicker_terms, from_model, mems_defaults
from nav_fusion.state import UNSEEN, layout_of

UNITS = {"angular_velocity": "rad/s", "linear_acceleration": "m/s^2", "position": "m"}


def channel(name: str, *effects: object) -> ChannelModel:
    return ChannelModel(
        name,
        "/x",
        UNITS[name.split(".")[0]],
        10.0,
        0.3,
        tuple(FittedEffect(e, ()) for e in effects),
    )  # type: ignore[arg-type]


def imu(*effects: object) -> list[ChannelModel]:
    return [
        channel(f"{n}.{a}", *effects)
        for n in ("angular_velocity", "linear_acceleration")
        for a in "xyz"
    ]


def test_terms_enter_with_their_own_dynamics_and_the_turn_on_sigma_not_the_mean() -> None:
    noise = from_model(
        NoiseModel(tuple(imu(WhiteNoise(1e-3), GaussMarkov(2e-3, 50.0)))), TurnOn(0.01, 0.2)
    )
    turn_on, markov = noise.gyro[0].terms
    assert (turn_on.initial_sigma, turn_on.density) == (0.01, 0.0)
    assert markov.density == pytest.approx(2e-3 * math.sqrt(2 / 50.0))
    assert markov.initial_sigma == 2e-3
    assert noise.gyro[0].white_density == 1e-3


def test_an_aid_whose_rate_the_model_does_not_state_has_the_rate_at_which_it_comes() -> None:
    """A density is of no use without it: the variance of a fix is density^2 times the rate."""

    def fixes(rate_hz: float | None) -> list[ChannelModel]:
        white = (FittedEffect(WhiteNoise(0.1), ()),)
        return [ChannelModel(f"position.{a}", "", "m", rate_hz, 0.0, white) for a in LEVEL]

    inertial = imu(WhiteNoise(1e-3))
    stated = from_model(NoiseModel((*inertial, *fixes(2.0))))
    told = from_model(NoiseModel((*inertial, *fixes(None))), rates=AidRates(position_hz=2.0))
    assert told.position == stated.position
    assert stated.notes == ()
    assert told.notes[0] == (
        "position.east: the model does not say at what rate (rate_hz): 2 Hz used"
    )


def test_a_walk_carries_the_turn_on_bias() -> None:
    noise = from_model(NoiseModel(tuple(imu(WhiteNoise(1e-3), RateRandomWalk(1e-5)))))
    (walk,) = noise.accel[0].terms
    assert (walk.density, walk.initial_sigma) == (1e-5, 0.2)


def test_a_density_of_the_receiver_becomes_the_sigma_of_a_fix() -> None:
    fixes = [
        channel(f"position.{a}", WhiteNoise(0.1), GaussMarkov(0.8, 30.0))
        for a in ("east", "north", "up")
    ]
    noise = from_model(NoiseModel(tuple(imu(WhiteNoise(1e-3)) + fixes)))
    assert noise.position[0].white_sigma == pytest.approx(0.1 * math.sqrt(10.0))
    assert not noise.position_claimed


def test_a_receivers_narrow_band_is_two_states_with_its_own_law() -> None:
    band = NarrowBand(frequency_hz=0.2, bandwidth_hz=0.1, sigma=0.4)
    noise = from_model(
        NoiseModel((*imu(WhiteNoise(1e-4)), *(channel(f"position.{a}", band) for a in LEVEL)))
    )
    east = noise.position[0]
    (pair,) = east.terms
    f = np.linspace(0.05, 4.9, 30)
    np.testing.assert_allclose(sampled_psd(pair, f, 0.1), band.psd(f, 0.1), rtol=1e-9)
    assert east.white_sigma == 0.0
    slow = layout_of(noise, False, False).slow
    assert list(slow.target[-6:]) == [6, UNSEEN, 7, UNSEEN, 8, UNSEEN]


def test_a_receiver_behind_a_low_pass_keeps_variance_and_density_in_few_states() -> None:
    effects = WhiteNoise(0.2), BandwidthLimit(cutoff_hz=0.5, order=2, damping=0.9)
    noise = from_model(
        NoiseModel((*imu(WhiteNoise(1e-4)), *(channel(f"position.{a}", *effects) for a in LEVEL)))
    )
    east = noise.position[0]
    f = grid(0.1)
    true = model_psd(channel("position.east", *effects), f, 0.1)
    found = sum(
        (sampled_psd(t, f, 0.1) for t in east.terms), np.full(f.size, 0.1) * east.white_sigma**2
    )
    assert layout_of(noise, False, False).slow.target.size <= 12 + 3 * 4
    assert np.mean(found) == pytest.approx(np.mean(true), rel=0.03)
    assert found[0] == pytest.approx(true[0], rel=0.1)
    assert np.mean(true / found) == pytest.approx(1.0, abs=0.02)


def test_the_white_density_of_an_inertial_axis_is_its_fast_spectrum_at_0_hz() -> None:
    limited = imu(WhiteNoise(1e-3), BandwidthLimit(cutoff_hz=2.0, order=1, damping=0.7))
    assert from_model(NoiseModel(tuple(limited))).gyro[0].white_density == pytest.approx(
        1e-3, rel=1e-4
    )
    band = imu(NarrowBand(frequency_hz=1.0, bandwidth_hz=1.0, sigma=1e-3))
    assert from_model(NoiseModel(tuple(band))).gyro[0].white_density > 1e-4


def test_without_position_channels_the_claim_is_used_and_said() -> None:
    noise = from_model(NoiseModel(tuple(imu(WhiteNoise(1e-3)))))
    assert noise.position_claimed
    assert any("own covariance" in note for note in noise.notes)


def test_what_is_no_state_is_said() -> None:
    noise = from_model(NoiseModel(tuple(imu(WhiteNoise(1e-3), Quantization(1e-5)))))
    assert any("quantization" in note for note in noise.notes)


def test_a_missing_gyro_is_named() -> None:
    with pytest.raises(InputError, match=r"angular_velocity\.x"):
        from_model(NoiseModel(tuple(imu(WhiteNoise(1e-3))[3:])))


def test_flicker_terms_follow_the_spectrum_over_the_band() -> None:
    B = 3e-4
    f = np.geomspace(1 / (2 * np.pi * 300), 1 / (2 * np.pi * 10), 40)
    S = sum(
        t.density**2 / ((1 / t.correlation_time_s) ** 2 + (2 * np.pi * f) ** 2)
        for t in flicker_terms(B)
    )
    # two terms over two and a half decades ripple
    assert np.all(np.abs(np.log(S / (B**2 / (2 * np.pi * f)))) < math.log(2.0))


def test_too_many_terms_are_refused() -> None:
    many = [GaussMarkov(1e-3, float(t)) for t in range(10, 20)]
    with pytest.raises(InputError, match="slow terms"):
        layout_of(from_model(NoiseModel(tuple(imu(WhiteNoise(1e-3), *many)))))


def test_defaults_have_18_navigation_and_bias_states_and_more() -> None:
    assert layout_of(mems_defaults(), False, False).states == 9 + 12 + 3
