"""Every effect of the catalogue at a known size, played upon clean channels; numpy only.

For what a model says too much, too little or wrongly: nothing of the suite is imported.  Sizes are
in terms of a channel's white density w and its deviation a sample, w/sqrt(dt).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Floats = np.ndarray
Values = dict[str, float]
DT, N = 0.005, 120_000
OVERSAMPLED = 20
DROPPED = {"rate": 0.5, "mean_length_s": 0.05}


def sizes(w: float) -> dict[str, tuple[Values, str]]:
    """Parameters of each effect on a channel of white density w, and the one that is a size."""
    s = w / np.sqrt(DT)
    return {
        "white_noise": ({"density": w}, "density"),
        "quantization": ({"coefficient": 5.0 * w * DT}, "coefficient"),
        "bias_instability": ({"coefficient": 1.5 * w}, "coefficient"),
        "rate_random_walk": ({"coefficient": 0.5 * w}, "coefficient"),
        "gauss_markov": ({"sigma": 0.3 * s, "correlation_time_s": 1.0}, "sigma"),
        "rate_ramp": ({"slope": 0.02 * w}, "slope"),
        "periodic": ({"frequency_hz": 37.3, "amplitude": 0.1 * s}, "amplitude"),
        "narrow_band": ({"frequency_hz": 37.3, "bandwidth_hz": 2.0, "sigma": 0.3 * s}, "sigma"),
        "output_rounding": ({"step": 0.5 * s}, "step"),
        "outliers": ({"rate": 0.002, "scale": 8.0 * s}, "rate"),
        "bias_step": ({"time_s": 300.0, "height": 0.2 * s}, "height"),
        "variance_change": ({"from_s": 200.0, "to_s": 300.0, "ratio": 1.5}, "ratio"),
        "random_telegraph": ({"height": 0.5 * s, "mean_dwell_s": 10.0}, "height"),
        "saturation": ({"limit": 2.0 * s}, "limit"),
        "temperature": ({"coefficient": 0.1 * s}, "coefficient"),
        "bandwidth_limit": ({"cutoff_hz": 30.0, "order": 2.0, "damping": 0.7}, "cutoff_hz"),
        "averaging": ({"window_s": 0.012}, "window_s"),
        "held_samples": ({"factor": 4.0}, "factor"),
        "timestamp_jitter": ({"std_s": 3e-4}, "std_s"),
        "dropouts": (DROPPED, "rate"),
        "cross_axis": ({"correlation": 0.5}, "correlation"),
    }


TRANSPORT = ("held_samples", "timestamp_jitter", "dropouts")


def upon(
    kind: str, p: Values, x: Floats, w: float, heat: Floats, rng: np.random.Generator
) -> Floats:
    """The channel x with an effect; a filter's white noise is made anew beneath it."""
    t, s = DT * np.arange(N), w / np.sqrt(DT)
    added: dict[str, Callable[[], Floats]] = {
        "quantization": lambda: p["coefficient"] * _uniform_steps(rng),
        "bias_instability": lambda: p["coefficient"] * _flicker(rng),
        "rate_random_walk": lambda: np.cumsum(rng.normal(0, p["coefficient"] * DT**0.5, N)),
        "gauss_markov": lambda: _recursion(p["sigma"], p["correlation_time_s"], rng),
        "rate_ramp": lambda: p["slope"] * t,
        "periodic": lambda: p["amplitude"] * np.sin(2 * np.pi * p["frequency_hz"] * t + 1.0),
        "narrow_band": lambda: _band(p, rng),
        "outliers": lambda: (rng.random(N) < p["rate"]) * rng.normal(0, p["scale"], N),
        "bias_step": lambda: p["height"] * (t >= p["time_s"]),
        "variance_change": lambda: _louder(p, s, t, rng),
        "random_telegraph": lambda: p["height"] * _two_levels(p["mean_dwell_s"], rng),
        "temperature": lambda: p["coefficient"] * (heat - heat[0]),
    }
    if kind in added:
        return np.asarray(x + added[kind]())
    if kind == "output_rounding":
        return np.asarray(np.round(x / p["step"]) * p["step"])
    if kind == "saturation":
        return np.clip(x - x.mean(), -p["limit"], p["limit"])
    if kind in ("bandwidth_limit", "averaging"):
        return _filtered(kind, p, w, rng)
    return x


