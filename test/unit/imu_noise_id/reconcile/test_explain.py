"""What candidates are: bursts taken out of the record, jumps to the sample, filters by name."""

import numpy as np
import pytest
from imu_noise_id.model import ChannelModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile.explain import candidates, quieten, to_the_sample
from imu_noise_id.reconcile.state import analyse
from imu_noise_id.reconcile.work import initial_state

NAME, DT, COUNT = "angular_velocity.x", 0.01, 60_000
BURST, RATIO, BLOCK = slice(20_000, 44_000), 3.0, 400


def found(values, **effects):
    fitted = tuple(typed_effect(effect, NAME, given) for effect, given in effects.items())
    model = ChannelModel(NAME, "/imu/data", "rad/s", 1.0 / DT, 0.0, fitted)
    return analyse(initial_state(model, values, DT, 0.0, None, 1.0))


def burst(rng):
    white = rng.standard_normal(COUNT)
    white[BURST] *= np.sqrt(RATIO)
    return white


def test_a_long_burst_leaves_no_slow_noise_behind():
    values = burst(np.random.default_rng(0))
    analysis = found(values, white_noise={"density": np.sqrt(DT)})
    quiet, _ = quieten(analysis, BURST.start, BURST.stop, RATIO)
    means = quiet.reshape(-1, BLOCK).mean(axis=1) * np.sqrt(BLOCK)
    inside = means[BURST.start // BLOCK : BURST.stop // BLOCK]
    assert 0.6 < inside.var() < 1.6  # 60 blocks, standard error 0.18
    assert abs(quiet[BURST].var() - 1.0) < 0.05


def test_what_is_slow_stays_as_it_is():
    rng = np.random.default_rng(1)
    slow = np.cumsum(rng.normal(0.0, 0.05, COUNT))
    analysis = found(
        slow + burst(rng),
        white_noise={"density": np.sqrt(DT)},
        rate_random_walk={"coefficient": 0.05 / np.sqrt(DT)},
    )
    off = quieten(analysis, BURST.start, BURST.stop, RATIO)[0] - slow
    blocks = off[BURST].reshape(-1, BLOCK).mean(axis=1)
    assert np.abs(blocks).max() < 5.0 / np.sqrt(BLOCK) * np.sqrt(RATIO)


def test_jumps_found_in_blocks_move_to_their_samples():
    edges = np.array([1_300, 2_950, 4_015, 7_777])
    level = (np.searchsorted(edges, np.arange(10_000), side="right") % 2).astype(float)
    coarse = np.repeat(level.reshape(-1, 100).mean(axis=1) > 0.5, 100).astype(float)
    noisy = level - 0.5 + 0.1 * np.random.default_rng(2).standard_normal(level.size)
    assert np.count_nonzero(coarse != level) > 50
    assert np.array_equal(to_the_sample(coarse, noisy, 100), level)


def averaged(rng, over=10, window=13):
    """White noise at ``over`` times the rate, each sample the mean of the ``window`` before it."""
    total = np.cumsum(rng.standard_normal(COUNT * over + window) * np.sqrt(over))
    first = np.arange(COUNT) * over
    return (total[first + window - 1] - np.where(first > 0, total[first - 1], 0.0)) / window


def behind_a_pole(rng, cutoff_hz=18.0):
    """White noise through one pole at ten times the rate, a fifth louder than the model says."""
    over = 10
    a = np.exp(-2.0 * np.pi * cutoff_hz * DT / over)
    drive, out = 1.2 * rng.standard_normal(COUNT * over) * np.sqrt(over), 0.0
    seen = np.empty(COUNT * over)
    for k, u in enumerate(((1.0 - a) * drive).tolist()):
        out = a * out + u
        seen[k] = out
    return seen[::over]


@pytest.mark.parametrize(
    ("made", "name"), [(averaged, "averaging"), (behind_a_pole, "bandwidth_limit")]
)
def test_a_filter_is_weighed_with_the_level_free_beneath_it(made, name):
    """What folds back, or was louder before the filter, gave other filters the better fit."""
    model = {"white_noise": {"density": np.sqrt(DT)}}
    analysis = found(made(np.random.default_rng(3)), **model)
    best = candidates(analysis.state, analysis)[0]
    assert best.effect.name == name
    assert getattr(best.effect, "order", 1.0) == 1.0
