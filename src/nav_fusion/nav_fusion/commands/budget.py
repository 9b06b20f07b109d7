"""``ros2 run nav_fusion budget``: what a sensor's noise costs, effect by effect."""

from __future__ import annotations

import argparse
from pathlib import Path

from imu_noise_id.commands.console import Parser, check_folder, positive, progress, run, warn
from imu_noise_id.errors import InputError

SHORTEST_S, LONGEST_S = 1.0, 86_400.0
_EXAMPLES = """\
  ros2 run nav_fusion budget --model out/model.yaml --output budget
  ros2 run nav_fusion budget --model cheap.yaml good.yaml --output budget --duration 600
  ros2 run nav_fusion budget --model out/model.yaml --output budget --vibration 2 --temperature 20
"""


def parser() -> Parser:
    """Return the command's arguments."""
    arguments = Parser(
        "nav_fusion budget",
        "Position, velocity and heading error that noise models cause, free and aided by fixes, "
        "and each effect's share of it: budget.json and report.html.",
        _EXAMPLES,
    )
    arguments.add_argument(
        "--model",
        nargs="+",
        action="extend",
        required=True,
        metavar="MODEL.yaml",
        help="noise models, side by side",
    )
    arguments.add_argument("--output", required=True, metavar="DIR", help="folder for the results")
    arguments.add_argument("--duration", type=positive, default=300.0, metavar="S", help="(300)")
    arguments.add_argument(
        "--temperature",
        type=float,
        default=10.0,
        metavar="K",
        help="change that a temperature effect is multiplied with (10)",
    )
    arguments.add_argument(
        "--vibration",
        type=float,
        default=0.0,
        metavar="M_S2",
        help="root mean square of vibration on the accelerometers, m/s^2 (0)",
    )
    arguments.add_argument(
        "--turn-on-gyro",
        type=float,
        default=0.01,
        metavar="RAD_S",
        help="standard deviation of the gyros' constant bias of a day (0.01)",
    )
    arguments.add_argument(
        "--turn-on-accel",
        type=float,
        default=0.2,
        metavar="M_S2",
        help="the same of the accelerometers (0.2)",
    )
    return arguments


def work(options: argparse.Namespace) -> None:
    """Compute and write the budgets."""
    for name in ("temperature", "vibration", "turn_on_gyro", "turn_on_accel"):
        if not 0.0 <= getattr(options, name) < float("inf"):
            raise InputError(f"--{name.replace('_', '-')}: a finite number from 0 is needed")
    if not SHORTEST_S <= options.duration <= LONGEST_S:
        raise InputError(
            f"--duration {options.duration:g}: {SHORTEST_S:g} to {LONGEST_S:g} s can be computed"
        )
    folder = Path(options.output)
    check_folder(folder)
    from imu_noise_id.files import write_or_keep, write_text
    from imu_noise_id.model_file import load_model
    from imu_noise_id.report.page import render
    from imu_noise_id.results_file import write_json

    from nav_fusion.budget import Environment, budget_of, budget_tree
    from nav_fusion.budget_report import page_of
    from nav_fusion.noise import TurnOn

    environment = Environment(
        TurnOn(options.turn_on_gyro, options.turn_on_accel), options.temperature, options.vibration
    )
    budgets = []
    with progress(len(options.model), "budget") as done:
        for path in options.model:
            budgets.append(budget_of(load_model(path), environment, options.duration, name=path))
            done(path)
    page = render(page_of(budgets))

    def write(place: Path) -> None:
        write_json(budget_tree(budgets), place / "budget.json")
        write_text(place / "report.html", page)

    write_or_keep(write, folder)
    for budget in budgets:
        for s in budget.scenarios:
            print(
                f"{budget.model}, {s.name}: after {s.time_s[-1]:.0f} s "
                f"{s.position_sigma_m[-1]:.3g} m, {s.velocity_sigma_m_s[-1]:.3g} m/s, "
                f"{s.heading_sigma_rad[-1] * 57.29578:.3g} deg (1 sigma)"
            )
        warn(budget.notes)


def main(arguments: list[str] | None = None) -> int:
    """Run the command."""
    return run(parser(), work, arguments)
