"""What the navigation filter needs to know of the sensors, and how a noise model becomes that."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from imu_noise_id.curves import model_psd
from imu_noise_id.effects.narrow_band import NarrowBand
from imu_noise_id.effects.white_noise import WhiteNoise
from imu_noise_id.errors import InputError
from imu_noise_id.model import ChannelModel, NoiseModel

from nav_fusion import colour
from nav_fusion.noise_terms import PairTerm, SlowTerm

AXES = ("x", "y", "z")
LEVEL = ("east", "north", "up")
SLOW_NAMES = ("gauss_markov", "rate_random_walk", "bias_instability", "random_telegraph")
"""Effects that are states of the filter."""

ROUGH_NATS = 0.01
"""More than this lost a measurement is said."""


@dataclass(frozen=True)
class AxisNoise:
    """An inertial axis: white noise of ``white_density`` (unit/sqrt(Hz)) plus slow terms.

    ``channel`` is the whole model behind, where there is one: it tells what single samples do.
    """

    white_density: float
    terms: tuple[SlowTerm, ...] = ()
    channel: ChannelModel | None = None


@dataclass(frozen=True)
class AidNoise:
    """One component of an aiding measurement.

    Attributes
    ----------
    white_sigma : float
        Of each measurement, in its unit (with ``scaled``: as a fraction of the receiver's claim).
    terms : tuple of SlowTerm and PairTerm
        Colour, in the same unit.
    """

    white_sigma: float
    terms: tuple[SlowTerm | PairTerm, ...] = ()


@dataclass(frozen=True)
class NavigationNoise:
    """Noise of all sensors that the filter may be given.

    Attributes
    ----------
    gyro, accel : tuple of three AxisNoise
        rad/s and m/s^2, sensor axes.
    position, velocity : tuple of three AidNoise or None
        East, north, up in m and m/s; None: take the receiver's claim, see ``position_claimed``.
    heading : AidNoise or None
        rad.
    position_claimed : bool
        Whether ``position`` is in units of the standard deviation that the receiver claims.
    source : str
        Where it comes from, for the report.
    notes : tuple of str
    """

    gyro: tuple[AxisNoise, AxisNoise, AxisNoise]
    accel: tuple[AxisNoise, AxisNoise, AxisNoise]
    position: tuple[AidNoise, AidNoise, AidNoise]
    velocity: tuple[AidNoise, AidNoise, AidNoise]
    heading: AidNoise
    position_claimed: bool = False
    source: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class TurnOn:
    """Standard deviation of the constant bias that a sensor has on a day: not in a static record.

    A static record's mean is that day's bias and gravity; the next day has another.
    """

    gyro_sigma_rad_s: float = 0.01
    accel_sigma_m_s2: float = 0.2


@dataclass(frozen=True)
class AidRates:
    """Measurements a second of each aid, where the model does not state it."""

    position_hz: float = 10.0
    velocity_hz: float = 10.0
    heading_hz: float = 10.0


def mems_defaults(turn_on: TurnOn = TurnOn()) -> NavigationNoise:
    """Stated values for a consumer MEMS IMU and a single-frequency receiver.

    Gyro 0.01 deg/s/sqrt(Hz) and 10 deg/h of bias over 300 s; accelerometer 200 ug/sqrt(Hz) and
    0.1 mg over 300 s.  Receiver: colour of 30 s with 0.95 of what it
    claims, and white noise with all of it: which of both a receiver has is not known without a
    model, and a fix that is thought too good is gated.
    """
    gyro = AxisNoise(
        1.7e-4,
        _with_turn_on(
            (SlowTerm.gauss_markov(5e-5, 300.0, "gauss_markov"),), turn_on.gyro_sigma_rad_s
        ),
    )
    accel = AxisNoise(
        2e-3,
        _with_turn_on(
            (SlowTerm.gauss_markov(1e-3, 300.0, "gauss_markov"),), turn_on.accel_sigma_m_s2
        ),
    )
    claim = AidNoise(1.0, (SlowTerm.gauss_markov(0.95, 30.0, "gauss_markov"),))
    speed = AidNoise(0.15)
    heading = AidNoise(0.03, (SlowTerm.gauss_markov(0.1, 60.0, "gauss_markov"),))
    return NavigationNoise(
        (gyro,) * 3,
        (accel,) * 3,
        (claim,) * 3,
        (speed,) * 3,
        heading,
        True,
        "MEMS defaults",
        ("no model of these sensors: values of a consumer MEMS IMU are assumed",),
    )


def from_model(
    model: NoiseModel, turn_on: TurnOn = TurnOn(), rates: AidRates = AidRates()
) -> NavigationNoise:
    """Noise of the filter from an identified or typed model.

    Gauss-Markov terms and walks enter as they are; bias instability as Gauss-Markov terms
    (:func:`flicker_terms`).  What is faster: of an inertial channel by its spectrum at 0 Hz (lines,
    rounding and what acts on single samples average out in navigation, or are in the budget; a note
    says so), of an aid as white noise and colour of few states (:mod:`nav_fusion.colour`).  Aids
    that the model lacks get the defaults; one whose rate it does not state has that of ``rates``.

    Raises
    ------
    InputError
        Where a gyro or accelerometer channel is missing.
    """
    notes: list[str] = []
    defaults = mems_defaults(turn_on)
    gyro = [_axis(model, f"angular_velocity.{a}", turn_on.gyro_sigma_rad_s, notes) for a in AXES]
    accel = [
        _axis(model, f"linear_acceleration.{a}", turn_on.accel_sigma_m_s2, notes) for a in AXES
    ]
    position = [_aid(model, f"position.{a}", rates.position_hz, notes) for a in LEVEL]
    velocity = [_aid(model, f"velocity.{a}", rates.velocity_hz, notes) for a in LEVEL]
    heading = _aid(model, "heading", rates.heading_hz, notes)
    known = all(p is not None for p in position)
    if not known:
        notes.append(
            "the model has no position channels: the receiver's own covariance is used, "
            "as white noise and as colour of 30 s"
        )
    return NavigationNoise(
        _three(gyro, defaults.gyro),
        _three(accel, defaults.accel),
        _three(position, defaults.position) if known else defaults.position,
        _three(velocity, defaults.velocity),
        heading or defaults.heading,
        not known,
        model.source or "model",
        tuple(dict.fromkeys(notes)),
    )


def flicker_terms(
    coefficient: float, shortest_s: float = 3.0, longest_s: float = 1000.0, count: int = 2
) -> tuple[SlowTerm, ...]:
    """Gauss-Markov terms whose summed spectrum follows B^2/(2 pi f) over a band.

    Correlation times in geometric steps; least squares in the logarithm over 1/(2 pi T) of the
    band's ends, all terms of equal sigma (a sum of Lorentzians of equal variance at geometric
    corners is flicker, van der Ziel 1950).
    """
    times = np.geomspace(shortest_s, longest_s, 2 * count + 1)[1::2]
    f = np.geomspace(0.5 / (np.pi * longest_s), 0.5 / (np.pi * shortest_s), 50)
    shape = np.sum(2 * times / (1 + (2 * np.pi * np.outer(f, times)) ** 2), axis=1)
    log_variance = np.mean(np.log(coefficient**2 / (2 * np.pi * f)) - np.log(shape))
    sigma = math.exp(0.5 * log_variance)
    return tuple(SlowTerm.gauss_markov(sigma, float(t), "bias_instability") for t in times)


def slow_terms(channel: ChannelModel) -> tuple[SlowTerm, ...]:
    """Slow terms of a channel's effects, those of ``SLOW_NAMES``."""
    terms: list[SlowTerm] = []
    for fitted in channel.effects:
        value = {
            p.name: v for p, v in zip(fitted.effect.parameters, fitted.effect.values(), strict=True)
        }
        if fitted.name == "gauss_markov":
            terms.append(
                SlowTerm.gauss_markov(
                    float(value["sigma"]), float(value["correlation_time_s"]), fitted.name
                )
            )
        elif fitted.name == "rate_random_walk":
            terms.append(SlowTerm(0.0, math.inf, float(value["coefficient"]), fitted.name))
        elif fitted.name == "bias_instability":
            terms.extend(flicker_terms(float(value["coefficient"])))
        elif fitted.name == "random_telegraph":
            # same spectrum as a Gauss-Markov term of half the dwell time
            terms.append(
                SlowTerm.gauss_markov(
                    0.5 * float(value["height"]), 0.5 * float(value["mean_dwell_s"]), fitted.name
                )
            )
    return tuple(terms)


