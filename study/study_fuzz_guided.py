"""Fuzz the readers guided by their own coverage: inputs that reach new lines are changed further.

Beside the seeded campaigns (study_fuzz_bags.py, study_fuzz_files.py), whose inputs do not depend on
the code.  Needs atheris, which is no part of the workspace (``pip install atheris``):

    source env.sh
    .venv/bin/python study/study_fuzz_guided.py --reader mcap --minutes 5 --corpus DIR

The readers: an MCAP file, a folder's metadata.yaml (a whole MCAP file beside it), the bytes of
messages, a model file.  Each input is read or refused in one line that names the file; anything
else stops the run and is kept as ``crash-*`` in the corpus folder.  Those, and the smallest set of
inputs that reaches all that was reached, are in ``test/faults/seeds``.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))

# compiled code cannot be looked into: imported as it is
import imu_noise_id.allan
import imu_noise_id.phase
import imu_noise_id.pyramid

with atheris.instrument_imports(include=["imu_noise_id"]):
    import imu_noise_id.bag_files
    import imu_noise_id.bags
    import imu_noise_id.model_file  # noqa: F401

    from helpers import fuzz_targets as targets

MEMORY_MB = 2000


def main() -> None:
    """Fuzz one reader for some minutes."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--reader", choices=targets.READERS, required=True)
    arguments.add_argument("--minutes", type=float, default=5.0)
    arguments.add_argument("--corpus", type=Path, required=True)
    options = arguments.parse_args()
    options.corpus.mkdir(parents=True, exist_ok=True)
    for k, seed in enumerate(targets.starting_points(options.reader)):
        (options.corpus / f"start-{k}").write_bytes(seed)
    shared_memory = Path("/dev/shm")
    place = shared_memory if shared_memory.is_dir() else None
    with tempfile.TemporaryDirectory(dir=place) as name:
        attempt: Callable[[bytes], str] = targets.reader(options.reader, Path(name))

        def one(data: bytes) -> None:
            attempt(data)

        flags = [
            f"-max_total_time={round(60 * options.minutes)}",
            f"-artifact_prefix={options.corpus}{os.sep}",
            f"-rss_limit_mb={MEMORY_MB}",
            *("-timeout=20", "-max_len=8192", "-print_final_stats=1", "-seed=7"),
            str(options.corpus),
        ]
        atheris.Setup([sys.argv[0], *flags], one)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
