"""Laws that every spectral effect keeps, each checked against the others."""

from __future__ import annotations

import numpy as np
import pytest
from imu_noise_id.effects.averaging import Averaging
from imu_noise_id.effects.bandwidth_limit import BandwidthLimit, DigitalBandwidthLimit
from imu_noise_id.effects.base import ResponseEffect, StochasticEffect
from imu_noise_id.effects.bias_instability import BiasInstability
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.effects.periodic import Periodic
from imu_noise_id.effects.quantization import Quantization
from imu_noise_id.effects.rate_random_walk import RateRandomWalk
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.ordinates import Ordinates, Residual
from numpy.testing import assert_allclose
from scipy.signal import butter, freqz

DT = 0.01
STOCHASTIC = [
    WhiteNoise(1.3),
    GaussMarkov(1.3, 2.0),
    BiasInstability(0.7),
    RateRandomWalk(0.1),
    Quantization(0.01),
    NarrowBand(20.0, 0.3, 1.3),
]
RESPONSES = [
    Averaging(0.012),
    Averaging(0.055),
    BandwidthLimit(20.0, 1),
    BandwidthLimit(20.0, 2, 0.3),
    DigitalBandwidthLimit(20.0, 1),
    DigitalBandwidthLimit(40.0, 2, 0.3),
]


def name_of(effect: object) -> str:
    return type(effect).__name__


@pytest.mark.parametrize("effect", STOCHASTIC, ids=name_of)
def test_gradient_is_the_slope_of_the_psd(effect: StochasticEffect) -> None:
    f = np.linspace(0.01, 50.0, 5000)
    for row, name in zip(effect.psd_gradient(f, DT), effect.free(), strict=True):
        value, step = getattr(effect, name), 1e-5
        up, down = (
            effect.replace(**{name: value * np.exp(s * step)}).psd(f, DT)  # type: ignore[attr-defined]
            for s in (1.0, -1.0)
        )
        assert_allclose(row, (up - down) / (2 * step), atol=1e-5 * np.abs(row).max())


@pytest.mark.parametrize("effect", STOCHASTIC, ids=name_of)
@pytest.mark.parametrize("m", [1, 3, 10, 50])
def test_allan_variance_is_the_integral_of_the_sampled_psd(
    effect: StochasticEffect, m: int
) -> None:
    f = (np.arange(40000) + 0.5) * 50.0 / 40000
    kernel = np.sin(np.pi * f * m * DT) ** 4 / (m * np.sin(np.pi * f * DT)) ** 2
    integral = 4.0 * np.mean(effect.psd(f, DT) * kernel) * 50.0
    assert_allclose(effect.allan_variance(np.array([m * DT]), DT), integral, rtol=1e-3)


@pytest.mark.parametrize("effect", STOCHASTIC, ids=name_of)
def test_simulation_has_the_effects_own_allan_variance(effect: StochasticEffect) -> None:
    rng = np.random.default_rng(4)
    m = np.array([1, 4, 16])
    measured = np.zeros(3)
    for _ in range(4):
        x = effect.simulate(2**14, DT, rng)
        for i, k in enumerate(m):
            means = x.reshape(-1, k).mean(axis=1)
            measured[i] += 0.125 * np.mean(np.diff(means) ** 2)
    assert_allclose(measured, effect.allan_variance(m * DT, DT), rtol=0.12)


def test_bias_instability_is_flat_at_0_664_b() -> None:
    deviation = np.sqrt(BiasInstability(2.0).allan_variance(np.array([10.0, 1000.0]), DT))
    assert_allclose(deviation, 2.0 * np.sqrt(2.0 * np.log(2.0) / np.pi), rtol=1e-3)


def test_gauss_markov_is_a_walk_below_and_white_above_its_correlation_time() -> None:
    effect = GaussMarkov(1.0, 100.0)
    q = np.sqrt(2.0 / 100.0)
    early, late = effect.allan_variance(np.array([0.5, 1e5]), DT)
    assert_allclose(early, q**2 * 0.5 / 3.0, rtol=5e-3)
    assert_allclose(late, (q * 100.0) ** 2 / 1e5, rtol=5e-3)


def test_quantization_crosses_sqrt_3_q_at_one_second() -> None:
    assert_allclose(Quantization(0.2).allan_variance(np.array([1.0]), DT), 3 * 0.2**2)


@pytest.mark.parametrize("effect", STOCHASTIC[:1] + STOCHASTIC[1:2] + STOCHASTIC[3:], ids=name_of)
def test_state_space_has_the_effects_spectrum(effect: StochasticEffect) -> None:
    form = effect.state_space(DT)
    assert form is not None
    f = np.array([0.5, 7.0, 20.1, 44.0])
    for frequency in f:
        z = np.exp(2j * np.pi * frequency * DT)
        transfer = form.H @ np.linalg.inv(z * np.eye(form.F.shape[0]) - form.F)
        power = (transfer @ form.Q @ transfer.conj().T + form.R).real.item() * DT
        assert_allclose(power, effect.psd(np.array([frequency]), DT), rtol=1e-6)


