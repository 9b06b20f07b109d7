"""The selection finds what is clearly there and adds nothing to white noise."""

import numpy as np
import pytest
from imu_noise_id.dither import dithered
from imu_noise_id.effects.averaging import Averaging
from imu_noise_id.effects.bandwidth_limit import BandwidthLimit, DigitalBandwidthLimit
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.ordinates import cosine_coefficients, ordinates
from imu_noise_id.selection import select
from imu_noise_id.whittle import log_covariance, parameter_vector
from scipy import signal

from helpers.noise_records import DT, markov, walk, white

N = 60000
# s^2 + 3 s + 3 has half its power at 1.3617, wn = sqrt(3); Tustin's transform warps the axis
BESSEL_HZ = 100.0 / np.pi * np.arctan(np.sqrt(3.0) / 1.3617 * np.tan(0.15 * np.pi))
BEHIND_A_LOW_PASS = ["bandwidth_limit", "gauss_markov", "white_noise"]


def names(values):
    fitted = select(ordinates(cosine_coefficients(values), DT))
    return sorted(e.name for e in fitted.effects)


def test_white_noise_stays_white():
    rng = np.random.default_rng(11)
    wrong = sum(names(white(20000, rng)) != ["white_noise"] for _ in range(60))
    assert wrong <= 2


@pytest.mark.parametrize(
    ("expected", "extra"),
    [
        (["rate_random_walk"], lambda rng: walk(N, rng, 0.5)),
        (["gauss_markov"], lambda rng: markov(N, rng, 3.0, 2.0)),
        (["quantization"], lambda rng: np.diff(rng.standard_normal(N + 1)) * 0.05 / DT),
        (
            ["gauss_markov", "rate_random_walk"],
            lambda rng: markov(N, rng, 5.0, 0.5) + walk(N, rng, 1.0),
        ),
        (["narrow_band"], lambda rng: NarrowBand(20.0, 1.0, 4.0).simulate(N, DT, rng)),
    ],
    ids=lambda x: "+".join(x) if isinstance(x, list) else "",
)
def test_what_is_clearly_there_is_found(expected, extra):
    rng = np.random.default_rng(12)
    assert names(white(N, rng) + extra(rng)) == sorted(["white_noise", *expected])


def test_a_boxcar_over_1_2_samples_is_found():
    rng = np.random.default_rng(13)
    fine = rng.standard_normal(5 * N + 6)
    box = np.convolve(fine, np.ones(6) / 6, "valid")[::5][:N]
    fitted = select(ordinates(cosine_coefficients(box), DT))
    window = next(e for e in fitted.effects if isinstance(e, Averaging)).window_s
    assert abs(window / DT - 1.2) < 0.03


@pytest.mark.parametrize(
    ("filtered", "cutoff_hz", "damping"),
    [
        (signal.butter(2, 10.0, fs=100.0), 10.0, np.sqrt(0.5)),
        (signal.butter(2, 30.0, fs=100.0), 30.0, np.sqrt(0.5)),
        (signal.butter(1, 12.5, fs=100.0), 12.5, None),
        # a Bessel filter's corner of 3 dB is not its natural frequency
        (signal.bessel(2, 15.0, fs=100.0, norm="mag"), BESSEL_HZ, np.sqrt(0.75)),
    ],
    ids=["butter2_10", "butter2_30", "butter1_12.5", "bessel2_15"],
)
def test_a_digital_low_pass_is_found_with_its_corner_and_damping(filtered, cutoff_hz, damping):
    rng = np.random.default_rng(14)
    record = signal.lfilter(*filtered, white(N, rng) + markov(N, rng, 3.0, 2.0))
    _, coefficients, floor = dithered(record, DT, rng)
    fitted = select(ordinates(coefficients, DT), floor)
    assert sorted(e.name for e in fitted.effects) == BEHIND_A_LOW_PASS
    found = next(e for e in fitted.effects if isinstance(e, DigitalBandwidthLimit))
    assert found.order == (1 if damping is None else 2)
    error = np.sqrt(np.diag(log_covariance(fitted)))
    off = parameter_vector((found,)) - np.log([cutoff_hz, damping or 1.0][: len(found.free())])
    first = sum(len(e.free()) for e in fitted.effects[: fitted.effects.index(found)])
    error = error[first : first + off.size]
    assert np.all(error < 0.03)
    assert np.all(np.abs(off) < 4.0 * error)


def test_a_low_pass_before_sampling_is_found_as_such():
    rng = np.random.default_rng(15)
    fine = signal.lfilter(*signal.butter(2, 20.0, fs=2000.0), rng.standard_normal(20 * N))[::20]
    fitted = select(ordinates(cosine_coefficients(fine), DT))
    (found,) = (e for e in fitted.effects if isinstance(e, BandwidthLimit))
    assert not isinstance(found, DigitalBandwidthLimit)
    assert abs(found.cutoff_hz / 20.0 - 1.0) < 0.02
