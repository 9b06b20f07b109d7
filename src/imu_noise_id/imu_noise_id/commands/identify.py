"""``ros2 run imu_noise_id identify``: a noise model of every channel, live or from bags."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from imu_noise_id.commands.console import Parser, check_folder, positive, progress, run, warn
from imu_noise_id.errors import InputError

if TYPE_CHECKING:
    from imu_noise_id.commands.outputs import Job
    from imu_noise_id.topics import TopicNames

_EXAMPLES = """\
  ros2 run imu_noise_id identify --bag my_bag --output out       then open out/report.html
  ros2 run imu_noise_id identify --bag my_bag --last 600 --output out
  ros2 run imu_noise_id identify --bag my_bag --topic imu=/sensors/imu --output out
  ros2 run imu_noise_id identify --bag my_bag --json | python3 -m json.tool
  ros2 run imu_noise_id identify --bag folder_of_bags --output fleet
  ros2 run imu_noise_id identify                                 live, from /imu/data and so on
  ros2 run imu_noise_id identify --ros-args -r /imu/data:=/sensors/imu
"""
_KINDS = ("imu", "mag", "temperature", "fix", "vel")


def parser() -> Parser:
    """Return the command's arguments."""
    arguments = Parser(
        "imu_noise_id identify",
        "Identify the noise of a still IMU, magnetometer and GNSS receiver: every effect with its "
        "95 % interval, as identify.json, model.yaml and report.html.  Without --bag it runs as a "
        "live node on the robot's topics.",
        _EXAMPLES,
    )
    arguments.add_argument(
        "--bag",
        action="extend",
        nargs="+",
        metavar="BAG",
        help="rosbag2 folder or .mcap file; several, or a folder of them: each into DIR/NAME",
    )
    arguments.add_argument("--output", metavar="DIR", help="folder for the results")
    arguments.add_argument(
        "--last", type=positive, metavar="S", help="use only the recording's last S seconds"
    )
    arguments.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="[KIND=]TOPIC",
        help="topic to use, where a bag has several of a type or you mean another; KIND is "
        f"{', '.join(_KINDS)}; KIND= leaves that sensor out",
    )
    arguments.add_argument(
        "--json", action="store_true", help="print identify.json (or fleet.json) on stdout"
    )
    arguments.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="spread many bags over the Dask cluster at this address, e.g. tcp://host:8786",
    )
    return arguments


def topic_names(asked: list[str], bag: str) -> TopicNames:
    """Turn ``KIND=TOPIC`` and bare topics into the reader's choice.

    Raises
    ------
    InputError
        When a kind is unknown, or a bare topic is not in the bag or of no type that is read.
    """
    from imu_noise_id.topics import TopicNames

    chosen: dict[str, str] = {}
    for item in asked:
        kind, equals, topic = item.partition("=")
        if not equals:
            kind, topic = _kind_of(item, bag), item
        if kind not in _KINDS:
            raise InputError(f"--topic {item}: unknown kind '{kind}': one of {', '.join(_KINDS)}")
        if kind in chosen:
            raise InputError(f"--topic {item}: {kind} is already {chosen[kind]!r}: name one topic")
        chosen[kind] = topic
    return TopicNames(**chosen)


def _kind_of(topic: str, bag: str) -> str:
    from imu_noise_id.bags import list_topics, listing
    from imu_noise_id.topics import TYPES

    found = list_topics(bag)
    for info in found:
        if info.name != topic:
            continue
        for kind, types in TYPES.items():
            if info.type in types:
                return kind
        raise InputError(
            f"{bag}: topic {topic} is {info.type}, which is not read; {listing(found)}"
        )
    raise InputError(f"{bag}: no topic {topic}; it holds {listing(found)}")


def jobs_of(options: argparse.Namespace) -> tuple[list[Job], bool]:
    """Return the recordings to identify, and whether they are a fleet.

    Raises
    ------
    InputError
        When a folder holds no bag.
    """
    from imu_noise_id.bag_files import find_bags
    from imu_noise_id.commands.outputs import Job

    given = [Path(bag) for bag in options.bag]
    bags = [found for path in given for found in find_bags(path)]
    fleet = len(given) > 1 or bags != given
    if not bags:
        raise InputError(f"{given[0]}: no bag in this folder: give a rosbag2 folder or .mcap file")
    names: dict[str, int] = {}
    jobs = []
    for bag in bags:
        name = Path(os.path.abspath(bag)).name.removesuffix(".mcap")
        names[name] = names.get(name, 0) + 1
        if names[name] > 1:
            name = f"{name}_{names[name]}"
        output = "" if options.output is None else str(Path(options.output, name if fleet else ""))
        topics = topic_names(options.topic, str(bag))
        jobs.append(Job(name, str(bag), output, topics, options.last))
    return jobs, fleet


def work(options: argparse.Namespace) -> int:
    """Identify one recording or many."""
    if not options.bag:
        raise InputError("--bag is missing: without it, only --ros-args may be given (live node)")
    if options.output is None and not options.json:
        raise InputError("--output is missing: name a folder for the results")
    if options.output is not None:
        check_folder(Path(options.output))
    jobs, fleet = jobs_of(options)
    if fleet:
        return _work_fleet(jobs, options)
    return _work_one(jobs[0], options)


def _work_one(job: Job, options: argparse.Namespace) -> int:
    from imu_noise_id.commands.outputs import read_job, write_identification
    from imu_noise_id.identify import identify_recording
    from imu_noise_id.results_file import identification_tree, json_text

    with progress(1, f"reading {job.name}"):
        recording = read_job(job)
    with progress(len(recording.channels) + 1, "identifying") as advance:
        identification = identify_recording(recording, workers=2, done=advance)
        if options.output is not None:
            write_identification(identification, job.output)
    if options.json:
        print(json_text(identification_tree(identification)), end="")
        return 0
    from imu_noise_id.terminal import console, model_table

    console().print(model_table(identification.model))
    warn([*identification.recording.notes, *identification.notes])
    for result in identification.channels:
        said = (*result.channel.quality.notes, *result.notes)
        warn([f"{result.channel.name}: {note}" for note in said])
    print(f"report: {Path(job.output, 'report.html')}")
    return 0


def _work_fleet(jobs: list[Job], options: argparse.Namespace) -> int:
    from imu_noise_id.commands.outputs import identify_fleet
    from imu_noise_id.results_file import fleet_tree, json_text, write_json
    from imu_noise_id.terminal import console, fleet_table

    if options.output is None:
        raise InputError("--output is missing: many bags need a folder for their results")
    with progress(len(jobs), f"{len(jobs)} recordings") as advance:
        units = identify_fleet(jobs, options.scheduler, advance)
    tree = fleet_tree(units)
    write_json(tree, Path(options.output, "fleet.json"))
    if options.json:
        print(json_text(tree), end="")
    else:
        console().print(fleet_table(tree))
        print(f"fleet: {Path(options.output, 'fleet.json')}")
    failed = [unit for unit in units if unit.model is None]
    if failed:
        names = "; ".join(unit.error for unit in failed)
        raise InputError(f"{len(failed)} of {len(units)} bags not identified: {names}")
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Run the command: with a bag here, without one as the live node."""
    import sys

    given = sys.argv[1:] if arguments is None else arguments
    if not given or given[0] == "--ros-args":
        return run(parser(), lambda options: _live(given), [])
    return run(parser(), work, given)


def _live(ros_arguments: list[str]) -> int:
    from imu_noise_id.ros.identify_node import run_node

    return run_node(ros_arguments) or 0
