"""Reconciliation against hidden effects: names, false alarms, gaps, confusions, real recordings.

Writes ``docs/study_reconcile.md``.  Recordings come from ``test/helpers/hidden_effects.py``, which
shares nothing with the catalogue; the model is identified from another recording of the same
made-up sensor.  Every run is one line of ``--results``; what is there already is not repeated.

    python study/study_reconcile.py --runs 20 [--controls 40] [--only clear half ...]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "test" / "helpers"))

import hidden_effects as hidden  # noqa: E402
from imu_noise_id.identify import identify_recording  # noqa: E402
from imu_noise_id.model import ChannelModel, NoiseModel  # noqa: E402
from imu_noise_id.model_file import load_model, save_model, typed_effect  # noqa: E402
from imu_noise_id.reconcile import (  # noqa: E402
    Reconciliation,
    compare_recording,
    reconcile_recording,
)
from imu_noise_id.reconcile.compare import INDEPENDENT  # noqa: E402
from imu_noise_id.reconcile.loop import (  # noqa: E402
    FALSE_ALARM_RATE,
    TIES_SHARE,
    TIMING_SHARE,
)
from imu_noise_id.reconcile.null import load_null  # noqa: E402
from imu_noise_id.recording import Channel, Recording, unit_of  # noqa: E402
from scipy.special import ndtr  # noqa: E402
from scipy.stats import chi2  # noqa: E402

CLEAR_NATS, HALF_NATS = 30.0, 15.0
SOUGHT_NATS = {"periodic": 12.0, "narrow_band": 7.0, "variance_change": 7.0}
"""What the search over places costs anyone, beyond a known place: see what can be seen."""
POWER_NATS = (7.5, 22.5, 45.0, 60.0)
"""Beside 15 and 30, which every effect has: twice each of these but one is there too."""
PAIRS = (
    "periodic&rate_ramp",
    "narrow_band&output_rounding",
    "bias_step&outliers",
    "periodic+gauss_markov",
    "variance_change+rate_ramp",
)
LACKING = "periodic+narrow_band+bias_step"
SLOW = {"rate_random_walk", "gauss_markov", "bias_instability", "random_telegraph"}
SENSORS = 40
"""Made-up sensors, whose models the recordings share."""
CERTAIN_KINDS = {
    *("outliers", "output_rounding", "saturation", "bandwidth_limit", "averaging"),
    *("held_samples", "timestamp_jitter", "dropouts"),
}
"""Not graded in nats, far above any threshold; at half strength half as much of it."""
GRADED = tuple(k for k in hidden.KINDS if k not in CERTAIN_KINDS)


@dataclass(frozen=True)
class Setting:
    """What is recorded, and where its model comes from."""

    names: tuple[str, ...] = hidden.IMU_CHANNELS
    rate_hz: float = 200.0
    duration_s: float = 600.0
    typed: bool = False

    @property
    def false_alarm_rate(self) -> float:
        """The same for a channel as with six of them."""
        return FALSE_ALARM_RATE * len(self.names) / 6.0


GNSS = Setting(("position.east", "position.north", "position.up"), 10.0, 3600.0)
SETTINGS = {
    "typed": Setting(typed=True),
    "typed half": Setting(typed=True),
    "typed nothing": Setting(typed=True),
    "gnss": GNSS,
    "gnss half": GNSS,
    "gnss nothing": GNSS,
    "own form": Setting(hidden.IMU_CHANNELS[:1], typed=True),
}
"""Of sections that are not six channels of an identified model."""


def as_recording(made: hidden.Hidden) -> Recording:
    topic = "/gps/fix" if "position.up" in made.values else "/imu/data"

    def channel(name: str, stamp_ns: Any, values: Any, rate_hz: float, topic: str) -> Channel:
        still = np.ones(values.size, dtype=bool)
        return Channel(topic, name, unit_of(name), stamp_ns, values, still, rate_hz)

    channels = tuple(
        channel(name, made.stamp_ns, values, made.rate_hz, topic)
        for name, values in made.values.items()
    )
    regressor = channel(
        "temperature", made.temperature_ns, made.temperature, 1.0, "/imu/temperature"
    )
    return Recording(made.kind, int(made.stamp_ns[0]), channels, regressor)


def record(setting: Setting, kind: str, nats: float, seed: int, **seeds: int) -> hidden.Hidden:
    trust = hidden.KNOWN if setting.typed else 1.0
    where = (setting.duration_s, setting.rate_hz, setting.names)
    return hidden.recording(kind, nats, seed, *where, trust=trust, **seeds)


def typed_model(setting: Setting, sensor_seed: int) -> NoiseModel:
    """The sensor's own values, as a hand-typed file would have them."""
    channels = []
    for name, sensor in hidden.sensors(sensor_seed, setting.names).items():
        white = typed_effect("white_noise", name, {"density": sensor.white})
        values = {"sigma": sensor.slow_sigma, "correlation_time_s": sensor.slow_time_s}
        slow = typed_effect("gauss_markov", name, dict(values))
        channels.append(ChannelModel(name, "", unit_of(name), None, 0.0, (white, slow)))
    return NoiseModel(tuple(channels))


