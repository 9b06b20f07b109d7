"""What an effect is: a named part of a noise model, with parameters, laws and a simulation.

One effect is one file of this folder: a frozen dataclass whose fields are its parameters in SI
units, derived from one of the classes below, which say where it acts.  The order of action is the
order of :class:`Stage`: source -> bandwidth -> output -> rounding -> hold -> stamp -> transport;
within a stage, the order of the names.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from dataclasses import dataclass
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from imu_noise_id.ordinates import LEAST_SCORE, Residual
from imu_noise_id.recording import Floats


class Stage(IntEnum):
    """Where in the sensor an effect acts, in physical order."""

    SOURCE = 0
    BANDWIDTH = 1
    OUTPUT = 2
    ROUNDING = 3
    HOLD = 4
    STAMP = 5
    TRANSPORT = 6


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes
    ----------
    name : str
        Field of the effect, key in every file.
    unit : str
        Unit with ``{u}`` for the channel's unit, e.g. ``{u}/sqrt(Hz)``.
    positive : bool
        Positive parameters are estimated, and their intervals formed, in the logarithm.
    meaning : str
        One line for documentation and help.
    estimated : bool
        False for what is chosen and not estimated by likelihood (an order, a name, a factor).
    """

    name: str
    unit: str
    positive: bool
    meaning: str
    estimated: bool = True

    def unit_for(self, channel_unit: str) -> str:
        """Unit on a channel: ``{u}/sqrt(Hz)`` on rad/s is ``rad/s/sqrt(Hz)``."""
        return self.unit.format(u=channel_unit)


@dataclass(frozen=True)
class StateSpace:
    """Sampled linear Gaussian form of a stochastic effect.

    x_{k+1} = F x_k + w_k,  y_k = H x_k + v_k,  E[w w'] = Q,  E[v v'] = R,  x_0 ~ N(0, P0);
    shapes (s, s), (1, s), (s, s), (1, 1), (s, s).  A state that starts unknown has a large P0
    and says so in ``diffuse`` (s,).
    """

    F: Floats
    H: Floats
    Q: Floats
    R: Floats
    P0: Floats
    diffuse: tuple[bool, ...]


@dataclass(frozen=True)
class Effect(ABC):
    """Base of all effects; subclasses are frozen dataclasses of their parameters."""

    name: ClassVar[str]
    form: ClassVar[str] = ""
    """Which realisation of the name it is, where there are several; empty for the usual one."""
    stage: ClassVar[Stage]
    parameters: ClassVar[tuple[Parameter, ...]]

    def values(self) -> tuple[float | str, ...]:
        """Parameter values in the order of ``parameters``."""
        return tuple(getattr(self, p.name) for p in self.parameters)

    def free(self) -> tuple[str, ...]:
        """Names of the parameters that a fit estimates."""
        return tuple(p.name for p in self.parameters if p.estimated)

    def replace(self, **changes: float | str) -> Effect:
        """Return a copy with other parameter values."""
        return dataclasses.replace(self, **changes)

    def limits(self, sample_time_s: float, duration_s: float) -> tuple[tuple[float, float], ...]:
        """Range of each free parameter in which it can be told from something else.

        Parameters
        ----------
        sample_time_s, duration_s : float
            Of the record from which the effect is estimated.
        """
        return tuple((0.0, float("inf")) for _ in self.free())


