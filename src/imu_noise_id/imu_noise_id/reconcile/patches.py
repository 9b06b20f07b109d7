"""Where power comes or goes with time: one band of the spectrum, for a while.

A whitened record has the same power at all times and frequencies.  The statistics of the whole
spectrum miss a band that is twice too loud in one half and silent in the other, and those of the
variance one that is narrow.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import fft

from imu_noise_id.recording import Floats

MOST_STRETCHES = 16
LEAST_STRETCH = 32
"""Samples of a stretch where there are fewer stretches."""
BINS = 128
RATIOS = np.geomspace(0.05, 200.0, 120)
"""Of loudness that are tried."""
LEAST_ORDINATES = 4
"""Ordinates of a stretch in a bin."""


@dataclass(frozen=True)
class Patch:
    """A stretch of time and a band of frequencies whose power differs from that of other times.

    Attributes
    ----------
    nats : float
        Log-likelihood gained over the same power at all times.
    places : float
        How many such patches there are.
    first, last : int
        Samples [first, last).
    low_hz, high_hz : float
    ratio : float
        Power within over that of the same band at other times.
    """

    nats: float
    places: float
    first: int
    last: int
    low_hz: float
    high_hz: float
    ratio: float

    @property
    def net(self) -> float:
        """Nats beyond the logarithm of the number of places."""
        return self.nats - float(np.log(self.places))


def contrast(inside: Floats, outside: Floats, dof_in: Floats, dof_out: Floats) -> Floats:
    """Nats by which two sums of power prefer a level each over one for both."""
    p, q = np.maximum(inside, 1e-300), np.maximum(outside, 1e-300)
    gain = (dof_in + dof_out) * np.log((p + q) / (dof_in + dof_out))
    gain -= dof_in * np.log(p / dof_in) + dof_out * np.log(q / dof_out)
    return np.asarray(0.5 * gain)


def loudest_patch(white: Floats, sample_time_s: float) -> Patch:
    """The patch that gains most beyond its places, of whole stretches and bins, doubling bands.

    A band and its complement in time gain alike; of a patch at the end of the record the side is
    taken outside which the power is nearer to 1.
    """
    n = white.size
    stretches = max(min(MOST_STRETCHES, n // LEAST_STRETCH), 2)
    size = n // stretches
    parts = white[: stretches * size].reshape(stretches, size)
    power, dof, edges = _binned(parts)
    total = np.zeros((stretches + 1, power.shape[1]))
    total[1:] = np.cumsum(power, axis=0)
    i, j = _windows(stretches)
    span = (j - i)[:, None].astype(float)
    rarity = stretches / np.minimum(span, stretches - span)
    best: Patch | None = None
    for width, sums, many in _bands(total, dof):
        inside = sums[j] - sums[i]
        outside = sums[-1] - inside
        dof_in, dof_out = span * many, (stretches - span) * many
        nats = contrast(inside, outside, dof_in, dof_out)
        places = rarity * (power.shape[1] / width)
        at = np.unravel_index(int(np.argmax(nats - np.log(places))), nats.shape)
        if best is not None and nats[at] - np.log(places[at[0], 0]) <= best.net:
            continue
        row, column = int(at[0]), int(at[1])
        p = float(inside[at] / dof_in[row, column]), float(outside[at] / dof_out[row, column])
        bounds = int(i[row]) * size, int(j[row]) * size if j[row] < stretches else n
        if bounds[0] == 0 and abs(np.log(p[0] + 1e-300)) < abs(np.log(p[1] + 1e-300)):
            bounds, p = (bounds[1], n), p[::-1]
        low, high = edges[[column, column + width]] / (size * sample_time_s)
        ratio = p[0] / max(p[1], 1e-300)
        best = Patch(
            float(nats[at]), float(places[row, 0]), *bounds, float(low), float(high), ratio
        )
    assert best is not None
    return best


def band_gain(white: Floats, first: int, last: int) -> tuple[float, float]:
    """What tells a window from the rest: nats of its whole power, and of its best band's.

    The second is beyond the logarithm of the number of such bands.
    """
    inside = white[None, first:last]
    outside = np.concatenate((white[:first], white[last:]))[None, :]
    energy = float(np.sum(inside**2)), float(np.sum(outside**2))
    whole = contrast(*map(np.array, (*energy, inside.size, outside.size)))
    if min(inside.size, outside.size) < LEAST_STRETCH:
        return float(whole), 0.0
    bins = min(_bin_count(inside.size), _bin_count(outside.size))
    p, dof_in, _ = _binned(inside, bins)
    q, dof_out, _ = _binned(outside, bins)
    both = np.vstack((p, q))
    best = 0.0
    for (width, sums, many_in), (_, _, many_out) in zip(
        _bands(both, dof_in), _bands(both, dof_out), strict=True
    ):
        nats = contrast(sums[0], sums[1], many_in, many_out)
        best = max(best, float(nats.max()) - float(np.log(bins / width)))
    return float(whole), best


def gain_of_fast(white: Floats, first: int, last: int, share: Floats) -> float:
    """Nats by which a window's fast noise alone, of another level, tells it from the rest.

    Where that is the share s of the power, the window's is 1 + (ratio - 1) s times the rest's.

    Parameters
    ----------
    white : (n,) float64
    first, last : int
    share : (n,) float64
        At the record's DCT ordinates.
    """
    inside, outside = white[None, first:last], np.concatenate((white[:first], white[last:]))[None]
    if min(inside.size, outside.size) < LEAST_STRETCH:
        return 0.0
    bins = min(_bin_count(inside.size), _bin_count(outside.size))
    p, dof_in, _ = _binned(inside, bins)
    q, dof_out, _ = _binned(outside, bins)
    at = np.linspace(0.0, share.size - 1.0, bins + 1)
    mean = np.add.reduceat(share, at[:-1].astype(int)) / np.diff(at)
    more = 1.0 + (RATIOS[:, None] - 1.0) * np.clip(mean, 0.0, 1.0)
    dof = dof_in + dof_out
    nats = dof * np.log((p + q) / (p / more + q)) - dof_in * np.log(more)
    return 0.5 * float(np.max(np.sum(nats, axis=1)))


def _bin_count(samples: int) -> int:
    return max(min(BINS, samples // 2 // LEAST_ORDINATES), 2)


def _binned(parts: Floats, bins: int = 0) -> tuple[Floats, Floats, np.ndarray]:
    """Sums of the ordinates of each part in bins of equal width, their degrees of freedom, edges.

    In units of one degree of freedom each; of the ordinates only whole ones, 2 degrees each.
    """
    size = parts.shape[1]
    ordinates = (size - 1) // 2
    count = bins or _bin_count(size)
    edges = 1 + np.linspace(0, ordinates, count + 1).astype(int)
    power = 2.0 * np.abs(fft.rfft(parts, axis=1)[:, 1 : ordinates + 1]) ** 2 / size
    return np.add.reduceat(power, edges[:-1] - 1, axis=1), 2.0 * np.diff(edges), edges


def _windows(stretches: int) -> tuple[np.ndarray, np.ndarray]:
    """Stretches [i, j) of a record, of each that ends with the record only its complement."""
    i, j = np.triu_indices(stretches + 1, 1)
    return i[j < stretches], j[j < stretches]


def _bands(sums: Floats, dof: Floats) -> Iterator[tuple[int, Floats, Floats]]:
    """Width in bins, sums and degrees of freedom of all bands of doubling widths but the whole."""
    along = np.zeros((sums.shape[0], sums.shape[1] + 1))
    along[:, 1:] = np.cumsum(sums, axis=1)
    many = np.concatenate(([0.0], np.cumsum(dof)))
    width = 1
    while width < dof.size:
        yield width, along[:, width:] - along[:, :-width], many[width:] - many[:-width]
        width *= 2
