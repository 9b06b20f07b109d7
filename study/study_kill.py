"""``kill -9`` at random moments while ``identify`` and ``fuse`` run and write.

On bags: the output folder holds the files of one recording, the command works on another, and is
killed; each file must then be that of the one or of the other, to the last byte.  Half the kills
fall anywhere in the run, half into the part of it that writes.  Live: a sender goes on at 100 Hz
while ``identify`` (a checkpoint each second) is killed and started again; each start must resume
all that the one before had resumed and kept since.  ``fuse`` live writes nothing; it must
come back.  Moments are drawn from a seed.  Ends with status 1 where anything else was seen.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))

from imu_noise_id.ros.messages import to_time

from helpers.live import Listener, Program, write_still_bag

DURATION_S = 20.0
RATE_HZ = 100
CHECKPOINT_S = 1.0
PATIENCE_S = 60.0


def files_of(folder: Path) -> dict[str, bytes]:
    """Every file by its name below a folder, those of a writer that was killed left out."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not any(p.endswith(".part") for p in path.parts)
    }


def run(command: list[str], kill_after_s: float | None = None) -> float:
    """Run a command, or kill it after a time; return how long it ran."""
    begin = time.monotonic()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    try:
        process.wait(kill_after_s if kill_after_s is not None else 300.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    return time.monotonic() - begin


def first_write_s(command: list[str], folder: Path) -> tuple[float, float]:
    """When a command has replaced its first file and when it ended, seconds since its start."""
    before = {p: p.stat().st_mtime_ns for p in folder.rglob("*") if p.is_file()}
    begin, first = time.monotonic(), None
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while process.poll() is None:
        changed = any(
            p.is_file() and p.name[0] != "." and p.stat().st_mtime_ns != before.get(p)
            for p in list(folder.rglob("*"))
        )
        if first is None and changed:
            first = time.monotonic() - begin
        time.sleep(0.002)
    end = time.monotonic() - begin
    return first or end, end


def kill_on_bags(program: list[str], kills: int, seed: int, folder: Path) -> Counter[str]:
    """Kill a command on a bag; count what its files were then."""
    rng = np.random.default_rng(seed)
    bags = [
        write_still_bag(folder / f"bag{k}", DURATION_S, RATE_HZ, np.random.default_rng(k))
        for k in range(2)
    ]
    output = folder / "output"
    states = []
    for bag in bags:
        run([*program, "--bag", str(bag), "--output", str(output)])
        states.append(files_of(output))
    again = [*program, "--bag", str(bags[0]), "--output", str(output)]
    first, end = first_write_s(again, output)
    same = files_of(output) == states[0]
    print(f"  runs {end:.1f} s, writes from {first:.1f} s; again the same bytes: {same}")
    seen: Counter[str] = Counter()
    for kill in range(kills):
        target = kill % 2
        moment = rng.uniform(0.0 if kill % 4 < 2 else first - 0.3, end)
        run([*program, "--bag", str(bags[1 - target]), "--output", str(output)], moment)
        seen[judge(files_of(output), states)] += 1
    run(again)
    left = [p.name for p in output.rglob("*.part")]
    seen["left behind after one whole run"] = len(left)
    return seen


def judge(found: dict[str, bytes], states: list[dict[str, bytes]]) -> str:
    """Say whether each file is one of two, and whether all are of one."""
    for name, data in found.items():
        if all(state.get(name) != data for state in states):
            return f"WRONG: {name} of {len(data)} bytes is neither"
    if set(found) != set(states[0]):
        return "WRONG: a file is missing"
    return "all of one run" if found in states else "each whole, of two runs"


class Sender:
    """Publishes a still IMU for ever and counts."""

    def __init__(self) -> None:
        from sensor_msgs.msg import Imu

        self.kind = Imu
        self.listener = Listener()
        self.publisher = self.listener.node.create_publisher(Imu, "/imu/data", 1000)
        self.sent = 0
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self) -> None:
        rng = np.random.default_rng(0)
        while not self.stop.wait(1.0 / RATE_HZ):
            message = self.kind()
            message.header.stamp = to_time(10**18 + self.sent * 10**9 // RATE_HZ)
            message.angular_velocity.x, message.angular_velocity.y = rng.normal(0.0, 1e-3, 2)
            message.linear_acceleration.z = 9.81 + rng.normal(0.0, 1e-2)
            self.publisher.publish(message)
            self.sent += 1

    def close(self) -> None:
        """Stop publishing."""
        self.stop.set()
        self.thread.join()
        self.listener.close()


def heard(sender: Sender, program: Program) -> bool:
    """Wait until a node has subscribed; False where it ended before."""
    end = time.monotonic() + PATIENCE_S
    while not sender.publisher.get_subscription_count():
        if program.process.poll() is not None or time.monotonic() > end:
            return False
        time.sleep(0.02)
    return True


def gone(sender: Sender) -> None:
    """Wait until the middleware has noticed that a node was killed."""
    end = time.monotonic() + PATIENCE_S
    while sender.publisher.get_subscription_count() and time.monotonic() < end:
        time.sleep(0.02)


def kill_live(name: str, package: str, kills: int, seed: int, folder: Path) -> Counter[str]:
    """Kill a live node and start it again."""
    rng = np.random.default_rng(seed)
    checkpoint = folder / "checkpoint"
    settings = ["-p", "first_after_s:=1.0", "-p", "publish_period_s:=1.0"]
    settings += ["-p", f"checkpoint:={checkpoint}", "-p", f"checkpoint_period_s:={CHECKPOINT_S}"]
    command = [package, name, *(["--ros-args", *settings] if name == "identify" else [])]
    seen: Counter[str] = Counter()
    sender, kept = Sender(), 0
    try:
        for kill in range(kills):
            program = Program(dict(os.environ), folder / f"{name}{kill}.log", command)
            if not heard(sender, program):
                seen[f"WRONG: did not start: {program.output[-200:]}"] += 1
                program.kill()
                continue
            time.sleep(rng.uniform(0.0, 6.0))
            program.kill()
            resumed = re.search(r"(\d+) samples resumed", program.output)
            count = int(resumed[1]) if resumed else 0
            if name == "identify" and count < kept:
                seen["WRONG: fewer resumed than the last start had resumed"] += 1
            elif "Traceback" in program.output:
                seen["WRONG: traceback"] += 1
            else:
                seen["resumed" if count else "started"] += 1
            kept = count
            gone(sender)
    finally:
        sender.close()
    if name == "identify":
        print(f"  {kept} samples resumed at the last start of {sender.sent} sent")
    return seen


def main() -> int:
    """Kill, and print what was found."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seed", type=int, default=0)
    for what, default in (("identify", 14), ("fuse", 14), ("live", 16), ("live-fuse", 6)):
        arguments.add_argument(f"--{what}", type=int, default=default)
    options = arguments.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    os.environ.setdefault("ROS_DOMAIN_ID", "95")
    wrong = 0
    with tempfile.TemporaryDirectory() as name:
        os.environ.setdefault("ROS_LOG_DIR", f"{name}/log")
        campaigns = (
            ("identify --bag", options.identify, kill_on_bags,
             (["ros2", "run", "imu_noise_id", "identify"],)),
            ("fuse --bag", options.fuse, kill_on_bags, (["ros2", "run", "nav_fusion", "fuse"],)),
            ("identify live", options.live, kill_live, ("identify", "imu_noise_id")),
            ("fuse live", options.live_fuse, kill_live, ("fuse", "nav_fusion")),
        )  # fmt: skip
        for k, (what, kills, campaign, given) in enumerate(campaigns):
            folder = Path(name, str(k))
            folder.mkdir()
            print(f"{what}: {kills} kills, seed {options.seed + k}", flush=True)
            seen = campaign(*given, kills, options.seed + k, folder) if kills else Counter()
            for outcome, count in sorted(seen.items()):
                print(f"  {count:4d} {outcome}", flush=True)
                wrong += outcome.startswith("WRONG") * count
    print(f"{wrong} wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
