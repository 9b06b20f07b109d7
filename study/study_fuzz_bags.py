"""Read a hundred thousand damaged bags: each is read as far as it is whole, or refused in a line.

Prints the counts, the slowest read and the growth of the process.  Whatever else happens is printed
with the seed that makes it again (``--only SEED``) and ends the run with status 1.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))

from helpers import damaged_bags as damaged

GROWTH_LIMIT_MB = 400.0
JUDGED = 11
"""Of so many bags, one's stamps and motion are looked into too, which takes most of the time."""


def sources(folder: Path) -> list[tuple[str, bytes, list[int], str]]:
    """Return name, bytes, record heads and suffix of the bags to damage."""
    made = [
        ("plain", damaged.mcap_bytes(CompressionType.NONE, crcs=False), ".mcap"),
        ("all kinds", damaged.mcap_bytes(CompressionType.NONE, False, every=True), ".mcap"),
        ("checksums", damaged.mcap_bytes(CompressionType.NONE, crcs=True), ".mcap"),
        ("zstd", damaged.mcap_bytes(CompressionType.ZSTD, crcs=False), ".mcap"),
        ("lz4", damaged.mcap_bytes(CompressionType.LZ4, crcs=False), ".mcap"),
        ("unchunked", damaged.mcap_bytes(CompressionType.NONE, False, chunked=False), ".mcap"),
        ("sqlite3", damaged.sqlite_bytes(folder), ".db3"),
    ]
    return [
        (name, data, damaged.record_heads(data) if suffix == ".mcap" else [0, 100, 4096], suffix)
        for name, data, suffix in made
    ]


def one(seed: int, bags: list[tuple[str, bytes, list[int], str]], folder: Path) -> tuple[str, str]:
    """Damage a bag by the seed's way and read it."""
    rng = np.random.default_rng(seed)
    name, data, heads, suffix = bags[seed % len(bags)]
    damage = damaged.DAMAGES[seed // len(bags) % len(damaged.DAMAGES)]
    path = folder / f"damaged{suffix}"
    path.write_bytes(damage(bytearray(data), heads, rng))
    return f"{name}, {damage.__name__}", damaged.read_or_refuse(path, judged=seed % JUDGED == 0)


def systematic(folder: Path) -> int:
    """Cut a tiny file at every byte, change every byte of its record heads in every way."""
    data = damaged.tiny_mcap()
    path = folder / "tiny.mcap"
    outcome: Counter[str] = Counter()
    for way, files in (
        ("cut", damaged.every_prefix(data)),
        ("head flip", damaged.every_head_flip(data, range(1, 256))),
    ):
        for content in files:
            path.write_bytes(content)
            outcome[f"{way} {damaged.read_or_refuse(path)}"] += 1
    print("systematic:", ", ".join(f"{count} {way}" for way, count in sorted(outcome.items())))
    return sum(outcome.values())


def main() -> int:
    """Run the campaign."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--count", type=int, default=100_000)
    arguments.add_argument("--first", type=int, default=0)
    arguments.add_argument("--only", type=int)
    options = arguments.parse_args()
    warnings.simplefilter("error")
    seeds = range(options.first, options.first + options.count)
    if options.only is not None:
        seeds = range(options.only, options.only + 1)
    shared_memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=shared_memory if shared_memory.is_dir() else None) as name:
        if options.only is None and options.first == 0:
            systematic(Path(name))
        return campaign(seeds, Path(name))


def campaign(seeds: range, folder: Path) -> int:
    """Read every seed's bag, print what happened."""
    bags = sources(folder)
    outcome: Counter[tuple[str, str]] = Counter()
    slowest = (0.0, -1)
    failed = []
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for seed in seeds:
        begin = time.perf_counter()
        try:
            outcome[one(seed, bags, folder)] += 1
        except Exception as error:  # what must not happen is what is looked for
            failed.append(seed)
            print(f"seed {seed}: {type(error).__name__}: {error}")
            if len(seeds) == 1:
                raise
        if (seed + 1 - seeds.start) % 5000 == 0:
            print(f"{seed + 1 - seeds.start} bags read, {len(failed)} failed", flush=True)
        slowest = max(slowest, (time.perf_counter() - begin, seed))
    growth = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    for way, count in sorted(outcome.items()):
        print(f"{way[0]:28s} {way[1]:8s} {count}")
    print(
        f"{len(seeds)} bags: {sum(c for w, c in outcome.items() if w[1] == 'read')} read, "
        f"{sum(c for w, c in outcome.items() if w[1] == 'refused')} refused, {len(failed)} failed; "
        f"slowest {slowest[0]:.2f} s (seed {slowest[1]}), memory grew by {growth:.0f} MB"
    )
    return int(bool(failed) or growth > GROWTH_LIMIT_MB)


if __name__ == "__main__":
    sys.exit(main())
