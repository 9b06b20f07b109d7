"""Reconciliation: where recording and model differ, what is missing, and whether it helps.

``compare`` and ``gap`` measure, ``explain`` proposes, ``loop`` decides; ``clean`` comes first and
``mended`` last.
"""

from imu_noise_id.reconcile.loop import (
    compare_recording,
    reconcile_recording,
)
from imu_noise_id.reconcile.result import (
    ChannelReconciliation,
    Gap,
    HeldOut,
    Reconciliation,
    Step,
    Where,
    reconciliation_tree,
)

__all__ = [
    "ChannelReconciliation",
    "Gap",
    "HeldOut",
    "Reconciliation",
    "Step",
    "Where",
    "compare_recording",
    "reconcile_recording",
    "reconciliation_tree",
]
