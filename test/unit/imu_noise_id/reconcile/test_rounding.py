"""Coarse output: its step is named, and nothing else is taken for what the stairs do."""

import numpy as np
import pytest
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import Reconciliation, reconcile_recording
from imu_noise_id.reconcile.unrounded import white_stride
from imu_noise_id.recording import Channel, Recording

NAMES = ("position.east", "position.north", "position.up")
RATE_HZ, COUNT = 5.0, 18_000
WHITE_M, SLOW_M, SLOW_S = 0.012, 0.25, 40.0


def courses(seed: int) -> list[np.ndarray]:
    """White noise of a centimetre on an exponentially correlated course, run as a recursion."""
    rng = np.random.default_rng(seed)
    a = np.exp(-1.0 / RATE_HZ / SLOW_S)
    out = []
    for _ in NAMES:
        x, slow = SLOW_M * rng.standard_normal(), []
        for w in (rng.standard_normal(COUNT) * SLOW_M * np.sqrt(1.0 - a * a)).tolist():
            x = a * x + w
            slow.append(x)
        out.append(np.array(slow) + WHITE_M * rng.standard_normal(COUNT))
    return out


def reconciled(values: list[np.ndarray]) -> Reconciliation:
    stamps = np.rint(np.arange(COUNT) / RATE_HZ * 1e9).astype(np.int64)
    still = np.ones(COUNT, dtype=bool)
    channels = tuple(
        Channel("/gps/fix", name, "m", stamps, v, still, RATE_HZ)
        for name, v in zip(NAMES, values, strict=True)
    )
    models = []
    for name in NAMES:
        white = typed_effect("white_noise", name, {"density": WHITE_M / np.sqrt(RATE_HZ)})
        slow = {"sigma": SLOW_M, "correlation_time_s": SLOW_S}
        markov = typed_effect("gauss_markov", name, slow)
        models.append(ChannelModel(name, "/gps/fix", "m", RATE_HZ, 0.0, (white, markov)))
    return reconcile_recording(Recording("made", 0, channels), NoiseModel(tuple(models)), 0, 1)


@pytest.mark.parametrize("step", [0.02, 0.05, 0.12])
def test_positions_in_coarse_digits_are_rounded_and_nothing_else(step: float) -> None:
    result = reconciled([step * np.rint(v / step) for v in courses(1)])
    for channel in result.channels:
        assert [s.effect.name for s in channel.steps] == ["output_rounding"]
        assert channel.steps[0].effect.effect.step == pytest.approx(step, rel=1e-6)
        assert channel.verdict == "explained"
        assert channel.after.score < 1.4


def test_a_record_is_thinned_until_it_moves_by_half_a_step() -> None:
    rng = np.random.default_rng(2)
    walk = np.cumsum(0.1 * rng.standard_normal(40_000))  # half a step in 25 samples
    assert 20 <= white_stride(np.rint(walk), 1.0) <= 32
    assert white_stride(np.rint(4.0 * rng.standard_normal(5_000)), 1.0) == 1
    assert white_stride(np.rint(0.05 * rng.standard_normal(5_000) + 0.4), 1.0) == 0