def sensor_model(setting: Setting, sensor_seed: int, folder: Path) -> NoiseModel:
    """Model of the sensor from another recording, with nothing hidden; identified once."""
    if setting.typed:
        return typed_model(setting, sensor_seed)
    file = folder / f"{setting.names[0]}_{len(setting.names)}_{sensor_seed}.yaml"
    if not file.is_file():
        clean = record(setting, "nothing", 0.0, 10**6 + sensor_seed, sensor_seed=sensor_seed)
        folder.mkdir(parents=True, exist_ok=True)
        save_model(identify_recording(as_recording(clean), 1).model, file)
    return load_model(file)


def loud_simulator(sensor_seed: int, folder: Path) -> NoiseModel:
    """Model of a simulator's recording whose white noise is a tenth too loud."""
    file = folder / f"loud_{sensor_seed}.yaml"
    if not file.is_file():
        clean = record(Setting(), "nothing", 0.0, 2 * 10**6 + sensor_seed, sensor_seed=sensor_seed)
        rng = np.random.default_rng([sensor_seed, 9])
        for name, sensor in hidden.sensors(sensor_seed).items():
            more = np.sqrt(0.21 * clean.rate_hz) * sensor.white
            clean.values[name] = clean.values[name] + more * rng.standard_normal(
                clean.stamp_ns.size
            )
        folder.mkdir(parents=True, exist_ok=True)
        save_model(identify_recording(as_recording(clean), 1).model, file)
    return load_model(file)


def commit() -> str:
    """Of the code that runs; with a + where it has been changed since."""
    words = ("git", "-C", str(ROOT), "describe", "--always", "--dirty=+", "--exclude", "*")
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()


def run_one(task: Task, folder: Path, code: str) -> dict[str, Any]:
    return {**_run(task, folder), "commit": code}


def _run(task: Task, folder: Path) -> dict[str, Any]:
    section, kind, nats, seed = task
    if section == "own form":
        return run_own_form(kind, nats, seed)
    setting = SETTINGS.get(section, Setting())
    sensor_seed = seed % SENSORS
    if section == "loud":
        model = loud_simulator(sensor_seed, folder)
    else:
        model = sensor_model(setting, sensor_seed, folder)
    made = record(setting, kind, nats, seed, sensor_seed=sensor_seed)
    if section == "loud":
        made.truth = dict.fromkeys(made.values, ("white_noise",))
    start = time.process_time()
    result = reconcile_recording(as_recording(made), model, 0, 1, setting.false_alarm_rate)
    line: dict[str, Any] = {
        "section": section,
        "kind": kind,
        "nats": nats,
        "seed": seed,
        "cpu_s": round(time.process_time() - start, 2),
        "truth": {name: list(right) for name, right in made.truth.items()},
        "found": found_in(result),
    }
    if section in ("clear", "gnss") and judge(line) in ("right", "between"):
        noise_seed = seed + 5 * 10**6
        second = as_recording(
            record(setting, kind, nats, seed, sensor_seed=sensor_seed, noise_seed=noise_seed)
        )
        part = replace(second, channels=tuple(second.channel(name) for name in made.truth))
        line["second"] = max(c.before.score for c in compare_recording(part, result.model))
    return line


def found_in(result: Reconciliation) -> dict[str, Any]:
    return {
        c.name: {
            "verdict": c.verdict,
            "before": c.before.score,
            "after": c.after.score,
            "steps": [[s.action, s.effect.name, s.effect.note] for s in c.steps],
        }
        for c in result.channels
        if c.verdict != "agrees"
    }


