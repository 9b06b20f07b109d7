"""Random telegraph noise against its definition."""

from __future__ import annotations

import numpy as np
import pytest
from imu_noise_id.effects.random_telegraph import RandomTelegraph, decode

TELEGRAPH = RandomTelegraph(height=2.0, mean_dwell_s=0.5)
DT = 0.01


def test_spectrum_is_the_transform_of_the_autocovariance() -> None:
    f = np.linspace(0.0, 0.5 / DT, 50)
    lags = np.arange(1, 5000)
    covariance = np.exp(-2.0 * lags * DT / TELEGRAPH.mean_dwell_s)
    direct = DT * (1.0 + 2.0 * np.cos(2.0 * np.pi * np.outer(f, lags) * DT) @ covariance)
    np.testing.assert_allclose(TELEGRAPH.psd(f, DT), direct, rtol=1e-9)


def test_gradient_is_the_derivative() -> None:
    f = np.geomspace(1e-3, 50.0, 40)
    for row, name in enumerate(("height", "mean_dwell_s")):
        value = getattr(TELEGRAPH, name)
        up = TELEGRAPH.replace(**{name: value * np.exp(1e-5)}).psd(f, DT)
        down = TELEGRAPH.replace(**{name: value * np.exp(-1e-5)}).psd(f, DT)
        np.testing.assert_allclose(
            TELEGRAPH.psd_gradient(f, DT)[row], (up - down) / 2e-5, rtol=1e-6
        )


def test_simulation_has_levels_variance_and_dwell() -> None:
    x = TELEGRAPH.simulate(400_000, DT, np.random.default_rng(0))
    assert set(np.unique(x)) == {-1.0, 1.0}
    assert np.var(x) == pytest.approx(1.0, abs=0.02)
    jumps = np.count_nonzero(np.diff(x))
    assert x.size * DT / jumps == pytest.approx(0.5, rel=0.05)


def test_allan_variance_is_that_of_the_simulation() -> None:
    x = TELEGRAPH.simulate(400_000, DT, np.random.default_rng(1))
    for m in (4, 32, 256):
        means = x[: x.size // m * m].reshape(-1, m).mean(axis=1)
        seen = 0.5 * np.mean(np.diff(means) ** 2)
        assert TELEGRAPH.allan_variance(np.array([m * DT]), DT)[0] == pytest.approx(seen, rel=0.1)


def test_decoding_finds_the_course_under_noise() -> None:
    rng = np.random.default_rng(2)
    level = TELEGRAPH.simulate(60_000, DT, rng)
    means = (level + 3.0 * rng.standard_normal(level.size)).reshape(-1, 10).mean(axis=1)
    decoded = decode(means, 5.0)
    right = np.mean(decoded.upper == (level.reshape(-1, 10).mean(axis=1) > 0.0))
    assert right > 0.85
    assert decoded.high - decoded.low == pytest.approx(2.0, rel=0.1)
    assert decoded.mean_dwell == pytest.approx(5.0, rel=0.3)
    assert decoded.log_likelihood < decoded.path_log_likelihood
