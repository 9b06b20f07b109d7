"""Spectral ordinates of a record in the DCT-II, binned where the spectrum is smooth.

The orthonormal DCT-II C_k of n samples has ``E[C_k^2 dt] = S(f_k)`` at ``f_k = k/(2 n dt)``, k = 1
... n-1; for white noise and for a random walk of unknown level the ordinates are exactly
independent, each S(f_k) times chi-square with one degree of freedom.  Unequal ends of the record
leak nothing, which the Fourier transform cannot say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from imu_noise_id.recording import Floats

SINGLE = 128
LOG_WIDTH = 0.02
LINEAR_FROM_HZ = 5.0
LINEAR_WIDTH_HZ = 0.1
LEAST_SCORE = 3.0
"""Score statistic below which a fit with the effect added is not tried."""


@dataclass(frozen=True)
class Ordinates:
    """Averaged DCT-II ordinates.

    Attributes
    ----------
    frequency_hz : (b,) float64
        Mean frequency of each bin.
    power : (b,) float64
        Mean of ``C_k^2 dt`` over the bin, unit^2/Hz, comparable with a two-sided PSD.
    dof : (b,) float64
        Degrees of freedom: ordinates in the bin, less what was spent on courses and gaps.
    sample_time_s, duration_s : float
    """

    frequency_hz: Floats
    power: Floats
    dof: Floats
    sample_time_s: float
    duration_s: float


LEAST_NEW = 1e-3
"""Share of a shape's information that no parameter of the fit explains: of less, what is left is
rounding and the second order, and an amount read from it may be a hundred times the signal."""


@dataclass(frozen=True)
class Residual:
    """What a fitted spectrum leaves, for score statistics of what might be added to it.

    Attributes
    ----------
    ordinates : Ordinates
    psd : (b,) float64
        Fitted spectrum.
    tangent : (p, b) float64
        Derivatives of log psd by the fitted parameters.
    known : (p, p) float64 or None
        Information on them from elsewhere, where the fit is not of the ordinates alone.
    """

    ordinates: Ordinates
    psd: Floats
    tangent: Floats
    known: Floats | None = None

    def score(self, shapes: Floats) -> tuple[Floats, Floats]:
        """Efficient score of adding ``amount * shape`` to the spectrum.

        Parameters
        ----------
        shapes : (g, b) float64

        Returns
        -------
        amount, chi2 : (g,) float64
            One-step estimate of the amount and the score statistic, 0 where the amount is negative.
        """
        weight = 0.5 * self.ordinates.dof
        relative = shapes / self.psd
        misfit = self.ordinates.power / self.psd - 1.0
        score = relative @ (weight * misfit)
        information = np.einsum("gb,b,gb->g", relative, weight, relative)
        if self.tangent.size:
            cross = (relative * weight) @ self.tangent.T
            fisher = (self.tangent * weight) @ self.tangent.T
            if self.known is not None:
                fisher = fisher + self.known
            fisher[np.diag_indices_from(fisher)] *= 1.0 + 1e-9
            information = information - np.sum(cross * np.linalg.solve(fisher, cross.T).T, axis=1)
        information = np.maximum(information, LEAST_NEW * (relative**2 @ weight))
        amount = np.maximum(score, 0.0) / information
        return amount, amount * np.maximum(score, 0.0)


def fast_length(n: int) -> int:
    """Largest 5-smooth length up to n that loses at most a thousandth of the record, else n."""
    smooth = [
        2**a * 3**b * 5**c
        for c in range(12)
        for b in range(18)
        for a in range(36)
        if n * 0.999 <= 2**a * 3**b * 5**c <= n
    ]
    return max(smooth, default=n)


def bin_edges(n: int, sample_time_s: float, peaks_hz: tuple[float, ...] = ()) -> np.ndarray:
    """First ordinate of each bin, and n: single ordinates, then log bins, then linear ones.

    About each of ``peaks_hz`` the bins are single ordinates again that widen with the distance.
    """
    spacing_hz = 1.0 / (2.0 * n * sample_time_s)
    linear_from = int(LINEAR_FROM_HZ / spacing_hz)
    linear_width = max(1, int(LINEAR_WIDTH_HZ / spacing_hz))
    start = min(SINGLE + 1, n)
    single = np.arange(1, start)
    count = max(int(np.log(max(n / start, 1.0)) / LOG_WIDTH), 1)
    log = np.unique(np.rint(start * np.exp(LOG_WIDTH * np.arange(count + 1))).astype(np.int64))
    wide = np.flatnonzero((log[:-1] >= linear_from) & (np.diff(log) > linear_width))
    if wide.size:
        log = log[: wide[0] + 1]
        linear = np.arange(log[-1] + linear_width, n, linear_width)
    else:
        linear = np.zeros(0, dtype=np.int64)
    away = np.unique(np.rint(np.concatenate((np.arange(32), 32 * 1.05 ** np.arange(200)))))
    away = away[away <= 2 * linear_width].astype(np.int64)
    fine = [int(f / spacing_hz) + side * away for f in peaks_hz for side in (-1, 1)]
    inside = [part[(part >= 1) & (part < n)] for part in (single, log, linear, *fine)]
    return np.unique(np.concatenate((*inside, [n])))


def cosine_coefficients(values: Floats) -> Floats:
    """Orthonormal DCT-II of the values about the first of them (the level is of no interest)."""
    return np.asarray(fft.dct(values - values[0], norm="ortho"))


def ordinates(
    coefficients: Floats, sample_time_s: float, peaks_hz: tuple[float, ...] = ()
) -> Ordinates:
    """Bin the squared DCT-II coefficients of a complete record.

    Parameters
    ----------
    coefficients : (n,) float64
        From :func:`cosine_coefficients`, n >= 3.
    sample_time_s : float
    peaks_hz : tuple of float
        Where narrow peaks ask for narrow bins.
    """
    n = coefficients.size
    edges = bin_edges(n, sample_time_s, peaks_hz)
    count = np.diff(edges).astype(float)
    power = np.add.reduceat(coefficients[: edges[-1]] ** 2, edges[:-1]) * (sample_time_s / count)
    middle = 0.5 * (edges[:-1] + edges[1:] - 1)
    frequency_hz = middle / (2.0 * n * sample_time_s)
    return Ordinates(frequency_hz, power, count, sample_time_s, n * sample_time_s)