def fast_part(channel: ChannelModel) -> ChannelModel:
    """Return a channel without its slow terms."""
    return replace(channel, effects=tuple(f for f in channel.effects if f.name not in SLOW_NAMES))


def white_density(channel: ChannelModel, rate_hz: float = 100.0) -> float:
    """Root of the spectrum at 0 Hz of an inertial channel's fast part, unit/sqrt(Hz).

    What is fast for navigation acts through its integral, as white noise of that density; a
    resonance adds the foot of its spectrum, and noise behind a low-pass the whole of it.
    """
    f = np.array([1e-4 * (channel.rate_hz or rate_hz)])
    return math.sqrt(float(model_psd(fast_part(channel), f, 1.0 / (channel.rate_hz or rate_hz))[0]))


def _with_turn_on(terms: tuple[SlowTerm, ...], sigma: float) -> tuple[SlowTerm, ...]:
    """Add the turn-on bias: in the walk where there is one, else as a constant."""
    if sigma <= 0:
        return terms
    for i, term in enumerate(terms):
        if math.isinf(term.correlation_time_s):
            walk = replace(term, initial_sigma=math.hypot(term.initial_sigma, sigma))
            return (*terms[:i], walk, *terms[i + 1 :])
    return (SlowTerm(sigma, math.inf, 0.0, "turn_on_bias"), *terms)


