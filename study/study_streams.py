"""How often the interval of a white noise holds while drivers and clocks do their worst.

Each fault of ``test/helpers/bad_streams.py`` is done to 20 s of an IMU at 1 kHz whose six axes have
white noise of known deviation, as often as ``--runs`` says; the table gives how many of the 95 %
intervals hold the truth (with the binomial standard error), the mean error in standard errors, and
what other effects were named.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))

from imu_noise_id.live import identify_columns

from helpers import bad_streams as bad


def main() -> None:
    """Print the table."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--runs", type=int, default=20)
    arguments.add_argument("--count", type=int, default=20_000)
    options = arguments.parse_args()
    print("| fault | intervals that hold | mean error / SE | other effects (of axes) |")
    print("|---|---|---|---|")
    for number, fault in enumerate(bad.HARMLESS):
        errors, named = [], Counter[str]()
        for run in range(options.runs):
            rng = np.random.default_rng([number, run])
            model = identify_columns([fault(bad.still(rng, options.count), rng).columns()]).model
            errors.append(bad.errors(model))
            named.update(e.name for c in model.channels for e in c.effects)
        z = np.concatenate(errors)
        axes = 6 * options.runs
        held = float(np.mean(np.abs(z) < 1.96))
        spread = np.sqrt(0.95 * 0.05 / z.size)
        others = ", ".join(f"{n} {c}" for n, c in named.items() if n != "white_noise") or "none"
        print(
            f"| {fault.__name__.replace('_', ' ')} | {held:.3f} ± {spread:.3f} ({z.size} of {axes})"
            f" | {z.mean():+.2f} | {others} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
