"""How often the interval of a white noise holds while drivers and clocks do their worst.

Each fault of ``test/helpers/bad_streams.py`` is done to 20 s of an IMU at 1 kHz whose six axes have
white noise of known deviation, as often as ``--runs`` says; the table gives how many of the 95 %
intervals hold the truth (with the 95 % Wilson interval), the mean and the standard deviation of the
error in standard errors, and what other effects were named.  A run is written as a line as it
ends; what is in ``--results`` already is not run again.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))

from imu_noise_id.live import identify_columns
from study_reconcile import wilson

from helpers import bad_streams as bad

AXES = 6


def one_run(number: int, run: int, count: int) -> dict[str, object]:
    """Errors in standard errors of the axes that have white noise, and the effects named."""
    fault, rng = bad.HARMLESS[number], np.random.default_rng([number, run])
    model = identify_columns([fault(bad.still(rng, count), rng).columns()]).model
    named = Counter(e.name for c in model.channels for e in c.effects)
    errors = bad.errors(model).tolist()
    return {"fault": fault.__name__, "run": run, "errors": errors, "named": dict(named)}


def row(fault: str, runs: list[dict[str, object]]) -> str:
    """A line of the table."""
    z = np.concatenate([run["errors"] for run in runs])
    named = Counter[str]()
    for run in runs:
        named.update(run["named"])
    others = ", ".join(f"{n} {c}" for n, c in named.items() if n != "white_noise") or "none"
    held = wilson(int(np.count_nonzero(np.abs(z) < 1.96)), z.size)
    return (
        f"| {fault.replace('_', ' ')} | {len(runs)} | {z.size} of {AXES * len(runs)} | {held} | "
        f"{z.mean():+.2f} | {z.std():.2f} | {others} |"
    )


def main() -> None:
    """Run what is missing and print the table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--runs", type=int, default=20)
    arguments.add_argument("--count", type=int, default=20_000)
    arguments.add_argument("--results", type=Path, default=Path("build/study_streams.jsonl"))
    options = arguments.parse_args()
    lines = options.results.read_text().splitlines() if options.results.exists() else []
    results = [json.loads(line) for line in lines]
    done = {(r["fault"], r["run"]) for r in results}
    with options.results.open("a", encoding="utf-8") as file:
        for run in range(options.runs):
            for number, fault in enumerate(bad.HARMLESS):
                if (fault.__name__, run) not in done:
                    results.append(one_run(number, run, options.count))
                    print(json.dumps(results[-1]), file=file, flush=True)
    print("| fault | runs | axes | intervals that hold | mean error / SE | sd | other effects |")
    print("|---|---|---|---|---|---|---|")
    for fault in bad.HARMLESS:
        print(row(fault.__name__, [r for r in results if r["fault"] == fault.__name__]))


if __name__ == "__main__":
    main()
