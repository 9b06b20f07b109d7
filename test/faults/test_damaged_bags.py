"""Damaged bags are read as far as they are whole, or refused in a line: a seeded part of the study.

``study/study_fuzz_bags.py`` runs the same on more than a hundred thousand.
"""

import numpy as np
import pytest
from mcap.writer import CompressionType

from helpers import damaged_bags as damaged

SEEDS = range(40)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return {
        "plain": damaged.mcap_bytes(CompressionType.NONE, crcs=False),
        "every kind": damaged.mcap_bytes(CompressionType.NONE, crcs=True, every=True),
        "zstd": damaged.mcap_bytes(CompressionType.ZSTD, crcs=False),
        "lz4": damaged.mcap_bytes(CompressionType.LZ4, crcs=True),
        "unchunked": damaged.mcap_bytes(CompressionType.NONE, crcs=False, chunked=False),
        "sqlite3": damaged.sqlite_bytes(tmp_path_factory.mktemp("sqlite3")),
    }


@pytest.mark.parametrize("damage", damaged.DAMAGES, ids=lambda d: d.__name__)
@pytest.mark.parametrize("name", ["plain", "every kind", "zstd", "lz4", "unchunked", "sqlite3"])
def test_a_damaged_file_is_read_or_refused(tmp_path, files, name, damage):
    data = files[name]
    heads = damaged.record_heads(data) if name != "sqlite3" else [0, 100, 4096]
    path = tmp_path / "damaged.mcap"
    outcomes = set()
    for seed in SEEDS:
        path.write_bytes(damage(bytearray(data), heads, np.random.default_rng(seed)))
        outcomes.add(damaged.read_or_refuse(path))
    assert "read" in outcomes


def test_every_seventh_prefix_is_read_or_refused(tmp_path):
    path = tmp_path / "cut.mcap"
    outcomes = []
    for content in damaged.every_prefix(damaged.tiny_mcap(), 7):
        path.write_bytes(content)
        outcomes.append(damaged.read_or_refuse(path))
    whole = outcomes.index("read")
    assert set(outcomes[:whole]) == {"refused"}
    assert set(outcomes[whole:]) == {"read"}


def test_every_byte_of_every_record_head_may_be_wrong(tmp_path):
    path = tmp_path / "flipped.mcap"
    outcomes = set()
    for content in damaged.every_head_flip(damaged.tiny_mcap(), range(1, 256, 128)):
        path.write_bytes(content)
        outcomes.add(damaged.read_or_refuse(path))
    assert outcomes == {"read", "refused"}


def test_metadata_with_any_byte_wrong_is_read_or_refused(tmp_path):
    bag = damaged.folder_bag(tmp_path)
    text = (bag / "metadata.yaml").read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(200):
        changed = damaged.flip_anywhere(bytearray(text), [], rng)
        (bag / "metadata.yaml").write_bytes(changed)
        assert damaged.read_or_refuse(bag) in {"read", "refused"}
