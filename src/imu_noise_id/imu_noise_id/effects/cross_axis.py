"""Cross-axis noise: part of the white noise of two channels is the same."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import CouplingEffect, Parameter
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class CrossAxis(CouplingEffect):
    """E[w_this w_other] = correlation, w the unit-variance drives of the channels' white noises.

    Attributes
    ----------
    other : str
        Name of the other channel.
    correlation : float
        Between -1 and 1.
    """

    other: str
    correlation: float

    name: ClassVar[str] = "cross_axis"
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("other", "", False, "The other channel"),
        Parameter("correlation", "1", False, "Correlation of the two white noises"),
    )


def correlation(white_a: Floats, white_b: Floats) -> tuple[float, float]:
    """Correlation of two whitened channels and its standard error, (value, std_error).

    Samples that are exactly 0 on either (not seen, or not new) say nothing and are left out.
    """
    both = (white_a != 0.0) & (white_b != 0.0)
    if both.sum() < 2:
        return 0.0, 1.0
    a, b = white_a[both], white_b[both]
    a, b = a - a.mean(), b - b.mean()
    power = float(np.sqrt((a @ a) * (b @ b)))
    value = float(a @ b) / power if power > 0.0 else 0.0
    return value, (1.0 - value**2) / float(np.sqrt(a.size))


def joint_drives(correlations: Floats, n: int, rng: np.random.Generator) -> Floats:
    """Unit-variance white drives of several channels, (channels, n).

    A matrix that is not a correlation matrix (estimates need not be) is replaced by the nearest one
    that its positive eigenvalues give.

    Parameters
    ----------
    correlations : (c, c) float64
        Ones on the diagonal.
    """
    values, vectors = np.linalg.eigh(correlations)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    root /= np.linalg.norm(root, axis=1, keepdims=True)
    return root @ rng.standard_normal((correlations.shape[0], n))
