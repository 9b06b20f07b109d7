"""What the live ``fuse`` has a process of its own do: identify the rest that it begins with.

In a thread of the node it would take the interpreter's lock from reception, 5 ms at a time.
"""

from __future__ import annotations

from dataclasses import dataclass

from imu_noise_id.columns import TopicColumns
from imu_noise_id.errors import InputError

from nav_fusion.fuse import choose_noise
from nav_fusion.noise import NavigationNoise
from nav_fusion.parameters import Parameters


@dataclass(frozen=True)
class Leading:
    """What has come since the beginning."""

    columns: tuple[TopicColumns, ...]
    parameters: Parameters


@dataclass(frozen=True)
class Found:
    """The noise model of the rest, or of what is assumed without one; or why there is none."""

    noise: NavigationNoise | None
    problem: str = ""


DIED = Found(None, "the identifying process died")


def find_noise(leading: Leading) -> Found:
    """One job."""
    try:
        noise = choose_noise(leading.columns, None, leading.parameters, "the live stream")
    except (ValueError, InputError) as error:
        return Found(None, str(error))
    return Found(noise)
