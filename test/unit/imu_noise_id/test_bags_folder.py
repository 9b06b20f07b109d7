"""The recordings of bags/: small, sound, and holding what their truth files say."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from imu_noise_id.bags import read_recording

from helpers.damaged_bags import check

BAGS = Path(__file__).resolve().parents[3] / "bags"
NAMES = ("demo_mems", "thesis_1khz", "thesis_100hz")


@pytest.fixture(scope="module", params=NAMES)
def bag(request):
    truth = yaml.safe_load((BAGS / f"{request.param}.truth.yaml").read_text())
    return BAGS / request.param, truth["channels"]


def test_a_bag_is_small_sound_and_still(bag):
    path, truth = bag
    assert sum(f.stat().st_size for f in path.iterdir()) < 3_000_000
    recording = read_recording(path)
    check(recording)
    assert recording.notes == ()
    assert set(truth) <= {c.name for c in recording.channels}
    for channel in recording.channels:
        assert channel.quality.static
        assert channel.quality.missing == 0


def test_channels_have_the_rate_mean_and_spread_of_their_truth(bag):
    path, truth = bag
    recording = read_recording(path)
    for name, expected in truth.items():
        channel = recording.channel(name)
        assert channel.rate_hz == pytest.approx(expected["rate_hz"], rel=1e-9)
        if "H_z" not in expected:
            continue
        # receivers' noise is coloured: its variance comes from fewer samples than there are
        pole = abs(expected["pole"])
        independent = channel.values.size * (1 - pole) / (1 + pole)
        tolerance = 5.0 / np.sqrt(2.0 * independent)
        assert channel.values.std() == pytest.approx(expected["std"], rel=tolerance + 0.002)
        if name != "heading" and "position" not in name:
            error = 5.0 * expected["std"] / np.sqrt(independent)
            assert channel.values.mean() == pytest.approx(expected["mean"], abs=error + 1e-9)
