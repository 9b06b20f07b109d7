"""``ros2 run imu_noise_id reconcile``: where recording and simulation differ, and why."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imu_noise_id.commands.console import Parser, check_folder, progress, run, seed, warn

if TYPE_CHECKING:
    from imu_noise_id.model import NoiseModel
    from imu_noise_id.recording import Recording

_EXAMPLES = """\
  ros2 run imu_noise_id reconcile --bag my_bag --model old/model.yaml --output out
  ros2 run imu_noise_id reconcile --bag my_bag --simulation gazebo_bag --output out
  ros2 run imu_noise_id export --model out/model.yaml --format gazebo --rate 100 --output imu.sdf
"""


def parser() -> Parser:
    """Return the command's arguments."""
    arguments = Parser(
        "imu_noise_id reconcile",
        "Compare a recording with a noise model, or with a simulator's recording: say where they "
        "differ, name the effect that is missing, add it, and show the gap shrink on data that "
        "no fit has seen.  Writes reconcile.json, the mended model.yaml and report.html.",
        _EXAMPLES,
    )
    arguments.add_argument("--bag", required=True, metavar="BAG", help="the real recording")
    given = arguments.add_mutually_exclusive_group(required=True)
    given.add_argument("--model", metavar="MODEL.yaml", help="model to check and to mend")
    given.add_argument(
        "--simulation", metavar="BAG", help="a simulator's recording in place of a model"
    )
    arguments.add_argument("--output", required=True, metavar="DIR", help="folder for the results")
    arguments.add_argument(
        "--seed", type=seed, default=0, metavar="N", help="same seed, same answer (default 0)"
    )
    arguments.add_argument(
        "--topic",
        action="append",
        default=[],
        metavar="[KIND=]TOPIC",
        help="topic to use, as for identify; of the simulator's recording too, if it has it",
    )
    return arguments


def given_model(options: argparse.Namespace) -> tuple[NoiseModel, Recording | None]:
    """Return the model to be checked: a file's, or that of a simulator's recording, and this.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    from imu_noise_id.model_file import load_model

    if options.model is not None:
        return load_model(options.model), None
    from imu_noise_id.identify import identify_recording

    simulation = _read(options.simulation, options)
    warn([f"{options.simulation}: {note}" for note in simulation.notes])
    return identify_recording(simulation).model, simulation


def _read(bag: str, options: argparse.Namespace) -> Recording:
    """Read one of the bags, by the topics asked for that it has or that none has."""
    from imu_noise_id.bags import list_topics, read_recording
    from imu_noise_id.commands.identify import topic_names

    bags = [b for b in (options.bag, options.simulation) if b]
    held = {b: {topic.name for topic in list_topics(b)} for b in bags} if options.topic else {}

    def meant(topic: str) -> bool:
        return topic in held[bag] or not any(topic in names for names in held.values())

    asked = [item for item in options.topic if meant(item.rpartition("=")[2])]
    return read_recording(bag, topic_names(asked, bag))


def work(options: argparse.Namespace) -> None:
    """Read, reconcile, write."""
    from imu_noise_id.errors import InputError
    from imu_noise_id.files import write_or_keep, write_text
    from imu_noise_id.model_file import save_model
    from imu_noise_id.reconcile import reconcile_recording, reconciliation_tree
    from imu_noise_id.report.reconciliation import channel_sentence, reconciliation_page
    from imu_noise_id.results_file import write_json
    from imu_noise_id.terminal import console, reconciliation_table

    output = Path(options.output)
    check_folder(output)
    model, simulation = given_model(options)
    recording = _read(options.bag, options)
    shared = {c.name for c in model.channels} & {c.name for c in recording.channels}
    if not shared:
        names = ", ".join(c.name for c in recording.channels)
        raise InputError(f"{options.bag}: its channels ({names}) are not in the model")
    with progress(len(shared) + 1, "comparing") as advance:
        result = reconcile_recording(
            recording, model, options.seed, progress=advance, simulation=simulation
        )
        advance("writing the report")
        page = reconciliation_page(recording, model, result)

    def write(folder: Path) -> None:
        write_json(reconciliation_tree(result), folder / "reconcile.json")
        save_model(result.model, folder / "model.yaml")
        write_text(folder / "report.html", page)

    write_or_keep(write, output)
    console().print(reconciliation_table(result))
    for channel in result.channels:
        if channel.verdict != "agrees":
            print(channel_sentence(channel))
    warn([*recording.notes, *result.notes])
    print(f"report: {output / 'report.html'}")


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    return run(parser(), work, arguments)