def test_flickers_states_follow_its_spectrum() -> None:
    effect = BiasInstability(1.0)
    form = effect.state_space(DT)
    for frequency in (3e-4, 1e-2, 0.2):
        z = np.exp(2j * np.pi * frequency * DT)
        transfer = form.H @ np.linalg.inv(z * np.eye(form.F.shape[0]) - form.F)
        power = (transfer @ form.Q @ transfer.conj().T).real.item() * DT
        assert_allclose(power, effect.psd(np.array([frequency]), DT), rtol=0.12)


def test_a_line_has_its_allan_variance() -> None:
    line = Periodic(3.3, 0.5)
    x = line.simulate(2**15, DT, np.random.default_rng(1))
    for m in (1, 10, 64):
        means = np.convolve(x, np.ones(m) / m, "valid")
        measured = 0.5 * np.mean((means[m:] - means[:-m]) ** 2)
        assert_allclose(line.allan_variance(np.array([m * DT]), DT), measured, rtol=3e-2)


@pytest.mark.parametrize("effect", RESPONSES, ids=name_of)
def test_response_gradient_is_its_slope_and_zero_frequency_passes(effect: ResponseEffect) -> None:
    f = np.linspace(0.01, 49.0, 2000)
    assert_allclose(effect.power_response(np.zeros(1), DT), 1.0)
    for row, name in zip(effect.log_response_gradient(f, DT), effect.free(), strict=True):
        value, step = getattr(effect, name), 1e-5
        up, down = (
            np.log(effect.replace(**{name: value * np.exp(s * step)}).power_response(f, DT))  # type: ignore[attr-defined]
            for s in (1.0, -1.0)
        )
        assert_allclose(row, (up - down) / (2 * step), atol=2e-3 * np.abs(row).max())


def test_averaging_over_1_2_samples_correlates_neighbours_by_a_sixth() -> None:
    f = (np.arange(4096) + 0.5) * 50.0 / 4096
    response = Averaging(0.012).power_response(f, DT)
    neighbours = np.mean(response * np.cos(2 * np.pi * f * DT)) / np.mean(response)
    assert_allclose(neighbours, 1.0 / 6.0, rtol=1e-6)


def test_bandwidth_limit_is_the_folded_filter() -> None:
    effect = BandwidthLimit(20.0, 2, 0.4)
    f = np.array([0.0, 10.0, 45.0])
    aliases = f[:, None] + 100.0 * np.arange(-400, 401)
    u2 = (aliases / 20.0) ** 2
    folded = np.sum(1.0 / ((1 - u2) ** 2 + 4 * 0.16 * u2), axis=1)
    assert_allclose(effect.power_response(f, DT), folded / folded[0], rtol=1e-3)


@pytest.mark.parametrize("order", [1, 2])
def test_a_digital_bandwidth_limit_is_tustins_filter(order: int) -> None:
    f = np.array([0.0, 10.0, 30.0, 49.0])
    _, gain = freqz(*butter(order, 30.0, fs=100.0), worN=f, fs=100.0)
    response = DigitalBandwidthLimit(30.0, order).power_response(f, DT)
    assert_allclose(response, np.abs(gain) ** 2, rtol=1e-6)


def test_applying_a_response_gives_white_noise_its_spectrum() -> None:
    rng = np.random.default_rng(3)
    n = 2**15
    x = BandwidthLimit(10.0, 2, 0.5).apply(rng.standard_normal(n), np.arange(n) * DT, DT, rng)
    f = np.fft.rfftfreq(n, DT)
    power = np.abs(np.fft.rfft(x)) ** 2 / n
    for low, high in ((1.0, 2.0), (9.0, 11.0), (30.0, 40.0)):
        inside = (f > low) & (f < high)
        expected = BandwidthLimit(10.0, 2, 0.5).power_response(f[inside], DT).mean()
        assert_allclose(power[inside].mean(), expected, rtol=0.1)


def test_a_band_of_several_bins_is_found_before_one_large_ordinate() -> None:
    n, f = 20000, np.arange(1, 20000) / (2.0 * 20000 * DT)
    bins = Ordinates(f, np.ones(f.size), np.ones(f.size), DT, n * DT)
    bins.power[4] = 12.0
    bins.power[np.abs(f - 20.0) < 0.5] = 1.4
    (start,) = NarrowBand.starts(Residual(bins, np.ones(f.size), np.zeros((0, f.size))))
    assert isinstance(start, NarrowBand)
    assert abs(start.frequency_hz - 20.0) < 0.5
