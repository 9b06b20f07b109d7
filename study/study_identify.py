"""Identification against truth: accuracy, intervals, structure and contamination.

Writes ``docs/study_identify.md``.  Records are made here from their definitions, by numpy alone;
the Cramer-Rao bounds are of the Whittle likelihood at every ordinate, from spectra written down
here and differentiated numerically.  Nothing of the package's simulation or spectra is used.

    python study/study_identify.py --runs 1000 [--only laws structure ...] [--results FILE]

Every run is one line of ``--results``; what is there already is not repeated.
"""

from __future__ import annotations

import argparse
import os
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from imu_noise_id.effects import CATALOGUE
from imu_noise_id.estimation import estimate_series
from imu_noise_id.intervals import estimates
from imu_noise_id.ordinates import Ordinates, cosine_coefficients, ordinates
from imu_noise_id.selection import white_start
from imu_noise_id.series import Series
from imu_noise_id.whittle import Fit, fit
from kept_runs import KeptRuns
from numpy.typing import NDArray
from scipy.signal import lfilter

Floats = NDArray[np.float64]
RATE_HZ, DURATION_S = 100.0, 3600.0
DT, N = 1.0 / RATE_HZ, int(RATE_HZ * DURATION_S)


# -------------------------------------------------------------- records and spectra, by themselves


def white(n: int, dt: float, rng: np.random.Generator, density: float) -> Floats:
    return rng.standard_normal(n) * density / np.sqrt(dt)


def markov(n: int, dt: float, rng: np.random.Generator, sigma: float, memory_s: float) -> Floats:
    a = np.exp(-dt / memory_s)
    drive = rng.standard_normal(n) * sigma * np.sqrt(1.0 - a * a)
    drive[0] = rng.standard_normal() * sigma
    return lfilter([1.0], [1.0, -a], drive)


def walk(n: int, dt: float, rng: np.random.Generator, k: float) -> Floats:
    return np.cumsum(rng.standard_normal(n)) * k * np.sqrt(dt)


def flicker(n: int, dt: float, rng: np.random.Generator, b: float) -> Floats:
    """Sum of Gauss-Markov terms, two a decade (ripple 2e-4): another construction than ours."""
    steps = 2
    memories = 10.0 ** np.arange(np.log10(dt) - 0.4, np.log10(n * dt) + 2.0, 1.0 / steps)
    sigma = b * np.sqrt(np.log(10.0) / steps / np.pi)
    return np.sum([markov(n, dt, rng, sigma, m) for m in memories], axis=0)


def rounded_angle(n: int, dt: float, rng: np.random.Generator, q: float) -> Floats:
    return np.diff(rng.standard_normal(n + 1)) * q / dt


def resonance(
    n: int, dt: float, rng: np.random.Generator, centre: float, width: float, sigma: float
) -> Floats:
    """A slow random phasor, two Gauss-Markov quadratures, on a carrier."""
    memory = 1.0 / (np.pi * width)
    angle = 2.0 * np.pi * centre * dt * np.arange(n)
    cosine, sine = (markov(n, dt, rng, sigma, memory) for _ in range(2))
    return cosine * np.cos(angle) + sine * np.sin(angle)


def s_markov(f: Floats, sigma: float, memory_s: float) -> Floats:
    a = np.exp(-DT / memory_s)
    return sigma**2 * (1 - a * a) * DT / np.abs(1 - a * np.exp(-2j * np.pi * f * DT)) ** 2


def s_resonance(f: Floats, centre: float, width: float, sigma: float) -> Floats:
    memory = 1.0 / (np.pi * width)
    return 0.5 * (s_markov(f - centre, sigma, memory) + s_markov(f + centre, sigma, memory))


Maker = Callable[[np.random.Generator], Floats]
SPECTRA: dict[str, Callable[..., Floats]] = {
    "white_noise": lambda f, d: np.full_like(f, d**2),
    "gauss_markov": s_markov,
    "rate_random_walk": lambda f, k: k**2 / (2.0 * np.sin(np.pi * f * DT) / DT) ** 2,
    "bias_instability": lambda f, b: b**2 * DT / (2.0 * np.sin(np.pi * f * DT)),
    "quantization": lambda f, q: 4.0 * q**2 / DT * np.sin(np.pi * f * DT) ** 2,
    "narrow_band": s_resonance,
}
MAKERS: dict[str, Callable[..., Floats]] = {
    "white_noise": white,
    "gauss_markov": markov,
    "rate_random_walk": walk,
    "bias_instability": flicker,
    "quantization": rounded_angle,
    "narrow_band": resonance,
}
Law = tuple[tuple[str, tuple[float, ...]], ...]
W = ("white_noise", (1.0,))
LAWS: dict[str, Law] = {
    "white + Gauss-Markov (20 s)": (W, ("gauss_markov", (0.5, 20.0))),
    "white + Gauss-Markov (300 s)": (W, ("gauss_markov", (0.5, 300.0))),
    "white + rate random walk": (W, ("rate_random_walk", (0.05,))),
    "white + bias instability": (W, ("bias_instability", (0.3,))),
    "quantization + white": (W, ("quantization", (0.02,))),
    "white + two Gauss-Markov": (W, ("gauss_markov", (2.0, 1.0)), ("gauss_markov", (1.5, 40.0))),
    "white + narrow band": (W, ("narrow_band", (20.0, 0.5, 2.0))),
}


