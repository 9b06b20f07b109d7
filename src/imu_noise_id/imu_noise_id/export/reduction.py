"""What other tools know of a noise: a white density, a walk or one Gauss-Markov term per channel.

Decisions, stated in every file written:

- *White*: N^2 of ``white_noise``, plus step^2/12 per sample of ``output_rounding`` (white where the
  noise exceeds the step), so step^2/(12 rate) as a density.
- *Walk*: K^2 of ``rate_random_walk``, plus 2 sigma^2/T_c of each ``gauss_markov`` (its growth over
  times well below T_c), plus what stands for ``bias_instability``: the walk that equals the flat
  0.664 B at tau_B = (N/0.664 B)^2, where the white noise's Allan deviation comes down to the floor.
- *Gauss-Markov*: the term of the largest sigma; a walk alone is one of a correlation time far
  beyond any run; flicker alone is one whose Allan peak, 0.618 sigma at 1.89 T_c, is the floor at
  tau_B.
- Where no slow term was seen: the upper bound that the model states, else the walk that would
  equal the white noise over the whole recording, N sqrt(3)/T.  It is named.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from imu_noise_id.errors import InputError
from imu_noise_id.model import ChannelModel, FittedEffect, NoiseModel

FLICKER_FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)  # 0.664: flat Allan deviation over B
GAUSS_MARKOV_PEAK = 0.618  # largest Allan deviation over sigma, at 1.89 correlation times
WHITE_AND_DRIFT = frozenset(
    ("white_noise", "output_rounding", "gauss_markov", "bias_instability", "rate_random_walk")
)
"""Effects that a target holds which has a white density and a walk or a Gauss-Markov term."""
LONGEST_CORRELATION_S = 1.0e7  # stands for a walk where only Gauss-Markov terms can be written


@dataclass(frozen=True)
class Exported:
    """A file for another tool.

    Attributes
    ----------
    text : str
    notes : tuple of str
        What the target cannot hold, and what stands in its place, one sentence each.
    """

    text: str
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Drift:
    """One Gauss-Markov term: diffusion density in unit/s/sqrt(Hz), correlation time in s."""

    diffusion: float
    correlation_time_s: float

    @property
    def sigma(self) -> float:
        """Stationary standard deviation, diffusion sqrt(T_c/2)."""
        return self.diffusion * math.sqrt(self.correlation_time_s / 2.0)


def joined(notes: Sequence[str]) -> list[str]:
    """Say once what is said of several channels: the same sentence, with their names before it."""
    channels: dict[tuple[str, str], list[str]] = {}
    for note in notes:
        channel, _, sentence = note.partition(": ")
        alone = "" if "." in channel else channel  # a sensor, not one of its axes
        channels.setdefault((sentence, alone), []).append(channel)
    return [f"{', '.join(names)}: {sentence}" for (sentence, _), names in channels.items()]


def slower_sensors(model: NoiseModel, rate_hz: float) -> list[str]:
    """Say which sensors beside the IMU do not run at the rate that values per sample are for."""
    notes = []
    for quantity in ("magnetic_field", "position", "velocity"):
        rates = {c.rate_hz for c in model.channels if c.name.startswith(f"{quantity}.")}
        for own_hz in sorted(r for r in rates if r is not None and abs(r - rate_hz) > 0.1 * r):
            notes.append(
                f"{quantity}: recorded at {own_hz:.4g} Hz, written for {rate_hz:.4g} Hz as asked: "
                f"for this sensor, export with --rate {own_hz:.4g}"
            )
    return notes


def channels_of(model: NoiseModel, quantity: str, target: str) -> dict[str, ChannelModel]:
    """Return the three axes of a quantity.

    Raises
    ------
    InputError
        When the model lacks one that the target needs.
    """
    axes = ("east", "north", "up") if quantity in ("position", "velocity") else ("x", "y", "z")
    found = {}
    for axis in axes:
        try:
            found[axis] = model.channel(f"{quantity}.{axis}")
        except KeyError:
            raise InputError(
                f"{model.source}: no channel {quantity}.{axis}, which {target} needs: "
                "identify a recording of the whole sensor"
            ) from None
    return found


def has_axes(model: NoiseModel, quantity: str) -> bool:
    """Whether the model has all three axes of a quantity."""
    return sum(channel.name.startswith(f"{quantity}.") for channel in model.channels) == 3


def _all(channel: ChannelModel, name: str) -> list[FittedEffect]:
    return [fitted for fitted in channel.effects if fitted.name == name]


def _value(fitted: FittedEffect, parameter: str) -> float:
    return float(getattr(fitted.effect, parameter))


def white_power(channel: ChannelModel, rate_hz: float) -> float:
    """White spectrum at a sample rate, unit^2/Hz; 0 where the channel has none."""
    power = sum(_value(e, "density") ** 2 for e in _all(channel, "white_noise"))
    rounding = sum(_value(e, "step") ** 2 for e in _all(channel, "output_rounding"))
    return power + rounding / (12.0 * rate_hz)


def white_density(channel: ChannelModel, rate_hz: float, target: str) -> float:
    """White density at a sample rate, unit/sqrt(Hz).

    Raises
    ------
    InputError
        When the channel has none.
    """
    power = white_power(channel, rate_hz)
    if not power > 0.0:
        raise InputError(
            f"{channel.name}: no white_noise in the model, which {target} needs: "
            "identify a longer recording or type its density"
        )
    return math.sqrt(power)


def flicker_onset_s(channel: ChannelModel) -> float | None:
    """Time at which the white noise's Allan deviation reaches the flat 0.664 B, or None."""
    white = sum(_value(e, "density") ** 2 for e in _all(channel, "white_noise"))
    flicker = sum(_value(e, "coefficient") ** 2 for e in _all(channel, "bias_instability"))
    if not white > 0.0 or not flicker > 0.0:
        return None
    return white / (FLICKER_FLOOR**2 * flicker)


