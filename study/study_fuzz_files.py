"""Damage model files, parameter files and checkpoints: read to the last bit, or refused in a line.

Five families, numbered as in study_fuzz_bags.py: bytes of model files; an unknown key in a place
drawn by lot, and a number replaced by what is none or out of range, both to be named with their
line; the same for the nodes' parameter files; bytes of checkpoints.  What is read is written and
read again: the same text must come out.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np
import yaml

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))

import campaign
from imu_noise_id.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from imu_noise_id.columns import TopicColumns
from imu_noise_id.effects import CATALOGUE
from imu_noise_id.errors import InputError
from imu_noise_id.model_file import CHANNEL_TOPICS, load_model, model_text
from imu_noise_id.ros.identify_node import SETTINGS as IDENTIFY
from imu_noise_id.ros.parameter_files import check_arguments
from nav_fusion.ros.settings import SETTINGS as FUSE

from helpers import damaged_bags as damaged
from imu_noise_id import cdr

ROOT = Path(__file__).resolve().parents[1]
BAD = ("-1.0e+300", ".nan", ".inf", "often", "[1.0]", "{a: 1}", "", "1_0", "0x", "1e999", "-0.0")
DAMAGES = (*damaged.METADATA_DAMAGES[:2], damaged.shuffle_lines, damaged.put_yaml)


def every_effect() -> str:
    """A model file, one key a line, in which every effect of the catalogue has every member."""
    rng = np.random.default_rng(0)
    channels = []
    for name in list(CHANNEL_TOPICS)[:2]:
        other = next(n for n in CHANNEL_TOPICS if n != name)
        effects = [
            {
                "name": kind.name,
                "parameters": {
                    p.name: {"value": other}
                    if kind.__annotations__.get(p.name) == "str"
                    else {
                        "value": 1.0 if p.name == "order" else 1.0 - 0.5 * rng.random(),
                        "std_error": rng.random(),
                        "lower": 0.5 * rng.random(),
                        "upper": 0.5 + 0.5 * rng.random(),
                    }
                    for p in kind.parameters
                },
            }
            for kind in CATALOGUE.values()
            if kind.name not in ("variance_change", "held_samples")
        ]
        channels.append({"name": name, "rate_hz": 200.0, "mean": 0.1, "effects": effects})
    tree = {"format": "model/1", "source": "study", "notes": ["a note"], "channels": channels}
    return yaml.safe_dump(tree, sort_keys=False, default_flow_style=False)


def read_model(path: Path) -> None:
    """Read a model file, write it and read it again."""
    text = model_text(load_model(path))
    again = path.with_name("again.yaml")
    again.write_text(text, encoding="utf-8")
    assert model_text(load_model(again)) == text, "comes back otherwise"


def outcome(read: object, path: Path, line: int | None = None) -> str:
    """Read; what is refused must name the file and, where one is known, the line."""
    try:
        read(path)  # type: ignore[operator]
    except InputError as error:
        said = str(error)
        assert "\n" not in said, said
        assert said.startswith(str(path)), said
        if line is None:
            return "refused"
        found = re.match(r".*?, line (\d+): ", said.removeprefix(str(path.parent)))
        assert found, f"no line in: {said}"
        return "refused at its line" if int(found[1]) == line else "refused at another line"
    return "read"


def models_by_bytes(folder: Path) -> campaign.Attempt:
    """Bytes, lines and values of model files, anywhere."""
    files = sorted((ROOT / "bags").glob("*.truth.yaml"))
    texts = [every_effect().encode(), *(f.read_bytes() for f in files)]

    def attempt(number: int) -> str:
        rng = np.random.default_rng(number)
        text, damage = texts[number % len(texts)], DAMAGES[number // len(texts) % len(DAMAGES)]
        path = folder / "model.yaml"
        path.write_bytes(damage(bytearray(text), [0], rng))
        return f"{damage.__name__}: {outcome(read_model, path)}"

    return attempt


def with_unknown_key(lines: list[str], rng: np.random.Generator) -> int:
    """Put a key that nobody knows before one that there is; return its line."""
    places = [k for k, line in enumerate(lines) if re.match(r" *(- )?\w+:", line) and k > 1]
    k = int(rng.choice(places))
    indent = re.match(r" *", lines[k])[0]  # type: ignore[index]
    item = lines[k].lstrip().startswith("- ")
    lines.insert(k + item, f"{indent}{'  ' * item}color: red")
    return k + item + 1


def with_bad_value(lines: list[str], rng: np.random.Generator) -> int:
    """Put what is no number, or out of range, in the place of a number; return its line."""
    places = [k for k, line in enumerate(lines) if re.match(r" *(- )?\w+: -?[\d.]+(e.*)?$", line)]
    k = int(rng.choice(places))
    lines[k] = lines[k].split(": ")[0] + ": " + BAD[int(rng.integers(len(BAD)))]
    return k + 1


def models_by_keys(folder: Path) -> campaign.Attempt:
    """Unknown keys and bad values in a model file."""
    whole = every_effect().splitlines()

    def attempt(number: int) -> str:
        rng = np.random.default_rng(number)
        lines, change = list(whole), (with_unknown_key, with_bad_value)[number % 2]
        line = change(lines, rng)
        path = folder / "model.yaml"
        path.write_text("\n".join(lines), encoding="utf-8")
        found = outcome(read_model, path, line)
        assert change is not with_unknown_key or found == "refused at its line", found
        return f"{change.__name__}: {found}"

    return attempt


def parameters(folder: Path) -> campaign.Attempt:
    """Unknown keys, bad values and damaged bytes in the nodes' parameter files."""
    files = [
        (ROOT / f"src/{package}/config/{node}.yaml", node, settings)
        for package, node, settings in (
            ("imu_noise_id", "identify", IDENTIFY),
            ("nav_fusion", "fuse", FUSE),
        )
    ]
    texts = [re.sub(" +#.*", "", f.read_text()).replace("/**", node) for f, node, _ in files]
    ways = (with_unknown_key, with_bad_value, *DAMAGES)

    def attempt(number: int) -> str:
        rng = np.random.default_rng(number)
        _, node, settings = files[number % 2]
        way = ways[number // 2 % len(ways)]
        path, line = folder / "parameters.yaml", None
        if way in DAMAGES:
            path.write_bytes(way(bytearray(texts[number % 2].encode()), [0], rng))
        else:
            lines = texts[number % 2].splitlines()
            line = way(lines, rng)
            path.write_text("\n".join(lines))

        def read(file: Path) -> None:
            check_arguments(["--params-file", str(file)], node, settings)

        found = outcome(read, path, line)
        assert way is not with_unknown_key or found == "refused at its line", found
        return f"{way.__name__}: {found}"

    return attempt


def checkpoints(folder: Path) -> campaign.Attempt:
    """Bytes of a checkpoint."""
    rng = np.random.default_rng(0)
    stamp_ns = 10**18 + np.arange(50) * 10**7
    values = rng.normal(size=(len(cdr.LAYOUTS[cdr.IMU].columns), 50))
    columns = TopicColumns("/imu/data", cdr.IMU, stamp_ns, stamp_ns, values, frozenset({b"imu"}))
    save_checkpoint(Checkpoint((columns,)), folder / "whole")
    whole = (folder / "whole").read_bytes()
    heads = [m.start() for m in re.finditer(b"PK..|.NUMPY", whole, re.DOTALL)]
    damages = damaged.DAMAGES

    def attempt(number: int) -> str:
        path = folder / "checkpoint"
        damage = damages[number % len(damages)]
        path.write_bytes(damage(bytearray(whole), heads, np.random.default_rng(number)))
        return f"{damage.__name__}: {outcome(load_checkpoint, path)}"

    return attempt


FAMILIES = {
    "model bytes": (models_by_bytes, 20_000),
    "model keys": (models_by_keys, 10_000),
    "parameters": (parameters, 20_000),
    "checkpoint": (checkpoints, 20_000),
}


def main() -> int:
    """Run the campaign."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--share", type=float, default=1.0, help="of the inputs to try")
    arguments.add_argument("--family")
    arguments.add_argument("--only", type=int)
    options = arguments.parse_args()
    warnings.simplefilter("error")
    failed = 0
    for name, (make, count) in FAMILIES.items():
        if options.family not in (None, name):
            continue
        with tempfile.TemporaryDirectory() as folder:
            attempt = make(Path(folder))
            if options.only is not None:
                print(attempt(options.only))
                continue
            tally = campaign.run(attempt, range(round(options.share * count)))
        for seen, times in sorted(tally.outcomes.items()):
            print(f"  {seen:44s} {times}")
        print(f"{name}: {tally.summary()}", flush=True)
        failed += len(tally.failures)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
