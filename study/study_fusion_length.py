"""Very long runs of the filter: soundness of the covariance, NIS and NEES at the end.

Run: ``python study/study_fusion_length.py``.  Results are appended by line; study_fusion.py makes
the page of them.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from study_fusion import long_run

PLAN = (
    (200_000, range(100, 110)),
    (10_000_000, range(11, 14)),
    (200_000, range(110, 160)),
    (1_000_000, range(200, 206)),
)
"""Steps and seeds, in the order in which they are run."""


def main() -> None:
    """Run what is missing."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--results", type=Path, default=Path("build/study_fusion_length.jsonl"))
    file = arguments.parse_args().results
    lines = file.read_text().splitlines() if file.exists() else []
    done = {(x["steps"], x["seed"]) for x in map(json.loads, lines)}
    file.parent.mkdir(parents=True, exist_ok=True)
    for steps, seeds in PLAN:
        for seed in seeds:
            if (steps, seed) not in done:
                with file.open("a") as out:
                    out.write(json.dumps(asdict(long_run(steps, seed))) + "\n")


if __name__ == "__main__":
    main()