def run_own_form(kind: str, nats: float, seed: int) -> dict[str, Any]:
    """An effect of the catalogue's own form, and whether its true values are in the intervals."""
    setting = SETTINGS["own form"]
    name = setting.names[0]
    made, truth = hidden.own_form(kind, nats, seed, name)
    model = typed_model(setting, seed)
    start = time.process_time()
    result = reconcile_recording(as_recording(made), model, 0, 1, setting.false_alarm_rate)
    inside: dict[str, bool] = {}
    for step in result.channel(name).steps:
        if step.effect.name == kind:
            for parameter, said in zip(
                step.effect.effect.parameters, step.effect.estimates, strict=True
            ):
                low, high = said.lower, said.upper
                if parameter.name in truth and low is not None and high is not None:
                    inside[parameter.name] = bool(low <= truth[parameter.name] <= high)
    cpu_s = round(time.process_time() - start, 2)
    line = {"section": "own form", "kind": kind, "nats": nats, "seed": seed, "cpu_s": cpu_s}
    return {**line, "truth": {name: [kind]}, "found": found_in(result), "inside": inside}


def judge(line: dict[str, Any]) -> str:
    """One of right, between (the truth is one of two names), wrong, unexplained, none.

    Every hidden name must stand on its channel, and no step on a channel where nothing is hidden.
    """
    truth, found = line["truth"], line["found"]
    answers = []
    for name, hidden_names in truth.items():
        steps = found.get(name, {"steps": []})["steps"]
        names = [s[1] for s in steps if s[0] == "add"] or [s[1] for s in steps]
        notes = " ".join(s[2] for s in steps)
        if hidden_names == ["white_noise"]:
            names = [s[1] for s in steps if s[0] == "refit"]
        for wanted in hidden_names:
            if not wanted:
                closed = found.get(name, {"verdict": "agrees"})["verdict"] == "explained"
                answers.append("wrong" if closed else "right")
            elif wanted in names:
                answers.append("right")
            elif wanted in notes or (wanted in SLOW and _slow_group(steps)):
                answers.append("between")
            elif names or steps:
                answers.append("wrong")
            else:
                answers.append("unexplained" if name in found else "none")
    if any(f["steps"] for name, f in found.items() if name not in truth):
        answers.append("wrong")
    order = ("wrong", "none", "unexplained", "between", "right")
    return min(answers, key=order.index, default="right")


def _slow_group(steps: list[list[str]]) -> bool:
    return any(s[1] in SLOW and "between" in s[2] for s in steps)


def wilson(hits: int, runs: int) -> str:
    if runs == 0:
        return "-"
    p, z = hits / runs, 1.96
    middle = (p + z * z / (2 * runs)) / (1 + z * z / runs)
    half = z * np.sqrt(p * (1 - p) / runs + z * z / (4 * runs * runs)) / (1 + z * z / runs)
    low, high = max(middle - half, 0.0), min(middle + half, 1.0)
    return f"{100 * p:.0f} % ({100 * low:.0f}-{100 * high:.0f})"


Task = tuple[str, str, float, int]


def tasks(runs: int, controls: int, only: Iterable[str], first_seed: int) -> list[Task]:
    """What is to be run, in an order that leaves some of everything when it is cut short."""
    alone = tuple(k for k in hidden.ON_ONE_CHANNEL if k not in CERTAIN_KINDS)
    sections: dict[str, tuple[float, tuple[str, ...], tuple[float, ...]]] = {
        # runs, kinds, strengths
        "nothing": (controls, ("nothing",), (0.0,)),
        "typed nothing": (controls / 4, ("nothing",), (0.0,)),
        "gnss nothing": (controls / 4, ("nothing",), (0.0,)),
        "clear": (runs, hidden.KINDS, (CLEAR_NATS,)),
        "half": (runs, hidden.KINDS, (HALF_NATS,)),
        "gnss": (runs, alone, (CLEAR_NATS,)),
        "gnss half": (runs / 4, alone, (HALF_NATS,)),
        "outside": (runs, tuple(hidden.OUTSIDE), (CLEAR_NATS,)),
        "pairs": (runs, PAIRS, (2.0 * CLEAR_NATS,)),
        "loud": (runs, ("nothing",), (0.0,)),
        "lacking": (runs, (LACKING,), (2.0 * CLEAR_NATS,)),
        "own form": (runs, hidden.OWN_FORMS, (4.0 * CLEAR_NATS,)),
        "typed": (runs / 4, hidden.KINDS, (CLEAR_NATS,)),
        "typed half": (runs / 4, hidden.KINDS, (HALF_NATS,)),
        "power": (runs / 4, GRADED, POWER_NATS),
    }
    for kind, more in SOUGHT_NATS.items():
        sections[f"sought per {kind}"] = (runs / 4, (kind,), (HALF_NATS + more,))
    wanted = set(only) or set(sections)
    ordered: list[tuple[float, Task]] = []
    for name, (count, kinds, strengths) in sections.items():
        if name in wanted or name.split()[0] in wanted:
            many = int(np.ceil(count))
            cells = product(range(many), kinds, strengths)
            ordered += [
                ((s + 1) / many, (name.split(" per")[0], kind, nats, first_seed + s))
                for s, kind, nats in cells
            ]
    return [task for _, task in sorted(ordered, key=lambda pair: pair[0])]