SHORT = 60_000
STRUCTURES: tuple[tuple[str, Law, int], ...] = (
    ("white + Gauss-Markov (2, 5 s)", (W, ("gauss_markov", (2.0, 5.0))), SHORT),
    ("white + Gauss-Markov (2, 1 s)", (W, ("gauss_markov", (2.0, 1.0))), SHORT),
    ("white + bias instability (1)", (W, ("bias_instability", (1.0,))), SHORT),
    ("white + bias instability (3)", (W, ("bias_instability", (3.0,))), SHORT),
    ("quantization + white", LAWS["quantization + white"], SHORT),
    ("white + narrow band", LAWS["white + narrow band"], SHORT),
    (
        "white + two Gauss-Markov (5, 0.1 s; 3, 10 s)",
        (W, ("gauss_markov", (5.0, 0.1)), ("gauss_markov", (3.0, 10.0))),
        N,
    ),
    ("white + Gauss-Markov (0.5, 20 s)", LAWS["white + Gauss-Markov (20 s)"], SHORT),
    ("white + Gauss-Markov (0.5, 300 s)", LAWS["white + Gauss-Markov (300 s)"], SHORT),
    ("white + rate random walk", LAWS["white + rate random walk"], SHORT),
    ("white + bias instability (0.3)", LAWS["white + bias instability"], SHORT),
    ("white + two Gauss-Markov (2, 1 s; 1.5, 40 s)", LAWS["white + two Gauss-Markov"], SHORT),
)
"""Of the structure study: expected ratio to the next set 20 nats or more, then those below 5."""
CASES = (("white", (W,), SHORT), *STRUCTURES)


def record(law: Law, rng: np.random.Generator, n: int = N, dt: float = DT) -> Floats:
    return np.sum([MAKERS[name](n, dt, rng, *values) for name, values in law], axis=0)


def spectrum(law: Law, theta: Floats, f: Floats) -> Floats:
    total, used = np.zeros_like(f), 0
    for name, values in law:
        total += SPECTRA[name](f, *np.exp(theta[used : used + len(values)]))
        used += len(values)
    return total


def bound(law: Law, n: int = N) -> Floats:
    """Cramer-Rao bound of the log parameters, from J = 1/2 sum over all ordinates."""
    f = np.arange(1, n) / (2.0 * n * DT)
    theta = np.log([v for _, values in law for v in values])
    rows = []
    for i in range(theta.size):
        step = np.zeros(theta.size)
        step[i] = 1e-5
        up, down = (np.log(spectrum(law, theta + s * step, f)) for s in (1.0, -1.0))
        rows.append((up - down) / 2e-5)
    J = 0.5 * np.array(rows) @ np.array(rows).T
    return np.sqrt(np.diag(np.linalg.inv(J)))


# ---------------------------------------------------------------- 1 accuracy and intervals


def fitted_law(law: Law, grid: Ordinates) -> Fit:
    """Fit of the given kinds, each started from the data as the selection does."""
    current = fit((white_start(grid),), grid)
    for name, _ in law[1:]:
        starts = CATALOGUE[name].starts(current.residual)  # type: ignore[attr-defined]
        trials = [fit((*current.effects, s), grid) for s in starts]
        current = max(trials, key=lambda t: t.log_likelihood)
    return current


def one_law(name: str, seed: int) -> list[list[float]] | None:
    """Estimates with their interval ends, (p,) each, Gauss-Markov terms in order of memory."""
    law = LAWS[name]
    y = record(law, np.random.default_rng([1, seed, list(LAWS).index(name)]))
    grid = ordinates(cosine_coefficients(y), DT)
    try:
        fitted = fitted_law(law, grid)
        peaks = tuple(values[0] for kind, values in law if kind == "narrow_band")
        if peaks:  # narrow bins about a narrow band, as the pipeline has them
            grid = ordinates(cosine_coefficients(y), DT, peaks)
            fitted = fit(fitted.effects, grid)
        found, _ = estimates(fitted, "u")
    except ValueError:
        return None
    white_first = sorted(
        found, key=lambda e: (e.name != "white_noise", getattr(e.effect, "correlation_time_s", 0))
    )
    rows = [x for e in white_first for x in e.estimates]
    lower = [0.0 if x.lower is None else x.lower for x in rows]
    upper = [np.inf if x.upper is None else x.upper for x in rows]
    return [[float(x.value) for x in rows], lower, upper]


