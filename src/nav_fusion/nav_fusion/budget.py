"""Error budget: what each effect of a noise model costs in position, velocity and heading.

The covariance of the navigation errors on a level platform, errors as in ``nav_fusion.strapdown``
but in east-north-up and without the Earth's rate (7e-5 rad/s; gravity's gradient is in)::

    r' = v,   v' = G r - [f x] psi - C b_a - n_a,   psi' = -C b_g - n_g,   b' = -b/T + w

It is linear, so each effect's part is had by leaving the others out and keeping the *same gains*;
the parts sum to the whole.  Aided, the gains are the optimal ones for all effects together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from imu_noise_id.model import ChannelModel, NoiseModel
from numpy.typing import NDArray

from nav_fusion.noise import (
    AXES,
    AidNoise,
    AidRates,
    AxisNoise,
    NavigationNoise,
    TurnOn,
    from_model,
)
from nav_fusion.noise_terms import SlowTerm

Floats = NDArray[np.float64]

GRAVITY_M_S2 = 9.80665
EARTH_RADIUS_M = 6.371e6
NAV = 9
FORMAT = "budget/1"
SCENARIOS = ("free", "stationary", "aided")
"""Unaided; unaided with nothing but what a static record shows; aided by fixes."""
NOT_IN_A_STATIC_RECORD = ("turn_on_bias", "temperature", "vibration", "start")


@dataclass(frozen=True)
class Environment:
    """What a static record does not show, and the motion of the scenario.

    Attributes
    ----------
    turn_on : TurnOn
        Constant bias of a day.
    temperature_change_k : float
        Times a ``temperature`` effect's coefficient: a bias.
    vibration_m_s2, vibration_rad_s : float
        Root mean square of vibration on each axis, a narrow band of a tenth of its frequency.
    vibration_hz : float
    tilt_rad, heading_rad, speed_m_s, position_m : float
        Standard deviations at the start.
    weave_m_s2, weave_s : float
        Amplitude and period of the horizontal acceleration that makes the heading observable.
    """

    turn_on: TurnOn = field(default_factory=TurnOn)
    temperature_change_k: float = 10.0
    vibration_m_s2: float = 0.0
    vibration_rad_s: float = 0.0
    vibration_hz: float = 40.0
    tilt_rad: float = 1e-3
    heading_rad: float = 1e-2
    speed_m_s: float = 0.05
    position_m: float = 0.5
    weave_m_s2: float = 1.0
    weave_s: float = 20.0


@dataclass(frozen=True)
class Source:
    """One effect as it enters the covariance.

    White spectra (6,) of gyro and accelerometer, start in navigation (9,), its slow states, and
    whether it is the aid's white noise.
    """

    effect: str
    sensor: str
    psd: Floats = field(default_factory=lambda: np.zeros(6))
    start: Floats = field(default_factory=lambda: np.zeros(NAV))
    slow: tuple[int, ...] = ()
    aid_white: bool = False


@dataclass(frozen=True)
class Share:
    """Part of the variance that one effect causes, (k,) each, of position, velocity and heading."""

    effect: str
    sensor: str
    position: Floats
    velocity: Floats
    heading: Floats


@dataclass(frozen=True)
class Scenario:
    """Budget over time of one model.

    ``position_sigma_m`` and ``velocity_sigma_m_s`` (k,) are of one horizontal axis: the root
    mean square of east and north.
    """

    name: str
    time_s: Floats
    position_sigma_m: Floats
    velocity_sigma_m_s: Floats
    heading_sigma_rad: Floats
    shares: tuple[Share, ...]


@dataclass(frozen=True)
class Budget:
    """Budget of one model."""

    model: str
    scenarios: tuple[Scenario, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _System:
    """States and sources of one model."""

    target: NDArray[np.int64]
    rate: Floats
    density2: Floats
    variance: Floats
    sources: tuple[Source, ...]
    aid_white: Floats


def budget_of(
    model: NoiseModel,
    environment: Environment = Environment(),
    duration_s: float = 300.0,
    aid_rate_hz: float = 10.0,
    name: str = "",
) -> Budget:
    """Budget of a model in every scenario.

    Raises
    ------
    InputError
        When the model lacks an inertial channel.
    """
    # turn-on bias stands by itself: in the filter it starts the walk, and would be the walk's here
    rates = AidRates(aid_rate_hz, aid_rate_hz, aid_rate_hz)
    noise = from_model(model, TurnOn(0.0, 0.0), rates)
    noise = replace(noise, position=_three([_plain(a, 1.0 / aid_rate_hz) for a in noise.position]))
    if noise.position_claimed:
        scale = 2.5
        noise = replace(
            noise,
            position=_three([_scaled(a, scale) for a in noise.position]),
            notes=(
                *noise.notes,
                f"no position channels in the model: a receiver of "
                f"{scale} m is assumed for the aided scenario",
            ),
        )
    system = _system(model, noise, environment)
    scenarios = tuple(
        _run(kind, system, environment, duration_s, aid_rate_hz) for kind in SCENARIOS
    )
    return Budget(name or model.source or "model", scenarios, noise.notes)


def _three(axes: list[AidNoise]) -> tuple[AidNoise, AidNoise, AidNoise]:
    return axes[0], axes[1], axes[2]


def _scaled(aid: AidNoise, scale: float) -> AidNoise:
    terms = tuple(
        SlowTerm.gauss_markov(t.initial_sigma * scale, t.correlation_time_s, t.name)
        for t in aid.terms
        if isinstance(t, SlowTerm)
    )
    return AidNoise(aid.white_sigma * scale, terms)


def _plain(aid: AidNoise, step_s: float) -> AidNoise:
    """Return an aid whose pairs are Gauss-Markov terms of their variance V and density S at 0 Hz.

    T = S/(2 V) is all that an average over many fixes sees; white where T is below a step.
    """
    white2, terms = aid.white_sigma**2, []
    for term in aid.terms:
        if isinstance(term, SlowTerm):
            terms.append(term)
        elif (time_s := term.memory_s) >= step_s:
            terms.append(SlowTerm.gauss_markov(term.sigma, time_s, term.name))
        else:
            white2 += term.sigma**2
    return AidNoise(math.sqrt(white2), tuple(terms))


def _system(model: NoiseModel, noise: NavigationNoise, environment: Environment) -> _System:
    rows: list[tuple[int, SlowTerm, str]] = []
    groups_of_axes: tuple[tuple[int, str, tuple[AxisNoise | AidNoise, ...]], ...] = (
        (0, "gyro", noise.gyro),
        (3, "accelerometer", noise.accel),
        (6, "receiver", noise.position),
    )
    for base, sensor, axes in groups_of_axes:
        rows += [
            (base + k, t, sensor)
            for k, axis in enumerate(axes)
            for t in axis.terms
            if isinstance(t, SlowTerm)
        ]
    others, constants = _other_sources(model, environment)
    rows += constants
    groups: dict[tuple[str, str], list[int]] = {}
    for k, (_, term, sensor) in enumerate(rows):
        groups.setdefault((term.name, sensor), []).append(k)
    sources = [Source(effect, sensor, slow=tuple(ks)) for (effect, sensor), ks in groups.items()]
    white = np.array([a.white_density**2 for a in (*noise.gyro, *noise.accel)])
    for sensor, part in (("gyro", slice(0, 3)), ("accelerometer", slice(3, 6))):
        psd = np.zeros(6)
        psd[part] = white[part]
        sources.append(Source("white_noise", sensor, psd=psd))
    sources += others
    e = environment
    start = [e.position_m] * 3 + [e.speed_m_s] * 3 + [e.tilt_rad] * 2 + [e.heading_rad]
    sources.append(Source("start", "alignment", start=np.square(start)))
    sources.append(Source("white_noise", "receiver", aid_white=True))
    return _System(
        np.array([t for t, _, _ in rows]),
        np.array(
            [
                0.0 if math.isinf(t.correlation_time_s) else 1 / t.correlation_time_s
                for _, t, _ in rows
            ]
        ),
        np.array([t.density**2 for _, t, _ in rows]),
        np.array([t.initial_sigma**2 for _, t, _ in rows]),
        tuple(sources),
        np.array([a.white_sigma**2 for a in noise.position]),
    )


def _other_sources(
    model: NoiseModel, environment: Environment
) -> tuple[list[Source], list[tuple[int, SlowTerm, str]]]:
    """Effects that are no states of the filter, and the environment's, as their integral sees them.

    Fast noise of variance s^2 about w rad/s leaves its integral with variance s^2/w^2 at the start
    and a white part, its spectrum at 0 Hz; quantization leaves Q^2 and no white part.
    """
    sources: list[Source] = []
    constants = _turn_on(environment.turn_on)
    for base, sensor, prefix, start in (
        (0, "gyro", "angular_velocity", 6),
        (3, "accelerometer", "linear_acceleration", 3),
    ):
        rms = environment.vibration_rad_s if base == 0 else environment.vibration_m_s2
        for k, axis in enumerate(AXES):
            if rms > 0:
                bandwidth = 0.1 * environment.vibration_hz
                sources.append(
                    _fast(
                        "vibration",
                        sensor,
                        base + k,
                        start + k,
                        rms,
                        environment.vibration_hz,
                        bandwidth,
                    )
                )
            for effect, values in _effects(model.channel(f"{prefix}.{axis}")):
                source = _one(
                    effect, values, sensor, base + k, start + k, model.channel(f"{prefix}.{axis}")
                )
                if source is not None:
                    sources.append(source)
                sigma = {
                    "temperature": abs(values.get("coefficient", 0.0))
                    * environment.temperature_change_k
                }.get(effect, 0.0)
                if sigma > 0:
                    constants.append((base + k, SlowTerm(sigma, math.inf, 0.0, effect), sensor))
    return _merged(sources), constants


def _turn_on(turn_on: TurnOn) -> list[tuple[int, SlowTerm, str]]:
    return [
        (base + k, SlowTerm(sigma, math.inf, 0.0, "turn_on_bias"), sensor)
        for base, sensor, sigma in (
            (0, "gyro", turn_on.gyro_sigma_rad_s),
            (3, "accelerometer", turn_on.accel_sigma_m_s2),
        )
        if sigma > 0
        for k in range(3)
    ]


def _effects(channel: ChannelModel) -> list[tuple[str, dict[str, float]]]:
    return [
        (
            f.name,
            {
                p.name: float(v)
                for p, v in zip(f.effect.parameters, f.effect.values(), strict=True)
                if not isinstance(v, str)
            },
        )
        for f in channel.effects
    ]


def _one(
    effect: str, values: dict[str, float], sensor: str, axis: int, start: int, channel: ChannelModel
) -> Source | None:
    if effect == "periodic":
        return _fast(
            effect,
            sensor,
            axis,
            start,
            values["amplitude"] / math.sqrt(2),
            values["frequency_hz"],
            0.0,
        )
    if effect == "narrow_band":
        return _fast(
            effect,
            sensor,
            axis,
            start,
            values["sigma"],
            values["frequency_hz"],
            values["bandwidth_hz"],
        )
    psd, first = np.zeros(6), np.zeros(NAV)
    if effect == "quantization":
        first[start] = values["coefficient"] ** 2
    elif effect == "output_rounding":
        psd[axis] = values["step"] ** 2 / 12.0 / (channel.rate_hz or 100.0)
    else:
        return None
    return Source(effect, sensor, psd, first)


def _fast(
    effect: str,
    sensor: str,
    axis: int,
    start: int,
    sigma: float,
    frequency_hz: float,
    bandwidth_hz: float,
) -> Source:
    """Narrow-band noise: (s/w)^2 in the integral, and the Lorentzian's tail at 0 Hz as white."""
    psd, first = np.zeros(6), np.zeros(NAV)
    psd[axis] = sigma**2 * bandwidth_hz / (2 * math.pi * frequency_hz**2)
    first[start] = (sigma / (2 * math.pi * frequency_hz)) ** 2
    return Source(effect, sensor, psd, first)