def read_results(path: Path) -> dict[Task, dict[str, Any]]:
    if not path.is_file():
        return {}
    lines = [json.loads(text) for text in path.read_text().splitlines() if text.strip()]
    return {(d["section"], d["kind"], d["nats"], d["seed"]): d for d in lines}


HEAD = """# Reconciliation against hidden effects

Written by `study/study_reconcile.py`; 95 % Wilson intervals in brackets.  200 Hz, 600 s;
recordings by `test/helpers/hidden_effects.py`, which shares no code and no exact form
with the catalogue.  The model is identified from another recording of the sensor (40
sensors), or, *typed*, is the sensor's own without intervals.  Strength in nats: expected gain of a
perfect fit over none, *none* being a clean sensor that explains this recording and the
one that the model came from alike, and a third of it over the best other name (computed
before the run by the helper's `Strength`).  *Between*: the sentence names the truth as one
of two.
"""


def report(results: Iterable[dict[str, Any]]) -> str:
    lines = list(results)
    parts = [
        HEAD,
        _controls(lines),
        _attainable(),
        _power(lines),
        *(_names(lines, section, title) for section, title in SECTIONS),
        _coverage(lines),
        _second(lines),
        _confusion(lines),
    ]
    return "\n".join(part for part in parts if part) + "\n"


SECTIONS = (
    ("clear", f"Clearly present ({CLEAR_NATS:g} nats), six channels, identified model"),
    ("half", f"Half that strength ({HALF_NATS:g} nats), six channels, identified model"),
    ("sought", "Half that strength beyond what the search over places costs, six channels"),
    ("typed", f"Clearly present ({CLEAR_NATS:g} nats), six channels, typed model"),
    ("typed half", f"Half that strength ({HALF_NATS:g} nats), six channels, typed model"),
    ("gnss", f"GNSS positions, 10 Hz, 1 h ({CLEAR_NATS:g} nats), identified model"),
    ("gnss half", f"GNSS positions, half that strength ({HALF_NATS:g} nats)"),
    ("pairs", "Two effects, on one channel (&) or on two (+)"),
    ("loud", "A simulator's recording whose white noise is a tenth too loud on all channels"),
    ("lacking", "A simulator's recording that lacks three effects at once"),
    ("outside", "In no catalogue: right is any answer but a closed gap under a wrong name"),
)


CONTROLS = (
    ("nothing", "six channels, identified model"),
    ("typed nothing", "six channels, typed model"),
    ("gnss nothing", "a receiver, identified model"),
)


def _controls(lines: list[dict[str, Any]]) -> str:
    rows = [
        "## Nothing hidden\n",
        "| of | recordings | any change | any alarm |",
        "|---|---|---|---|",
    ]
    for section, model in CONTROLS:
        controls = [d for d in lines if d["section"] == section]
        changed = sum(any(f["steps"] for f in d["found"].values()) for d in controls)
        alarms = sum(bool(d["found"]) for d in controls)
        n = len(controls)
        rows.append(f"| {model} | {n} | {wilson(changed, n)} | {wilson(alarms, n)} |")
    return "\n".join((*rows, ""))


TESTS = 15
"""Statistics of the battery on a typical channel."""


