"""Samples that are left out are replaced by ones that differ from the others in nothing."""

import numpy as np
import pytest
from imu_noise_id.reconcile.contamination import mend

COUNT = 20_000


@pytest.mark.parametrize("length", [1, 20, 60, 400])
def test_a_mended_stretch_has_the_level_and_the_spread_of_its_surroundings(length):
    rng = np.random.default_rng(length)
    level = 5.0 + 1e-4 * np.arange(COUNT)
    mask = np.arange(COUNT) % (4 * length) >= 3 * length
    values = np.where(mask, np.nan, level + rng.standard_normal(COUNT))
    mended = mend(values, mask, 1.0, rng)
    np.testing.assert_array_equal(mended[~mask], values[~mask])
    off = (mended - level)[mask]
    assert abs(off.mean()) < 0.1
    assert off.std() == pytest.approx(1.0, abs=0.1)
    means = off[: off.size // length * length].reshape(-1, length).mean(axis=1)
    assert means.std() < 1.6 / np.sqrt(length) + 0.2 * (length == 1)


def test_a_record_that_begins_and_ends_masked_has_the_level_of_the_rest():
    rng = np.random.default_rng(0)
    mask = np.ones(1000, dtype=bool)
    mask[300:700] = False
    mended = mend(np.where(mask, np.nan, 3.0), mask, 0.0, rng)
    np.testing.assert_allclose(mended, 3.0)
