"""``ros2 run imu_noise_id reconcile``: where recording and simulation differ, and why."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from imu_noise_id.commands.console import Parser, check_folder, progress, run, seed, warn

if TYPE_CHECKING:
    from imu_noise_id.model import NoiseModel

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
        help="topic of the recording to use, as for identify",
    )
    return arguments


def given_model(options: argparse.Namespace) -> NoiseModel:
    """Return the model to be checked: a file's, or that of a simulator's recording.

    Raises
    ------
    InputError
        When it cannot be read.
    """
    from imu_noise_id.model_file import load_model

    if options.model is not None:
        return load_model(options.model)
    from imu_noise_id.bags import read_recording
    from imu_noise_id.identify import identify_recording

    return identify_recording(read_recording(options.simulation)).model


def work(options: argparse.Namespace) -> None:
    """Read, reconcile, write."""
    from imu_noise_id.bags import read_recording
    from imu_noise_id.commands.identify import topic_names
    from imu_noise_id.errors import InputError
    from imu_noise_id.files import write_or_keep, write_text
    from imu_noise_id.model_file import save_model
    from imu_noise_id.reconcile import reconcile_recording, reconciliation_tree
    from imu_noise_id.report.reconciliation import channel_sentence, reconciliation_page
    from imu_noise_id.results_file import write_json
    from imu_noise_id.terminal import console, reconciliation_table

    output = Path(options.output)
    check_folder(output)
    model = given_model(options)
    recording = read_recording(options.bag, topic_names(options.topic, options.bag))
    shared = {c.name for c in model.channels} & {c.name for c in recording.channels}
    if not shared:
        names = ", ".join(c.name for c in recording.channels)
        raise InputError(f"{options.bag}: its channels ({names}) are not in the model")
    with progress(len(shared) + 1, "comparing") as advance:
        result = reconcile_recording(recording, model, options.seed, progress=advance)
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