def _attainable() -> str:
    """What the rate of false alarms lets anyone see, who fits perfectly but does not know where."""
    setting = Setting()
    level = np.log((1.0 - TIES_SHARE - TIMING_SHARE) * FALSE_ALARM_RATE / len(setting.names))
    limit = float(level - np.log(INDEPENDENT * TESTS))
    dt = 1.0 / setting.rate_hz
    null = load_null(round(setting.duration_s * setting.rate_hz), dt)
    needed = {
        name: 0.5 * float(chi2.isf(np.exp(limit), k))
        for k, name in ((1, "known place, one parameter"), (2, "two parameters"))
    }
    grid = np.linspace(0.0, 40.0, 4001)
    for name, (size, places) in SOUGHT.items():
        net = next(g for g in grid if null.log_p(name, g) < limit)
        needed[f"sought: {size}"] = float(net + np.log(places))
    rows = [
        "## What can be seen at this rate of false alarms\n",
        f"One channel of six at {100 * FALSE_ALARM_RATE:g} % a recording: a statistic counts from "
        f"log p = {limit:.1f} on.  The root of twice the log-likelihood ratio of a perfect fit is "
        "normal about that of twice the expected gain, deviation 1; so even a perfect fit is seen "
        "in the share given, by its strength.\n",
        "| effect | nats that count | " + " | ".join(f"{g:g} nats" for g in SEEN_AT) + " |",
        "|---|---|" + "---|" * len(SEEN_AT),
    ]
    for name, nats in needed.items():
        cells = " | ".join(f"{100 * seen(g, nats):.0f} %" for g in SEEN_AT)
        rows.append(f"| {name} | {nats:.1f} | {cells} |")
    most = [
        float(seen(HALF_NATS, needed[NEEDS.get(k, "known place, one parameter")])) for k in GRADED
    ]
    everything = (sum(most) + len(CERTAIN_KINDS)) / len(hidden.KINDS)
    rows.append(
        f"\nSo of the {len(GRADED)} graded effects, one as often as the other, {HALF_NATS:g} nats "
        f"let a perfect fit see {100 * np.mean(most):.0f} %, and of all {len(hidden.KINDS)}, the "
        f"others always seen, {100 * everything:.0f} %."
    )
    return "\n".join((*rows, ""))


def _power(lines: list[dict[str, Any]]) -> str:
    """Share right or between at every strength, the graded effects."""
    cells: dict[tuple[str, float], Counter[str]] = {}
    for line in lines:
        if line["section"] in ("power", "half", "clear") and line["kind"] in GRADED:
            cell = cells.setdefault((line["kind"], line["nats"]), Counter())
            cell[judge(line)] += 1
    if not any(line["section"] == "power" for line in lines):
        return ""
    strengths = sorted({nats for _, nats in cells})
    rows = [
        "## Power against strength, six channels, identified model\n",
        "Right or between, of so many.\n",
        "| effect | " + " | ".join(f"{g:g} nats" for g in strengths) + " |",
        "|---|" + "---|" * len(strengths),
    ]
    for kind in (*GRADED, "**all**"):
        row = []
        for nats in strengths:
            own = [c for (k, g), c in cells.items() if g == nats and kind in (k, "**all**")]
            pooled = sum(own, Counter())
            near, n = pooled["right"] + pooled["between"], sum(pooled.values())
            row.append(f"{100 * near / n:.0f} % of {n}" if n else "-")
        rows.append(f"| {kind} | " + " | ".join(row) + " |")
    return "\n".join((*rows, ""))


def seen(gain: float, needed: float) -> float:
    """Share of recordings in which a perfect fit of an expected gain passes what counts."""
    return float(ndtr(np.sqrt(2.0 * gain) - np.sqrt(2.0 * needed)))


NEEDS = {
    "periodic": "sought: line",
    "narrow_band": "sought: band of 1 Hz",
    "variance_change": "sought: burst of a tenth",
    "gauss_markov": "two parameters",
    "random_telegraph": "two parameters",
    "bias_step": "two parameters",
}
"""What an effect needs where it is not one parameter at a known place; never more than it does."""


SOUGHT = {
    "band": ("band of 1 Hz", 100.0),
    "burst": ("burst of a tenth", 10.0),
    "line": ("line", 1.0),
}
"""What is charged for its places within the statistic: what, and how many there are of it."""
SEEN_AT = (7.5, 15.0, 30.0, 45.0, 60.0)


def _coverage(lines: list[dict[str, Any]]) -> str:
    """How often the interval of a parameter holds the true value, effects of own form."""
    table: dict[tuple[str, str], list[bool]] = {}
    for line in lines:
        for parameter, held in line.get("inside", {}).items():
            table.setdefault((line["kind"], parameter), []).append(held)
    if not table:
        return ""
    rows = [
        "## Intervals, effects of the catalogue's own form made by independent code\n",
        "| effect | parameter | named | true value inside the 95 % interval |",
        "|---|---|---|---|",
    ]
    for (kind, parameter), held in sorted(table.items()):
        rows.append(f"| {kind} | {parameter} | {len(held)} | {wilson(sum(held), len(held))} |")
    pooled = [h for held in table.values() for h in held]
    rows.append(f"| **all** | | {len(pooled)} | {wilson(sum(pooled), len(pooled))} |")
    return "\n".join((*rows, ""))


