"""Recordings with a hidden effect, made by code that shares nothing with the catalogue.

numpy only; nothing of the suite is imported.  The forms differ from the catalogue's on purpose:
lines wander in phase, ramps are curved, steps have edges, hits are uniform, resonances are driven
by Laplacian noise, dwell times are gamma distributed.  Strengths are asked for in nats, the
log-likelihood that a perfect fit is expected to gain, and turned into amplitudes by the formulas
below (Gaussian noise of spectrum S, ordinates k/2T); slow courses also gain a third of that over
the best random walk.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

IMU_CHANNELS = (
    *(f"angular_velocity.{a}" for a in "xyz"),
    *(f"linear_acceleration.{a}" for a in "xyz"),
)
CERTAIN = float("inf")


@dataclass
class Hidden:
    """Arrays of one topic with what was hidden in them.

    ``truth`` maps a channel to the names of what was hidden there; ``gain`` is the
    expected log-likelihood gain of the weakest hidden effect in nats.
    """

    kind: str
    stamp_ns: np.ndarray
    values: dict[str, np.ndarray]
    rate_hz: float
    truth: dict[str, tuple[str, ...]] = field(default_factory=dict)
    gain: float = 0.0
    temperature: np.ndarray | None = None
    temperature_ns: np.ndarray | None = None


@dataclass(frozen=True)
class Sensor:
    """White noise and one exponentially correlated term, per channel."""

    white: float
    slow_sigma: float
    slow_time_s: float
    level: float


def sensors(seed: int, names: tuple[str, ...] = IMU_CHANNELS) -> dict[str, Sensor]:
    """Six different channels of one made-up sensor."""
    rng = np.random.default_rng([seed, 1])
    out = {}
    for name in names:
        white = (1e-4 if name.startswith("ang") else 1e-3) * rng.uniform(0.7, 1.5)
        time_s = rng.uniform(15.0, 60.0)
        slow = white * rng.uniform(1.0, 2.5) / np.sqrt(2.0 * time_s)
        out[name] = Sensor(white, slow, time_s, rng.uniform(-0.01, 0.01))
    return out


def spectrum(sensor: Sensor, f: np.ndarray) -> np.ndarray:
    """Two-sided spectrum of the clean channel."""
    T = sensor.slow_time_s
    return sensor.white**2 + 2.0 * sensor.slow_sigma**2 * T / (1.0 + (2.0 * np.pi * f * T) ** 2)


def clean(sensor: Sensor, n: int, dt: float, rng: np.random.Generator) -> np.ndarray:
    """White noise plus a recursion x <- a x + w, run in Python floats from its own law."""
    fast = rng.standard_normal(n) * sensor.white / np.sqrt(dt)
    return fast + recursion(n, dt, sensor.slow_sigma, sensor.slow_time_s, rng) + sensor.level


def recursion(
    n: int, dt: float, sigma: float, time_s: float, rng: np.random.Generator
) -> np.ndarray:
    """Exponentially correlated noise, uniform increments."""
    a = float(np.exp(-dt / time_s))
    w = rng.uniform(-1.0, 1.0, n) * np.sqrt(3.0) * sigma * np.sqrt(1.0 - a * a)
    out, x = np.empty(n), sigma * float(rng.standard_normal())
    for k, v in enumerate(w.tolist()):
        x = a * x + v
        out[k] = x
    return out


# --- expected gains ---------------------------------------------------------------------------


def gain_of_signal(signal: np.ndarray, sensor: Sensor, dt: float) -> float:
    """Half the energy of a known signal over the noise spectrum."""
    n = signal.size
    centred = signal - signal.mean()
    mirrored = np.concatenate((centred, centred[::-1]))
    power = np.abs(np.fft.rfft(mirrored)[1:n]) ** 2 * dt / (2.0 * n)
    f = np.arange(1, n) / (2.0 * n * dt)
    return 0.5 * float(np.sum(power / spectrum(sensor, f)))


def gain_of_spectrum(extra: np.ndarray, sensor: Sensor, f: np.ndarray) -> float:
    """Sum of (r - 1 - log r)/2, r the ratio of spectra with and without."""
    r = 1.0 + extra / spectrum(sensor, f)
    return 0.5 * float(np.sum(r - 1.0 - np.log(r)))


def amplitude_for(gain, target: float, low: float, high: float) -> float:
    """Amplitude at which an increasing ``gain(amplitude)`` reaches the target, by bisection."""
    for _ in range(60):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if gain(middle) < target else (low, middle)
    return float(np.sqrt(low * high))


def scaled_signal(shape: np.ndarray, sensor: Sensor, dt: float, nats: float) -> np.ndarray:
    """A course of the wanted gain."""
    return shape * float(np.sqrt(nats / gain_of_signal(shape, sensor, dt)))


def scaled_course(shape: np.ndarray, sensor: Sensor, dt: float, nats: float) -> np.ndarray:
    """A slow course of the wanted gain over nothing, and a third of it over the best walk."""
    n = shape.size
    centred = shape - shape.mean()
    mirrored = np.concatenate((centred, centred[::-1]))
    k = np.arange(1, min(n, 2000))
    f = k / (2.0 * n * dt)
    S = spectrum(sensor, f)
    power = np.abs(np.fft.rfft(mirrored)[k]) ** 2 * dt / (2.0 * n) / S
    walk_law = 1.0 / (2.0 * np.pi * f) ** 2 / S
    scales = np.exp(np.linspace(-12.0, 12.0, 97)) / np.sqrt(walk_law[0])
    ratio = 1.0 + np.outer(scales**2, walk_law)

    def over_walk(amplitude: float) -> float:
        seen = 1.0 + amplitude**2 * power
        walk = -0.5 * np.sum(np.log(ratio) + seen / ratio, axis=1)
        return float(-0.5 * k.size - walk.max())

    alone = float(np.sqrt(nats / gain_of_signal(shape, sensor, dt)))
    if over_walk(alone) >= nats / 3.0:
        return shape * alone
    return shape * amplitude_for(over_walk, nats / 3.0, alone, 1e6 * alone)


def _ordinates(n: int, dt: float) -> np.ndarray:
    return np.arange(1, n) / (2.0 * n * dt)


# --- effects on one channel: (values, sensor, dt, nats, rng) -> (values, gain) ------------------


def line(x, sensor, dt, nats, rng):
    t = np.arange(x.size) * dt
    f0 = rng.uniform(5.0, 0.45 / dt) if dt < 0.05 else rng.uniform(0.5, 4.0)
    wander = np.cumsum(rng.standard_normal(x.size)) * 0.25 / np.sqrt(x.size)
    shape = np.sin(2.0 * np.pi * f0 * t + wander + rng.uniform(0.0, 6.0))
    return x + scaled_signal(shape, sensor, dt, nats), nats


def resonance(x, sensor, dt, nats, rng):
    n = x.size
    f0 = rng.uniform(0.1, 0.35) / dt
    width = f0 * rng.uniform(0.01, 0.03)
    f = np.fft.rfftfreq(n, dt)
    drive = np.fft.rfft(rng.laplace(size=n))
    shape = np.fft.irfft(drive / (1.0 - (f / f0) ** 2 + 1j * width / f0 * f / f0), n)
    shape /= shape.std()
    k = _ordinates(n, dt)
    law = 1.0 / ((1.0 - (k / f0) ** 2) ** 2 + (width * k / f0**2) ** 2)
    law *= 1.0 / (2.0 * np.sum(law) * (k[1] - k[0]))
    a = amplitude_for(lambda s: gain_of_spectrum(s * s * law, sensor, k), nats, 1e-9, 1e3)
    return x + a * shape, nats


def wander(x, sensor, dt, nats, rng):
    """Second exponentially correlated term, faster than the first."""
    n = x.size
    time_s = float(np.exp(rng.uniform(np.log(0.1), np.log(1.5)))) * (1.0 if dt < 0.05 else 10.0)
    k = _ordinates(n, dt)
    law = 2.0 * time_s / (1.0 + (2.0 * np.pi * k * time_s) ** 2)
    a = amplitude_for(lambda s: gain_of_spectrum(s * s * law, sensor, k), nats, 1e-9, 1e3)
    return x + recursion(n, dt, a, time_s, rng), nats


def walk(x, sensor, dt, nats, rng):
    n = x.size
    k = _ordinates(n, dt)
    law = 1.0 / (2.0 * np.pi * k) ** 2
    a = amplitude_for(lambda s: gain_of_spectrum(s * s * law, sensor, k), nats, 1e-12, 1e3)
    steps = rng.standard_t(6.0, n) / np.sqrt(1.5) * a * np.sqrt(dt)
    return x + np.cumsum(steps), nats


def flicker(x, sensor, dt, nats, rng):
    n = x.size
    f = np.fft.rfftfreq(4 * n, dt)
    f[0] = f[1]
    phases = np.exp(2j * np.pi * rng.random(f.size)) * rng.rayleigh(1.0, f.size)
    shape = np.fft.irfft(phases / f**0.51, 4 * n)[:n]
    k = _ordinates(n, dt)
    # rayleigh squared has mean 2; two-sided density of irfft's output
    law = 2.0 * dt / (4 * n) * k**-1.02
    a = amplitude_for(lambda s: gain_of_spectrum(s * s * law, sensor, k), nats, 1e-12, 1e12)
    return x + a * shape, nats


def granular(x, sensor, dt, nats, rng):
    """Differences of uniform noise."""
    k = _ordinates(x.size, dt)
    law = 4.0 * np.sin(np.pi * k * dt) ** 2 * dt / 12.0
    a = amplitude_for(lambda s: gain_of_spectrum(s * s * law, sensor, k), nats, 1e-12, 1e3)
    return x + a * np.diff(rng.random(x.size + 1)), nats


def louder(x, sensor, dt, nats, rng):
    k = _ordinates(x.size, dt)
    ones = np.full(k.size, dt)
    a = amplitude_for(lambda s: gain_of_spectrum(s * s * ones, sensor, k), nats, 1e-12, 1e3)
    return x + a * rng.standard_normal(x.size), nats


def ramp(x, sensor, dt, nats, rng):
    u = np.linspace(0.0, 1.0, x.size)
    return x + scaled_course(rng.choice([-1, 1]) * (u + 0.2 * u**2), sensor, dt, nats), nats


def step(x, sensor, dt, nats, rng):
    t = np.arange(x.size) * dt
    at = rng.uniform(0.2, 0.8) * t[-1]
    edge = 0.15 if dt < 0.05 else 1.0
    shape = rng.choice([-1, 1]) * np.tanh((t - at) / edge)
    return x + scaled_course(shape, sensor, dt, nats), nats


def burst(x, sensor, dt, nats, rng):
    n = x.size
    m = int(rng.uniform(0.03, 0.2) * n)
    first = int(rng.uniform(0.05, 0.9 - m / n) * n)
    edge = m // 20
    window = np.zeros(n)
    window[first : first + m] = 1.0
    window[first : first + edge] = np.linspace(0.0, 1.0, edge)
    window[first + m - edge : first + m] = np.linspace(1.0, 0.0, edge)
    ratio = amplitude_for(lambda a: 0.5 * m * (a - np.log1p(a)), nats, 1e-6, 1e3)
    sigma = sensor.white / np.sqrt(dt)
    return x + window * np.sqrt(ratio) * sigma * rng.standard_normal(n), nats


def popcorn(x, sensor, dt, nats, rng):
    """Two levels, gamma distributed dwell times."""
    n = x.size
    dwell_s = rng.uniform(4.0, 15.0) * (1.0 if dt < 0.05 else 6.0)
    dwells = rng.gamma(1.5, dwell_s / 1.5, int(3 * n * dt / dwell_s) + 20)
    level = np.searchsorted(np.cumsum(dwells), np.arange(n) * dt) % 2
    k = _ordinates(n, dt)
    law = 0.25 * dwell_s / (1.0 + (np.pi * k * dwell_s) ** 2)
    a = amplitude_for(lambda s: gain_of_spectrum(s * s * law, sensor, k), nats, 1e-9, 1e3)
    return x + a * level, nats


def hits(x, sensor, dt, nats, rng):
    sigma = sensor.white / np.sqrt(dt)
    count = max(int(nats / 30.0), 3)
    at = rng.choice(x.size, count, replace=False)
    out = x.copy()
    out[at] += rng.choice([-1, 1], count) * rng.uniform(9.0, 25.0, count) * sigma
    return out, float(count) * 40.0


def truncated(x, sensor, dt, nats, rng):
    """Floor to a grid with an offset."""
    sigma = sensor.white / np.sqrt(dt)
    grid = sigma * rng.uniform(0.15, 0.8)
    offset = rng.uniform(0.0, grid)
    return np.floor((x - offset) / grid) * grid + offset, CERTAIN


def clipped(x, sensor, dt, nats, rng):
    limit = abs(sensor.level) + rng.uniform(1.8, 2.8) * x.std()
    return np.clip(x, -limit, limit), CERTAIN


def sluggish(x, sensor, dt, nats, rng):
    """The fast noise through a second-order low pass at eight times the rate, then sampled."""
    over = 8
    f0 = rng.uniform(0.12, 0.3) / dt
    q = rng.uniform(0.5, 0.9)
    K = np.tan(np.pi * f0 * dt / over)
    norm = 1.0 / (1.0 + K / q + K * K)
    b, a1, a2 = K * K * norm, 2.0 * (K * K - 1.0) * norm, (1.0 - K / q + K * K) * norm
    drive = rng.standard_normal(x.size * over) * sensor.white / np.sqrt(dt / over)
    out, (u1, u2, y1, y2) = np.empty(x.size * over), (0.0, 0.0, 0.0, 0.0)
    for k, u in enumerate(drive.tolist()):
        y = b * (u + 2.0 * u1 + u2) - a1 * y1 - a2 * y2
        u2, u1, y2, y1 = u1, u, y1, y
        out[k] = y
    slow = recursion(x.size, dt, sensor.slow_sigma, sensor.slow_time_s, rng)
    return out[::over] + slow + sensor.level, CERTAIN


def smeared(x, sensor, dt, nats, rng):
    """A boxcar of one sample and a fraction."""
    a = rng.uniform(0.1, 0.4)
    w = np.array([1.0, a]) / (1.0 + a)
    return np.convolve(x, w)[: x.size], CERTAIN


# --- outside the catalogue ----------------------------------------------------------------------


def chirp(x, sensor, dt, nats, rng):
    t = np.arange(x.size) * dt
    f0, f1 = 0.1 / dt, 0.3 / dt
    shape = np.sin(2.0 * np.pi * (f0 * t + 0.5 * (f1 - f0) * t**2 / t[-1]))
    return x + scaled_signal(shape, sensor, dt, 200.0 * nats), nats


def breathing(x, sensor, dt, nats, rng):
    """Noise whose loudness swings."""
    t = np.arange(x.size) * dt
    sigma = sensor.white / np.sqrt(dt)
    extra = np.sqrt(0.5) * sigma * (1.0 + np.sin(2.0 * np.pi * rng.uniform(0.3, 3.0) * t))
    return x + extra * rng.standard_normal(x.size), CERTAIN


def lopsided(x, sensor, dt, nats, rng):
    """Skewed noise of the same variance."""
    sigma = sensor.white / np.sqrt(dt)
    return x + sigma * (rng.exponential(1.0, x.size) - 1.0), CERTAIN


def ringing(x, sensor, dt, nats, rng):
    """Decaying oscillations after shocks at random times."""
    n = x.size
    t = np.arange(400) * dt
    kernel = np.exp(-t / (60 * dt)) * np.sin(2.0 * np.pi * 0.12 / dt * t)
    shocks = np.zeros(n)
    shocks[rng.choice(n - 500, 40, replace=False)] = rng.choice([-1.0, 1.0], 40)
    shape = np.convolve(shocks, kernel)[:n]
    return x + scaled_signal(shape, sensor, dt, 8.0 * nats), nats


ON_ONE_CHANNEL = {
    "periodic": (line, ("periodic",)),
    "narrow_band": (resonance, ("narrow_band",)),
    "gauss_markov": (wander, ("gauss_markov",)),
    "rate_random_walk": (walk, ("rate_random_walk",)),
    "bias_instability": (flicker, ("bias_instability",)),
    "quantization": (granular, ("quantization",)),
    "white_noise": (louder, ("white_noise",)),
    "rate_ramp": (ramp, ("rate_ramp",)),
    "bias_step": (step, ("bias_step",)),
    "variance_change": (burst, ("variance_change",)),
    "random_telegraph": (popcorn, ("random_telegraph",)),
    "outliers": (hits, ("outliers",)),
    "output_rounding": (truncated, ("output_rounding",)),
    "saturation": (clipped, ("saturation",)),
    "bandwidth_limit": (sluggish, ("bandwidth_limit",)),
    "averaging": (smeared, ("averaging",)),
}
OUTSIDE = {"chirp": chirp, "breathing": breathing, "lopsided": lopsided, "ringing": ringing}
ON_THE_TOPIC = ("held_samples", "timestamp_jitter", "dropouts", "cross_axis", "temperature")
KINDS = (*ON_ONE_CHANNEL, *ON_THE_TOPIC)


def recording(
    kind: str,
    nats: float,
    seed: int,
    duration_s: float = 600.0,
    rate_hz: float = 200.0,
    names: tuple[str, ...] = IMU_CHANNELS,
    sensor_seed: int | None = None,
    noise_seed: int | None = None,
) -> Hidden:
    """One recording with one hidden effect, or with none (``kind`` "nothing").

    ``a+b`` hides two effects on two channels, ``a&b`` two on one.  The clean sensor depends on
    ``sensor_seed``, its noise on ``noise_seed`` (``seed`` where not given), the effect on ``seed``.
    """
    rng = np.random.default_rng([seed if noise_seed is None else noise_seed, 2])
    made = sensors(seed if sensor_seed is None else sensor_seed, names)
    n, dt = round(duration_s * rate_hz), 1.0 / rate_hz
    values = {name: clean(made[name], n, dt, rng) for name in names}
    out = Hidden(kind, np.rint(np.arange(n) * dt * 1e9).astype(np.int64), values, rate_hz)
    _warm(out, duration_s, rng)
    rng = np.random.default_rng([seed, 3])
    for part in kind.split("+"):
        name = str(rng.choice([name for name in names if name not in out.truth]))
        for single in part.split("&"):
            _hide(out, single, nats, made, rng, name)
    return out


def _warm(out: Hidden, duration_s: float, rng: np.random.Generator) -> None:
    """A temperature that warms up and wanders, once a second."""
    t = np.arange(int(duration_s))
    course = 25.0 + 6.0 * (1.0 - np.exp(-t / (0.3 * duration_s)))
    course += 0.4 * np.sin(2.0 * np.pi * t / (0.23 * duration_s) + rng.uniform(0, 6))
    out.temperature = course + 0.01 * rng.standard_normal(t.size)
    out.temperature_ns = (t * 1_000_000_000).astype(np.int64)


def _hide(
    out: Hidden, kind: str, nats: float, made: dict, rng: np.random.Generator, name: str
) -> None:
    names = list(out.values)
    dt = 1.0 / out.rate_hz
    if kind in ON_ONE_CHANNEL or kind in OUTSIDE:
        make, right = ON_ONE_CHANNEL.get(kind) or (OUTSIDE[kind], ("",))
        out.values[name], out.gain = make(out.values[name], made[name], dt, nats, rng)
        out.truth[name] = (*out.truth.get(name, ()), *right)
    elif kind == "temperature":
        assert out.temperature is not None
        t = np.arange(out.values[name].size) * dt
        lagged = np.interp(t - 4.0, np.arange(out.temperature.size), out.temperature)
        shape = lagged - lagged.mean()
        out.values[name] = out.values[name] + scaled_course(shape, made[name], dt, nats)
        out.truth[name], out.gain = (*out.truth.get(name, ()), "temperature"), nats
    elif kind == "cross_axis":
        other = str(rng.choice([n for n in names if n != name]))
        _share(out, (name, other), made, nats, rng)
    elif kind in ON_THE_TOPIC:
        _transport(out, kind, rng)
    elif kind != "nothing":
        raise ValueError(kind)


def _share(out: Hidden, pair: tuple[str, str], made: dict, nats: float, rng) -> None:
    """Each of two channels leaks the same noise; correlation r gains -n/2 log(1 - r^2)."""
    n = out.values[pair[0]].size
    r = float(np.sqrt(-np.expm1(-2.0 * nats / n)))
    share = np.sqrt(r / (1.0 - r))
    common = rng.standard_normal(n)
    for name in pair:
        sigma = made[name].white * np.sqrt(out.rate_hz)
        out.values[name] = out.values[name] + share * sigma * common
        out.truth[name] = ("cross_axis",)
    out.gain = nats


def _transport(out: Hidden, kind: str, rng: np.random.Generator) -> None:
    n = out.stamp_ns.size
    if kind == "held_samples":
        factor = int(rng.integers(2, 6))
        phase = int(rng.integers(factor))
        index = np.maximum((np.arange(n) - phase) // factor * factor + phase, 0)
        out.values = {k: v[index] for k, v in out.values.items()}
    elif kind == "timestamp_jitter":
        width = 0.08 / out.rate_hz
        out.stamp_ns = out.stamp_ns + np.rint(rng.uniform(-width, width, n) * 1e9).astype(np.int64)
    else:
        keep = np.ones(n, dtype=bool)
        for start in rng.choice(n - 60, int(rng.integers(5, 30)), replace=False):
            keep[start + 1 : start + 1 + int(rng.integers(2, 40))] = False
        out.stamp_ns = out.stamp_ns[keep]
        out.values = {k: v[keep] for k, v in out.values.items()}
    out.truth = dict.fromkeys(out.values, (kind,))
    out.gain = CERTAIN
