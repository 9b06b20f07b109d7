"""Overlapping Allan deviation with intervals: cost beside allantools, the stream's, and the loss.

Every pair is timed in turn in this one process, on one core, with the same taus; figures are
medians with the least and the most.  Writes ``allan.json`` and ``allan.md`` into ``--output``.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import resource
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import allantools
import numpy as np
from imu_noise_id.allan import AllanCurve, allan, allan_exact, curve, warm_up
from imu_noise_id.pyramid import empty_pyramid, feed
from imu_noise_id.series import Series
from numpy.typing import NDArray

Floats = NDArray[np.float64]
RATE_HZ = 1000.0
CHANNELS = 6
DAY = 86_400_000


@dataclass(frozen=True)
class Spread:
    """Median, least and most of several timings."""

    median: float
    least: float
    most: float


def spread(values: list[float]) -> Spread:
    return Spread(float(np.median(values)), min(values), max(values))


def seconds(work: Callable[[], object]) -> float:
    """Processor time, which other programs on the machine disturb least; all here is one thread."""
    start = time.process_time()
    work()
    return time.process_time() - start


def series_of(values: Floats, observed: NDArray[np.bool_] | None = None) -> Series:
    observed = np.ones(values.size, dtype=bool) if observed is None else observed
    return Series(values, observed, 1.0 / RATE_HZ)


def oadev(values: Floats, tau_s: Floats) -> Floats:
    return allantools.oadev(values, rate=RATE_HZ, data_type="freq", taus=tau_s)[1]


def peers(values: Floats, tau_s: Floats) -> dict[str, Callable[[], object]]:
    """Return other packages' overlapping Allan variance of one channel at these averaging times."""
    found: dict[str, Callable[[], object]] = {}
    if importlib.util.find_spec("allan_variance"):
        from allan_variance import compute_avar

        span = (tau_s[0], tau_s[-1])
        found["allan-variance"] = lambda: compute_avar(
            values, 1.0 / RATE_HZ, *span, n_clusters=tau_s.size, input_type="mean"
        )
    if importlib.util.find_spec("avar"):
        import avar

        factors = np.rint(tau_s * RATE_HZ).astype(np.int64)
        found["avar"] = lambda: avar.variance(values, factors)
    return found


def side_by_side(size: int, pairs: int, rng: np.random.Generator) -> dict[str, object]:
    """Six channels: ours, allantools, and reading the samples once."""
    channels = [series_of(9.81 + rng.standard_normal(size)) for _ in range(CHANNELS)]
    tau_s = allan(channels[0]).tau_s
    ours, theirs, reads, ratios, differ = [], [], [], [], []
    for _ in range(pairs):
        found: list[AllanCurve] = []
        ours.append(seconds(lambda found=found: found.extend(allan(c) for c in channels)))
        reads.append(seconds(lambda: [c.values.sum() for c in channels]))
        expected: list[Floats] = []
        theirs.append(
            seconds(lambda e=expected: e.extend(oadev(c.values, tau_s) for c in channels))
        )
        ratios.append(theirs[-1] / ours[-1])
        differ += [
            float(np.max(np.abs(c.deviation - e) / (c.upper - c.lower)))
            for c, e in zip(found, expected, strict=True)
        ]
    others = {
        name: CHANNELS * spread([seconds(run) for _ in range(2)]).median
        for name, run in peers(channels[0].values, tau_s).items()
    }
    lossy = [series_of(c.values, rng.random(size) > 0.05) for c in channels]
    return {
        "channels": CHANNELS,
        "samples": size,
        "taus": int(tau_s.size),
        "ours_s": asdict(spread(ours)),
        "allantools_s": asdict(spread(theirs)),
        "times_faster": asdict(spread(ratios)),
        "read_once_s": asdict(spread(reads)),
        "peers_s": others,
        "five_percent_lost_s": asdict(spread([seconds(lambda: [allan(c) for c in lossy])])),
        "largest_difference_in_interval_widths": max(differ),
    }


def growth(sizes: list[int], rng: np.random.Generator) -> list[dict[str, float]]:
    """Seconds for one channel against its length."""
    rows = []
    for size in sizes:
        series = series_of(rng.standard_normal(size))
        tau_s = allan(series).tau_s
        rows.append(
            {
                "samples": size,
                "ours_s": min(seconds(lambda s=series: allan(s)) for _ in range(5)),
                "allantools_s": min(
                    seconds(lambda s=series, t=tau_s: oadev(s.values, t)) for _ in range(2)
                ),
            }
        )
    return rows


