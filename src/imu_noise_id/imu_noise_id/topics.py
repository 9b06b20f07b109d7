"""Which topic of a bag carries which sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

from imu_noise_id import cdr
from imu_noise_id.errors import InputError

TYPES: Mapping[str, tuple[str, ...]] = {
    "imu": (cdr.IMU,),
    "mag": (cdr.MAGNETIC_FIELD,),
    "temperature": (cdr.TEMPERATURE,),
    "fix": (cdr.NAV_SAT_FIX,),
    "vel": (cdr.TWIST, cdr.TWIST_WITH_COVARIANCE),
}
"""Message types of each kind of sensor."""

DEFAULTS: Mapping[str, str] = {
    "imu": "/imu/data",
    "mag": "/imu/mag",
    "temperature": "/imu/temperature",
    "fix": "/gps/fix",
    "vel": "/gps/vel",
}


@dataclass(frozen=True)
class TopicNames:
    """Topics that the user asked for.

    None: the default name where it is there, else the only topic of the type.  An empty string:
    this sensor is not read.
    """

    imu: str | None = None
    mag: str | None = None
    temperature: str | None = None
    fix: str | None = None
    vel: str | None = None


@dataclass(frozen=True)
class TopicInfo:
    """A topic that a bag holds; `problem` says why its messages cannot be decoded, if so."""

    name: str
    type: str
    count: int
    problem: str = ""


def choose_topics(
    found: Sequence[TopicInfo], names: TopicNames, source: str
) -> dict[str, TopicInfo]:
    """The topic of each kind of sensor that the bag has.

    Raises
    ------
    InputError
        When a topic asked for is not there or of another type, when several could be meant, when
        there is none at all, or when the one chosen cannot be decoded.
    """
    chosen = {}
    for kind in (f.name for f in fields(TopicNames)):
        asked: str | None = getattr(names, kind)
        if asked == "":
            continue
        info = _asked_for(found, kind, asked, source) if asked else _only(found, kind, source)
        if info is None:
            continue
        if info.problem:
            raise InputError(f"{source}: topic {info.name} {info.problem}")
        chosen[kind] = info
    if not chosen.keys() - {"temperature"}:
        raise InputError(
            f"{source}: no topic of {', '.join(_short(t) for t in _all_types())}; it holds "
            f"{listing(found)}"
        )
    return chosen


def listing(found: Sequence[TopicInfo]) -> str:
    """The topics of a bag in a line."""
    shown = [f"{t.name} ({_short(t.type)}, {t.count})" for t in found[:12]]
    rest = [f"{len(found) - 12} more"] if len(found) > 12 else []
    return ", ".join(shown + rest) or "no topic"


def _asked_for(found: Sequence[TopicInfo], kind: str, name: str, source: str) -> TopicInfo:
    for info in found:
        if info.name == name:
            if info.type in TYPES[kind]:
                return info
            wanted = " or ".join(_short(t) for t in TYPES[kind])
            raise InputError(
                f"{source}: topic {name} is {_short(info.type)}, not {wanted}; "
                f"the bag holds {listing(found)}"
            )
    raise InputError(f"{source}: no topic {name}; it holds {listing(found)}")


def _only(found: Sequence[TopicInfo], kind: str, source: str) -> TopicInfo | None:
    fitting = [info for info in found if info.type in TYPES[kind]]
    candidates = [info for info in fitting if info.count] or fitting
    for info in candidates:
        if info.name == DEFAULTS[kind]:
            return info
    if len(candidates) > 1:
        raise InputError(
            f"{source}: which one is the {kind} topic? {listing(candidates)}; "
            f"choose with --topic {kind}=NAME"
        )
    return candidates[0] if candidates else None


def _all_types() -> list[str]:
    return [t for types in TYPES.values() for t in types]


def _short(msgtype: str) -> str:
    return msgtype.replace("/msg/", "/")
