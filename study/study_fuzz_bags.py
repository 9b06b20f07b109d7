"""Read more than a hundred thousand damaged bags: each is read as far as it is whole, or refused.

Four families: every prefix of small files; every single byte of their record heads changed in every
way; seeded damage to larger files; seeded damage to a folder's metadata.yaml, with files outside
the folder that must not be opened.  Each input has a number of its family (``--family FAMILY
--only NUMBER`` makes it again), a limit of time and one of memory.  What must not happen is printed
and ends the run with status 1.
"""

from __future__ import annotations

import argparse
import functools
import os
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))

import campaign

from helpers import damaged_bags as damaged

JUDGED = 11
"""Of so many bags, one's stamps and motion are looked into too, which takes most of the time."""
NONE, ZSTD, LZ4 = CompressionType.NONE, CompressionType.ZSTD, CompressionType.LZ4


@dataclass(frozen=True)
class Family:
    """Inputs of one kind, numbered from 0."""

    name: str
    count: int
    attempt: campaign.Attempt


def small_files(folder: Path) -> dict[str, bytes]:
    """Files small enough to be damaged in every place."""
    return {
        "plain": damaged.tiny_mcap(),
        "zstd": damaged.tiny_mcap(ZSTD, crcs=True),
        "lz4": damaged.tiny_mcap(LZ4),
        "unchunked": damaged.tiny_mcap(chunked=False),
    }


def prefixes(folder: Path) -> Family:
    """Every small file cut at every byte."""
    cuts = [(name, data, end) for name, data in small_files(folder).items()
            for end in range(len(data))]  # fmt: skip

    def attempt(number: int) -> str:
        name, data, end = cuts[number]
        path = folder / "cut.mcap"
        path.write_bytes(data[:end])
        return f"{name}: {damaged.read_or_refuse(path)}"

    return Family("prefix", len(cuts), attempt)


def head_flips(folder: Path) -> Family:
    """Every byte of every record head (opcode and length) of the small files, in all 255 ways."""
    places = [(name, data, head + k) for name, data in small_files(folder).items()
              for head in damaged.record_heads(data) for k in range(9)]  # fmt: skip

    def attempt(number: int) -> str:
        name, data, at = places[number // 255]
        path = folder / "flipped.mcap"
        changed = bytes([data[at] ^ (1 + number % 255)])
        path.write_bytes(data[:at] + changed + data[at + 1 :])
        return f"{name}: {damaged.read_or_refuse(path)}"

    return Family("head", 255 * len(places), attempt)


def seeded(folder: Path, count: int) -> Family:
    """Bags of every kind, damaged as a seed says."""
    made = [
        ("plain", damaged.mcap_bytes(NONE, crcs=False), ".mcap"),
        ("all kinds", damaged.mcap_bytes(NONE, False, every=True), ".mcap"),
        ("checksums", damaged.mcap_bytes(NONE, crcs=True), ".mcap"),
        ("zstd", damaged.mcap_bytes(ZSTD, crcs=False), ".mcap"),
        ("lz4", damaged.mcap_bytes(LZ4, crcs=False), ".mcap"),
        ("unchunked", damaged.mcap_bytes(NONE, False, chunked=False), ".mcap"),
        ("sqlite3", damaged.sqlite_bytes(folder), ".db3"),
    ]
    heads = [damaged.record_heads(d) if s == ".mcap" else [0, 100, 4096] for _, d, s in made]

    def attempt(number: int) -> str:
        rng = np.random.default_rng(number)
        name, data, suffix = made[number % len(made)]
        damage = damaged.DAMAGES[number // len(made) % len(damaged.DAMAGES)]
        path = folder / f"damaged{suffix}"
        path.write_bytes(damage(bytearray(data), heads[number % len(made)], rng))
        outcome = damaged.read_or_refuse(path, judged=number % JUDGED == 0)
        return f"{name}, {damage.__name__}: {outcome}"

    return Family("seeded", count, attempt)


def metadata(folder: Path, count: int) -> Family:
    """metadata.yaml of folders with MCAP or sqlite3, damaged as a seed says."""
    (folder / "folders").mkdir()
    bags = damaged.folders_with_traps(folder / "folders")
    texts = [(bag / "metadata.yaml").read_bytes() for bag in bags]
    watch = damaged.OpenedOutside(folder)

    def attempt(number: int) -> str:
        rng = np.random.default_rng(number)
        bag, text = bags[number % len(bags)], texts[number % len(bags)]
        damage = damaged.METADATA_DAMAGES[number // len(bags) % len(damaged.METADATA_DAMAGES)]
        (bag / "metadata.yaml").write_bytes(damage(bytearray(text), [0], rng))
        with watch.only(bag):
            outcome = damaged.read_or_refuse(bag, judged=False)
        return f"{bag.name}, {damage.__name__}: {outcome}"

    return Family("metadata", count, attempt)


def main() -> int:
    """Run the campaign."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seeded", type=int, default=100_000)
    arguments.add_argument("--metadata", type=int, default=20_000)
    arguments.add_argument("--family")
    arguments.add_argument("--only", type=int)
    options = arguments.parse_args()
    warnings.simplefilter("error")
    makers: list[Callable[[Path], Family]] = [
        prefixes,
        head_flips,
        functools.partial(seeded, count=options.seeded),
        functools.partial(metadata, count=options.metadata),
    ]
    failed = tried = 0
    shared_memory = Path("/dev/shm")
    for make in makers:
        place = shared_memory if shared_memory.is_dir() else None
        with tempfile.TemporaryDirectory(dir=place) as name:
            family = make(Path(name))
            if options.family not in (None, family.name):
                continue
            if options.only is not None:
                print(family.attempt(options.only))
                continue
            print(f"{family.name}: {family.count} inputs, numbers 0 to {family.count - 1}")
            tally = campaign.run(family.attempt, range(family.count))
            for outcome, count in sorted(tally.outcomes.items()):
                print(f"  {outcome:36s} {count}")
            print(f"{family.name}: {tally.summary()}", flush=True)
            tried, failed = tried + tally.tried, failed + len(tally.failures)
    print(f"together {tried} inputs, {failed} failed (pid {os.getpid()})")
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
