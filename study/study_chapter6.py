"""Tables 6.1 and 6.2 of the thesis beside the exact filter on its printed models.

Run: ``python study/study_chapter6.py [--output docs/study_chapter6.md]``.
"""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np
from nav_fusion.chains import (
    ContinuousModel,
    SampledModel,
    heading_chain,
    identified_chain,
    position_chain,
)
from nav_fusion.discretize import exact, first_order
from nav_fusion.noise import AidNoise, AxisNoise
from nav_fusion.schedule import Chain, run_covariance, steady

LATITUDE = SampledModel(0.8208, 0.5819, 17.49, -14.49, 0.1)
MAGNETOMETER = SampledModel(-0.6155, -0.7679, 339.2, 47.59, 0.1)
GYROS = {
    "S1 KVH DSP-1760": (ContinuousModel(-0.004277, 4.314, 587.8, 1e-3), 0.4544, 1.69e-4),
    "S2 Roketsan FOG": (ContinuousModel(0.0001333, -6.574, 685.3, 1e-3), 0.4159, 2.16e-4),
    "S3 LandMark 60": (ContinuousModel(-0.0212, 30.91, 609.7, 1e-3), 0.6683, 1.150e-3),
    "S4 NavChip 3": (ContinuousModel(0.04694, -19.44, 403.8, 1e-2), 0.7128, 5.831e-3),
}
ACCELEROMETERS = {
    "S5 Colibrys MS9002": (ContinuousModel(0.0006629, -0.344, 427.7, 1e-3), 0.8554, 0.1086),
    "S6 Microsystems": (ContinuousModel(0.000524, -1.264, 308.5, 1e-3), 0.8811, 0.1196),
    "S7 LandMark 60": (ContinuousModel(0.0005878, -0.5371, 623.9, 1e-3), 0.8716, 0.1155),
    "S8 NavChip 3": (ContinuousModel(-0.000388, 0.0302, 135.3, 1e-2), 0.3657, 0.0932),
}
SECONDS = 300.0


def excess(chain: Chain, seconds: float) -> float:
    """Largest relative distance of the run's last covariance from the periodic Riccati's."""
    last = run_covariance(chain, seconds).covariance[-1]
    limit = steady(chain)
    return float(np.max(np.abs(np.sqrt(np.diag(last)) / np.sqrt(np.diag(limit)) - 1)))


def position_rows() -> list[str]:
    """Rows of Table 6.1."""
    rows = []
    for name, (sensor, position, velocity) in ACCELEROMETERS.items():
        chain = position_chain(sensor, LATITUDE)
        run = run_covariance(chain, SECONDS)
        rough = run_covariance(position_chain(sensor, LATITUDE, first_order), SECONDS)
        at_50 = round(50 / chain.aid_period_s)
        limit = np.sqrt(np.diag(steady(chain)))
        rows.append(
            f"| {name} | {position} / {velocity} | "
            f"{run.sigma(0)[at_50]:.4f} / {run.sigma(1)[at_50]:.5f} | "
            f"{run.sigma(0)[-1]:.4f} / {run.sigma(1)[-1]:.5f} | "
            f"{limit[0]:.5f} / {limit[1]:.6f} | "
            f"{rough.sigma(0)[-1] / run.sigma(0)[-1] - 1:+.1e} |"
        )
    return rows


def heading_rows() -> list[str]:
    """Rows of Table 6.2."""
    rows = []
    for name, (sensor, printed, walk) in GYROS.items():
        chain = heading_chain(sensor, MAGNETOMETER)
        run = run_covariance(chain, SECONDS)
        limit = math.degrees(math.sqrt(steady(chain)[0, 0]))
        aid = AidNoise(abs(MAGNETOMETER.a0 / MAGNETOMETER.b0))
        plain = identified_chain(
            AxisNoise(math.radians(walk)), aid, 1, math.radians(5.0), aid_rate_hz=10.0
        )
        identified = math.degrees(run_covariance(plain, SECONDS).sigma(0)[-1])
        rows.append(
            f"| {name} | {printed} | {math.degrees(run.sigma(0)[500]):.5f} | "
            f"{math.degrees(run.sigma(0)[-1]):.5f} | {limit:.5f} | {identified:.5f} |"
        )
    return rows


def main() -> None:
    """Write the page."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--output", default="docs/study_chapter6.md")
    options = arguments.parse_args()
    worst = max(excess(heading_chain(s, MAGNETOMETER, exact), 3000.0) for s, *_ in GYROS.values())
    page = [
        "# Chapter 6: position and heading on the thesis's printed models",
        "",
        "Exact discretisation, 1 kHz and 10 Hz, initial errors 5 m and 5 deg, accelerometer in g "
        "times 9.80665, aid an ARMA(1,1) at its own 10 Hz whose state moves by the input that it "
        "shows.  The thesis's sigmas cannot be had from the models that it prints (its Q, R, C, P0 "
        "and durations are not printed); ours stand beside them as they come out.",
        "",
        "## Table 6.1: position m / velocity m/s, 1 sigma, before the fix",
        "",
        "| sensor | thesis | 50 s | 300 s | Riccati | first order, position |",
        "|---|---|---|---|---|---|",
        *position_rows(),
        "",
        "## Table 6.2: heading deg, 1 sigma, before the fix",
        "",
        "| sensor | thesis | 50 s | 300 s | Riccati | Allan's N and a white aid, 300 s |",
        "|---|---|---|---|---|---|",
        *heading_rows(),
        "",
        f"After 3000 s the heading chains' sigmas differ from the periodic Riccati solution by "
        f"{worst:.1e} at the most.",
        "",
    ]
    Path(options.output).parent.mkdir(parents=True, exist_ok=True)
    Path(options.output).write_text("\n".join(page))
    print("\n".join(page))


if __name__ == "__main__":
    main()
