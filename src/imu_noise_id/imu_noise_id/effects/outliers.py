"""Outliers: single samples far off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.special import ndtr

from imu_noise_id.effects.base import Parameter, TransformEffect
from imu_noise_id.recording import Floats, Mask

THRESHOLD = 5.0
"""Robust standard deviations beyond which a sample is taken for an outlier."""


@dataclass(frozen=True)
class Outliers(TransformEffect):
    """Each sample is hit with probability ``rate``; a hit adds N(0, scale^2).

    Attributes
    ----------
    rate : float
        Fraction of the samples.
    scale : float
        Standard deviation of a hit, in the channel's unit.
    """

    rate: float
    scale: float

    name: ClassVar[str] = "outliers"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("rate", "1", True, "Fraction of the samples that are hit"),
        Parameter("scale", "{u}", True, "Standard deviation of a hit"),
    )

    def apply(
        self, values: Floats, time_s: Floats, sample_time_s: float, rng: np.random.Generator
    ) -> Floats:
        """Add the hits."""
        hit = rng.random(values.size) < self.rate
        out = values.copy()
        out[hit] += rng.normal(0.0, self.scale, int(hit.sum()))
        return out


def outlier_mask(residual: Floats, threshold: float = THRESHOLD) -> Mask:
    """Samples of a white residual beyond ``threshold`` robust standard deviations, (n,).

    The deviation is 1.4826 times the median of the absolute values about the median.
    """
    centred = residual - np.median(residual)
    sigma = 1.4826 * float(np.median(np.abs(centred)))
    return np.abs(centred) > threshold * sigma


def outlier_parameters(hits: Floats, samples: int, sigma: float) -> tuple[float, float]:
    """Rate and scale from the deviations of the samples found beyond ``THRESHOLD sigma``.

    Gaussian hits below the threshold go unseen: with q the truncated-normal second moment the scale
    is iterated from the seen ones, and the rate is the seen fraction over P(|hit| > threshold).

    Parameters
    ----------
    hits : (m,) float64
        Deviations of the masked samples.
    samples : int
        All samples of the record.
    sigma : float
        Standard deviation of the clean samples.

    Returns
    -------
    rate, scale : float
    """
    if hits.size == 0:
        return 0.0, 0.0
    seen = float(np.mean(hits**2))
    total = seen
    limit = THRESHOLD * sigma
    for _ in range(200):
        c = limit / np.sqrt(total)
        tail = 2.0 * ndtr(-c)
        beyond = 1.0 + 2.0 * c * np.exp(-0.5 * c * c) / np.sqrt(2.0 * np.pi) / tail
        total = max(seen / beyond, (2.0 * sigma) ** 2)
    tail = 2.0 * ndtr(-limit / np.sqrt(total))
    rate = min(hits.size / samples / tail, 1.0)
    return float(rate), float(np.sqrt(max(total - sigma**2, sigma**2)))
