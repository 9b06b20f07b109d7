"""Counts of a stream to what rqt shows: a level, a sentence and the numbers."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from imu_noise_id.ros.messages import to_time
from imu_noise_id.watch import StreamWatch

_REMEMBER = 10
"""A count that grew within so many looks is a warning; after that it is only a number."""
_SILENT_NS = 2_000_000_000

COUNTS: Mapping[str, str] = {
    "invalid": "messages not of the type",
    "non_finite": "samples not finite",
    "duplicates": "stamps repeated",
    "out_of_order": "stamps out of order",
    "gaps": "gaps",
    "missing": "samples missing",
    "clock_steps": "clock steps",
    "rate_changes": "changes of rate",
}


@dataclass
class StreamDiagnosis:
    """Turns one topic's watch into a status; remembers the counts of the last looks."""

    _looks: deque[dict[str, int]] = field(default_factory=lambda: deque(maxlen=_REMEMBER))

    def status(
        self, name: str, watch: StreamWatch, complaints: Sequence[str], now_ns: int
    ) -> DiagnosticStatus:
        """Return the status of a topic as of now."""
        counts = {key: getattr(watch, key) for key in COUNTS}
        before = self._looks[0] if self._looks else dict.fromkeys(COUNTS, 0)
        grown = [f"{n - before[k]} {COUNTS[k]}" for k, n in counts.items() if n > before[k]]
        self._looks.append(counts)
        said = [*complaints, *grown]
        if watch.clock_steps > before["clock_steps"]:
            said.append(f"the clock jumped by {watch.largest_step_s:+.6g} s")
        if watch.frozen:
            said.append("messages come but their stamps stand still")
        silent = now_ns - watch.newest_log_ns > _SILENT_NS
        level = DiagnosticStatus.WARN if said else DiagnosticStatus.OK
        if silent:
            level = DiagnosticStatus.STALE
            age_s = (now_ns - watch.newest_log_ns) * 1e-9
            said.insert(0, f"silent for {age_s:.0f} s" if watch.received else "no message yet")
        numbers: dict[str, object] = {**counts, "received": watch.received}
        numbers["rate_hz"] = f"{watch.rate_at(now_ns):.4g}"
        numbers["offset_s"] = f"{watch.offset_s:.6g}"
        return status(level, name, "; ".join(said) or "as it should be", numbers)


def status(
    level: bytes, name: str, message: str, numbers: Mapping[str, object]
) -> DiagnosticStatus:
    """Return a status message."""
    values = [KeyValue(key=key, value=str(number)) for key, number in numbers.items()]
    return DiagnosticStatus(level=level, name=name, message=message, values=values)


def array(statuses: Sequence[DiagnosticStatus], now_ns: int) -> DiagnosticArray:
    """Return what ``/diagnostics`` carries."""
    message = DiagnosticArray(status=list(statuses))
    message.header.stamp = to_time(now_ns)
    return message