def _merged(sources: Sequence[Source]) -> list[Source]:
    merged: dict[tuple[str, str], Source] = {}
    for s in sources:
        key = (s.effect, s.sensor)
        old = merged.get(key)
        merged[key] = (
            s if old is None else replace(old, psd=old.psd + s.psd, start=old.start + s.start)
        )
    return list(merged.values())


def transition(system: _System, force: Floats, dt: float) -> Floats:
    """F (n, n) over ``dt`` to third order, level and facing east, at specific force (3,)."""
    m = system.target.size
    A = np.zeros((NAV + m, NAV + m))
    A[0:3, 3:6] = np.eye(3)
    A[3:6, 0:3] = np.diag([-1.0, -1.0, 2.0]) * GRAVITY_M_S2 / EARTH_RADIUS_M
    x, y, z = force
    A[3:6, 6:9] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    for s, target in enumerate(system.target):
        A[NAV + s, NAV + s] = -system.rate[s]
        if target < 3:
            A[6 + target, NAV + s] = -1.0
        elif target < 6:
            A[target, NAV + s] = -1.0
    step = A * dt
    return np.eye(NAV + m) + step @ (np.eye(NAV + m) + step / 2 @ (np.eye(NAV + m) + step / 3))


def _start_and_noise(system: _System, dt: float) -> tuple[Floats, Floats]:
    """Covariances at the start and process noise of each source, (E, n, n), diagonal."""
    m = system.target.size
    count = len(system.sources)
    P, Q = np.zeros((count, NAV + m, NAV + m)), np.zeros((count, NAV + m, NAV + m))
    nav = np.arange(NAV)
    for e, source in enumerate(system.sources):
        P[e, nav, nav] = source.start
        Q[e, nav[6:9], nav[6:9]] = source.psd[0:3] * dt
        Q[e, nav[3:6], nav[3:6]] = source.psd[3:6] * dt
        for s in source.slow:
            P[e, NAV + s, NAV + s] = system.variance[s]
            x = system.rate[s] * dt
            # half before and half after a step keep the stationary variance exactly
            half = (
                system.density2[s] / (2 * system.rate[s]) * math.tanh(x)
                if x > 0
                else 0.5 * system.density2[s] * dt
            )
            Q[e, NAV + s, NAV + s] = 2 * half
    return P, Q


