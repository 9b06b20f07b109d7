"""A public case: white noise and a slow Gauss-Markov bias, as Nikolic (2016) has them.

Writes ``docs/study_nikolic.md``.  12 h at 400 Hz: white density 1.064e-4, a bias x' = -x/T_c + w of
diffusion density 1.148e-6 and T_c = 530.8 s (standard deviation diffusion sqrt(T_c/2)).  Beside the
identification as a user gets it, effects chosen by itself: reading slopes of the Allan curve,
non-negative least squares on N, B and K, and a fit of the wavelet variances in the manner of GMWM.
The three are written here, and so are the records and the Cramer-Rao bound.

    python study/study_nikolic.py [--runs 10] [--hours 12] [--results FILE]

Every run is one line of ``--results``; what is there already is not repeated.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from imu_noise_id.effects.gauss_markov import GaussMarkov
from imu_noise_id.estimation import estimate_series
from imu_noise_id.intervals import estimates
from imu_noise_id.ordinates import cosine_coefficients, ordinates
from imu_noise_id.selection import white_start
from imu_noise_id.series import Series
from imu_noise_id.whittle import fit
from kept_runs import KeptRuns
from numpy.typing import NDArray
from scipy.optimize import least_squares, nnls
from scipy.signal import lfilter

Floats = NDArray[np.float64]
RATE_HZ = 400.0
DT = 1.0 / RATE_HZ
WHITE, DIFFUSION, MEMORY_S = 1.064e-4, 1.148e-6, 530.8
TRUTH = np.array((WHITE, DIFFUSION, MEMORY_S))
PER_OCTAVE = 4
FLICKER = 2.0 * np.log(2.0) / np.pi

HEAD = """# A public case: Nikolic (2016)

Written by `study/study_nikolic.py --runs {runs} --hours {hours:g}`: {hours:g} h at 400 Hz, white
density 1.064e-4, diffusion density 1.148e-6, correlation time 530.8 s.  RMSE of each estimate as a
share of the truth, with the standard error of the Monte Carlo; *bound* is the Cramer-Rao bound of
the Whittle likelihood.  Ours comes twice: told the effects, as the others are, and choosing them.

