"""The selection finds what is clearly there and adds nothing to white noise."""

import numpy as np
import pytest
from imu_noise_id.effects.averaging import Averaging
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.ordinates import cosine_coefficients, ordinates
from imu_noise_id.selection import select

from helpers.noise_records import DT, markov, walk, white

N = 60000


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