def _run(
    name: str, system: _System, environment: Environment, duration_s: float, aid_rate_hz: float
) -> Scenario:
    dt = 1.0 / aid_rate_hz
    steps = round(duration_s * aid_rate_hz)
    P, Q = _start_and_noise(system, dt)
    if name == "stationary":
        hidden = [e for e, s in enumerate(system.sources) if s.effect in NOT_IN_A_STATIC_RECORD]
        P[hidden], Q[hidden] = 0.0, 0.0
    n = P.shape[1]
    H = np.zeros((3, n))
    H[:, 0:3] = np.eye(3)
    for s, target in enumerate(system.target):
        if target >= 6:
            H[target - 6, NAV + s] = 1.0
    R = np.diag(system.aid_white)
    aid = np.array([s.aid_white for s in system.sources], dtype=float)
    course = np.zeros((steps + 1, len(system.sources), 3))
    course[0] = _figures(P)
    for k in range(steps):
        phase = 2 * math.pi * (k + 0.5) * dt / environment.weave_s
        force = np.array([environment.weave_m_s2 * math.sin(phase), 0.0, GRAVITY_M_S2])
        F = transition(system, force, dt)
        P = F @ (P + 0.5 * Q) @ F.T + 0.5 * Q
        if name == "aided":
            whole = P.sum(axis=0)
            S = H @ whole @ H.T + R
            K = np.linalg.solve(S, H @ whole).T
            keep = np.eye(n) - K @ H
            P = keep @ P @ keep.T + aid[:, None, None] * (K @ R @ K.T)
        course[k + 1] = _figures(P)
    return _scenario(name, dt * np.arange(steps + 1, dtype=np.float64), course, system.sources)


