"""A noise model: per channel a list of effects with intervals."""

from __future__ import annotations

from dataclasses import dataclass, field

from imu_noise_id.effects.base import Effect
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class Estimate:
    """One parameter's value with its 95 % interval.

    Attributes
    ----------
    value : float, str or None
        None where the data only bound it; a string for ``cross_axis.other``.
    std_error, lower, upper : float or None
        None where they cannot be had (a hand-typed model has none of them).
    unit : str
    """

    value: float | str | None
    std_error: float | None
    lower: float | None
    upper: float | None
    unit: str


@dataclass(frozen=True)
class FittedEffect:
    """An effect as estimated, or as typed by hand.

    Attributes
    ----------
    effect : Effect
        Typed values.
    estimates : tuple of Estimate
        In the order of ``effect.parameters``.
    note : str
        What a reader should know ("between gauss_markov and rate_random_walk", ...), or empty.
    """

    effect: Effect
    estimates: tuple[Estimate, ...]
    note: str = ""

    @property
    def name(self) -> str:
        """Name of the effect."""
        return self.effect.name


@dataclass(frozen=True)
class UpperBound:
    """A term that the data do not show, and the largest value that they allow (95 %).

    Attributes
    ----------
    name, parameter, unit : str
        Effect, its strength parameter and that parameter's unit.
    upper : float
    note : str
        Why it is not observable, e.g. what length of recording would show it.
    """

    name: str
    parameter: str
    unit: str
    upper: float
    note: str = ""


@dataclass(frozen=True)
class ChannelModel:
    """The noise of one channel.

    Attributes
    ----------
    name, topic, unit : str
    rate_hz : float or None
        Sample rate of the recording; None in a hand-typed file that does not say.
    mean : float
    effects : tuple of FittedEffect
        In physical order.
    log_covariance : (p, p) float64 or None
        Covariance of the estimated parameters, effects and parameters in order; positive ones as
        logarithms; rows of strings are left out.
    duration_s : float or None
        Length of the recording that the model describes.
    bounds : tuple of UpperBound
    """

    name: str
    topic: str
    unit: str
    rate_hz: float | None
    mean: float
    effects: tuple[FittedEffect, ...]
    log_covariance: Floats | None = None
    duration_s: float | None = None
    bounds: tuple[UpperBound, ...] = ()

    def find(self, effect_name: str) -> FittedEffect | None:
        """Return the first effect of that name, or None."""
        return next((e for e in self.effects if e.name == effect_name), None)


@dataclass(frozen=True)
class TemperatureCourse:
    """Decimated temperature of the recording that the model was identified from.

    Attributes
    ----------
    time_s, temperature_degc : (m,) float64
        Held at its last value beyond its end.
    """

    time_s: Floats
    temperature_degc: Floats


@dataclass(frozen=True)
class NoiseModel:
    """Channels of effects; what ``model.yaml`` holds.

    Attributes
    ----------
    channels : tuple of ChannelModel
    temperature : TemperatureCourse or None
        Present where a channel has a ``temperature`` effect.
    source : str
        Where the model comes from (a bag, ``live``, a file).
    """

    channels: tuple[ChannelModel, ...]
    temperature: TemperatureCourse | None = None
    source: str = ""
    notes: tuple[str, ...] = field(default=())

    def channel(self, name: str) -> ChannelModel:
        """Return the channel of that name; raise KeyError when there is none."""
        for channel in self.channels:
            if channel.name == name:
                return channel
        raise KeyError(name)
