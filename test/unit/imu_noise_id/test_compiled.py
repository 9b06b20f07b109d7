"""Compiled functions with a place for what was compiled, and without."""

from imu_noise_id.compiled import njit
from numba.core import caching


def twice(x):
    return 2.0 * x


def test_a_function_is_compiled_and_kept():
    compiled = njit(cache=True)(twice)
    assert compiled(1.5) == 3.0
    assert compiled._cache.cache_path


def test_a_function_is_compiled_where_nothing_can_be_kept(monkeypatch):
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    compiled = njit(cache=True)(twice)
    assert compiled(1.5) == 3.0
    assert compiled._cache.cache_path is None
