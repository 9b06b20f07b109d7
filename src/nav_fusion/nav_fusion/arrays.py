"""The arrays of the compiled filter, and where what lies in them.

Everything that depends on the past (states, covariances, counters, the detector of rest) is in
``bank`` and ``shared``, so that a checkpoint is a copy of them; ``cursor`` says where queues stand.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from imu_noise_id.compiled import njit
from numpy.typing import NDArray

from nav_fusion.correction import UPDATE_SIZE, Update, update_views
from nav_fusion.observe import Sensing
from nav_fusion.state import Layout, SlowModel
from nav_fusion.strapdown import SCRATCH_SIZE

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

FIX, VELOCITY_KIND, FIELD = 0, 1, 2
"""Kinds of measurement, in the order in which equal stamps are taken."""

Z_SIZE = 26
"""What the corrections need, and from ``OUTCOME`` on what became of a fix (``observe.RESULT``)."""
OUTCOME = 18
IMU_RING = 16384
MEASUREMENT_RING = 1024
CHECKPOINTS = 16
MOST_SAMPLES = 4096
REACH = IMU_RING - MOST_SAMPLES - 8

# shared: what all hypotheses have in common, rewound with them
BLOCK_START, BLOCK_COUNT, BLOCK_SUMS = 0, 1, 2
QUIET_BLOCKS, GAPS, GAP_S, FAST_BLOCKS, STILL = 10, 11, 12, 13, 14
SHAKE, SHAKE_BLOCKS, DENIED, RESTING, LAST_FORCE = 15, 16, 17, 18, 19
BLOCK_STEPS, SLOW_BLOCKS, QUIET_STEPS, LOUD_STEPS = 22, 24, 25, 28
"""Squared first differences (gyro, accelerometer), all axes summed: of the block that runs; and how
many, with their sums, in blocks of rest and in blocks that only the fixes show to be at rest."""
DENIED_AT = 31
"""Where the platform was (ECEF, 3) when it began to be watched for rest again."""
LAG, LAG_TURN = 34, 35
"""How long, s, all but the heaviest hypothesis lag behind; its turn (3) since, and how the specific
force has changed its velocity (3) and moved its place (3) (:func:`nav_fusion.hypotheses.lead`)."""
REPOSE = 44
"""Whether the platform has seemed to rest since the start (:mod:`nav_fusion.repose`)."""
SHARED = 45

# cursor: where the queues stand (int64)
SAMPLES, HEAD_MEASUREMENT, NEXT, FIRST_CHECKPOINT, LAST_CHECKPOINT, AHEAD = 0, 1, 2, 3, 4, 5
PUBLISH_DUE, CHECKPOINT_DUE = 6, 7
CURSOR = 16

LOST_NS = 14
"""Stamp of the fix at which the filter was found lost, or 0; it goes no further."""

# one row of output: r, v, q, then these
OUT_P, OUT_RATE, OUT_BIAS, OUT_BIAS_VARIANCE = 10, 91, 94, 100
OUT_HYPOTHESES, OUT_STILL, OUT_RESTING, OUT_SIZE = 106, 107, 108, 109

# the cursor's times, all of them ns, in the order of new_core's argument
START, CHECKPOINT_PERIOD, PUBLISH_PERIOD, GAP, WINDOW, FURTHEST = 8, 9, 10, 11, 12, 13

# constants
GYRO_PSD, ACCEL_PSD, UNKNOWN, QUIET, STILL_USE = 0, 3, 6, 10, 30
CIRCLE = 31
"""From here on, of each hypothesis, the shares of ``CIRCLE_HEADINGS`` of them; none if too few."""
CIRCLE_HEADINGS, FEWEST_ON_CIRCLE = 5, 8

# work: some vectors, one matrix and the last step before the scratch of its users
MATRIX, LAST_DT, VECTORS = 48, 57, 64


class Core(NamedTuple):
    """One filter with all its hypotheses, queues and checkpoints.

    Few arrays, the small ones packed: a compiled call costs by the array.
    """

    bank: Floats  # (K, size)
    shared: Floats  # (SHARED,)
    cursor: Ints  # (CURSOR,)
    imu_ns: Ints  # (IMU_RING,)
    imu: Floats  # (IMU_RING, 6): rate, force
    measurement_ns: Ints  # (MEASUREMENT_RING,), ascending from 0
    kind: Ints
    z: Floats  # (MEASUREMENT_RING, Z_SIZE)
    checkpoint_bank: Floats  # (CHECKPOINTS, K, size)
    checkpoint_shared: Floats
    checkpoint_sample: Ints  # (CHECKPOINTS,) number of samples taken when it was made
    target: Ints  # (m,)
    slow_table: Floats  # (4, m)
    constants: Floats  # (CONSTANTS,)
    ahead: Floats  # (size,), one hypothesis: scratch
    work: Floats  # scratch


def new_core(
    layout: Layout, hypotheses: Floats, times: Ints, gap: Floats, quiet: Floats, sensing: Sensing
) -> Core:
    """Allocate a core that starts from ``hypotheses`` (K, size).

    ``times`` (6,) ns: start, checkpoint period, publish period, gap, window, furthest ahead;
    ``gap`` (4,): sigma and correlation time of unknown acceleration and rate; ``quiet`` (7,): see
    :func:`nav_fusion.starting.quiet_limits`.
    """
    count, size = hypotheses.shape
    cursor = np.zeros(CURSOR, dtype=np.int64)
    cursor[START : START + 6] = times
    slow = layout.slow
    return Core(
        hypotheses.copy(),
        np.zeros(SHARED),
        cursor,
        np.zeros(IMU_RING, dtype=np.int64),
        np.zeros((IMU_RING, 6)),
        np.zeros(MEASUREMENT_RING, dtype=np.int64),
        np.zeros(MEASUREMENT_RING, dtype=np.int64),
        np.zeros((MEASUREMENT_RING, Z_SIZE)),
        np.zeros((CHECKPOINTS, count, size)),
        np.zeros((CHECKPOINTS, SHARED)),
        np.zeros(CHECKPOINTS, dtype=np.int64),
        slow.target,
        np.stack([slow.rate, slow.psd, slow.variance, slow.spin]),
        np.concatenate(
            [layout.gyro_psd, layout.accel_psd, gap, quiet, *sensing, circle_shares(count)]
        ),
        np.zeros(size),
        np.zeros(VECTORS + SCRATCH_SIZE + UPDATE_SIZE),
    )


@njit(cache=True)
def circle_heading(k: int, count: int) -> int:
    """Index of the k-th of the headings that are followed at rest."""
    return (2 * k * count + CIRCLE_HEADINGS) // (2 * CIRCLE_HEADINGS)


def circle_shares(count: int) -> Floats:
    """Weights (count, 5), flat, by which a function on the circle follows from five of its values.

    Exact for a constant, and for sine and cosine of the heading and of twice the heading.
    """
    if count < FEWEST_ON_CIRCLE:
        return np.empty(0)
    angle = 2.0 * np.pi * np.arange(count) / count
    waves = [np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)]
    basis = np.stack([np.ones(count), *waves], axis=1)
    five = [circle_heading(k, count) for k in range(CIRCLE_HEADINGS)]
    return np.linalg.solve(basis[five].T, basis.T).T.ravel()


@njit(cache=True)
def slow_of(core: Core) -> SlowModel:
    """Return the slow states' model."""
    t = core.slow_table
    return SlowModel(core.target, t[0], t[1], t[2], t[3])


@njit(cache=True)
def sensing_of(core: Core) -> Sensing:
    """Return what the corrections need, as ``new_core`` packed it."""
    c = core.constants
    return Sensing(c[17:20], c[20:24], c[24:26], c[26:27], c[27:31])


@njit(cache=True)
def update_of(core: Core) -> Update:
    """Return the working arrays of a correction."""
    return update_views(core.work[VECTORS + SCRATCH_SIZE :])