def study_laws(kept: KeptRuns, runs: int) -> str:
    lines = [
        "## 1. Accuracy and intervals\n",
        f"{DURATION_S:.0f} s at {RATE_HZ:.0f} Hz, {runs} runs a law; in the logarithm of each "
        "parameter.  Standard errors of the Monte Carlo in brackets.  Flicker is made as a sum of "
        "Gauss-Markov terms.\n",
        "| law | parameter | bound | RMSE/bound | bias/RMSE | covered |",
        "|---|---|---|---|---|---|",
    ]
    for name, law in LAWS.items():
        results = kept.map(one_law, [(name, seed) for seed in range(runs)])
        found = [r for r in results if r is not None]
        value, lower, upper = np.array(found).swapaxes(0, 1)
        truth = np.array([v for _, values in law for v in values])
        error = np.log(value / truth)
        rmse = np.sqrt(np.mean(error**2, axis=0))
        spread = np.std(error**2, axis=0) / np.sqrt(len(found)) / (2.0 * rmse)
        bias = error.mean(axis=0) / rmse
        covered = np.mean((lower <= truth) & (truth <= upper), axis=0)
        limit = bound(law)
        labels = [f"{kind}.{p.name}" for kind, _ in law for p in CATALOGUE[kind].parameters]
        for i, label in enumerate(labels):
            lines.append(
                f"| {name} | {label} | {limit[i]:.4f} | {rmse[i] / limit[i]:.3f} "
                f"({spread[i] / limit[i]:.3f}) | {bias[i]:+.2f} ({len(found) ** -0.5:.2f}) | "
                f"{covered[i]:.3f} ({np.sqrt(covered[i] * (1 - covered[i]) / len(found)):.3f}) |"
            )
        if len(found) < runs:
            lines.append(f"| {name} | | | {runs - len(found)} runs without a fit | | |")
        print(*lines[-len(labels) :], sep="\n", flush=True)
    return "\n".join(lines) + "\n"


# ---------------------------------------------------------------- 3 structure


def one_structure(index: int, seed: int) -> tuple[str, tuple[str, ...]]:
    """Names chosen by the whole pipeline, and what it says of names that fit equally."""
    _, law, n = CASES[index]
    y = record(law, np.random.default_rng([3, seed, index]), n)
    model = estimate_series(
        Series(y, np.ones(n, dtype=bool), DT), "u", np.random.default_rng(index)
    )
    names = " + ".join(sorted(e.name for e in model.effects))
    return names, tuple(e.note for e in model.effects if "between" in e.note)


def expected_ratio(law: Law, n: int) -> tuple[float, str]:
    """Smallest expected log-likelihood ratio of the law over another set, nats, and that set.

    The true spectrum is taken as data; every effect is left out, and every one swapped.
    """
    theta = np.log([v for _, values in law for v in values])
    y = np.ones(n)
    grid = ordinates(cosine_coefficients(y), DT)
    f = grid.frequency_hz
    exact = Ordinates(f, spectrum(law, theta, f), grid.dof, DT, n * DT)
    best, label = np.inf, ""
    kinds = [k for k in SPECTRA if k not in ("white_noise", "narrow_band")]
    for i in range(1, len(law)):
        rest = law[:i] + law[i + 1 :]
        for kind in (None, *kinds):
            others = [k for k, _ in rest] + ([kind] if kind else [])
            if sorted(others) == sorted(k for k, _ in law):
                continue
            try:
                other = fitted_law(tuple((k, ()) for k in others), exact)
            except ValueError:
                continue
            ratio = exact.power / other.spectrum.psd
            gain = float(0.5 * grid.dof @ (ratio - 1.0 - np.log(ratio)))
            if gain < best:
                best, label = gain, " + ".join(sorted(others))
    return best, label