class StochasticEffect(Effect):
    """Adds a stationary (or stationary-increment) random signal; all of them sum in the spectrum.

    Lines are in this class too: random phase, power ``amplitude^2/2``, no continuous spectrum.
    """

    stage = Stage.SOURCE

    @classmethod
    def starts(cls, residual: Residual) -> tuple[StochasticEffect, ...]:
        """Starting values for a fit that adds this effect to a fitted spectrum, best first.

        Empty where nothing of the kind shows.  The default has none: the effect is found elsewhere.
        """
        return ()

    @abstractmethod
    def psd(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """Two-sided PSD of the sampled signal (aliasing included), (n,), unit^2/Hz."""

    @abstractmethod
    def psd_gradient(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """Derivatives of the PSD by the logarithm of each free parameter, (p, n)."""

    @abstractmethod
    def allan_variance(self, tau_s: Floats, sample_time_s: float) -> Floats:
        """Allan variance at ``tau_s``, (n,), unit^2."""

    def state_space(self, sample_time_s: float) -> StateSpace | None:
        """Sampled state-space form, or None where the effect has no finite one."""
        return None

    @abstractmethod
    def simulate(self, n: int, sample_time_s: float, rng: np.random.Generator) -> Floats:
        """One realisation of n samples."""


class StrengthEffect(StochasticEffect):
    """Stochastic effect whose only parameter is its strength, S(f) = strength^2 law(f)."""

    @staticmethod
    @abstractmethod
    def law(frequency_hz: Floats, sample_time_s: float) -> Floats:
        """Two-sided PSD at strength 1, (n,)."""

    @classmethod
    def starts(cls, residual: Residual) -> tuple[StochasticEffect, ...]:
        """One-step estimate of the strength."""
        ordinates = residual.ordinates
        shape = cls.law(ordinates.frequency_hz, ordinates.sample_time_s)[None]
        amount, chi2 = residual.score(shape)
        strength = {cls.parameters[0].name: float(np.sqrt(amount[0]))}
        return (cls(**strength),) if chi2[0] > LEAST_SCORE else ()

    def psd(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """S(f) = strength^2 law(f)."""
        strength = float(getattr(self, self.parameters[0].name))
        return strength**2 * self.law(frequency_hz, sample_time_s)

    def psd_gradient(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """Return dS/d(log strength) = 2 S."""
        return 2.0 * self.psd(frequency_hz, sample_time_s)[None]


class CourseEffect(Effect):
    """Adds a deterministic course: ramps, steps, lines, what follows the temperature."""

    stage = Stage.SOURCE

    @abstractmethod
    def course(self, time_s: Floats, temperature: Floats | None) -> Floats:
        """Return the signal at ``time_s`` since the recording's first stamp, (n,)."""


class TransformEffect(Effect):
    """Changes the samples that it is given: bandwidth, rounding, saturation, outliers."""

    stage = Stage.OUTPUT

    @abstractmethod
    def apply(
        self, values: Floats, time_s: Floats, sample_time_s: float, rng: np.random.Generator
    ) -> Floats:
        """Return the transformed samples, (n,)."""


class ResponseEffect(TransformEffect):
    """Multiplies the spectrum of everything that acts before it; 1 at frequency 0."""

    stage = Stage.BANDWIDTH

    @classmethod
    def starts(cls, residual: Residual) -> tuple[ResponseEffect, ...]:
        """Starting values for a fit that adds this effect to a fitted spectrum."""
        return ()

    @abstractmethod
    def power_response(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """Factor on the two-sided PSD of the sampled signal (aliasing included), (n,)."""

    @abstractmethod
    def log_response_gradient(self, frequency_hz: Floats, sample_time_s: float) -> Floats:
        """Derivatives of the log response by the log of each free parameter, (p, n)."""

    def apply(
        self, values: Floats, time_s: Floats, sample_time_s: float, rng: np.random.Generator
    ) -> Floats:
        """Filter with the root of the power response, without phase.

        Done in the DCT-II, whose symmetric extension lets slow signals pass the ends unharmed.
        """
        n = values.size
        coefficients = fft.dct(values, norm="ortho")
        frequency_hz = np.arange(n) / (2.0 * n * sample_time_s)
        coefficients *= np.sqrt(self.power_response(frequency_hz, sample_time_s))
        return np.asarray(fft.idct(coefficients, norm="ortho"))


class TransportEffect(Effect):
    """Acts on the messages of a whole topic: which are sent, with what stamp and which sample."""

    stage = Stage.TRANSPORT

    @abstractmethod
    def transport(
        self, stamp_s: Floats, sample_time_s: float, rng: np.random.Generator
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Return the stamps that are sent (m,) and which sample each of them carries (m,)."""


class CouplingEffect(Effect):
    """Ties the noise of one channel to that of another."""

    stage = Stage.SOURCE
