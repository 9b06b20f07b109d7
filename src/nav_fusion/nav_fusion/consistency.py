"""Is the covariance true? NIS, NEES and whiteness, each with the band that a true one stays in."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from nav_fusion import arrays, headings, observe
from nav_fusion.doubt import FEWEST_FIXES, doubts_of, sentences
from nav_fusion.state import ALIVE, NAV, SLOW, STRIDE

if TYPE_CHECKING:
    from nav_fusion.engine import Engine, Status

Floats = NDArray[np.float64]

MANY_GATED = 0.1
"""A true model's gate keeps one fix in 10^4 out; a tenth is no matter of single bad fixes."""


def normalised_squares(error: Floats, covariance: Floats) -> Floats:
    """e' P^-1 e of errors (..., k) with covariances (..., k, k): NEES, or NIS of innovations."""
    solved = np.linalg.solve(covariance, error[..., None])[..., 0]
    return np.einsum("...i,...i->...", error, solved)


def mean_band(dof: int, count: int, confidence: float = 0.95) -> tuple[float, float]:
    """Band that the mean of ``count`` independent chi-squares of ``dof`` stays in."""
    tail = 0.5 * (1.0 - confidence)
    low, high = chdtri(dof * count, [1.0 - tail, tail]) / count
    return float(low), float(high)


def portmanteau(lag_sums: Floats, count: float, components: int, squares: float) -> float:
    """Box-Pierce statistic of whitened innovations: n sum over lags of the squared correlation.

    ``lag_sums`` (L,) are sums of e_k . e_{k-l} over ``components`` and ``squares`` that of
    e_k . e_k, the NIS: with them the scale falls out, and innovations that are merely too small
    for their covariance are neither white nor coloured by that.
    """
    lags = np.arange(1, lag_sums.size + 1)
    pairs = np.maximum(count - lags, 1.0)
    variance = squares / (components * count)
    return float(np.sum((lag_sums / variance) ** 2 / (components * pairs)))


def whiteness_limit(lags: int, confidence: float = 0.99) -> float:
    """Quantile of the portmanteau statistic under a true filter."""
    return float(chdtri(lags, 1.0 - confidence))


def is_symmetric_positive(P: Floats) -> bool:
    """Whether a covariance is symmetric to the last bit and has a Cholesky factor."""
    if not np.array_equal(P, P.T):
        return False
    scale = 1.0 / np.sqrt(np.diag(P))
    return bool(np.linalg.eigvalsh(P * np.outer(scale, scale))[0] > -1e-12)


def covariance_of(hypothesis: Floats, slow_states: int) -> Floats:
    """P (n, n) of a hypothesis."""
    n = NAV + slow_states
    return hypothesis[SLOW + slow_states :].reshape(n, STRIDE)[:, :n].copy()


@dataclass(frozen=True)
class Innovations:
    """Every fix against what the filter expected of it.

    Attributes
    ----------
    stamp_ns : (k,) int64
        When the fix holds.
    innovation, sigma : (k, 3) float64
        East, north, up, m: fix less expectation, colour removed, and its standard deviation.
    nis : (k,) float64
        Its normalised square, 3 degrees of freedom.
    used : (k,) bool
        False: kept out by the gate.  Fixes that repeat the one before are not listed.
    """

    stamp_ns: NDArray[np.int64]
    innovation: Floats
    sigma: Floats
    nis: Floats
    used: NDArray[np.bool_]


def innovations_of(engine: Engine) -> Innovations:
    """Innovations of the fixes that the engine has taken so far."""
    stamp_ns, rows = engine.results()
    told = rows[:, 7] != observe.SAME_AGAIN
    stamp_ns, rows = stamp_ns[told], rows[told]
    return Innovations(
        stamp_ns, rows[:, 0:3], rows[:, 3:6], rows[:, 6], rows[:, 7] == observe.TAKEN
    )


def _whiteness(s: Floats) -> float | None:
    """Return the portmanteau statistic of the innovations; None for fewer than twenty fixes."""
    squares = float(s[observe.NIS_SUM])
    if s[observe.DOF_SUM] < 60.0 or squares <= 0.0:
        return None
    lags = s[observe.WHITE_SUM : observe.WHITE_SUM + observe.LAGS]
    return portmanteau(lags, float(s[observe.WHITE_COUNT]), 3, squares)


