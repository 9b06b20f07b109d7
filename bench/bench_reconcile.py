"""Reconciliation: cost cold and with the null cached, and how it grows with length.

Six channels at 200 Hz of a model with three effects per channel, one of them hidden.  The cold run
simulates the null with an empty cache folder; the warm one reads it.  Wall clock and processor time
of the core (reading and report are the command's).  Writes ``reconcile.json`` and ``reconcile.md``
into ``--output``.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from pathlib import Path

import numpy as np
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import reconcile_recording
from imu_noise_id.recording import unit_of
from imu_noise_id.simulate import simulate_recording

RATE_HZ = 200.0
NAMES = tuple(
    f"{kind}.{axis}" for kind in ("angular_velocity", "linear_acceleration") for axis in "xyz"
)
EFFECTS: dict[str, dict[str, float | str]] = {
    "white_noise": {"density": 1e-3},
    "gauss_markov": {"sigma": 3e-4, "correlation_time_s": 40.0},
}
LINE: dict[str, float | str] = {"frequency_hz": 43.0, "amplitude": 2e-3}


def model(with_line: bool) -> NoiseModel:
    """Six channels; a vibration on the first where asked for."""
    channels = []
    for name in NAMES:
        effects = [typed_effect(effect, name, values) for effect, values in EFFECTS.items()]
        if with_line and name == NAMES[0]:
            effects.append(typed_effect("periodic", name, LINE))
        channels.append(
            ChannelModel(name, "/imu/data", unit_of(name), RATE_HZ, 0.0, tuple(effects))
        )
    return NoiseModel(tuple(channels))


def timed(minutes: float) -> dict[str, float]:
    """Cold and warm seconds of one length."""
    recording = simulate_recording(model(True), 60.0 * minutes, np.random.default_rng(1))
    out = {"minutes": minutes}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        for label in ("cold", "warm"):
            wall, cpu = time.perf_counter(), time.process_time()
            result = reconcile_recording(recording, model(False))
            out[f"{label}_s"] = time.perf_counter() - wall
            out[f"{label}_cpu_s"] = time.process_time() - cpu
            assert result.channels[0].steps[0].effect.name == "periodic"
    return out


def table(rows: list[dict[str, float]]) -> str:
    """Markdown."""
    lines = [
        "## Reconciliation, 6 channels at 200 Hz\n",
        "| minutes | cold s | cold CPU s | null cached s | null cached CPU s |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        cells = (row[k] for k in ("cold_s", "cold_cpu_s", "warm_s", "warm_cpu_s"))
        lines.append(f"| {row['minutes']:g} | " + " | ".join(f"{c:.1f}" for c in cells) + " |")
    return "\n".join((*lines, ""))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    parser.add_argument("--minutes", type=float, nargs="+", default=[2.5, 5.0, 10.0])
    options = parser.parse_args()
    rows = [timed(minutes) for minutes in options.minutes]
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / "reconcile.json").write_text(json.dumps(rows, indent=1))
    (options.output / "reconcile.md").write_text(table(rows))
    print(table(rows))


if __name__ == "__main__":
    main()