| method | white noise | diffusion | correlation time |
|---|---|---|---|
"""


def record(n: int, rng: np.random.Generator) -> Floats:
    """White noise and a stationary Gauss-Markov bias by its exact recursion."""
    a = np.exp(-DT / MEMORY_S)
    sigma = DIFFUSION * np.sqrt(MEMORY_S / 2.0)
    drive = rng.standard_normal(n)
    drive *= sigma * np.sqrt(-np.expm1(-2.0 * DT / MEMORY_S))
    drive[0] = sigma * rng.standard_normal()
    slow = lfilter([1.0], [1.0, -a], drive)
    drive = rng.standard_normal(n)
    drive *= WHITE / np.sqrt(DT)
    return np.asarray(slow + drive)


def allan_variance(y: Floats) -> tuple[Floats, Floats]:
    """Overlapping Allan variance, four averaging times an octave up to a tenth of the record."""
    total = np.concatenate(([0.0], np.cumsum(y - y.mean())))
    octaves = int(PER_OCTAVE * np.log2(y.size / 10))
    m = np.unique(np.rint(2.0 ** (np.arange(octaves + 1) / PER_OCTAVE)).astype(int))
    out = []
    for size in m:
        step = max(size // 16, 1)
        ends = total[::step] if size % step == 0 else None
        k = size // step
        if ends is None:
            d = total[2 * size :] - 2.0 * total[size:-size] + total[: -2 * size]
        else:
            d = ends[2 * k :] - 2.0 * ends[k:-k] + ends[: -2 * k]
        out.append(0.5 * np.mean(d**2) / size**2)
    return m * DT, np.array(out)


def s_markov_allan(tau_s: Floats, diffusion: float, memory_s: float) -> Floats:
    """Allan variance of a Gauss-Markov process, IEEE Std 952."""
    x = tau_s / memory_s
    bracket = 1.0 - (3.0 - 4.0 * np.exp(-x) + np.exp(-2.0 * x)) / (2.0 * x)
    exact = (diffusion * memory_s) ** 2 / tau_s * bracket
    return np.where(x < 1e-3, diffusion**2 * tau_s / 3.0, exact)


def slopes(tau_s: Floats, variance: Floats) -> Floats:
    """N where the curve is read at 1 s, K where it rises most like the root of time."""
    n = np.sqrt(np.interp(1.0, tau_s, variance))
    slope = np.gradient(np.log(variance), np.log(tau_s))
    at = int(np.argmax(np.where(tau_s > 30.0, slope, -np.inf)))
    return np.array((n, np.sqrt(3.0 * variance[at] / tau_s[at]), np.nan))


def non_negative(tau_s: Floats, variance: Floats) -> Floats:
    """N^2/tau + 2 ln 2/pi B^2 + K^2 tau/3 by relative non-negative least squares."""
    design = np.stack((1.0 / tau_s, np.full_like(tau_s, FLICKER), tau_s / 3.0), axis=1)
    amounts, _ = nnls(design / variance[:, None], np.ones_like(variance))
    return np.array((np.sqrt(amounts[0]), np.sqrt(amounts[2]), np.nan))


def wavelet_moments(tau_s: Floats, variance: Floats, duration_s: float) -> Floats:
    """Minimum distance of log Haar wavelet variances (half Allan's), weighted by their number."""
    octave = np.log2(np.rint(tau_s / DT))
    kept = octave == np.rint(octave)
    tau_s, variance = tau_s[kept], variance[kept]
    weight = np.sqrt(np.maximum(duration_s / tau_s, 1.0))

    def misfit(theta: Floats) -> Floats:
        n, q, memory = np.exp(theta)
        model = n**2 / tau_s + s_markov_allan(tau_s, q, memory)
        return weight * np.log(variance / model)

    start = slopes(tau_s, variance)
    found = [
        least_squares(misfit, np.log((start[0], start[1], memory))) for memory in (30.0, 300.0, 3e3)
    ]
    return np.exp(min(found, key=lambda f: f.cost).x)


def ours(y: Floats) -> tuple[Floats, Floats, str]:
    """Estimates, whether each interval covers the truth (white, sigma, time), effects found."""
    model = estimate_series(
        Series(y, np.ones(y.size, dtype=bool), DT), "rad/s", np.random.default_rng(0)
    )
    value, covered = np.full(3, np.nan), np.full(3, np.nan)

    def held(row, truth: float) -> float:
        lower = -np.inf if row.lower is None else row.lower
        upper = np.inf if row.upper is None else row.upper
        return float(lower <= truth <= upper)

    for fitted in model.effects:
        rows = fitted.estimates
        if fitted.name == "white_noise":
            value[0], covered[0] = rows[0].value, held(rows[0], WHITE)
        elif fitted.name == "gauss_markov":
            sigma, memory = rows[0].value, rows[1].value
            value[1:] = sigma * np.sqrt(2.0 / memory), memory
            covered[1] = held(rows[0], DIFFUSION * np.sqrt(MEMORY_S / 2.0))
            covered[2] = held(rows[1], MEMORY_S)
        elif fitted.name == "rate_random_walk":
            value[1] = rows[0].value
    return value, covered, " + ".join(e.name for e in model.effects)


def told(y: Floats) -> Floats:
    """The same likelihood, told that the record is white noise and a Gauss-Markov process."""
    grid = ordinates(cosine_coefficients(y), DT)
    white = fit((white_start(grid),), grid)
    trials = [fit((*white.effects, s), grid) for s in GaussMarkov.starts(white.residual)]
    found = max(trials, key=lambda t: t.log_likelihood)
    density, sigma, memory = (v for e in estimates(found, "rad/s")[0] for v in e.effect.values())
    return np.array((density, sigma * np.sqrt(2.0 / memory), memory), dtype=float)


def bound(n: int) -> Floats:
    """Cramer-Rao bound of white, diffusion and time, as shares of them, from every ordinate."""
    f = np.arange(1, 200_001) / (2.0 * n * DT)  # beyond, all is white
    white = np.full_like(f, WHITE**2)
    slow = DIFFUSION**2 * MEMORY_S**2 / (1.0 + (2.0 * np.pi * f * MEMORY_S) ** 2)
    total = white + slow
    by_time = 2.0 * slow / (1.0 + (2.0 * np.pi * f * MEMORY_S) ** 2)
    rows = np.stack((2.0 * white, 2.0 * slow, by_time)) / total
    J = 0.5 * rows @ rows.T
    J[0, 0] += 0.5 * 4.0 * (n - f.size)
    return np.sqrt(np.diag(np.linalg.inv(J)))


def row(name: str, values: Floats) -> str:
    """RMSE in per cent with its standard error, for each parameter that the method gives."""
    cells = []
    for column, truth in zip(values.T, TRUTH, strict=True):
        seen = column[np.isfinite(column)]
        if seen.size == 0:
            cells.append("none")
            continue
        square = (seen / truth - 1.0) ** 2
        rmse = np.sqrt(square.mean())
        error = square.std() / np.sqrt(seen.size) / (2.0 * rmse)
        less = "" if seen.size == column.size else f", {seen.size} of {column.size}"
        cells.append(f"{100 * rmse:.2f} % ({100 * error:.2f}{less})")
    return f"| {name} | " + " | ".join(cells) + " |"


def page(runs: list[dict[str, Any]], hours: float) -> str:
    """Return the table of the runs so far."""
    methods = list(runs[0]["estimates"])
    lines = [row(name, np.array([run["estimates"][name] for run in runs])) for name in methods]
    cells = " | ".join(f"{100 * b:.2f} %" for b in bound(round(hours * 3600.0 * RATE_HZ)))
    lines.append(f"| bound | {cells} |")
    covered = np.array([run["covered"] for run in runs]).T
    share = [f"{int(np.nansum(c))} of {int(np.isfinite(c).sum())}" for c in covered]
    counts = Counter(run["effects"] for run in runs)
    chosen = ", ".join(f"{name} in {count}" for name, count in counts.items())
    tail = (
        f"\nOur 95 % intervals cover the white density in {share[0]} runs, the Gauss-Markov sigma\n"
        f"in {share[1]}, its correlation time in {share[2]}.  Effects chosen: {chosen}.\n"
    )
    return HEAD.format(runs=len(runs), hours=hours) + "\n".join(lines) + "\n" + tail


def one_run(hours: float, seed: int) -> dict[str, object]:
    """Estimates of every method on one record, whether ours covers the truth, what it chose."""
    n = round(hours * 3600.0 * RATE_HZ)
    y = record(n, np.random.default_rng([2, seed]))
    tau_s, variance = allan_variance(y)
    value, covered, effects = ours(y)
    rows = {
        "slopes": slopes(tau_s, variance),
        "non-negative least squares": non_negative(tau_s, variance),
        "GMWM-like": wavelet_moments(tau_s, variance, n * DT),
        "ours, effects given": told(y),
        "ours, effects chosen": value,
    }
    print(seed, rows, effects, flush=True)
    estimates = {name: row.tolist() for name, row in rows.items()}
    return {"estimates": estimates, "covered": covered.tolist(), "effects": effects}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--hours", type=float, default=12.0)
    parser.add_argument(
        "--output", type=Path, default=Path(__file__).parents[1] / "docs" / "study_nikolic.md"
    )
    parser.add_argument(
        "--results", type=Path, default=Path(__file__).parents[1] / "build" / "study_nikolic.jsonl"
    )
    options = parser.parse_args()
    kept = KeptRuns(options.results, 1)
    for count in range(1, options.runs + 1):  # the page grows with every run: each takes minutes
        runs = kept.map(one_run, [(options.hours, seed) for seed in range(count)])
        options.output.write_text(page(runs, options.hours))


if __name__ == "__main__":
    main()