def _figures(P: Floats) -> Floats:
    """Variances (E, 3) of position and velocity (one horizontal axis) and heading."""
    return np.stack(
        [0.5 * (P[:, 0, 0] + P[:, 1, 1]), 0.5 * (P[:, 3, 3] + P[:, 4, 4]), P[:, 8, 8]], axis=-1
    )


def _scenario(name: str, time_s: Floats, course: Floats, sources: Sequence[Source]) -> Scenario:
    keep = np.unique(
        np.concatenate(([0], np.rint(np.geomspace(1, time_s.size - 1, 120)).astype(int)))
    )
    course = course[keep]
    total = course.sum(axis=1)
    share = course / np.maximum(total, 1e-300)[:, None, :]
    shares = tuple(
        Share(s.effect, s.sensor, *share[:, e].T)
        for e, s in enumerate(sources)
        if share[:, e].max() > 0
    )
    position, velocity, heading = np.sqrt(total).T
    return Scenario(name, time_s[keep], position, velocity, heading, shares)


def budget_tree(budgets: Sequence[Budget]) -> dict[str, Any]:
    """``budget/1``."""
    return {
        "format": FORMAT,
        "models": [
            {
                "model": b.model,
                "notes": list(b.notes),
                "scenarios": [
                    {
                        "name": s.name,
                        "time_s": s.time_s,
                        "position_sigma_m": s.position_sigma_m,
                        "velocity_sigma_m_s": s.velocity_sigma_m_s,
                        "heading_sigma_rad": s.heading_sigma_rad,
                        "shares": [
                            {
                                "effect": x.effect,
                                "sensor": x.sensor,
                                "position": x.position,
                                "velocity": x.velocity,
                                "heading": x.heading,
                            }
                            for x in s.shares
                        ],
                    }
                    for s in b.scenarios
                ],
            }
            for b in budgets
        ],
    }
