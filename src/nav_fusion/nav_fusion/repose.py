"""What seems to rest from the start on, before that is known: nothing is learned by its turning.

Until fixes show that the velocity is 0, the vertical gyro's bias turns the estimate of a platform
that stands, by degrees.  Tilt and accelerometer bias, which levelling has made one, are one by the
body's axes all the while; a covariance whose tilt stayed behind would see them together in one
direction after the other, and both would become known apart from nothing.  So what P says of tilt
turns with the estimate (``correction.take_tilt_along``), as it does when a correction turns it;
what bears gravity is vertical; and no fix turns the heading.  That is where to linearise, and no
measurement: the estimate and what is known of rest stay as they are.

It begins with a start that seems still, and ends for good when the sensors are not quiet or the
velocity contradicts rest, and when rest is known.
"""

from __future__ import annotations

from imu_noise_id.compiled import njit

from nav_fusion.arrays import REPOSE, Core, sensing_of, update_of
from nav_fusion.correction import whiten
from nav_fusion.hypotheses import heaviest, settle_all
from nav_fusion.resting import prepare_stop


@njit(cache=True)
def end_repose(core: Core) -> None:
    """Take the platform for moving, or for known to rest, from now on."""
    if core.shared[REPOSE] == 1.0:
        settle_all(core)
        core.shared[REPOSE] = 0.0


@njit(cache=True)
def is_known_to_move(core: Core) -> bool:
    """Whether the velocity of the heaviest hypothesis contradicts rest."""
    settle_all(core)
    sensing, update = sensing_of(core), update_of(core)
    prepare_stop(core.bank[heaviest(core)], core.target.size, sensing.still[0] ** 2, update)
    return whiten(3, update) > sensing.gate[3]
