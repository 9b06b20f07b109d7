"""Result files: ``identify.json`` and ``fleet.json``; numbers that cannot be had are null."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from imu_noise_id.allan import AllanCurve
from imu_noise_id.files import write_text
from imu_noise_id.identify import ChannelResult, Identification
from imu_noise_id.model import NoiseModel
from imu_noise_id.model_file import bound_tree, effect_tree

if TYPE_CHECKING:
    from imu_noise_id.axes_together import AxesTogether
    from imu_noise_id.cca import Cca


def plain(value: Any) -> Any:
    """Numpy's arrays and scalars as Python's; what is not finite as None; complex as [re, im]."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value.tolist()]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, complex):
        return plain(value.real) if value.imag == 0.0 else [plain(value.real), plain(value.imag)]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def json_text(tree: Any) -> str:
    """Strict JSON, one key a line and short lists on one."""
    return json.dumps(plain(tree), allow_nan=False, ensure_ascii=False, indent=1) + "\n"


def write_json(tree: Any, path: Path | str) -> None:
    """Write a tree as a whole file.

    Raises
    ------
    InputError
        When it cannot be written.
    """
    write_text(path, json_text(tree))


def identification_tree(identification: Identification) -> dict[str, Any]:
    """``identify/1``."""
    recording = identification.recording
    return {
        "format": "identify/1",
        "bag": recording.source,
        "channels": [_channel_tree(result) for result in identification.channels],
        "sensors": [together_tree(sensor) for sensor in identification.sensors],
        "notes": [*recording.notes, *identification.notes],
    }


def _channel_tree(result: ChannelResult) -> dict[str, Any]:
    channel, model = result.channel, result.model
    return {
        "topic": channel.topic,
        "name": channel.name,
        "unit": channel.unit,
        "rate_hz": channel.rate_hz,
        "samples": int(result.series.observed.sum()),
        "duration_s": channel.duration_s,
        "mean": result.series.mean if channel.values.size else None,
        "quality": _quality_tree(result),
        "allan": allan_tree(result.allan),
        "effects": [effect_tree(fitted) for fitted in model.effects],
        "bounds": [bound_tree(bound) for bound in model.bounds],
        "cca": _cca_of_channel(result),
    }


def _cca_of_channel(result: ChannelResult) -> dict[str, Any] | None:
    """Canonical correlation analysis and how far its Allan curve is from the measured one."""
    if result.cca is None:
        return None
    return {**cca_tree(result.cca), "allan_distance": result.cca_distance}


def together_tree(sensor: AxesTogether) -> dict[str, Any]:
    """Model of the axes of one sensor together as plain data."""
    model = sensor.model
    space = model.state_space
    return {
        "topic": sensor.topic,
        "names": list(sensor.names),
        "order": model.order,
        "canonical_correlations": model.canonical_correlations,
        "chance_level": model.chance_level,
        "significant": model.significant,
        "A": space.A,
        "C": space.C,
        "K": space.K,
        "innovation_covariance": space.innovation_covariance,
        "sample_time_s": space.sample_time_s,
        "allan_distance": list(sensor.distances),
    }


def _quality_tree(result: ChannelResult) -> dict[str, Any]:
    quality = result.channel.quality
    return {
        "gaps": quality.gaps,
        "missing": quality.missing,
        "duplicates": quality.duplicates,
        "out_of_order": quality.out_of_order,
        "non_finite": quality.non_finite,
        "held": quality.held,
        "static": quality.static,
        "jitter_s": quality.jitter_s,
        "left_out_s": [list(span) for span in quality.moving_s],
        "notes": [*quality.notes, *result.notes],
    }


def allan_tree(curve: AllanCurve | None) -> dict[str, Any]:
    """Allan curve as plain lists; empty where there is none."""
    if curve is None:
        return {"tau_s": [], "deviation": [], "lower": [], "upper": [], "confidence": 0.95}
    return {
        "tau_s": curve.tau_s,
        "deviation": curve.deviation,
        "lower": curve.lower,
        "upper": curve.upper,
        "confidence": curve.confidence,
    }


def cca_tree(cca: Cca) -> dict[str, Any]:
    """Canonical correlation analysis as plain data; poles and zeros are those of H(s)."""
    empty = np.empty(0)
    return {
        "method": cca.method,
        "order": cca.order,
        "canonical_correlations": cca.canonical_correlations,
        "chance_level": cca.chance_level,
        "significant": cca.significant,
        "H_z": {
            "numerator": cca.H_z.numerator,
            "denominator": cca.H_z.denominator,
            "sample_time_s": cca.H_z.sample_time_s,
        },
        "H_s": {
            "numerator": empty if cca.H_s is None else cca.H_s.numerator,
            "denominator": empty if cca.H_s is None else cca.H_s.denominator,
        },
        "poles": cca.poles,
        "zeros": cca.zeros,
        "minimum_phase": cca.minimum_phase,
        "settling_time_s": cca.settling_time_s,
        "rise_time_s": cca.rise_time_s,
        "bandwidth_rise_hz": cca.bandwidth_rise_hz,
        "bandwidth_3db_hz": cca.bandwidth_3db_hz,
        "innovation_variance": cca.innovation_variance,
        "notes": list(cca.notes),
    }


@dataclass(frozen=True)
class Unit:
    """One recording of a fleet.

    Attributes
    ----------
    name, bag : str
        Folder of its results, and where it was recorded.
    model : NoiseModel or None
        None where it could not be identified.
    error : str
        Why, or empty.
    """

    name: str
    bag: str
    model: NoiseModel | None
    error: str = ""


def fleet_tree(units: Sequence[Unit]) -> dict[str, Any]:
    """``fleet/1``: per channel and parameter the units side by side, and their spread."""
    rows: dict[tuple[str, str, int, str], dict[str, Any]] = {}
    for unit in units:
        for channel in unit.model.channels if unit.model else ():
            counts: dict[str, int] = {}
            for fitted in channel.effects:
                occurrence = counts[fitted.name] = counts.get(fitted.name, -1) + 1
                for parameter, e in zip(fitted.effect.parameters, fitted.estimates, strict=True):
                    key = (channel.name, fitted.name, occurrence, parameter.name)
                    row = rows.setdefault(key, {"unit": e.unit, "units": []})
                    row["units"].append(
                        {"name": unit.name, "value": e.value, "lower": e.lower, "upper": e.upper}
                    )
    return {
        "format": "fleet/1",
        "units": [
            {
                "name": unit.name,
                "bag": unit.bag,
                "status": "failed" if unit.model is None else "identified",
                "error": unit.error or None,
            }
            for unit in units
        ],
        "parameters": [
            {
                "channel": channel,
                "effect": effect,
                "occurrence": occurrence + 1,
                "parameter": parameter,
                **row,
                **_spread([u["value"] for u in row["units"]]),
            }
            for (channel, effect, occurrence, parameter), row in rows.items()
        ],
    }


def _spread(values: list[Any]) -> dict[str, float | None]:
    """Median and sample standard deviation over the units that show the parameter."""
    numbers = [v for v in values if isinstance(v, float | int)]
    return {
        "median": float(np.median(numbers)) if numbers else None,
        "spread": float(np.std(numbers, ddof=1)) if len(numbers) > 1 else None,
    }
