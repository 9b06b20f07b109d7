"""Which tests speak against the noise model, and the sentences that say so.

One family at one level (``evidence.FALSE_ALARMS``): the mean NIS, sums of innovations over blocks
of each length, their correlation, and the first differences of gyro and accelerometer at rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nav_fusion import arrays, evidence, observe
from nav_fusion.state import SPANS

if TYPE_CHECKING:
    from nav_fusion.engine import Engine

Floats = NDArray[np.float64]

FEWEST_FIXES = 30
"""Fewer say nothing about the covariance."""

MATERIAL = 0.05
"""A sigma that is wrong by less changes nobody's decision."""

MATERIAL_CORRELATION = 0.05
"""Nor does a correlation of successive innovations below this."""

MATERIAL_LOUDNESS = 0.2
"""Nor an IMU whose single samples are noisier or quieter than its model by less."""

FIX_KINDS = ("nis", "sums", "correlation")
"""Of a :class:`Doubt` that the fixes raise."""

TESTS = 1 + len(observe.SPAN_FIXES) + 1 + 2


@dataclass(frozen=True)
class Doubt:
    """One test of the family.

    Attributes
    ----------
    kind : str
        ``nis``, ``sums``, ``correlation``, ``gyro`` or ``accel``.
    fixes : int
        Length of the blocks for ``sums``, else 0.
    evidence : float
        Logarithm of the e-value.
    size : float
        What was found over what the model says: standard deviations; a correlation as it is.
    material : bool
        Whether that is enough to matter.
    """

    kind: str
    fixes: int
    evidence: float
    size: float
    material: bool

    @property
    def holds(self) -> bool:
        """Whether the test speaks against the model."""
        return self.material and self.evidence > evidence.limit(TESTS)


def doubts_of(engine: Engine) -> tuple[Doubt, ...]:
    """All tests of a filter as they stand."""
    if engine._core is None:
        return ()
    return (*fix_doubts(engine._best()), *step_doubts(engine))


def fix_doubts(s: Floats) -> tuple[Doubt, ...]:
    """Tests on the innovations of a hypothesis."""
    fixes = int(s[observe.WHITE_COUNT])
    if fixes < FEWEST_FIXES:
        return ()
    found = [_scale_doubt("nis", 0, float(s[observe.NIS_SUM]), 3.0 * fixes)]
    for i, length in enumerate(observe.SPAN_FIXES):
        count = fixes // length
        if count > 0:
            squares = float(s[SPANS + 4 * i + 3])
            found.append(_scale_doubt("sums", length, squares, 3.0 * count))
    return (*found, _correlation_doubt(s))


def step_doubts(engine: Engine) -> tuple[Doubt, ...]:
    """Tests on the IMU's first differences at rest, or where the fixes alone show rest."""
    sums, _ = steps_seen(engine)
    found = []
    for k, (kind, model) in enumerate(zip(("gyro", "accel"), engine.steps(), strict=True)):
        if sums[0] > 0.0:
            mean, count = float(sums[1 + k] / sums[0]), float(sums[0])
            size = model.factor(mean)
            material = abs(size - 1.0) > MATERIAL_LOUDNESS
            found.append(Doubt(kind, 0, model.evidence(mean, count), size, material))
    return tuple(found)


def steps_seen(engine: Engine) -> tuple[Floats, bool]:
    """Count and sums of squared differences, and whether the sensors were quiet meanwhile.

    Where they never were, those of the blocks that only the fixes show to be at rest.
    """
    assert engine._core is not None
    d = engine._core.shared
    quiet = d[arrays.QUIET_STEPS : arrays.QUIET_STEPS + 3]
    return (
        (quiet, True) if quiet[0] > 0.0 else (d[arrays.LOUD_STEPS : arrays.LOUD_STEPS + 3], False)
    )


def _scale_doubt(kind: str, fixes: int, squares: float, dof: float) -> Doubt:
    size = math.sqrt(squares / dof)
    material = abs(size - 1.0) > MATERIAL
    return Doubt(kind, fixes, evidence.of_scale(squares, dof), size, material)


def _correlation_doubt(s: Floats) -> Doubt:
    """Mean over the lags of the e-values, which is one too; the largest correlation of them."""
    squares = float(s[observe.NIS_SUM])
    products = s[observe.WHITE_SUM : observe.WHITE_SUM + observe.LAGS]
    each = np.array([evidence.of_correlation(float(p), squares) for p in products])
    mean = float(np.logaddexp.reduce(each)) - math.log(observe.LAGS)
    size = float(products[np.argmax(np.abs(products))]) / max(squares, 1e-300)
    return Doubt("correlation", 0, mean, size, abs(size) > MATERIAL_CORRELATION)


def sentences(engine: Engine, doubts: tuple[Doubt, ...]) -> tuple[str, ...]:
    """What the tests that hold say, the strongest of those about the same thing."""
    said = []
    held = [d for d in doubts if d.holds]
    nis = [d for d in held if d.kind == "nis"]
    if nis:
        said.append(_about_nis(engine, nis[0].size))
    sums = [d for d in held if d.kind == "sums"]
    if sums and not nis:
        said.append(_about_sums(max(sums, key=lambda d: d.evidence)))
    if any(d.kind == "correlation" for d in held):
        said.append(
            "the innovations are not white: the noise model is not that of the sensors "
            "(correlation times, or the sizes of slow errors)"
        )
    said.extend(_about_steps(engine, d) for d in held if d.kind in ("gyro", "accel"))
    return tuple(said)


def _about_nis(engine: Engine, factor: float) -> str:
    assumed = (
        "the covariance that the receiver claims, or that is assumed where it claims none,"
        if engine.noise.position_claimed
        else "the model's noise of the fixes"
    )
    if factor > 1.0:
        return (
            f"the covariance is not to be trusted: the fixes differ from what it expects by "
            f"{factor:.1f} times its sigma (NIS {3 * factor**2:.2f}, expected 3); "
            f"{assumed} may be too small, the receiver's noise coloured, the IMU noisier than its "
            "model, or gnss_delay_s and lever_arm_m not those of the platform"
        )
    return (
        f"the covariance is too careful: the fixes differ from what it expects by {factor:.2f} "
        f"of its sigma (NIS {3 * factor**2:.2f}, expected 3); {assumed} is too "
        "large: identify the receiver at rest (10 minutes or more) and give the model"
    )


def _about_sums(d: Doubt) -> str:
    if d.size > 1.0:
        return (
            f"the covariance is not to be trusted: summed over {d.fixes} fixes, innovations are "
            f"{d.size:.2f} times what it expects; the IMU is noisier than its model, or the "
            "receiver's slow errors are larger"
        )
    return (
        f"the covariance is too careful: summed over {d.fixes} fixes, innovations are "
        f"{d.size:.2f} of what it expects; the model's slow errors, of the receiver or of the IMU, "
        "are too large"
    )


def _about_steps(engine: Engine, d: Doubt) -> str:
    name = "gyroscope" if d.kind == "gyro" else "accelerometer"
    _, quiet = steps_seen(engine)
    if d.size < 1.0:
        return (
            f"the {name} is quieter than its model at rest: {d.size:.2g} of its noise; "
            "identify this IMU (a minute at rest) and give the model"
        )
    still = "at rest" if quiet else "where the fixes show rest (it is never quiet)"
    return (
        f"the {name} is louder than its model {still}, by {d.size:.2g}: the platform shakes, or "
        "the model's noise is too small"
    )
