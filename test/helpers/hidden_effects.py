"""Recordings with a hidden effect, made by code that shares nothing with the catalogue.

numpy only; nothing of the suite is imported.  The forms differ from the catalogue's on purpose:
lines wander in phase, ramps are curved, steps have edges, hits are uniform, resonances are driven
by Laplacian noise, dwell times are gamma distributed.

Strengths are asked for in nats: the log-likelihood that a perfect fit is expected to gain over
none, and a third of it over the best other name, both before any noise is drawn.  *None* is a clean
sensor that explains two recordings alike, the one here and the one of equal length from which its
model came, in which nothing is hidden: what would lie inside that model's intervals is no gain.
(``trust`` says how much longer that one is; ``KNOWN`` where the model is the sensor itself.)
Another name adds one more effect to such a sensor, in this recording only.  All by Whittle's
formula on ordinates k/2T, expectations in the place of powers (``Strength``); a line, a narrow
band and a shared noise, which no clean sensor imitates, and a burst by closed forms.

What is far beyond any threshold however little there is of it (rounding, clipping, filters, what is
done to stamps, outliers) is not graded in nats: ``amount_of`` hides half as much of it where half
the nats of ``CLEAR_NATS`` are asked for.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

IMU_CHANNELS = (
    *(f"angular_velocity.{a}" for a in "xyz"),
    *(f"linear_acceleration.{a}" for a in "xyz"),
)
CERTAIN = float("inf")
CLEAR_NATS = 30.0
KNOWN = 1e4


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
    """White noise and one exponentially correlated term, per channel.

    ``trust`` is the length of the recording from which its model comes over that of the one with
    the effect: 1, or ``KNOWN`` where the model is the sensor's own.
    """

    white: float
    slow_sigma: float
    slow_time_s: float
    level: float
    trust: float = 1.0


def sensors(
    seed: int, names: tuple[str, ...] = IMU_CHANNELS, trust: float = 1.0
) -> dict[str, Sensor]:
    """Different channels of one made-up sensor."""
    rng = np.random.default_rng([seed, 1])
    out = {}
    for name in names:
        white = (1e-4 if name.startswith("ang") else 1e-3) * rng.uniform(0.7, 1.5)
        time_s = rng.uniform(15.0, 60.0)
        slow = white * rng.uniform(1.0, 2.5) / np.sqrt(2.0 * time_s)
        out[name] = Sensor(white, slow, time_s, rng.uniform(-0.01, 0.01), trust)
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


def amount_of(nats: float) -> float:
    """How much of an effect that nats do not grade, of what there is when it is clear."""
    return min(nats / CLEAR_NATS, 1.0)


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


BINS = 500
OTHERS = ("white_noise", "quantization", "rate_random_walk", "bias_instability", "gauss_markov")
SAME_SLOW = {"rate_random_walk", "gauss_markov"}


def _other_law(name: str, f: np.ndarray, dt: float, time_s: float) -> np.ndarray:
    if name == "white_noise":
        return np.ones_like(f)
    if name == "quantization":
        return 4.0 * np.sin(np.pi * f * dt) ** 2
    if name == "rate_random_walk":
        return 1.0 / (2.0 * np.pi * f) ** 2
    if name == "bias_instability":
        return 1.0 / f
    return 2.0 * time_s / (1.0 + (2.0 * np.pi * f * time_s) ** 2)


class Strength:
    """Expected gains on one sensor, on ``BINS`` log-spaced groups of ordinates."""

    def __init__(self, sensor: Sensor, n: int, dt: float) -> None:
        self.trust = sensor.trust
        edges = np.unique(np.rint(np.geomspace(1, n, BINS + 1)).astype(int))
        self.edges, self.n, self.dt, self.sensor = edges, n, dt, sensor
        self.count = np.diff(edges).astype(float)
        self.f = 0.5 * (edges[:-1] + edges[1:] - 1) / (2.0 * n * dt)
        self.clean = spectrum(sensor, self.f)

    def grouped(self, power: np.ndarray) -> np.ndarray:
        """Means over the groups of a power at the ordinates 1 ... n - 1."""
        return np.add.reduceat(power, self.edges[:-1] - 1) / self.count

    def ordinates(self, signal: np.ndarray) -> np.ndarray:
        """Cosine coefficients of a signal times sqrt(dt), 1 ... n - 1, sign kept."""
        n = signal.size
        turned = np.fft.rfft(np.concatenate((signal, signal[::-1])))[1:n]
        turned = turned * np.exp(-0.5j * np.pi * np.arange(1, n) / n)
        return turned.real * np.sqrt(self.dt / (2.0 * n))

    def gain(self, extra: np.ndarray, noisy: bool, other: str = "") -> float:
        """Nats over none, or over one other name, of an extra power per group.

        ``noisy``: the extra is noise, and the truth has its spectrum; else a signal, and the
        truth takes it away.
        """
        seen = self.clean + extra
        truth = self.trust * (np.log(self.clean) + 1.0)
        truth = truth + np.log(seen if noisy else self.clean) + 1.0
        theta = np.log([self.sensor.white, self.sensor.slow_sigma, self.sensor.slow_time_s])
        starts = [theta]
        if other:
            times = np.array([20.0, 500.0, 2e4]) * self.dt if other == "gauss_markov" else (1.0,)
            starts = []
            for time_s in times:
                law = _other_law(other, self.f, self.dt, time_s)
                amount = np.sum(self.count * extra * law / self.clean**2)
                amount /= np.sum(self.count * (law / self.clean) ** 2)
                more = [np.log(max(amount, 1e-300))]
                more += [np.log(time_s)] if other == "gauss_markov" else []
                starts.append(np.concatenate((theta, more)))
        return min(self._loss(start, seen, other) for start in starts) - 0.5 * float(
            np.sum(self.count * truth)
        )

    def _spectra(self, theta: np.ndarray, other: str) -> tuple[np.ndarray, np.ndarray]:
        white, sigma, time_s = np.exp(np.clip(theta[:3], -60.0, 30.0))
        first = spectrum(Sensor(white, sigma, time_s, 0.0), self.f)
        if not other:
            return first, first
        shortest = np.log(5.0 * self.dt)
        time_s = float(np.exp(np.clip(theta[4], shortest, 12.0))) if theta.size > 4 else 1.0
        return first, first + np.exp(theta[3]) * _other_law(other, self.f, self.dt, time_s)

    def _loss(self, theta: np.ndarray, seen: np.ndarray, other: str) -> float:
        """Least expected misfit of both recordings, by damped scoring."""

        def misfit(t: np.ndarray) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
            a, b = self._spectra(t, other)
            terms = self.trust * (np.log(a) + self.clean / a) + np.log(b) + seen / b
            return 0.5 * float(np.sum(self.count * terms)), (a, b)

        value, (a, b) = misfit(theta)
        damping = 1e-3
        for _ in range(40):
            moved = [self._spectra(theta + d, other) for d in 1e-4 * np.eye(theta.size)]
            Ja = np.array([(m[0] / a - 1.0) / 1e-4 for m in moved])
            Jb = np.array([(m[1] / b - 1.0) / 1e-4 for m in moved])
            w = 0.5 * self.count
            slope = Ja @ (self.trust * w * (self.clean / a - 1.0)) + Jb @ (w * (seen / b - 1.0))
            J = (Ja * (self.trust * w)) @ Ja.T + (Jb * w) @ Jb.T
            step = np.linalg.solve(J + np.diag(damping * np.diag(J) + 1e-9), slope)
            step *= min(1.0, 1.5 / max(float(np.abs(step).max()), 1e-12))
            trial, spectra = misfit(theta + step)
            if trial < value:
                done = value - trial < 1e-3
                theta, value, (a, b) = theta + step, trial, spectra
                damping = max(0.2 * damping, 1e-6)
                if done:
                    break
            else:
                damping *= 8.0
                if damping > 1e4:
                    break
        return value

    def noise(self, law: np.ndarray, nats: float, name: str) -> float:
        """Power of a noise of spectrum ``law`` at the ordinates, to be clearly present."""
        shape = self.grouped(law)
        group = SAME_SLOW if name in SAME_SLOW and name != "gauss_markov" else {name}
        if name == "random_telegraph":  # told by its levels from its twin, which no other law beats
            group = set(OTHERS)
        others = [o for o in OTHERS if o not in group]
        return self._enough(lambda power: self._least(power * shape, True, others, nats))

    def signal(self, shape: np.ndarray, nats: float, rivals: tuple[np.ndarray, ...] = ()) -> float:
        """Amplitude of a signal, to be clearly present; ``rivals`` are other courses."""
        courses = self.ordinates(shape - shape.mean())
        weight = 1.0 / np.repeat(self.clean, self.count.astype(int))
        rests = []
        for rival in rivals:
            r = self.ordinates(rival - rival.mean())
            rests.append(courses - r * float(r @ (weight * courses)) / float(r @ (weight * r)))
        whole = self.grouped(courses**2)
        left = [self.grouped(rest**2) for rest in rests]

        def least(power: float) -> float:
            others = ("rate_random_walk", "bias_instability", "gauss_markov")
            value = self._least(power * whole, False, others, nats)
            for rest in left:
                if value < 1.0:
                    break
                value = min(value, self.gain(power * rest, False) / (nats / 3.0))
            return value

        return float(np.sqrt(self._enough(least)))

    def _least(self, extra: np.ndarray, noisy: bool, others, nats: float) -> float:
        """Smallest of gain over none / nats and gain over each other name / (nats/3)."""
        value = self.gain(extra, noisy) / nats
        for other in others:
            if value < 1.0:
                break
            value = min(value, self.gain(extra, noisy, other) / (nats / 3.0))
        return value

    def _enough(self, least) -> float:
        """Smallest power at which ``least`` reaches 1, by bisection."""
        low = high = float(np.median(self.clean)) * 1e-8
        while least(high) < 1.0:
            low, high = high, 10.0 * high
        while high > 1.02 * low:
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if least(middle) < 1.0 else (low, middle)
        return high


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
    law = 2.0 * time_s / (1.0 + (2.0 * np.pi * _ordinates(n, dt) * time_s) ** 2)
    a = np.sqrt(Strength(sensor, n, dt).noise(law, nats, "gauss_markov"))
    return x + recursion(n, dt, a, time_s, rng), nats


def walk(x, sensor, dt, nats, rng):
    n = x.size
    law = 1.0 / (2.0 * np.pi * _ordinates(n, dt)) ** 2
    a = np.sqrt(Strength(sensor, n, dt).noise(law, nats, "rate_random_walk"))
    steps = rng.standard_t(6.0, n) / np.sqrt(1.5) * a * np.sqrt(dt)
    return x + np.cumsum(steps), nats


def flicker(x, sensor, dt, nats, rng):
    n = x.size
    f = np.fft.rfftfreq(4 * n, dt)
    f[0] = f[1]
    phases = np.exp(2j * np.pi * rng.random(f.size)) * rng.rayleigh(1.0, f.size)
    shape = np.fft.irfft(phases / f**0.51, 4 * n)[:n]
    # rayleigh squared has mean 2; two-sided density of irfft's output
    law = 2.0 * dt / (4 * n) * _ordinates(n, dt) ** -1.02
    a = np.sqrt(Strength(sensor, n, dt).noise(law, nats, "bias_instability"))
    return x + a * shape, nats


def granular(x, sensor, dt, nats, rng):
    """Differences of uniform noise."""
    law = 4.0 * np.sin(np.pi * _ordinates(x.size, dt) * dt) ** 2 * dt / 12.0
    a = np.sqrt(Strength(sensor, x.size, dt).noise(law, nats, "quantization"))
    return x + a * np.diff(rng.random(x.size + 1)), nats


def louder(x, sensor, dt, nats, rng):
    law = np.full(x.size - 1, dt)
    a = np.sqrt(Strength(sensor, x.size, dt).noise(law, nats, "white_noise"))
    return x + a * rng.standard_normal(x.size), nats


def ramp(x, sensor, dt, nats, rng):
    u = np.linspace(0.0, 1.0, x.size)
    shape = rng.choice([-1, 1]) * (u + 0.2 * u**2)
    rivals = (_warming(x.size), np.sign(u - 0.5))
    return x + Strength(sensor, x.size, dt).signal(shape, nats, rivals) * shape, nats


def step(x, sensor, dt, nats, rng):
    t = np.arange(x.size) * dt
    at = rng.uniform(0.2, 0.8) * t[-1]
    edge = 0.15 if dt < 0.05 else 1.0
    shape = rng.choice([-1, 1]) * np.tanh((t - at) / edge)
    rivals = (t, _warming(x.size))
    return x + Strength(sensor, x.size, dt).signal(shape, nats, rivals) * shape, nats


def _warming(n):
    """Another course that a drift may be taken for."""
    return 1.0 - np.exp(-np.linspace(0.0, 1.0, n) / 0.3)


def burst(x, sensor, dt, nats, rng):
    n = x.size
    m = int(rng.uniform(0.03, 0.2) * n)
    first = int(rng.uniform(0.05, 0.9 - m / n) * n)
    edge = m // 20
    window = np.zeros(n)
    window[first : first + m] = 1.0
    window[first : first + edge] = np.linspace(0.0, 1.0, edge)
    window[first + m - edge : first + m] = np.linspace(1.0, 0.0, edge)
    edges = window[first : first + m] ** 2

    def least(a: float) -> float:
        truth, more = 0.5 * float(np.sum(np.log1p(a * edges))), float(np.sum(a * edges))
        both = (1.0 + sensor.trust) * n  # none: one louder level here and where the model is from
        over_none = 0.5 * both * np.log1p(more / both) - truth
        over_louder = 0.5 * n * np.log1p(more / n) - truth
        return min(over_none / nats, over_louder / (nats / 3.0))

    ratio = amplitude_for(least, 1.0, 1e-6, 1e3)
    sigma = sensor.white / np.sqrt(dt)
    return x + window * np.sqrt(ratio) * sigma * rng.standard_normal(n), nats


def popcorn(x, sensor, dt, nats, rng):
    """Two levels, gamma distributed dwell times."""
    n = x.size
    dwell_s = rng.uniform(4.0, 15.0) * (1.0 if dt < 0.05 else 6.0)
    dwells = rng.gamma(1.5, dwell_s / 1.5, int(3 * n * dt / dwell_s) + 20)
    level = np.searchsorted(np.cumsum(dwells), np.arange(n) * dt) % 2
    law = 0.25 * dwell_s / (1.0 + (np.pi * _ordinates(n, dt) * dwell_s) ** 2)
    strength = Strength(sensor, n, dt)
    power = strength.noise(law, nats, "random_telegraph")
    known = gain_of_signal(level - level.mean(), sensor, dt)
    jumps = int(np.count_nonzero(np.diff(level)))
    while True:  # the course is worth more than its Gaussian twin, every jump's place paid for
        blur_s = min(2.0 * sensor.white**2 / power, dwell_s)
        place = 1.0 + np.log(dwell_s / blur_s)
        twin = strength.gain(power * strength.grouped(law), True)
        if power * known - jumps * place - twin >= nats / 3.0:
            return x + np.sqrt(power) * level, nats
        power *= 1.1


def hits(x, sensor, dt, nats, rng):
    sigma = sensor.white / np.sqrt(dt)
    count = max(int(nats / 30.0), 3)
    at = rng.choice(x.size, count, replace=False)
    out = x.copy()
    size = amount_of(nats) * sigma
    out[at] += rng.choice([-1, 1], count) * rng.uniform(9.0, 25.0, count) * size
    return out, float(count) * 40.0


def truncated(x, sensor, dt, nats, rng):
    """Floor to a grid with an offset."""
    sigma = sensor.white / np.sqrt(dt)
    grid = amount_of(nats) * sigma * rng.uniform(0.15, 0.8)
    offset = rng.uniform(0.0, grid)
    return np.floor((x - offset) / grid) * grid + offset, CERTAIN


def clipped(x, sensor, dt, nats, rng):
    limit = abs(sensor.level) + rng.uniform(1.8, 2.8) * x.std()
    beyond = amount_of(nats) * float(np.mean(np.abs(x) > limit))
    limit = limit if amount_of(nats) == 1.0 else float(np.quantile(np.abs(x), 1.0 - beyond))
    return np.clip(x, -limit, limit), CERTAIN


def sluggish(x, sensor, dt, nats, rng):
    """The fast noise through a second-order low pass at eight times the rate, then sampled."""
    over = 8
    f0 = rng.uniform(0.12, 0.3) / dt / np.sqrt(amount_of(nats))  # takes (f/f0)^2 of the low ones
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
    a = amount_of(nats) * rng.uniform(0.1, 0.4)
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
    trust: float = 1.0,
) -> Hidden:
    """One recording with one hidden effect, or with none (``kind`` "nothing").

    ``a+b`` hides two effects on two channels, ``a&b`` two on one.  The clean sensor depends on
    ``sensor_seed``, its noise on ``noise_seed`` (``seed`` where not given), the effect on ``seed``,
    how much is known of the sensor is ``trust``.
    """
    rng = np.random.default_rng([seed if noise_seed is None else noise_seed, 2])
    made = sensors(seed if sensor_seed is None else sensor_seed, names, trust)
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
        strength = Strength(made[name], t.size, dt)
        rivals = (t, np.sign(t - 0.1 * t[-1]), np.sign(t - 0.5 * t[-1]))
        out.values[name] = out.values[name] + shape * strength.signal(shape, nats, rivals)
        out.truth[name], out.gain = (*out.truth.get(name, ()), "temperature"), nats
    elif kind == "cross_axis":
        other = str(rng.choice([n for n in names if n != name]))
        _share(out, (name, other), made, nats, rng)
    elif kind in ON_THE_TOPIC:
        _transport(out, kind, amount_of(nats), rng)
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


def _transport(out: Hidden, kind: str, amount: float, rng: np.random.Generator) -> None:
    """Half a hold is the least that there is, each value twice."""
    n = out.stamp_ns.size
    if kind == "held_samples":
        factor = int(rng.integers(2, 6)) if amount == 1.0 else 2
        phase = int(rng.integers(factor))
        index = np.maximum((np.arange(n) - phase) // factor * factor + phase, 0)
        out.values = {k: v[index] for k, v in out.values.items()}
    elif kind == "timestamp_jitter":
        width = amount * 0.08 / out.rate_hz
        out.stamp_ns = out.stamp_ns + np.rint(rng.uniform(-width, width, n) * 1e9).astype(np.int64)
    else:
        keep = np.ones(n, dtype=bool)
        losses = int(np.ceil(amount * int(rng.integers(5, 30))))
        for start in rng.choice(n - 60, losses, replace=False):
            keep[start + 1 : start + 1 + int(rng.integers(2, 40))] = False
        out.stamp_ns = out.stamp_ns[keep]
        out.values = {k: v[keep] for k, v in out.values.items()}
    out.truth = dict.fromkeys(out.values, (kind,))
    out.gain = CERTAIN


# --- the catalogue's own forms, for the coverage of intervals ----------------------------------


def _own_shapes(kind, sensor, n, dt, nats, rng):
    """(what is added, true values) of one effect exactly as the catalogue has it."""
    t, k = np.arange(n) * dt, _ordinates(n, dt)
    strength = Strength(sensor, n, dt)
    if kind == "white_noise":
        p = strength.noise(np.ones(n - 1), nats, kind)
        total = float(np.sqrt(sensor.white**2 + p))
        return np.sqrt(p / dt) * rng.standard_normal(n), {"density": total}
    if kind == "quantization":
        Q = np.sqrt(strength.noise(4.0 * np.sin(np.pi * k * dt) ** 2 / dt, nats, kind))
        return np.diff(rng.standard_normal(n + 1)) * Q / dt, {"coefficient": Q}
    if kind == "gauss_markov":
        T = float(rng.uniform(0.2, 1.5))
        law = 2.0 * T / (1.0 + (2.0 * np.pi * k * T) ** 2)
        s = np.sqrt(strength.noise(law, nats, kind))
        return recursion(n, dt, s, T, rng), {"sigma": s, "correlation_time_s": T}
    if kind == "rate_random_walk":
        K = np.sqrt(strength.noise(1.0 / (2.0 * np.pi * k) ** 2, nats, kind))
        return np.cumsum(rng.standard_normal(n)) * K * np.sqrt(dt), {"coefficient": K}
    if kind == "periodic":
        f0 = float(rng.uniform(5.0, 0.45 / dt))
        shape = np.sin(2.0 * np.pi * f0 * t + rng.uniform(0.0, 6.0))
        a = float(np.sqrt(nats / gain_of_signal(shape, sensor, dt)))
        return a * shape, {"frequency_hz": f0, "amplitude": a}
    if kind == "rate_ramp":
        a = strength.signal(t, nats, (_warming(n),))
        return a * t, {"slope": a}
    if kind == "bias_step":
        at = float(rng.uniform(0.2, 0.8)) * t[-1]
        shape = (t >= at).astype(float)
        a = strength.signal(shape, nats, (t,))
        return a * shape, {"time_s": at, "height": a}
    m = int(rng.uniform(0.05, 0.2) * n)
    first = int(rng.uniform(0.05, 0.9 - m / n) * n)
    extra = amplitude_for(lambda a: 0.5 * m * (a - np.log1p(a)), nats, 1e-6, 1e3)
    out = np.zeros(n)
    out[first : first + m] = np.sqrt(extra) * sensor.white / np.sqrt(dt) * rng.standard_normal(m)
    return out, {"from_s": first * dt, "to_s": (first + m) * dt, "ratio": 1.0 + extra}


OWN_FORMS = (
    *("white_noise", "quantization", "gauss_markov", "rate_random_walk", "periodic", "rate_ramp"),
    *("bias_step", "variance_change"),
)


def own_form(
    kind: str, nats: float, seed: int, name: str, duration_s: float = 600.0, rate_hz: float = 200.0
) -> tuple[Hidden, dict[str, float]]:
    """One channel of a known sensor with one effect of the catalogue's form, and its values."""
    sensor = sensors(seed, (name,), KNOWN)[name]
    rng = np.random.default_rng([seed, 4])
    n, dt = round(duration_s * rate_hz), 1.0 / rate_hz
    extra, truth = _own_shapes(kind, sensor, n, dt, nats, rng)
    stamp_ns = np.rint(np.arange(n) * dt * 1e9).astype(np.int64)
    out = Hidden(kind, stamp_ns, {name: clean(sensor, n, dt, rng) + extra}, rate_hz)
    _warm(out, duration_s, rng)
    out.truth[name], out.gain = (kind,), nats
    return out, truth
