"""Real recordings at rest against a model of white noise alone.

Writes ``docs/study_reconcile_real.md``.  The rest of every recording of ``../shared/data`` is cut
in two.  The model is a hand-typed one: white noise of the level by which neighbours
differ.  The first part says what is missing; the second part is asked the same, and whether it
agrees with what the first part made of the model.

    python study/study_reconcile_real.py
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from imu_noise_id.bags import read_recording
from imu_noise_id.model import ChannelModel, NoiseModel
from imu_noise_id.model_file import typed_effect
from imu_noise_id.reconcile import ChannelReconciliation, reconcile_recording
from imu_noise_id.recording import Channel, Recording
from study_real import DATA, ROOT, bags

LEAST_S = 5.0
HEAD = """# Reconciliation of real recordings with a model of white noise alone

Written by `study/study_reconcile_real.py` from the recordings of `../shared/data` (not part of the
project), what is still of each cut in two halves.  The model is typed: white noise of the
level by which neighbouring samples differ.  *First* and *second* say what is missing in
each half on its own; the gaps are those of the second half, under the white model and under
the model as the first half mended it.

| recording | channel | s each | missing in the first | in the second | gap, white | gap, mended |
|---|---|---|---|---|---|---|
"""


def white_model(recording: Recording) -> NoiseModel:
    """White noise of the level of neighbouring differences, typed."""
    channels = []
    for channel in recording.channels:
        difference = np.diff(channel.values[channel.still])
        density = float(np.std(difference)) / np.sqrt(2.0 * channel.rate_hz)
        if density > 0.0:
            white = typed_effect("white_noise", channel.name, {"density": density})
            channels.append(
                ChannelModel(channel.name, channel.topic, channel.unit, None, 0.0, (white,))
            )
    return NoiseModel(tuple(channels))


def longest_rest(still: np.ndarray) -> np.ndarray:
    """Indices of the longest run of still samples."""
    edges = np.flatnonzero(np.diff(still.astype(int), prepend=0, append=0))
    runs = edges.reshape(-1, 2)
    first, last = runs[np.argmax(runs[:, 1] - runs[:, 0])] if runs.size else (0, 0)
    return np.arange(first, last)


def halves(recording: Recording) -> tuple[Recording, Recording]:
    """The longest rest of each channel, before and after its middle."""

    def part(channel: Channel, second: bool) -> Channel:
        kept = longest_rest(channel.still)
        middle = kept[kept.size // 2]
        inside = kept[kept >= middle] if second else kept[kept < middle]
        return replace(
            channel,
            stamp_ns=channel.stamp_ns[inside],
            values=channel.values[inside],
            still=np.ones(inside.size, dtype=bool),
        )

    out = []
    for second in (False, True):
        channels = tuple(part(c, second) for c in recording.channels if c.still.sum() > 64)
        start = min((int(c.stamp_ns[0]) for c in channels), default=recording.start_ns)
        out.append(replace(recording, channels=channels, start_ns=start))
    return out[0], out[1]


def said(channel: ChannelReconciliation) -> str:
    """Steps in short, and the verdict where it is not explained."""
    names = [
        s.effect.name if s.action == "add" else f"{s.action} {s.effect.name}" for s in channel.steps
    ]
    if channel.verdict != "explained":
        names.append(f"({channel.verdict})")
    return ", ".join(names)


def rows(path: Path, name: str) -> list[str]:
    """Table rows of one bag."""
    recording = read_recording(path)
    first, second = halves(recording)
    if not first.channels or first.channels[0].duration_s < LEAST_S:
        return []
    model = white_model(first)
    one = reconcile_recording(first, model)
    two = reconcile_recording(second, model)
    again = reconcile_recording(second, one.model)
    out = []
    for result in one.channels:
        if result.name not in {c.name for c in model.channels}:
            continue
        other, mended = two.channel(result.name), again.channel(result.name)
        span_s = f"{first.channel(result.name).duration_s:.0f}"
        left = f"{mended.before.score:.2f} {mended.verdict}" + (
            f": {said(mended)}" if mended.steps else ""
        )
        if not np.isfinite(other.before.score):
            out.append(f"| {name} | {result.name} | {span_s} | too few samples | | | |")
            continue
        cells = (
            name,
            result.name,
            span_s,
            said(result),
            said(other),
            f"{other.before.score:.2f}",
            left,
        )
        out.append("| " + " | ".join(cells) + " |")
        print(out[-1], flush=True)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", default=[""])
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "study_reconcile_real.md")
    options = parser.parse_args()
    if not DATA.is_dir():
        sys.exit(f"{DATA}: missing, nothing to do")
    table = []
    with tempfile.TemporaryDirectory() as folder:
        for source in sorted(DATA.glob("*.npz")):
            if any(source.stem.startswith(only) for only in options.only):
                for path in bags(source, Path(folder)):
                    table += rows(path, path.name)
    options.output.write_text(HEAD + "\n".join(table) + "\n")


if __name__ == "__main__":
    main()