def _axis(model: NoiseModel, name: str, turn_on: float, notes: list[str]) -> AxisNoise:
    try:
        channel = model.channel(name)
    except KeyError:
        raise InputError(
            f"{model.source or 'model'}: no channel {name}, which the filter needs; "
            "add it with at least a white_noise density"
        ) from None
    for fitted in channel.effects:
        if fitted.name not in (*SLOW_NAMES, "white_noise"):
            notes.append(f"{fitted.name} is no state of the filter; its cost is in the budget")
    return AxisNoise(white_density(channel), _with_turn_on(slow_terms(channel), turn_on), channel)


def _aid(model: NoiseModel, name: str, rate_hz: float, notes: list[str]) -> AidNoise | None:
    try:
        channel = model.channel(name)
    except KeyError:
        return None
    terms: list[SlowTerm | PairTerm] = []
    for term in slow_terms(channel):
        if math.isinf(term.correlation_time_s):
            # a walk of the receiver cannot be told from motion: bounded at 1000 s instead
            sigma = term.density * math.sqrt(500.0)
            terms.append(SlowTerm.gauss_markov(sigma, 1000.0, term.name))
            notes.append(f"{name}: random walk taken as Gauss-Markov of 1000 s")
        else:
            terms.append(term)
    if not channel.rate_hz:
        notes.append(
            f"{name}: the model does not say at what rate (rate_hz): {rate_hz:.3g} Hz used"
        )
    fast = _fast_colour(channel, 1.0 / (channel.rate_hz or rate_hz))
    if fast.lost_nats > ROUGH_NATS:
        notes.append(
            f"{name}: the filter's states follow the receiver's colour roughly only "
            f"({fast.lost_nats:.3f} nats lost a measurement)"
        )
    return AidNoise(fast.white_sigma, (*terms, *fast.terms))


def _fast_colour(channel: ChannelModel, sample_time_s: float) -> colour.Colour:
    """White noise and states of an aid's fast part: as it is, or else reduced."""
    fast = fast_part(channel)
    bands = [f.effect for f in fast.effects if isinstance(f.effect, NarrowBand)]
    whites = [f.effect for f in fast.effects if isinstance(f.effect, WhiteNoise)]
    if 0 < len(bands) <= 2 and len(bands) + len(whites) == len(fast.effects):
        white2 = sum(float(e.density) ** 2 for e in whites) / sample_time_s
        return colour.Colour(
            math.sqrt(white2),
            tuple(
                PairTerm.narrow_band(float(e.sigma), float(e.frequency_hz), float(e.bandwidth_hz))
                for e in bands
            ),
            0.0,
        )
    psd = model_psd(fast, colour.grid(sample_time_s), sample_time_s)
    return colour.reduced(psd, sample_time_s)


def _three(found: list, default: tuple) -> tuple:
    return tuple(f if f is not None else d for f, d in zip(found, default, strict=True))
