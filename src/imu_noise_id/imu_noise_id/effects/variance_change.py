"""Variance change: for a while the noise is louder, or quieter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from imu_noise_id.effects.base import Parameter, Stage, TransformEffect
from imu_noise_id.recording import Floats


@dataclass(frozen=True)
class VarianceChange(TransformEffect):
    """From ``from_s`` to ``to_s`` the fast noise has ``ratio`` times its variance.

    Fast is what does not fall towards high frequency (white noise, quantization); slow terms go on
    as they are.

    Attributes
    ----------
    from_s, to_s : float
        Seconds since the recording's first stamp.
    ratio : float
        Of variances.
    """

    from_s: float
    to_s: float
    ratio: float

    name: ClassVar[str] = "variance_change"
    stage = Stage.SOURCE
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("from_s", "s", False, "Start, since the first stamp"),
        Parameter("to_s", "s", False, "End, since the first stamp"),
        Parameter("ratio", "1", True, "Variance within over variance outside"),
    )

    def apply(
        self, values: Floats, time_s: Floats, sample_time_s: float, rng: np.random.Generator
    ) -> Floats:
        """Scale the given (fast) noise by sqrt(ratio) within the window."""
        within = (time_s >= self.from_s) & (time_s < self.to_s)
        return np.where(within, np.sqrt(self.ratio) * values, values)


SILENT = 1e-12


def variance_scan(white: Floats, blocks: int = 256) -> tuple[int, int, float, float, float]:
    """Most likely window of another variance in white samples.

    The window of m among n samples, with mean squares v_in, v_out and v_all, gains
    (n log v_all - m log v_in - (n - m) log v_out)/2 nats over one variance for all; every window of
    whole blocks is tried.  There are n/m places for a window, so that short ones reach any gain by
    chance more often: the window that gains most beyond log(n/min(m, n - m)) is taken (Duembgen and
    Spokoiny 2001).  A window that reaches one end of the record is as likely as the rest of it: of
    the two, the one outside which the variance is nearer to 1.

    Parameters
    ----------
    white : (n,) float64
        White samples of about unit variance.
    blocks : int
        Resolution of the window.

    Returns
    -------
    first, last : int
        Samples [first, last) of the window.
    ratio : float
        Variance within over variance outside.
    gain : float
        Log-likelihood gained over one variance for all, nats.
    places : float
        n/min(m, n - m).
    """
    size = max(white.size // blocks, 1)
    count = white.size // size
    energy = np.sum(white[: count * size].reshape(count, size) ** 2, axis=1)
    total = np.concatenate(([0.0], np.cumsum(energy)))
    i, j = np.triu_indices(count + 1, 1)
    keep = (j - i < count) & (j - i <= 0.9 * count)
    i, j = i[keep], j[keep]
    inside = total[j] - total[i]
    m_in = (j - i) * float(size)
    m_all = count * float(size)
    outside = total[-1] - inside
    v_in, v_out = inside / m_in, outside / (m_all - m_in)
    v_all = total[-1] / m_all
    least = max(SILENT * v_all, np.finfo(float).tiny)  # a window of equal samples has no variance
    v_in, v_out, v_all = np.maximum(v_in, least), np.maximum(v_out, least), max(v_all, least)
    gain = 0.5 * (m_all * np.log(v_all) - m_in * np.log(v_in) - (m_all - m_in) * np.log(v_out))
    places = m_all / np.minimum(m_in, m_all - m_in)
    best = int(np.argmax(gain - np.log(places)))
    first, last = int(i[best] * size), int(j[best] * size) if j[best] < count else white.size
    ratio = float(v_in[best] / v_out[best])
    rest = other_side(first, last, white.size)
    if rest is not None and abs(np.log(v_in[best])) < abs(np.log(v_out[best])):
        (first, last), ratio = rest, 1.0 / ratio
    return first, last, ratio, float(gain[best]), float(places[best])


def other_side(first: int, last: int, count: int) -> tuple[int, int] | None:
    """The rest of ``count`` samples beside a window that reaches one end of them; else None."""
    if first == 0:
        return last, count
    return (0, first) if last == count else None
