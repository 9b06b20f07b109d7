"""Canonical correlation analysis in the report: step response, Bode, poles and zeros, and words."""

from __future__ import annotations

from imu_noise_id.identify import ChannelResult
from imu_noise_id.report.page import Figure, Table


def transfer_paragraphs(result: ChannelResult) -> list[str]:
    """Say what past and future have to do with each other."""
    return []


def transfer_figures(result: ChannelResult) -> list[Figure]:
    """Return the pictures of the shaping filter."""
    return []


def transfer_table(result: ChannelResult) -> list[Table]:
    """Return the numbers of the shaping filter."""
    return []