def stream(samples: int, rng: np.random.Generator) -> dict[str, object]:
    """Cost a sample by size of batch, and memory over a day at 1 kHz."""
    noise = rng.standard_normal(1 << 20)
    cost = {}
    for batch in (10, 100, 1000, 10_000):
        count = min(noise.size // batch, 20_000)

        def work(batch: int = batch, count: int = count) -> None:
            state = empty_pyramid()
            for i in range(count):
                state = feed(state, noise[i * batch : (i + 1) * batch])

        cost[str(batch)] = min(seconds(work) for _ in range(3)) / (count * batch) * 1e6
    state, memory = empty_pyramid(), []
    for i in range(samples // 1000):
        start = (i * 1000) % (noise.size - 1000)
        state = feed(state, noise[start : start + 1000])
        if i == 60 or i == samples // 1000 - 1:
            memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
    kept = sum(part.nbytes for part in vars(state).values() if isinstance(part, np.ndarray))
    whole = allan(series_of(noise))
    grown = empty_pyramid()
    for start in range(0, noise.size, 777):
        grown = feed(grown, noise[start : start + 777])
    streamed = curve(grown, 1.0 / RATE_HZ)
    differ = np.abs(streamed.deviation - whole.deviation) / (whole.upper - whole.lower)
    return {
        "microseconds_a_sample_by_batch": cost,
        "samples": samples,
        "state_megabytes": kept / 2**20,
        "resident_growth_after_first_minute_megabytes": memory[-1] - memory[0],
        "largest_difference_from_batch_in_interval_widths": float(differ.max()),
    }


NOISES: dict[str, Callable[[Floats], Floats]] = {
    "white": lambda w: w,
    "flicker": lambda w: np.fft.irfft(
        np.fft.rfft(w) / np.sqrt(np.maximum(np.arange(w.size // 2 + 1), 1)), w.size
    )[: w.size // 4],
    "random walk": lambda w: np.cumsum(w)[: w.size // 4],
}


def loss(runs: int, rng: np.random.Generator) -> list[dict[str, object]]:
    """Degrees of freedom kept by the stride: var(every sample)/var(strided), pooled over taus."""
    rows = []
    for name, make in NOISES.items():
        strided, full = [], []
        for _ in range(runs):
            values = make(rng.standard_normal(1 << 16))
            series = series_of(values[: 1 << 14])
            fast = allan(series)
            strided.append(fast.deviation**2)
            full.append(allan_exact(series, fast.averaging_factor).deviation ** 2)
        m = fast.averaging_factor
        a, b = np.array(strided), np.array(full)
        for low, high in ((32, 512), (512, 1 << 14)):
            columns = (m >= low) & (m < high)
            pick = rng.integers(0, runs, (200, runs))
            draws = [
                np.mean(np.var(b[p][:, columns], 0) / np.var(a[p][:, columns], 0)) for p in pick
            ]
            kept = np.mean(np.var(b[:, columns], 0) / np.var(a[:, columns], 0))
            rows.append(
                {
                    "noise": name,
                    "averaging_factors": [low, high],
                    "windows_a_stride": [16, 28] if low < 512 else [32, 62],
                    "degrees_of_freedom_kept": float(kept),
                    "standard_error": float(np.std(draws)),
                }
            )
    return rows


def markdown(result: dict) -> str:
    """Fragment for the page of benchmarks."""
    pair, flow = result["side_by_side"], result["stream"]
    grew = flow["resident_growth_after_first_minute_megabytes"]
    lines = [
        f"Overlapping Allan deviation with intervals, {pair['channels']} channels of "
        f"{pair['samples']:,} samples, {pair['taus']} taus, processor time on one "
        "core, medians (least to most):",
        "",
        "| | seconds |",
        "|---|---|",
    ]
    for name, key in (
        ("allantools.oadev (no intervals)", "allantools_s"),
        ("ours, intervals included", "ours_s"),
        ("ours, 5 % of the samples lost", "five_percent_lost_s"),
        ("reading the samples once (sum)", "read_once_s"),
    ):
        row = pair[key]
        lines.append(f"| {name} | {row['median']:.3f} ({row['least']:.3f} to {row['most']:.3f}) |")
    for name, value in pair["peers_s"].items():
        lines.append(f"| {name} (one channel times six) | {value:.3f} |")
    speed = pair["times_faster"]
    lines += [
        "",
        f"{speed['median']:.0f} times faster "
        f"({speed['least']:.0f} to {speed['most']:.0f} by pair); "
        f"{pair['ours_s']['median'] / pair['read_once_s']['median']:.0f} times reading the samples "
        "once. Largest difference from allantools: "
        f"{pair['largest_difference_in_interval_widths']:.3f} of the interval's width.",
        "",
        "Streaming, microseconds a sample and channel by size of batch: "
        + ", ".join(f"{k}: {v:.3f}" for k, v in flow["microseconds_a_sample_by_batch"].items())
        + f". State {flow['state_megabytes']:.2f} MB; over {flow['samples']:,} samples "
        f"resident memory grew {grew:.1f} MB after the first "
        "minute; largest difference from the batch estimate "
        f"{flow['largest_difference_from_batch_in_interval_widths']:.1e} of the interval's width.",
        "",
        "| noise | averaging factors | strides | degrees of freedom kept (se) |",
        "|---|---|---|---|",
    ]
    for row in result["loss"]:
        low, high = row["averaging_factors"]
        fine, finest = row["windows_a_stride"]
        lines.append(
            f"| {row['noise']} | {low} to {high} | m/{fine} to m/{finest} | "
            f"{row['degrees_of_freedom_kept']:.4f} ({row['standard_error']:.4f}) |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Run the benchmark."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--samples", type=int, default=4_320_000)
    arguments.add_argument("--pairs", type=int, default=3)
    arguments.add_argument("--stream-samples", type=int, default=DAY)
    arguments.add_argument("--loss-runs", type=int, default=400)
    arguments.add_argument("--output", type=Path, default=Path(__file__).parent / "results")
    options = arguments.parse_args()
    warm_up()
    rng = np.random.default_rng(1)
    sizes = [n for n in (10_000, 100_000, 1_000_000, 10_000_000) if n <= 3 * options.samples]
    result = {
        "stream": stream(options.stream_samples, rng),
        "side_by_side": side_by_side(options.samples, options.pairs, rng),
        "growth": growth(sizes, rng),
        "loss": loss(options.loss_runs, rng),
    }
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / "allan.json").write_text(json.dumps(result, indent=1), encoding="utf-8")
    (options.output / "allan.md").write_text(markdown(result), encoding="utf-8")
    print(markdown(result))


if __name__ == "__main__":
    main()
