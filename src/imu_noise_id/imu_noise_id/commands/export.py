"""``ros2 run imu_noise_id export``: a model in another tool's file."""

from __future__ import annotations

import argparse

from imu_noise_id.commands.console import Parser, positive, run, warn

_TARGETS = ("kalibr", "robot_localization", "gtsam", "gazebo")
_EXAMPLES = """\
  ros2 run imu_noise_id export --model out/model.yaml --format kalibr --rate 200 --output imu.yaml
  ros2 run imu_noise_id export --model out/model.yaml --format gazebo --rate 100 --output imu.sdf
"""


def parser() -> Parser:
    """Return the command's arguments."""
    arguments = Parser(
        "imu_noise_id export",
        "Write a noise model as another tool reads it, units and rates converted and stated in "
        "comments.  What that tool cannot hold is named.",
        _EXAMPLES,
    )
    arguments.add_argument(
        "--model", required=True, metavar="MODEL.yaml", help="model of identify, or typed by hand"
    )
    arguments.add_argument("--format", required=True, choices=_TARGETS, help="the other tool")
    arguments.add_argument(
        "--rate",
        required=True,
        type=positive,
        metavar="HZ",
        help="sample rate at which the other tool runs the sensor",
    )
    arguments.add_argument("--output", required=True, metavar="FILE", help="file to write")
    return arguments


def work(options: argparse.Namespace) -> None:
    """Load, convert, write."""
    from imu_noise_id.export import FORMATS
    from imu_noise_id.files import write_text
    from imu_noise_id.model_file import load_model

    exported = FORMATS[options.format](load_model(options.model), options.rate)
    write_text(options.output, exported.text)
    warn(exported.notes)
    print(f"{options.output}: {options.format} at {options.rate:g} Hz")


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    return run(parser(), work, arguments)
