"""The axes of each sensor as one innovations model, and how far its Allan curves are from measured.

What the axes share (a temperature, a supply, the platform) is one state here and as many as there
are axes in models of one channel each.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from imu_noise_id.allan import AllanCurve
from imu_noise_id.canonical_variates import StateSpace
from imu_noise_id.joint_cca import Joint, joint
from imu_noise_id.recording import Floats
from imu_noise_id.series import Series
from imu_noise_id.shaping_allan import allan_distance, axis_allan_deviation
from imu_noise_id.transfer_function import stationary_covariance

if TYPE_CHECKING:
    from imu_noise_id.identify import ChannelResult

AXES = 3
LEAST_SAMPLES = 1000
WORKERS = 2


@dataclass(frozen=True)
class AxesTogether:
    """One model for the three axes of a sensor.

    Attributes
    ----------
    topic : str
    names : tuple of str
        Channels, in the order of the model's outputs.
    model : Joint
    deviations : tuple of (t,) float64
        Allan deviation of the model, of each axis at its measured averaging times.
    distances : tuple of (float or None)
        Of each axis from the measured curve, see ``allan_distance``.
    """

    topic: str
    names: tuple[str, ...]
    model: Joint
    deviations: tuple[Floats, ...]
    distances: tuple[float | None, ...]

    @property
    def innovation_correlation(self) -> Floats:
        """Correlations of the axes' innovations, (d, d)."""
        covariance = self.model.state_space.innovation_covariance
        sigma = np.sqrt(np.diag(covariance))
        return np.asarray(covariance / np.outer(sigma, sigma))


@dataclass(frozen=True)
class Mode:
    """A real state, or a complex pair, of a model of several axes.

    Attributes
    ----------
    time_constant_s : float
        In which it decays to 1/e.
    frequency_hz : float
        0 for a real state.
    sigma : (d,) float64
        Standard deviation that it alone gives each axis.
    """

    time_constant_s: float
    frequency_hz: float
    sigma: Floats


def modes(space: StateSpace) -> tuple[Mode, ...]:
    """Take a stable model apart into its modes, the slowest first."""
    if not space.A.size:
        return ()
    poles, vectors = np.linalg.eig(space.A)
    drive = space.K @ np.linalg.cholesky(space.innovation_covariance)
    P = stationary_covariance(space.A, drive @ drive.T)
    back = np.linalg.inv(vectors)
    variance = np.maximum(np.real(np.diag(back @ P @ back.conj().T)), 0.0)
    found = []
    for k in np.argsort(-np.abs(poles)):
        if poles[k].imag < 0.0:  # its conjugate stands for both
            continue
        both = 2.0 if poles[k].imag > 0.0 else 1.0
        sigma = np.abs(space.C @ vectors[:, k]) * np.sqrt(both * variance[k])
        decay = -np.log(max(abs(poles[k]), 1e-300)) / space.sample_time_s
        turn_hz = abs(np.angle(poles[k])) / (2.0 * np.pi * space.sample_time_s)
        found.append(Mode(float(1.0 / decay), float(turn_hz), sigma))
    return tuple(found)


def axes_together(results: Sequence[ChannelResult]) -> tuple[AxesTogether, ...]:
    """Model the sensors of which three axes were recorded on one grid and have a model each."""
    groups: dict[tuple[str, str], list[ChannelResult]] = {}
    for result in results:
        quantity = result.channel.name.partition(".")[0]
        if result.cca is not None and result.allan is not None:
            groups.setdefault((result.channel.topic, quantity), []).append(result)
    whole = [(topic, group) for (topic, _), group in groups.items() if len(group) == AXES]
    with ThreadPoolExecutor(WORKERS) as pool:
        found = list(pool.map(lambda one: _together(*one), whole))
    return tuple(sensor for sensor in found if sensor is not None)


def _together(topic: str, group: Sequence[ChannelResult]) -> AxesTogether | None:
    channels = aligned([result.series for result in group])
    if (
        channels is None
        or np.logical_and.reduce([c.observed for c in channels]).sum() < LEAST_SAMPLES
    ):
        return None
    model = joint(channels)
    curves = [result.allan for result in group if result.allan is not None]
    deviations = tuple(
        axis_allan_deviation(model.state_space, axis, curve.averaging_factor)
        for axis, curve in enumerate(curves)
    )
    distances = tuple(map(_distance, curves, deviations))
    return AxesTogether(
        topic, tuple(result.channel.name for result in group), model, deviations, distances
    )


def _distance(curve: AllanCurve, deviation: Floats) -> float | None:
    return allan_distance(curve.deviation, deviation, curve.degrees_of_freedom)


def aligned(channels: Sequence[Series]) -> tuple[Series, ...] | None:
    """Cut channels to the samples that they have in common; None where their rates differ."""
    step = channels[0].sample_time_s
    if any(abs(channel.sample_time_s / step - 1.0) > 1e-9 for channel in channels):
        return None
    first = [round((channel.start_s - channels[0].start_s) / step) for channel in channels]
    begin = max(first)
    size = (
        min(at + channel.values.size for at, channel in zip(first, channels, strict=True)) - begin
    )
    if size < 1:
        return None
    return tuple(
        replace(
            channel,
            values=channel.values[begin - at :][:size],
            observed=channel.observed[begin - at :][:size],
            start_s=channels[0].start_s + begin * step,
        )
        for at, channel in zip(first, channels, strict=True)
    )