def _uniform_steps(rng: np.random.Generator) -> Floats:
    """What rounding leaves of an angle, of unit variance, differenced."""
    return np.asarray(np.diff(rng.uniform(0.0, 12**0.5, N + 1)) / DT)


def _flicker(rng: np.random.Generator) -> Floats:
    """Part of a periodic record four times as long, of the two-sided spectrum 1/(2 pi f)."""
    f = np.fft.rfftfreq(4 * N, DT)[1:]
    z = rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size)
    amplitudes = z * np.sqrt(N / DT / np.pi / f)
    return np.fft.irfft(np.concatenate(([0.0], amplitudes)))[:N]


def _recursion(sigma: float, time_s: float, rng: np.random.Generator) -> Floats:
    a = float(np.exp(-DT / time_s))
    kicks = (rng.uniform(-1, 1, N) * np.sqrt(3.0 * (1 - a * a)) * sigma).tolist()
    out, x = [], sigma * float(rng.standard_normal())
    for kick in kicks:
        x = a * x + kick
        out.append(x)
    return np.array(out)


def _band(p: Values, rng: np.random.Generator) -> Floats:
    f = np.fft.rfftfreq(N, DT)
    gain = 1.0 / np.sqrt(1.0 + (2.0 * (f - p["frequency_hz"]) / p["bandwidth_hz"]) ** 2)
    x = np.fft.irfft(np.fft.rfft(rng.standard_normal(N)) * gain)
    return np.asarray(x / x.std() * p["sigma"])


def _louder(p: Values, s: float, t: Floats, rng: np.random.Generator) -> Floats:
    inside = (t >= p["from_s"]) & (t < p["to_s"])
    return np.asarray(inside * np.sqrt(p["ratio"] - 1.0) * s * rng.standard_normal(N))


def _two_levels(dwell_s: float, rng: np.random.Generator) -> Floats:
    out, k, level = np.zeros(N), 0, 0.0
    while k < N:
        length = max(round(rng.exponential(dwell_s) / DT), 1)
        out[k : k + length], level, k = level, 1.0 - level, k + length
    return out


def _filtered(kind: str, p: Values, w: float, rng: np.random.Generator) -> Floats:
    dt = DT / OVERSAMPLED
    x = rng.standard_normal(N * OVERSAMPLED) * w / np.sqrt(dt)
    f = np.fft.rfftfreq(x.size, dt)
    if kind == "averaging":
        gain = np.sinc(f * p["window_s"]) + 0j
        # sampling folds more upon 0 Hz than w was there
        gain /= np.sqrt(np.sum(np.sinc(np.arange(-99, 100) * p["window_s"] / DT) ** 2))
    else:
        u = f / p["cutoff_hz"]
        gain = 1.0 / (1.0 - u**2 + 2j * p["damping"] * u)
    return np.fft.irfft(np.fft.rfft(x) * gain, x.size)[::OVERSAMPLED]


def shared(
    first: float, second: float, r: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """White noise of two channels of densities ``first`` and ``second``, correlated by r."""
    common, a, b = rng.standard_normal((3, N))
    own = np.sqrt(1.0 - r)
    return (
        (np.sqrt(r) * common + own * a) * first / np.sqrt(DT),
        (np.sqrt(r) * common + own * b) * second / np.sqrt(DT),
    )


def transported(
    kind: str, p: Values, stamp_ns: Floats, values: dict[str, Floats], rng: np.random.Generator
) -> tuple[Floats, dict[str, Floats]]:
    """Stamps and values after a transport that holds, loses or delays."""
    if kind == "held_samples":
        held = np.arange(N) // round(p["factor"]) * round(p["factor"])
        return stamp_ns, {name: x[held] for name, x in values.items()}
    if kind == "timestamp_jitter":
        return stamp_ns + np.rint(rng.normal(0, p["std_s"], N) * 1e9).astype(np.int64), values
    kept, k = np.ones(N, dtype=bool), 0
    while True:
        k += round(rng.exponential(1.0 / p["rate"]) / DT) + 1
        if k >= N:
            return stamp_ns[kept], {name: x[kept] for name, x in values.items()}
        length = int(rng.geometric(DT / p["mean_length_s"]))
        kept[k : k + length] = False
        k += length
