"""``ros2 run nav_fusion fuse``: IMU and GNSS on an identified noise model, live or from a bag."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

from imu_noise_id.commands.console import Parser, check_folder, progress, run, warn
from imu_noise_id.commands.identify import topic_names
from imu_noise_id.errors import InputError

_EXAMPLES = """\
  ros2 run nav_fusion fuse --bag my_bag --model out/model.yaml --output fused
  ros2 run nav_fusion fuse --bag my_bag --output fused --set "lever_arm_m=[0.1, 0, 0.5]"
  ros2 run nav_fusion fuse --bag my_bag --output fused --topic fix=/ublox/fix
  ros2 run nav_fusion fuse --ros-args -p model_file:=out/model.yaml      live, from /imu/data ...
"""


def parser() -> Parser:
    """Return the command's arguments."""
    arguments = Parser(
        "nav_fusion fuse",
        "Fuse an IMU and a GNSS receiver with a filter that takes its noise from an identified "
        "model: filtered/ (a bag with /odometry/filtered and /gps/filtered), fuse.json and "
        "report.html.  "
        "Without --bag it runs as a live node.",
        _EXAMPLES,
    )
    arguments.add_argument("--bag", metavar="BAG", help="rosbag2 folder or .mcap file")
    arguments.add_argument(
        "--model",
        metavar="MODEL.yaml",
        help="noise model; without one the leading still part is identified, else stated MEMS "
        "values are used",
    )
    arguments.add_argument("--output", metavar="DIR", help="folder for the results")
    arguments.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="settings",
        help="a parameter of the filter, as in config/fuse.yaml",
    )
    arguments.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="[KIND=]TOPIC",
        help="topic to use; KIND is imu, fix, vel or mag; KIND= leaves that sensor out",
    )
    arguments.add_argument("--json", action="store_true", help="print fuse.json on stdout")
    return arguments


def work(options: argparse.Namespace) -> None:
    """Fuse one recording."""
    if not options.bag:
        raise InputError("--bag is missing: without it, only --ros-args may be given (live node)")
    if options.output is None and not options.json:
        raise InputError("--output is missing: name a folder for the results")
    from nav_fusion.settings_text import parameters_from

    parameters = parameters_from(options.settings)
    if options.output is not None:
        check_folder(Path(options.output))
    from imu_noise_id.model_file import load_model
    from imu_noise_id.results_file import json_text

    from nav_fusion.fuse import STEPS, fuse_bag, fuse_tree

    model = None if options.model is None else load_model(options.model)
    names = topic_names(options.topic, options.bag)
    with progress(STEPS + 2, "reading") as done:
        result = fuse_bag(options.bag, model, parameters, names, done)
        if options.output is not None:
            _write(result, options, done)
    if options.json:
        print(json_text(fuse_tree(result)), end="")
    else:
        print(_summary(options, result))
    warn(result.notes)


def _write(result, options: argparse.Namespace, done: Callable[[str], None]) -> None:  # type: ignore[no-untyped-def]  # lazy
    from imu_noise_id.files import write_or_keep, write_text
    from imu_noise_id.report.page import render

    from nav_fusion.fuse import write_result
    from nav_fusion.fuse_report import page_of

    page = render(page_of(result, options.bag))

    def write(folder: Path) -> None:
        write_result(result, folder, done)
        write_text(folder / "report.html", page)

    write_or_keep(write, Path(options.output))


def _summary(options: argparse.Namespace, result) -> str:  # type: ignore[no-untyped-def]  # lazy
    s = result.status
    nis = (
        "-" if s.nis_mean is None else f"{s.nis_mean:.2f} ({s.nis_lower:.2f} to {s.nis_upper:.2f})"
    )
    white = {None: "too few to tell", True: "white", False: "NOT white"}[s.white]
    end = result.solution
    sigma = end.pose_covariance[-1].diagonal() ** 0.5
    written = f"report: {Path(options.output, 'report.html')}"
    return (
        f"{options.bag}: {s.imu_samples} IMU samples; {s.used} fixes used, {s.gated} gated, "
        f"{s.late} late, {s.rejected} rejected\n"
        f"NIS {nis}, innovations {white}; 1 sigma at the end: {sigma[0]:.2f} m east, "
        f"{sigma[1]:.2f} m north, {sigma[2]:.2f} m up, {sigma[5] * 57.29578:.2f} deg heading\n"
        f"{written}"
    )


def main(arguments: list[str] | None = None) -> int:
    """Run the command; without ``--bag`` and with nothing but ROS arguments, the live node."""
    given = sys.argv[1:] if arguments is None else arguments
    if not given or given[0] == "--ros-args":
        from nav_fusion.ros.fuse_node import run_node

        return run_node(given)
    return run(parser(), work, given)
