"""Tails of reconciliation's battery on white records: the constants of ``reconcile/null.py``.

Prints, for each statistic, the mean excess over its 90 % point with its standard error, and the
slope from there to one in 1000, by length and sample time.

    python study/study_null.py [--simulations 4000]
"""

from __future__ import annotations

import argparse

import numpy as np
from imu_noise_id.reconcile.battery import NAMES
from imu_noise_id.reconcile.null import EXCESS_NATS, TAIL_FROM, simulate_null

RECORDS = ((30_000, 0.005), (36_000, 0.1), (120_000, 0.005))
"""Samples and sample time, s."""


def main() -> None:
    """Simulate and print."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--simulations", type=int, default=4000)
    simulations = arguments.parse_args().simulations
    print("| statistic | samples | mean excess, nats | slope to 1 in 1000 | in use |")
    print("|---|---|---|---|---|")
    for samples, sample_time_s in RECORDS:
        nats = simulate_null(samples, sample_time_s, 2, simulations).nats
        for name, column in zip(NAMES, nats.T, strict=True):
            start, far = np.quantile(column, (TAIL_FROM, 0.999))
            over = column[column > start] - start
            error = over.std(ddof=1) / np.sqrt(over.size)
            slope = (far - start) / np.log(1000.0 * (1.0 - TAIL_FROM))
            print(
                f"| {name} | {samples} | {over.mean():.3f} ({error:.3f}) | {slope:.3f} "
                f"| {EXCESS_NATS[name]} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
