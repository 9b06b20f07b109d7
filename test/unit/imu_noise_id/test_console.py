"""What goes wrong in a command becomes one line and a status, never a traceback."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable

import pytest
from imu_noise_id.commands.console import Parser, positive, progress, run, seed
from imu_noise_id.errors import InputError


def _run(work: Callable[[argparse.Namespace], int | None], *arguments: str) -> int:
    parser = Parser("pkg command", "Does something.", "  ros2 run pkg command --n 1\n")
    parser.add_argument("--n", type=positive)
    return run(parser, work, list(arguments))


def _raiser(error: BaseException) -> Callable[[argparse.Namespace], int | None]:
    def work(options: argparse.Namespace) -> int | None:
        raise error

    return work


def test_bad_input_is_one_line_and_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert _run(_raiser(InputError("x.bag: broken: record it again"))) == 2
    printed = capsys.readouterr()
    assert printed.err == "error: x.bag: broken: record it again\n"
    assert printed.out == ""


def test_an_interrupt_and_a_lack_of_memory_end_quietly(capsys: pytest.CaptureFixture[str]) -> None:
    assert _run(_raiser(KeyboardInterrupt())) == 130
    assert capsys.readouterr().err == ""
    assert _run(_raiser(MemoryError())) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_programming_error_is_not_hidden() -> None:
    with pytest.raises(ZeroDivisionError):
        _run(_raiser(ZeroDivisionError()))


def test_bad_arguments_point_to_the_examples(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as leaving:
        _run(lambda options: 0, "--n", "-3")
    assert leaving.value.code == 2
    printed = capsys.readouterr().err
    assert printed.count("\n") == 1
    assert "--help" in printed


@pytest.mark.parametrize("text", ["0", "-1", "nan", "inf", "abc"])
def test_a_number_above_zero_is_one(text: str) -> None:
    with pytest.raises((ValueError, argparse.ArgumentTypeError)):
        positive(text)
    with pytest.raises((ValueError, argparse.ArgumentTypeError)):
        seed("-1")


def test_a_pipe_shows_no_progress(capsys: pytest.CaptureFixture[str]) -> None:
    with progress(2, "work") as advance:
        advance("half")
        advance("done")
    printed = capsys.readouterr()
    assert printed.out + printed.err == ""


def printing(redirection: str) -> subprocess.CompletedProcess[str]:
    """Run a command that prints a great deal, its output redirected by bash."""
    code = (
        "from imu_noise_id.commands.console import Parser, run\n"
        "def work(options):\n    for k in range(100000): print('line', k)\n"
        "raise SystemExit(run(Parser('a b', 'c', 'd'), work, []))\n"
    )
    return subprocess.run(
        ["bash", "-c", f'"{sys.executable}" -c "$CODE" {redirection}'],
        env={"CODE": code, "PATH": "/usr/bin:/bin", "PYTHONPATH": ":".join(sys.path)},
        capture_output=True,
        text=True,
    )


def test_a_reader_that_goes_away_is_no_error() -> None:
    done = printing('| head -n 1; exit "${PIPESTATUS[0]}"')
    assert done.stdout == "line 0\n"
    assert done.stderr == ""
    assert done.returncode == 0


def test_an_output_that_was_closed_is_no_error() -> None:
    done = printing(">&-")
    assert (done.returncode, done.stderr) == (0, "")


def test_an_output_on_a_full_disk_is_one_line_and_status_2() -> None:
    done = printing("> /dev/full")
    assert done.returncode == 2
    assert done.stderr == ("error: standard output: cannot be written (No space left on device)\n")
