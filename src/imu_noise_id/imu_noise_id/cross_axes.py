"""Noise that channels of one topic share, from the correlation of their whitened residuals."""

from __future__ import annotations

import dataclasses
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from imu_noise_id.effects.cross_axis import CrossAxis, correlation
from imu_noise_id.model import ChannelModel, Estimate, FittedEffect
from imu_noise_id.recording import DERIVED

CLEAR = 5.0
LEAST = 0.01


def cross_axes(
    residuals: list[tuple[str, str, NDArray[np.float32]]],
) -> dict[str, tuple[FittedEffect, ...]]:
    """Cross-axis effects by channel name; each pair is listed on both of its channels.

    Parameters
    ----------
    residuals : list of (topic, name, (n,) white residual)
        Channels of different topics or lengths are not compared.
    """
    found: dict[str, tuple[FittedEffect, ...]] = {}
    for (topic, name, white), (other_topic, other, other_white) in combinations(residuals, 2):
        if topic != other_topic or white.size != other_white.size or white.size == 0:
            continue
        if name in DERIVED or other in DERIVED:
            continue
        value, error = correlation(white.astype(np.float64), other_white.astype(np.float64))
        if abs(value) < max(CLEAR * error, LEAST):
            continue
        for one, two in ((name, other), (other, name)):
            found[one] = (*found.get(one, ()), _effect(two, value, error))
    return found


def with_effects(model: ChannelModel, effects: tuple[FittedEffect, ...]) -> ChannelModel:
    """Return the model with more effects, in physical order, the covariance grown by theirs.

    Effects that the model lists already are left out.
    """
    new = tuple(e for e in effects if e not in model.effects)
    if not new:
        return model
    everything = (*model.effects, *new)
    order = sorted(range(len(everything)), key=lambda i: everything[i].effect.stage)
    covariance = model.log_covariance
    if covariance is not None:
        sizes = [sum(not isinstance(x.value, str) for x in e.estimates) for e in everything]
        variances = [_variance(x) for e in new for x in e.estimates if not isinstance(x.value, str)]
        whole = block_diag(covariance, np.diag(variances)) if variances else covariance
        starts = np.concatenate(([0], np.cumsum(sizes)))
        index = [j for i in order for j in range(starts[i], starts[i + 1])]
        covariance = whole[np.ix_(index, index)]
    return dataclasses.replace(
        model, effects=tuple(everything[i] for i in order), log_covariance=covariance
    )


def _variance(estimate: Estimate) -> float:
    return float(estimate.std_error or 0.0) ** 2


def _effect(other: str, value: float, error: float) -> FittedEffect:
    rows = (
        Estimate(other, None, None, None, ""),
        Estimate(
            value, error, max(value - 1.96 * error, -1.0), min(value + 1.96 * error, 1.0), "1"
        ),
    )
    return FittedEffect(CrossAxis(other, value), rows)
