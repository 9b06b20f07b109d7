"""``ros2 run nav_fusion play``: a recording on its topics, in time, with ``/clock``."""

from __future__ import annotations

import argparse
import sys

from imu_noise_id.commands.console import Parser, positive, run

_EXAMPLES = """\
  ros2 run nav_fusion play --bag my_bag
  ros2 run nav_fusion play --bag my_bag --rate 10 --topics /imu/data /gps/fix
  ros2 run nav_fusion play --bag my_bag --loop --ros-args -r /imu/data:=/sensors/imu
"""


def parser() -> Parser:
    """Return the command's arguments."""
    arguments = Parser(
        "nav_fusion play",
        "Publish a recording on its topics, as it was received, with /clock.  The bytes of the bag "
        "go out as they are; it ends when reliable subscribers have everything.",
        _EXAMPLES,
    )
    arguments.add_argument(
        "--bag", required=True, metavar="BAG", help="rosbag2 folder or .mcap file"
    )
    arguments.add_argument(
        "--rate", type=positive, default=1.0, metavar="X", help="times as fast as recorded (1)"
    )
    arguments.add_argument("--loop", action="store_true", help="start again at the end")
    arguments.add_argument(
        "--topics", nargs="+", default=[], metavar="TOPIC", help="only these topics (all)"
    )
    arguments.add_argument(
        "--wait",
        type=positive,
        default=2.0,
        metavar="S",
        help="at the start wait so long for every topic to have a subscriber (2)",
    )
    return arguments


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    given = sys.argv[1:] if arguments is None else arguments
    at = given.index("--ros-args") if "--ros-args" in given else len(given)

    def work(options: argparse.Namespace) -> None:
        from nav_fusion.ros.play_node import run_play

        played = run_play(
            options.bag, options.rate, options.loop, options.topics, options.wait, given[at:]
        )
        late = f", {played.late} late by up to {played.latest_s * 1e3:.1f} ms" * bool(played.late)
        print(f"{options.bag}: {played.messages} messages played{late}")

    return run(parser(), work, given[:at])
