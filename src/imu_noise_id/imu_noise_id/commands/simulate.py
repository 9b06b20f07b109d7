"""``ros2 run imu_noise_id simulate``: a bag in which a model plays."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imu_noise_id.commands.console import Parser, check_folder, positive, run, seed, warn

if TYPE_CHECKING:
    from imu_noise_id.model import NoiseModel

_EXAMPLES = """\
  ros2 run imu_noise_id simulate --model out/model.yaml --duration 600 --seed 1 --output sim
  ros2 run imu_noise_id identify --bag sim --output out_sim
"""


START_NS = 1_704_067_200_000_000_000
"""First stamp of a simulation, 2024-01-01: a stamp of zero means none in ROS."""


def parser() -> Parser:
    """Return the command's arguments."""
    arguments = Parser(
        "imu_noise_id simulate",
        "Write a bag in which a noise model plays: every channel at its own rate, mean included; "
        "steps, bursts and the temperature come at their recorded times.",
        _EXAMPLES,
    )
    arguments.add_argument(
        "--model", required=True, metavar="MODEL.yaml", help="model of identify, or typed by hand"
    )
    arguments.add_argument(
        "--duration", required=True, type=positive, metavar="S", help="length of the bag, seconds"
    )
    arguments.add_argument(
        "--seed", required=True, type=seed, metavar="N", help="the same seed gives the same bag"
    )
    arguments.add_argument("--output", required=True, metavar="BAG", help="rosbag2 folder to write")
    return arguments


def work(options: argparse.Namespace) -> None:
    """Load, simulate, write."""
    import numpy as np

    from imu_noise_id.bags import write_recording
    from imu_noise_id.errors import InputError
    from imu_noise_id.files import write_or_keep
    from imu_noise_id.model_file import load_model
    from imu_noise_id.simulate import simulate_recording

    check_folder(Path(options.output).parent)
    model = load_model(options.model)
    rng = np.random.default_rng(options.seed)
    try:
        recording = simulate_recording(model, options.duration, rng, START_NS)
    except ValueError as error:
        raise InputError(f"{options.model}: {error}: simulate longer") from error
    write_or_keep(lambda place: write_recording(recording, place), Path(options.output))
    warn([*recording.notes, *_unplayed(model)])
    samples = sum(channel.values.size for channel in recording.channels)
    print(
        f"{options.output}: {len(recording.channels)} channels, {samples} samples, "
        f"{options.duration:g} s"
    )


def _unplayed(model: NoiseModel) -> list[str]:
    """What a hand-typed model lacks for its bag to be like a sensor's."""
    notes = []
    means = [c.mean for c in model.channels if c.name.startswith("linear_acceleration.")]
    if means and not any(means):
        notes.append(
            "linear_acceleration: no mean in the model, so there is no gravity in the bag: for a "
            "level platform give linear_acceleration.z the mean 9.81"
        )
    if model.temperature is None:
        notes += [
            f"{channel.name}: temperature has no course in the model (key 'temperature'), so it "
            "does nothing in the bag"
            for channel in model.channels
            if channel.find("temperature")
        ]
    return notes


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    return run(parser(), work, arguments)