def study_structure(kept: KeptRuns, runs: int) -> str:
    lines = [
        "## 3. Structure\n",
        f"At {RATE_HZ:.0f} Hz through the whole pipeline (lines, courses, outliers and rounding "
        f"looked for too): {10 * runs} records of white noise, {runs} of each other law.  `next` "
        "is the set with the smallest expected log-likelihood ratio, in nats: from 20 the right "
        'set is asked for, below 5 "between A and B".  The last column counts the records where '
        "it was said, then those where the right set was chosen or what it lacks is one of the "
        "names said.\n",
        "| law | s | expected ratio, next | right set | most often else | between said, or right |",
        "|---|---|---|---|---|---|",
    ]
    for index, (name, law, n) in enumerate(CASES):
        count = 10 * runs if len(law) == 1 else runs
        results = kept.map(one_structure, [(index, seed) for seed in range(count)])
        names = Counter(found for found, _ in results)
        right = " + ".join(sorted(k for k, _ in law))
        share = names[right] / count
        other = next((f"{k} ({c})" for k, c in names.most_common() if k != right), "")
        gain, label = expected_ratio(law, n) if len(law) > 1 else (0.0, "")
        said = sum(bool(notes) for _, notes in results)
        either = sum(found == right or _names(notes, found, law) for found, notes in results)
        error = np.sqrt(share * (1 - share) / count)
        lines.append(
            f"| {name} | {n * DT:.0f} | {f'{gain:.3g}, {label}' if label else ''} | {share:.3f} "
            f"({error:.3f}) | {other} | {said}, {either} of {count} |"
        )
        print(lines[-1], flush=True)
    return "\n".join(lines) + "\n"


def _names(notes: tuple[str, ...], found: str, law: Law) -> bool:
    """Whether a note names what the set that was chosen lacks."""
    missing = Counter(k for k, _ in law) - Counter(found.split(" + "))
    return bool(missing) and all(any(k in note for note in notes) for k in missing)


# ---------------------------------------------------------------- 4 contamination


def one_contaminated(kind: str, seed: int) -> float:
    """log(estimate/truth) of the white density."""
    rng = np.random.default_rng([4, seed])
    n, dt = 120000, 0.005
    y = white(n, dt, rng, 1.0) + walk(n, dt, rng, 0.05) + 3.0
    observed = np.ones(n, dtype=bool)
    if kind == "outliers":
        hit = rng.random(n) < 1e-4
        y[hit] += rng.choice([-1.0, 1.0], hit.sum()) * 20.0 / np.sqrt(dt)
    elif kind == "lost":
        observed = rng.random(n) > 0.05
        gap = int(rng.integers(10000, n - 34000))
        observed[gap : gap + 24000] = False
        y[~observed] = 0.0
    model = estimate_series(Series(y, observed, dt), "u", rng)
    found = next((e.effect for e in model.effects if e.name == "white_noise"), None)
    return float(np.log(found.values()[0])) if found else np.nan  # type: ignore[arg-type]


def study_contamination(kept: KeptRuns, runs: int) -> str:
    lines = [
        "## 4. Contamination\n",
        f"600 s at 200 Hz, white noise and a walk, {runs} runs each: error of the white density.\n",
        "| record | mean error | RMSE | worst |",
        "|---|---|---|---|",
    ]
    titles = {
        "clean": "clean",
        "outliers": "0.01 % outliers of 20 sigma",
        "lost": "5 % lost samples and a 120 s gap",
    }
    for kind, title in titles.items():
        error = np.array(kept.map(one_contaminated, [(kind, seed) for seed in range(runs)]))
        lines.append(
            f"| {title} | {100 * error.mean():+.3f} % ({100 * error.std() / runs**0.5:.3f}) | "
            f"{100 * np.sqrt(np.mean(error**2)):.3f} % | {100 * np.abs(error).max():.2f} % |"
        )
    return "\n".join(lines) + "\n"


STUDIES: dict[str, Callable[[KeptRuns, int], str]] = {
    "laws": study_laws,
    "structure": study_structure,
    "contamination": study_contamination,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--only", nargs="*", choices=list(STUDIES), default=list(STUDIES))
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument(
        "--output", type=Path, default=Path(__file__).parents[1] / "docs" / "study_identify.md"
    )
    parser.add_argument(
        "--results", type=Path, default=Path(__file__).parents[1] / "build" / "study_identify.jsonl"
    )
    options = parser.parse_args()
    kept = KeptRuns(options.results, options.workers)
    parts = ["# Identification against truth\n", __doc__.split("\n\n")[1].replace("\n", " ") + "\n"]
    for name in options.only:
        begun = time.perf_counter()
        parts.append(STUDIES[name](kept, options.runs))
        print(f"{name}: {time.perf_counter() - begun:.0f} s", flush=True)
    options.output.parent.mkdir(exist_ok=True)
    options.output.write_text("\n".join(parts))


if __name__ == "__main__":
    main()
