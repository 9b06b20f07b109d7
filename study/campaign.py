"""Inputs tried by the hundred thousand, each under a limit of time and of memory.

A forked child tries one input after the other and says what came of each; the parent watches.  A
child that says nothing for too long is killed, and the campaign goes on behind the input that did
it; so it does behind one that ends the process.  Every input is made of its number alone, so that
one that failed is made again from it.
"""

from __future__ import annotations

import os
import resource
import select
import signal
import time
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

TIME_LIMIT_S = 20.0
MEMORY_LIMIT_MB = 512
BATCH = 2000

Attempt = Callable[[int], str]
"""Makes the input of a number and tries it; returns what came of it, raises what must not come."""


@dataclass
class Tally:
    """What came of a campaign.

    Attributes
    ----------
    outcomes : Counter of str
    failures : list of (int, str)
        Number of an input, and what must not have happened.
    slowest_s, largest_mb : (float, int)
        With the number of the input; memory is what the process grew by at its highest.
    """

    outcomes: Counter[str] = field(default_factory=Counter)
    failures: list[tuple[int, str]] = field(default_factory=list)
    slowest_s: tuple[float, int] = (0.0, -1)
    largest_mb: tuple[float, int] = (0.0, -1)

    @property
    def tried(self) -> int:
        """Inputs tried."""
        return self.outcomes.total() + len(self.failures)

    def add(self, number: int, line: str) -> None:
        """Count what the child said of an input."""
        failed, seconds, megabytes, what = line.split("\t", 3)
        self.slowest_s = max(self.slowest_s, (float(seconds), number))
        self.largest_mb = max(self.largest_mb, (float(megabytes), number))
        if int(failed):
            self.fail(number, what)
        else:
            self.outcomes[what] += 1

    def fail(self, number: int, what: str) -> None:
        """Note what must not have happened."""
        self.failures.append((number, what))
        print(f"input {number}: {what}", flush=True)

    def summary(self) -> str:
        """One line."""
        return (
            f"{self.tried} inputs, {len(self.failures)} failed; slowest "
            f"{self.slowest_s[0]:.2f} s (input {self.slowest_s[1]}), largest growth "
            f"{self.largest_mb[0]:.0f} MB (input {self.largest_mb[1]})"
        )


def run(attempt: Attempt, numbers: Sequence[int]) -> Tally:
    """Try the inputs of these numbers."""
    tally = Tally()
    at = 0
    while at < len(numbers):
        batch = numbers[at : at + BATCH]
        at += _run_batch(attempt, batch, tally)
        if at // 20_000 != (at - len(batch)) // 20_000:
            print(f"  {at} of {len(numbers)}: {len(tally.failures)} failed", flush=True)
    return tally


def _run_batch(attempt: Attempt, numbers: Sequence[int], tally: Tally) -> int:
    """Try a batch in a child of its own; return how many were tried before it ended."""
    ours, theirs = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(ours)
        _child(attempt, numbers, theirs)
    os.close(theirs)
    done = 0
    reason = ""
    with os.fdopen(ours, "rb", buffering=0) as pipe:
        waiting = b""
        while not reason and done < len(numbers):
            ready, _, _ = select.select([pipe], [], [], TIME_LIMIT_S)
            data = pipe.read(1 << 16) if ready else b""
            if not data:
                reason = "ended the process" if ready else f"hung for {TIME_LIMIT_S:g} s"
            *lines, waiting = (waiting + data).split(b"\n")
            for line in lines:
                tally.add(numbers[done], line.decode())
                done += 1
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    if done < len(numbers):
        tally.fail(numbers[done], f"{reason} (status {status})")
        done += 1
    return done


def _child(attempt: Attempt, numbers: Sequence[int], pipe: int) -> None:
    """Try inputs, say what came of them, end."""
    claimed = _status_mb("VmSize") + MEMORY_LIMIT_MB
    resource.setrlimit(resource.RLIMIT_AS, (int(claimed) << 20, int(claimed) << 20))
    for number in numbers:
        os.write(pipe, (one(attempt, number) + "\n").encode())
    os._exit(0)


def one(attempt: Attempt, number: int) -> str:
    """Try one input: failed or not, seconds, growth in MB and what came of it, between tabs."""
    Path("/proc/self/clear_refs").write_text("5")  # the highest so far is forgotten
    before = _status_mb("VmRSS")
    begin = time.perf_counter()
    failed = 0
    try:
        what = attempt(number)
    except Exception as error:  # noqa: BLE001 - what must not happen is what is looked for
        failed = 1
        place = traceback.extract_tb(error.__traceback__)[-1]
        text = " ".join(str(error).split())[:300]
        what = f"{type(error).__name__}: {text} ({Path(place.filename).name}:{place.lineno})"
    seconds = time.perf_counter() - begin
    growth = max(_status_mb("VmHWM") - before, 0.0)
    return f"{failed}\t{seconds:.6f}\t{growth:.2f}\t{what}"


def _status_mb(name: str) -> float:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1]) / 1024
    raise KeyError(name)
