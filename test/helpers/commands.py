"""Running a command inside a test, and a model that is easy to type."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

DENSITIES = {"angular_velocity": 1.2e-4, "linear_acceleration": 2.0e-3}


@dataclass(frozen=True)
class Result:
    """What a command did: exit status and what it printed."""

    status: int
    out: str
    err: str


Run = Callable[..., Result]


def model_text(rate_hz: float) -> str:
    """Return a hand-typed model of an IMU."""
    text = "format: model/1\nchannels:\n"
    for quantity, density in DENSITIES.items():
        for axis in "xyz":
            text += (
                f"- name: {quantity}.{axis}\n  rate_hz: {rate_hz}\n  mean: 0.01\n  effects:\n"
                f"  - name: white_noise\n    parameters: {{density: {density}}}\n"
            )
    return text
