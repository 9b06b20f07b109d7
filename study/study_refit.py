"""Typed models that have an effect which the recording has not, or has with another size.

Prints a row an effect: removed where it is not there, refitted where it is larger or smaller, and
how often the true size is inside the refit's interval.  Recordings by ``test/helpers``
(``hidden_effects.py`` the sensors, ``played_effects.py`` the effects), six channels, 200 Hz, 600 s.

    python study/study_refit.py [--runs 10] [--only outliers periodic ...]
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "test" / "helpers"))

import hidden_effects as hidden
import played_effects as played
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import (
    ChannelReconciliation,
    Reconciliation,
    reconcile_recording,
)
from study_reconcile import Setting, as_recording, record, typed_model

SMALLER, LARGER = 1.0 / 1.6, 1.6
FIRST_SEED = 300
SETTING = Setting(typed=True)


def sized(kind: str, w: float, factor: float) -> dict[str, float]:
    """Parameters as a model has them that is wrong by a factor."""
    p, size = played.sizes(w)[kind]
    if kind == "variance_change":
        return {**p, size: 1.0 + (p[size] - 1.0) * factor}
    if kind == "held_samples":
        return {**p, size: 2.0 if factor < 1.0 else 6.0}
    return {**p, size: p[size] * factor}


def given(
    model: NoiseModel, kind: str, names: tuple[str, ...], factor: float, w: dict[str, float]
) -> NoiseModel:
    """The sensor's model with an effect more, or with another white noise."""

    def channel(old: ChannelModel) -> ChannelModel:
        if old.name not in names:
            return old
        p: dict[str, float | str] = dict(sized(kind, w[old.name], factor))
        if kind == "cross_axis":
            p["other"] = next(n for n in names if n != old.name)
        kept = [e for e in old.effects if e.name != "white_noise" or kind != "white_noise"]
        return replace(old, effects=(*kept, typed_effect(kind, old.name, p)))

    return replace(model, channels=tuple(channel(c) for c in model.channels))


def touched(kind: str, names: tuple[str, ...], seed: int) -> tuple[str, ...]:
    """Channels that the effect is on."""
    if kind in played.TRANSPORT:
        return names
    first, axis = seed % 6 // 3 * 3, seed % 3
    second = names[first + (axis + 1) % 3]
    return (names[first + axis], second) if kind == "cross_axis" else (names[first + axis],)


def play(
    made: hidden.Hidden, kind: str, on: tuple[str, ...], seed: int, rng: np.random.Generator
) -> None:
    """Put the effect upon a clean recording."""
    sensors = hidden.sensors(seed % 40)
    w = sensors[on[0]].white
    p, _ = played.sizes(w)[kind]

    def slow(name: str) -> np.ndarray:
        sensor = sensors[name]
        law = (sensor.slow_sigma, sensor.slow_time_s)
        return hidden.recursion(played.N, played.DT, *law, rng)

    if kind in played.TRANSPORT:
        made.stamp_ns, made.values = played.transported(kind, p, made.stamp_ns, made.values, rng)
    elif kind == "cross_axis":
        densities = (sensors[name].white for name in on)
        fast = played.shared(*densities, p["correlation"], rng)
        made.values |= {name: x + slow(name) for name, x in zip(on, fast, strict=True)}
    else:
        assert made.temperature is not None
        assert made.temperature_ns is not None
        heat = np.interp(made.stamp_ns, made.temperature_ns, made.temperature)
        values = played.upon(kind, p, made.values[on[0]], w, heat, rng)
        anew = kind in ("bandwidth_limit", "averaging")
        made.values[on[0]] = values + slow(on[0]) if anew else values


def run(kind: str, seed: int, factor: float, there: bool) -> tuple[Reconciliation, tuple[str, ...]]:
    """Reconciliation of one recording, and the channels that the effect is on."""
    made = record(SETTING, "nothing", 0.0, seed, sensor_seed=seed % 40)
    w = {name: sensor.white for name, sensor in hidden.sensors(seed % 40).items()}
    on = touched(kind, tuple(w), seed)
    if there and kind != "white_noise":
        play(made, kind, on, seed, np.random.default_rng([seed, 77]))
    model = given(typed_model(SETTING, seed % 40), kind, on, factor, w)
    recording = as_recording(made)
    return reconcile_recording(recording, model, 0, 1, SETTING.false_alarm_rate), on


def answered(result: Reconciliation, on: tuple[str, ...], kind: str, action: str) -> bool:
    """Whether this action on this effect is the only step on its channels, the only ones."""
    wanted = {name: [(action, kind)] for name in on}
    said = {c.name: [(s.action, s.effect.name) for s in c.steps] for c in result.channels}
    return said == {c.name: wanted.get(c.name, []) for c in result.channels}


def inside(channel: ChannelReconciliation, kind: str, true: float, size: str) -> bool | None:
    """Whether the refitted size's interval holds the true one; None without one."""
    for step in channel.steps:
        for parameter, said in zip(
            step.effect.effect.parameters, step.effect.estimates, strict=True
        ):
            if step.effect.name == kind and parameter.name == size and said.lower is not None:
                assert said.upper is not None
                return bool(said.lower <= true <= said.upper)
    return None


def row(kind: str, runs: int) -> str:
    """One line of the table."""
    cells, held = [], []
    for factor, there in ((1.0, False), (SMALLER, True), (LARGER, True)):
        if kind == "white_noise" and not there:
            cells.append("-")
            continue
        right = 0
        for seed in range(FIRST_SEED, FIRST_SEED + runs):
            result, on = run(kind, seed, factor, there)
            right += answered(result, on, kind, "refit" if there else "remove")
            w = hidden.sensors(seed % 40)[on[0]].white
            p, size = played.sizes(w)[kind]
            if there:
                held.append(inside(result.channel(on[0]), kind, p[size], size))
        cells.append(f"{right} of {runs}")
    known = [h for h in held if h is not None]
    cells.append(f"{sum(known)} of {len(known)}" if known else "-")
    return f"| {kind} | " + " | ".join(cells) + " |"


def main() -> None:
    """Run and print."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--runs", type=int, default=10)
    arguments.add_argument("--only", nargs="*", default=[])
    options = arguments.parse_args()
    print("| effect | not there: removed | model 1.6 times too small | too large | inside |")
    print("|---|---|---|---|---|")
    for kind in options.only or list(played.sizes(1.0)):
        print(row(kind, options.runs), flush=True)


if __name__ == "__main__":
    main()
