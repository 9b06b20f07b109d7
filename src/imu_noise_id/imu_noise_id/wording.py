"""Channels and numbers in words, for the terminal and the report."""

from __future__ import annotations

import math

QUANTITIES = {
    "angular_velocity": "gyroscope",
    "linear_acceleration": "accelerometer",
    "magnetic_field": "magnetometer",
    "heading": "heading",
    "position": "position",
    "velocity": "velocity",
}
_SUPERSCRIPTS = str.maketrans(
    "-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"
)


def channel_label(name: str) -> str:
    """``angular_velocity.x`` -> ``gyroscope x``."""
    quantity, _, axis = name.partition(".")
    return f"{QUANTITIES.get(quantity, quantity)} {axis}".strip()


def powers(value: float) -> str:
    """Two digits as people write them: ``1.2\u00d710\u207b\u2074``."""
    if value == 0.0 or 1e-2 <= abs(value) < 1e3:
        return f"{value:.2g}"
    mantissa, _, exponent = f"{value:.1e}".partition("e")
    return f"{mantissa}\u00d710{str(int(exponent)).translate(_SUPERSCRIPTS)}"


def gap_text(score: float, decimals: int = 2) -> str:
    """Return a gap with as many digits as mean anything; a dash where there is none."""
    if not math.isfinite(score):
        return "-"
    return f"{score:.{decimals}f}" if score < 1000.0 else f"{score:.1g}"
