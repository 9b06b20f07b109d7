"""Channels against each other: common white noise that the model does not have, or has."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy import fft

from imu_noise_id.effects.cross_axis import CrossAxis
from imu_noise_id.model import ChannelModel
from imu_noise_id.reconcile.battery import Whitened
from imu_noise_id.reconcile.null import log_p_of
from imu_noise_id.reconcile.prior import TYPED_STD_ERROR
from imu_noise_id.recording import DERIVED, Floats

BANDS = 120
TRIMMED = 6
TRIMMED_EFFICIENCY = 0.98
"""Variance of the mean over that of the mean without these, normal law (2e5 simulated)."""


@dataclass(frozen=True)
class Tie:
    """Correlation of two whitened channels.

    Attributes
    ----------
    first, second : str
        Channel names.
    value, std_error : float
        Correlation over all frequencies.
    given : float
        What the model says; 0 where it says nothing.
    log_p : float
        Chance of such a difference from the model, the most extreme bands left out.
    """

    first: str
    second: str
    value: float
    std_error: float
    given: float
    log_p: float


def ties(whitened: dict[str, Whitened], models: dict[str, ChannelModel]) -> list[Tie]:
    """All pairs of measured channels of one length and rate.

    A channel that is computed from others is tied to them by arithmetic, and left out.  A
    vibration that two axes share correlates them in one band; common white noise does in all: the
    test leaves out the ``TRIMMED`` highest and as many lowest of ``BANDS``: nothing is lost of what
    all bands share, where the loudest alone, left out, took 1.2 standard deviations with them.
    """
    coefficients = {n: np.asarray(fft.dct(w.samples, norm="ortho")) for n, w in whitened.items()}
    out = []
    measured = [name for name in whitened if name not in DERIVED]
    for first, second in combinations(measured, 2):
        a, b = whitened[first], whitened[second]
        if a.samples.size != b.samples.size or a.sample_time_s != b.sample_time_s:
            continue
        given, error = _given(models, first, second)
        out.append(_tie((first, second), coefficients[first], coefficients[second], given, error))
    return out


def _tie(names: tuple[str, str], a: Floats, b: Floats, given: float, error: float) -> Tie:
    size = a.size // BANDS
    whole = BANDS * size
    # channels may be far louder than the model that whitened them: of what they are in each band
    powers = [(x[:whole] ** 2).reshape(BANDS, size).mean(axis=1) for x in (a, b)]
    products = (a * b)[:whole].reshape(BANDS, size).mean(axis=1)
    products = products / np.sqrt(np.maximum(powers[0] * powers[1], 1e-300))
    value = float(np.mean(a * b) / np.sqrt(np.mean(a**2) * np.mean(b**2)))
    std_error = float((1.0 - value**2) / np.sqrt(a.size))
    kept = np.sort(products - given)[TRIMMED : BANDS - TRIMMED]
    scatter = np.hypot((1.0 - given**2) / np.sqrt(whole * TRIMMED_EFFICIENCY), error)
    return Tie(*names, value, std_error, given, log_p_of(float(kept.mean()) / scatter))


def _given(models: dict[str, ChannelModel], first: str, second: str) -> tuple[float, float]:
    for name, other in ((first, second), (second, first)):
        for fitted in models[name].effects:
            if isinstance(fitted.effect, CrossAxis) and fitted.effect.other == other:
                said = fitted.effect.correlation
                return said, fitted.estimates[1].std_error or TYPED_STD_ERROR * abs(said)
    return 0.0, 0.0
