"""How strongly sums of squares or products speak against a model, however often one looks.

Each is the logarithm of an *e-value*: the likelihood of what was seen, averaged over rivals of the
model, over its likelihood under the model.  Under the model that ratio is a martingale of mean 1,
so that it ever exceeds 1/alpha with probability alpha at most (Ville 1939), however often it is
looked at; n of them together exceed n/alpha with the same probability.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from imu_noise_id.curves import model_allan_variance, model_psd
from imu_noise_id.effects.output_rounding import OutputRounding
from imu_noise_id.model import ChannelModel
from numpy.typing import NDArray

from nav_fusion.noise import AxisNoise

Floats = NDArray[np.float64]

FALSE_ALARMS = 0.01
"""Share of true models that any test of a filter ever speaks against, whatever the run's length."""

SHAPE = 2.0
"""Of the rivals' precision, a gamma law of mean 1: a factor of 2 either way."""

RIVAL_CORRELATION = 0.2
"""Standard deviation of the correlation that rivals of white innovations have."""

FREQUENCIES = 4096


def of_scale(squares: float, dof: float) -> float:
    """Log evidence that ``squares``, chi-square of ``dof`` under the model, has another scale.

    Rivals have the variance 1/x with x of a gamma law (``SHAPE``, ``SHAPE``).
    """
    if not dof > 0.0:
        return 0.0
    a, half = SHAPE, 0.5 * dof
    marginal = math.lgamma(a + half) - math.lgamma(a) + a * math.log(a)
    return marginal - (a + half) * math.log(a + 0.5 * squares) + 0.5 * squares


def of_correlation(products: float, squares: float) -> float:
    """Log evidence of a correlation: sums of e_k . e_{k-l} and of e_{k-l} . e_{k-l}.

    Rivals have the mean r e_{k-l} with r normal of ``RIVAL_CORRELATION``.
    """
    variance = RIVAL_CORRELATION**2
    wider = 1.0 + variance * squares
    return 0.5 * (variance * products * products / wider - math.log(wider))


def limit(tests: int) -> float:
    """Log evidence that one of so many tests must exceed: ``FALSE_ALARMS`` for all together."""
    return math.log(tests / FALSE_ALARMS)


@dataclass(frozen=True)
class Steps:
    """Mean square of a sensor's first differences at rest, all three axes, by its model.

    Attributes
    ----------
    lowest, highest : float
        The same but where rounding is coarser than the noise: then any between may be.
    dof : float
        Degrees of freedom of the mean, for each difference.
    """

    lowest: float
    highest: float
    dof: float

    def evidence(self, mean: float, count: float) -> float:
        """Log evidence of ``count`` differences whose mean square is outside."""
        dof = self.dof * count
        return of_scale(dof * self.factor(mean) ** 2, dof)

    def factor(self, mean: float) -> float:
        """Standard deviation seen over the nearest that the model allows; 1 between the two."""
        if mean > self.highest:
            return math.sqrt(mean / self.highest)
        return min(math.sqrt(mean / self.lowest), 1.0) if self.lowest > 0.0 else 1.0


def steps_of(axes: tuple[AxisNoise, AxisNoise, AxisNoise], rate_hz: float) -> Steps:
    """First differences that the models of three axes predict: white noise, rounding, bands, all.

    The mean square is twice the Allan variance at one sample.  For a Gaussian process with the
    differences' autocovariance r their mean square over n has the variance (2/n) sum r^2.
    """
    found = [_axis_steps(axis, rate_hz) for axis in axes]
    low, high, power = (float(sum(x)) for x in zip(*found, strict=True))
    return Steps(low, high, high * high / power)


def _axis_steps(axis: AxisNoise, rate_hz: float) -> tuple[float, float, float]:
    """Return lowest and highest mean square and sum of the squared autocovariances."""
    if axis.channel is None:
        mean = 2.0 * rate_hz * axis.white_density**2
        return mean, mean, 1.5 * mean * mean
    dt = 1.0 / rate_hz
    smooth = 2.0 * _allan_of_sample(axis.channel, dt)
    low, high = smooth, smooth
    step = _step(axis.channel)
    if 0.0 < smooth < 0.5 * step * step:  # a sigma below half a step
        low, high = 0.0, smooth + 0.5 * step * step
    f: Floats = (np.arange(FREQUENCIES, dtype=np.float64) + 0.5) * (0.5 * rate_hz / FREQUENCIES)
    psd = 4.0 * np.sin(np.pi * f * dt) ** 2 * model_psd(axis.channel, f, dt)
    shape = psd / max(float(psd.mean()), np.finfo(float).tiny)
    return low, high, high * high * float(np.mean(shape**2))


def _allan_of_sample(channel: ChannelModel, dt: float) -> float:
    """Allan variance at one sample, without what has a course: that is slow."""
    return float(model_allan_variance(channel, np.array([dt]), dt, span_s=(0.0, 0.0))[0])


def _step(channel: ChannelModel) -> float:
    steps = [f.effect.step for f in channel.effects if isinstance(f.effect, OutputRounding)]
    return max(steps, default=0.0)
