"""What reconciliation returns; every class maps one to one to a part of ``reconcile.json``."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from imu_noise_id.model import FittedEffect, NoiseModel
from imu_noise_id.model_file import effect_tree

AGREES, EXPLAINED, UNEXPLAINED = "agrees", "explained", "unexplained"
ADD, REFIT, REMOVE = "add", "refit", "remove"


@dataclass(frozen=True)
class Where:
    """One place at which recording and model differ.

    Attributes
    ----------
    domain : str
        ``allan``, ``spectrum``, ``amplitude``, ``time``, ``axes``, ``regressor`` or ``timing``.
    from_, to : float
        Range in the domain.
    unit : str
        Of the range: s, Hz, ...
    z : float
        Equivalent standard deviations, positive where the recording has more.
    """

    domain: str
    from_: float
    to: float
    unit: str
    z: float


def distinct(places: tuple[Where, ...]) -> tuple[Where, ...]:
    """Places without those that repeat one before them: several statistics look at one place."""
    first: dict[tuple[str, str, str, str], Where] = {}
    for place in places:
        key = (place.domain, f"{place.from_:.4g}", f"{place.to:.4g}", place.unit)
        first.setdefault(key, place)
    return tuple(first.values())


@dataclass(frozen=True)
class Gap:
    """How far recording and model are apart.

    Attributes
    ----------
    score : float
        On the part that no fit has seen; 1.0 is what the model's own simulations score on average.
    p_value : float
        Of the whole battery on the channel.
    where : tuple of Where
        What is significant, worst first.
    """

    score: float
    p_value: float
    where: tuple[Where, ...] = ()


@dataclass(frozen=True)
class HeldOut:
    """Gap before and after a step on data that its fit has not seen."""

    gap_before: float
    gap_after: float


@dataclass(frozen=True)
class Step:
    """One change to a channel's model.

    Attributes
    ----------
    action : str
        ``add``, ``refit`` or ``remove``.
    effect : FittedEffect
    gap_before, gap_after : float
        Scores on the whole recording.
    p_value : float
        Of what the step answers.
    held_out : HeldOut
    evidence : str
        One sentence.
    """

    action: str
    effect: FittedEffect
    gap_before: float
    gap_after: float
    p_value: float
    held_out: HeldOut
    evidence: str


@dataclass(frozen=True)
class ChannelReconciliation:
    """Verdict on one channel with what led to it."""

    topic: str
    name: str
    verdict: str
    before: Gap
    after: Gap
    steps: tuple[Step, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reconciliation:
    """Verdicts on all channels and the mended model.

    Attributes
    ----------
    channels : tuple of ChannelReconciliation
    model : NoiseModel
        The given model with the steps applied.
    false_alarm_rate : float
        Of the whole battery on the whole recording.
    notes : tuple of str
    """

    channels: tuple[ChannelReconciliation, ...]
    model: NoiseModel
    false_alarm_rate: float
    notes: tuple[str, ...] = ()

    def channel(self, name: str) -> ChannelReconciliation:
        """Return the channel of that name; raise KeyError when there is none."""
        for channel in self.channels:
            if channel.name == name:
                return channel
        raise KeyError(name)


def reconciliation_tree(result: Reconciliation) -> dict[str, Any]:
    """Return ``reconcile.json``, format ``reconcile/1``, as plain data."""
    return {
        "format": "reconcile/1",
        "channels": [_channel_tree(channel) for channel in result.channels],
        "false_alarm_rate": result.false_alarm_rate,
        "notes": list(result.notes),
    }


def _channel_tree(channel: ChannelReconciliation) -> dict[str, Any]:
    return {
        "topic": channel.topic,
        "name": channel.name,
        "verdict": channel.verdict,
        "before": _gap_tree(channel.before),
        "after": _gap_tree(channel.after),
        "steps": [_step_tree(step) for step in channel.steps],
        "notes": list(channel.notes),
    }


def _gap_tree(gap: Gap) -> dict[str, Any]:
    return {
        "score": _number(gap.score),
        "p_value": _number(gap.p_value),
        "where": [
            {
                "domain": place.domain,
                "from": _number(place.from_),
                "to": _number(place.to),
                "unit": place.unit,
                "z": _number(place.z),
            }
            for place in gap.where
        ],
    }


def _step_tree(step: Step) -> dict[str, Any]:
    return {
        "action": step.action,
        "effect": effect_tree(step.effect),
        "gap_before": _number(step.gap_before),
        "gap_after": _number(step.gap_after),
        "p_value": _number(step.p_value),
        "held_out": {
            "gap_before": _number(step.held_out.gap_before),
            "gap_after": _number(step.held_out.gap_after),
        },
        "evidence": step.evidence,
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