def _names(lines: list[dict[str, Any]], section: str, title: str) -> str:
    cells: dict[tuple[str, float], list[dict[str, Any]]] = {}
    for line in lines:
        if line["section"] == section:
            cells.setdefault((line["kind"], line["nats"]), []).append(line)
    if not cells:
        return ""
    rows = [
        f"## {title}\n",
        "| effect | nats | runs | right | right or between | wrong | unexplained | nothing seen |",
        "|---|---|---|---|---|---|---|---|",
    ]
    pooled: Counter[str] = Counter()
    for (kind, nats), runs in cells.items():
        rows.append(_row(kind, f"{nats:g}", Counter(judge(d) for d in runs)))
        pooled.update(judge(d) for d in runs)
    return "\n".join((*rows, _row("**all**", "", pooled), ""))


def _row(kind: str, nats: str, verdicts: Counter[str]) -> str:
    n = sum(verdicts.values())
    near = verdicts["right"] + verdicts["between"]
    rest = " | ".join(str(verdicts[name]) for name in ("unexplained", "none"))
    return (
        f"| {kind} | {nats} | {n} | {wilson(verdicts['right'], n)} | {wilson(near, n)} | "
        f"{wilson(verdicts['wrong'], n)} | {rest} |"
    )


def _second(lines: list[dict[str, Any]]) -> str:
    scores = np.array([d["second"] for d in lines if "second" in d])
    if scores.size == 0:
        return ""
    inside = int(np.sum(scores <= 1.15))
    cpu = np.median([d["cpu_s"] for d in lines])
    return (
        "## Gap on a second recording, under the mended model\n\n"
        "Other noise of the same sensor with the same effect (its own course included).\n\n"
        "| recordings named right | median | 95 % point | at most 1.15 |\n|---|---|---|---|\n"
        f"| {scores.size} | {np.median(scores):.2f} | {np.quantile(scores, 0.95):.2f} | "
        f"{wilson(inside, scores.size)} |\n\nMedian CPU time of a reconciliation: {cpu:.1f} s.\n"
    )


CONFUSED = ("clear", "half", "sought", "typed", "typed half", "gnss", "gnss half", "outside")


def _confusion(lines: list[dict[str, Any]]) -> str:
    """First name given against what was hidden, one effect a recording."""
    table: dict[str, Counter[str]] = {}
    for line in lines:
        if line["section"] not in CONFUSED or not line["truth"]:
            continue
        name = next(iter(line["truth"]))
        steps = line["found"].get(name, {"steps": []})["steps"]
        first = steps[0] if steps else ["", "unexplained" if name in line["found"] else "nothing"]
        label = first[1] if first[0] in ("add", "") else f"{first[0]} {first[1]}"
        table.setdefault(line["kind"], Counter())[label] += 1
    if not table:
        return ""
    rows = [
        "## Confusion: first name given, all strengths and models\n",
        "| hidden | given |",
        "|---|---|",
    ]
    for kind, given in table.items():
        rows.append(f"| {kind} | " + ", ".join(f"{k} {v}" for k, v in given.most_common()) + " |")
    return "\n".join((*rows, ""))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--controls", type=int, default=40)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--first-seed", type=int, default=0, help="development uses 100000 on")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so long")
    parser.add_argument("--results", type=Path, default=ROOT / "build" / "study_reconcile.jsonl")
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "study_reconcile.md")
    options = parser.parse_args()
    done = read_results(options.results)
    wanted = tasks(options.runs, options.controls, options.only, options.first_seed)
    left = [t for t in wanted if t not in done]
    options.results.parent.mkdir(parents=True, exist_ok=True)
    models = options.results.parent / "study_reconcile_models"
    one = partial(run_one, folder=models, code=commit())
    stop = time.monotonic() + 60.0 * options.minutes
    with ProcessPoolExecutor(options.workers) as pool, options.results.open("a") as file:
        for start in range(0, len(left), 4 * options.workers):
            if time.monotonic() > stop:
                break
            batch = left[start : start + 4 * options.workers]
            for task, line in zip(batch, pool.map(one, batch), strict=True):
                done[task] = line
                file.write(json.dumps(line) + "\n")
                file.flush()
    options.output.write_text(report(done.values()))


if __name__ == "__main__":
    main()