def status_of(engine: Engine) -> Status:
    """Figures of a filter, see :class:`nav_fusion.engine.Status`."""
    from nav_fusion.engine import Status

    past, running, counts = engine._past, engine._core, engine.counts
    s = np.zeros(SLOW) if running is None else engine._best()
    row = _newest_row(running)
    dof = int(s[observe.DOF_SUM])
    fixes = dof // 3
    band = mean_band(3, fixes) if fixes else (None, None)
    whiteness, limit = _whiteness(s), whiteness_limit(observe.LAGS)
    total = {slot: int(past[slot] + s[slot]) for slot in observe.TOTALS}
    alive = 0 if running is None else int((running.bank[:, ALIVE] != 0).sum())
    doubts = sentences(engine, doubts_of(engine))
    known = s[observe.ALIGNED_S] if s[observe.ALIGNED_S] > 0 else None
    bias = tuple(map(float, row[arrays.OUT_BIAS : arrays.OUT_BIAS + 6]))
    sigma = tuple(
        math.sqrt(max(v, 0.0)) for v in row[arrays.OUT_BIAS_VARIANCE : arrays.OUT_BIAS_VARIANCE + 6]
    )
    return Status(
        aligned=alive == 1,
        hypotheses=alive,
        heading_known_s=None if known is None else float(known),
        used=total[observe.USED],
        gated=total[observe.GATED],
        late=counts.late,
        rejected=counts.rejected + total[observe.REPEATED],
        velocity_used=total[observe.VELOCITY_USED],
        velocity_gated=total[observe.VELOCITY_GATED],
        heading_used=total[observe.HEADING_USED],
        heading_gated=total[observe.HEADING_GATED],
        still_updates=total[observe.STILL_UPDATES],
        recovered=total[observe.RECOVERED],
        imu_samples=counts.imu_samples,
        imu_duplicates=counts.imu_duplicates,
        imu_out_of_order=counts.imu_out_of_order,
        imu_non_finite=counts.imu_non_finite,
        gaps=0 if running is None else int(running.shared[arrays.GAPS]),
        gap_s=0.0 if running is None else float(running.shared[arrays.GAP_S]),
        nis_last=float(s[observe.LAST_NIS]) if fixes else None,
        nis_mean=float(s[observe.NIS_SUM]) / fixes if fixes else None,
        nis_recent=float(s[observe.RECENT_NIS]) if fixes else None,
        nis_dof=dof,
        nis_lower=band[0],
        nis_upper=band[1],
        whiteness=whiteness,
        whiteness_limit=limit,
        correlation=None if whiteness is None else _lag_one(s),
        white=None if whiteness is None else whiteness < limit,
        gate=float(chdtri(3, 1.0 - engine.parameters.gate_confidence)),
        still=bool(row[arrays.OUT_STILL]),
        gyro_bias=bias[:3],
        accel_bias=bias[3:],
        gyro_bias_sigma=sigma[:3],
        accel_bias_sigma=sigma[3:],
        notes=_all_notes(engine, total, doubts),
        doubts=doubts,
        fault=engine.fault,
    )


def _lag_one(s: Floats) -> float:
    """Correlation of neighbouring innovations on the axis where it is strongest."""
    products = s[observe.LAG_ONE : observe.LAG_ONE + 3]
    correlation = products / np.maximum(s[observe.SQUARES : observe.SQUARES + 3], 1e-300)
    return float(correlation[np.argmax(np.abs(correlation))])


def _newest_row(running: arrays.Core | None) -> Floats:
    """State at the newest sample, laid out as in ``core``; zeros before the start."""
    row = np.zeros(arrays.OUT_SIZE)
    if running is not None:
        k = int((running.cursor[arrays.SAMPLES] - 1) % arrays.IMU_RING)
        headings.write_output(running, k, row)
    return row


def _all_notes(engine: Engine, total: dict[int, int], doubts: tuple[str, ...]) -> tuple[str, ...]:
    """Return the engine's notes and what the counters say."""
    notes = list(engine.notes)
    if total[observe.REPEATED]:
        notes.append(
            f"{total[observe.REPEATED]} fixes repeat the one before to the last bit "
            "(frozen receiver): left out"
        )
    if total[observe.RECOVERED]:
        notes.append(
            f"{total[observe.RECOVERED]} times the filter was started anew from fixes that "
            "it had gated without a break"
        )
    running = engine._core
    if running is not None:
        if running.shared[arrays.GAPS] > 0:
            notes.append(
                f"IMU silent {int(running.shared[arrays.GAPS])} times, "
                f"{running.shared[arrays.GAP_S]:.2f} s in all: propagated with unknown motion"
            )
        if running.shared[arrays.FAST_BLOCKS] >= 4:
            notes.append(
                "angular_velocity stays above 8 rad/s for a second or more: degrees per "
                "second, perhaps; it must be rad/s"
            )
        if (running.bank[:, ALIVE] > 0).sum() > 1:
            notes.append(
                "heading not observable: no magnetometer, and the platform has not moved "
                "enough for the fixes to show it"
            )
    gated, used = total[observe.GATED], total[observe.USED]
    if gated + used >= FEWEST_FIXES and gated > MANY_GATED * (gated + used):
        notes.append(
            f"the covariance is not to be trusted: {gated} of {gated + used} fixes were kept out "
            "by the gate, more than bad fixes explain"
        )
    return (*notes, *doubts)