def walk_density(channel: ChannelModel, notes: list[str]) -> float:
    """Random walk that stands for all slow terms, unit/s/sqrt(Hz); ``notes`` says how."""
    power = sum(_value(e, "coefficient") ** 2 for e in _all(channel, "rate_random_walk"))
    for fitted in _all(channel, "gauss_markov"):
        sigma, time_s = _value(fitted, "sigma"), _value(fitted, "correlation_time_s")
        power += 2.0 * sigma**2 / time_s
        notes.append(
            f"{channel.name}: gauss_markov (sigma {sigma:.3g} {channel.unit}, {time_s:.3g} s) is "
            f"written as the walk that it is for times well below {time_s:.3g} s"
        )
    for fitted in _all(channel, "bias_instability"):
        onset_s = flicker_onset_s(channel)
        floor = FLICKER_FLOOR * _value(fitted, "coefficient")
        if onset_s is None:
            notes.append(f"{channel.name}: bias_instability left out: no white noise to meet it")
            continue
        power += 3.0 * floor**2 / onset_s
        notes.append(
            f"{channel.name}: bias_instability (floor {floor:.3g} {channel.unit}) is written as "
            f"the walk that equals its floor at {onset_s:.3g} s"
        )
    return math.sqrt(power) if power > 0.0 else _unseen_walk(channel, notes)


def _unseen_walk(channel: ChannelModel, notes: list[str]) -> float:
    bounds = [b.upper for b in channel.bounds if b.name == "rate_random_walk"]
    if bounds:
        notes.append(f"{channel.name}: no slow noise seen; the upper bound of the walk is written")
        return bounds[0]
    white = _all(channel, "white_noise")
    if channel.duration_s and white:
        notes.append(
            f"{channel.name}: no slow noise in the model; written is the walk that would equal the "
            f"white noise over the recording's {channel.duration_s:.3g} s"
        )
        return _value(white[0], "density") * math.sqrt(3.0) / channel.duration_s
    notes.append(f"{channel.name}: no slow noise in the model; 0 is written: type a small walk")
    return 0.0


def drift(channel: ChannelModel, notes: list[str]) -> Drift | None:
    """Return the one Gauss-Markov term that stands for the slow ones, or None."""
    terms = [
        Drift(
            _value(e, "sigma") * math.sqrt(2.0 / _value(e, "correlation_time_s")),
            _value(e, "correlation_time_s"),
        )
        for e in _all(channel, "gauss_markov")
    ]
    terms.sort(key=lambda term: term.sigma, reverse=True)
    for term in terms[1:]:
        notes.append(
            f"{channel.name}: a second gauss_markov (sigma {term.sigma:.3g} {channel.unit}, "
            f"{term.correlation_time_s:.3g} s) does not fit: one dynamic bias a channel"
        )
    walks = _all(channel, "rate_random_walk")
    if walks and terms:
        notes.append(f"{channel.name}: rate_random_walk does not fit beside the gauss_markov term")
    elif walks:
        terms = [Drift(_value(walks[0], "coefficient"), LONGEST_CORRELATION_S)]
        notes.append(
            f"{channel.name}: rate_random_walk is written as a dynamic bias of "
            f"{LONGEST_CORRELATION_S:.0e} s"
        )
    onset_s = flicker_onset_s(channel)
    if onset_s is None:
        return terms[0] if terms else None
    if terms:
        notes.append(f"{channel.name}: bias_instability does not fit beside the other slow term")
        return terms[0]
    floor = FLICKER_FLOOR * _value(_all(channel, "bias_instability")[0], "coefficient")
    sigma, time_s = floor / GAUSS_MARKOV_PEAK, onset_s / 1.89
    notes.append(
        f"{channel.name}: bias_instability (floor {floor:.3g} {channel.unit}) is written as the "
        f"dynamic bias whose Allan deviation peaks at that floor, at {onset_s:.3g} s"
    )
    return Drift(sigma * math.sqrt(2.0 / time_s), time_s)


def stationary_variance(channel: ChannelModel) -> float:
    """Variance of the correlated noise that stays bounded: Gauss-Markov and narrow-band terms."""
    names = ("gauss_markov", "narrow_band")
    return sum(_value(e, "sigma") ** 2 for name in names for e in _all(channel, name))


def left_out(channel: ChannelModel, held: frozenset[str], target: str) -> list[str]:
    """Name the effects that a target cannot hold."""
    notes = []
    for fitted in channel.effects:
        if fitted.name in held:
            continue
        values = ", ".join(
            f"{parameter.name} {_shown(value)} {parameter.unit_for(channel.unit)}".rstrip()
            for parameter, value in zip(
                fitted.effect.parameters, fitted.effect.values(), strict=True
            )
        )
        notes.append(f"{channel.name}: {fitted.name} ({values}) cannot be held by {target}")
    return notes


def _shown(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"


def comment(lines: list[str], mark: str = "# ") -> str:
    """Lines as comments of a file; nothing that came from outside can end one."""
    return "".join(f"{mark}{' '.join(line.split())}".rstrip() + "\n" for line in lines)
