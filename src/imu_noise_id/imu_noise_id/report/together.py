"""The axes of a sensor together in the report: shared states, and whether Allan agrees."""

from __future__ import annotations

from collections.abc import Sequence

from imu_noise_id.axes_together import AxesTogether, modes
from imu_noise_id.identify import ChannelResult
from imu_noise_id.report.curves import Part
from imu_noise_id.report.page import Section, Table
from imu_noise_id.terminal import number
from imu_noise_id.wording import QUANTITIES


def together_parts(sensors: Sequence[AxesTogether]) -> dict[tuple[str, str], Part]:
    """Allan deviations of the joint models by topic and channel, to lay over the measured ones."""
    return {
        (sensor.topic, name): Part(f"CCA of all axes, order {sensor.model.order}", deviation)
        for sensor in sensors
        for name, deviation in zip(sensor.names, sensor.deviations, strict=True)
    }


def together_section(sensor: AxesTogether, results: Sequence[ChannelResult]) -> Section:
    """What one model says of all axes of a sensor, beside one model for each."""
    quantity = sensor.names[0].partition(".")[0]
    alone = [
        r for r in results if r.channel.topic == sensor.topic and r.channel.name in sensor.names
    ]
    title = QUANTITIES.get(quantity, quantity)
    return Section(
        f"{title[:1].upper() + title[1:]}: axes together",
        (_states(sensor, alone), _distances(sensor, alone), *_remarks(sensor)),
        (),
        tuple(_tables(sensor, alone[0].channel.unit)),
        verdict=f"{sensor.model.order} state{'' if sensor.model.order == 1 else 's'}",
    )


def _states(sensor: AxesTogether, alone: Sequence[ChannelResult]) -> str:
    model = sensor.model
    largest = float(model.canonical_correlations[0]) if model.canonical_correlations.size else 0.0
    orders = [result.cca.order for result in alone if result.cca is not None]
    text = (
        f"One innovations model of the axes of {sensor.topic} takes {model.order} "
        f"state{'' if model.order == 1 else 's'} (past and future correlate by {largest:.3f} "
        f"against a chance level of {model.chance_level:.3f}); one model for each axis takes "
        f"{', '.join(map(str, orders))}."
    )
    if 0 < model.order < sum(orders):
        text += " Axes share states: what drives them is common to the sensor."
    return text


def _remarks(sensor: AxesTogether) -> list[str]:
    return [f"{note[:1].upper()}{note[1:]}." for note in sensor.model.notes]


def _distances(sensor: AxesTogether, alone: Sequence[ChannelResult]) -> str:
    joint = ", ".join(map(_percent, sensor.distances))
    single = ", ".join(_percent(result.cca_distance) for result in alone)
    return (
        f"Its Allan curves are {joint} from the measured ones; those of one axis at a time "
        f"{single}."
    )


def _percent(distance: float | None) -> str:
    return "unknown" if distance is None else f"{100.0 * distance:.2g} %"


def _tables(sensor: AxesTogether, unit: str) -> list[Table]:
    axes = tuple(name.partition(".")[2] for name in sensor.names)
    rows = tuple(
        (
            number(mode.time_constant_s),
            number(mode.frequency_hz) if mode.frequency_hz else "0",
            *(number(float(sigma)) for sigma in mode.sigma),
        )
        for mode in modes(sensor.model.state_space)
    )
    tables = []
    if rows:
        headings = ("time constant (s)", "frequency (Hz)", *(f"sigma {a} ({unit})" for a in axes))
        tables.append(Table("States of all axes", headings, rows, tuple(range(len(headings)))))
    correlation = sensor.innovation_correlation
    tables.append(
        Table(
            "Correlation of the innovations",
            ("", *axes),
            tuple(
                (a, *(f"{r:.3f}" for r in row)) for a, row in zip(axes, correlation, strict=True)
            ),
            tuple(range(1, len(axes) + 1)),
        )
    )
    return tables
