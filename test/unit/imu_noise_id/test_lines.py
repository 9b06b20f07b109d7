"""Lines are found at their frequency and amplitude; noise is not taken for them."""

import numpy as np
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.lines import find_lines, level_without_lines
from imu_noise_id.ordinates import cosine_coefficients, ordinates
from numpy.testing import assert_allclose

from helpers.noise_records import DT, walk, white

N = 30000


def lines_of(values, density=1.0):
    coefficients = cosine_coefficients(values)
    grid = ordinates(coefficients, DT)
    psd = np.full(grid.power.size, density**2)
    return find_lines(coefficients, grid, level_without_lines(grid, psd))


def sine(frequency_hz, amplitude):
    return amplitude * np.cos(2 * np.pi * frequency_hz * DT * np.arange(N) + 0.7)


def test_white_noise_has_no_line():
    rng = np.random.default_rng(21)
    assert sum(lines_of(white(N, rng)) != ((), ()) for _ in range(40)) == 0


def test_lines_are_found_within_their_errors():
    rng = np.random.default_rng(22)
    z = []
    for _ in range(30):
        frequency_hz = rng.uniform(2.0, 48.0)
        (line,), wide = lines_of(white(N, rng) + sine(frequency_hz, 1.5))
        errors = line.standard_errors(N * DT)
        z.append(
            ((line.frequency_hz - frequency_hz) / errors[0], (line.amplitude - 1.5) / errors[1])
        )
        assert wide == ()
    assert np.all(np.std(z, axis=0) < 1.5)


def test_strong_line_with_sidebands_is_three_lines():
    rng = np.random.default_rng(23)
    values = white(N, rng) + sine(30.0, 100.0) + sine(29.0, 3.0) + sine(31.0, 3.0)
    lines, _ = lines_of(values)
    assert_allclose([x.frequency_hz for x in lines], [29.0, 30.0, 31.0], atol=1e-3)
    assert_allclose([x.amplitude for x in lines], [3.0, 100.0, 3.0], rtol=0.15)


def test_narrow_band_is_no_line():
    rng = np.random.default_rng(24)
    for _ in range(5):
        lines, _ = lines_of(white(N, rng) + NarrowBand(20.0, 0.5, 5.0).simulate(N, DT, rng))
        assert lines == ()


def test_slow_noise_is_no_line():
    rng = np.random.default_rng(25)
    values = white(N, rng) + walk(N, rng, 2.0)
    coefficients = cosine_coefficients(values)
    grid = ordinates(coefficients, DT)
    psd = 1.0 + (2.0 / (2 * np.pi * grid.frequency_hz)) ** 2
    assert find_lines(coefficients, grid, psd) == ((), ())


def test_a_line_whose_phase_wanders_slowly_is_a_line_and_leaves_nothing():
    time_s = DT * np.arange(N)
    phase = 2 * np.pi * (23.0 * time_s + 0.05 * np.sin(6 * np.pi * time_s / time_s[-1]))
    values = white(N, np.random.default_rng(26)) + 2.0 * np.cos(phase)
    (line,), wide = lines_of(values)
    assert wide == ()
    assert abs(line.amplitude - 2.0) < 4.0 * line.standard_errors(N * DT)[1]
    assert lines_of(values - line.course(N, DT)) == ((), ())
