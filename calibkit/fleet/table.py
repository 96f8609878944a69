"""The fleet's table, one row per device: the same whatever process fitted them, in any order."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibkit.check import copies
from calibkit.fleet.device import Failure, Outcome, Row
from calibkit.fleet.keys import KeyFigure
from calibkit.numeric.control import Control
from calibkit.report.control_charts import ControlChart

_Identity = tuple[str, str, str]

COPIED = "copied logs"
FAILED = "failed"


@dataclass(frozen=True, slots=True)
class _Outlier:
    """A device that is an outlier in one figure."""

    serial: str
    figure: str
    value: float
    z: float
    limit: float


@dataclass(frozen=True, slots=True)
class DeviceRow:
    """A row of the table: the outcome of one device."""

    serial: str
    run: str
    run_sha256: str
    verdict: str
    error: str
    flags: int
    logs: tuple[str, ...] = ()
    """Names of the logs that the run was fitted to."""
    before: bool = False
    """Whether the run was there already."""
    effective_from: str = ""
    """Date from which its coefficients hold; "" where it has none."""
    """Whether the run was there already."""


@dataclass(frozen=True, slots=True)
class FleetTable:
    """Rows in the order of the serials, and a control chart of each key figure in the order of
    their stages.
    """

    entries: tuple[DeviceRow, ...]
    charts: tuple[ControlChart, ...]
    outliers: tuple[_Outlier, ...]
    """In the order of the figures, then the furthest first."""

    def list_outlying(self) -> list[str]:
        """A line per device that stands out, the furthest first: in how many key values, and the
        worst of them beside the values of the others.
        """
        deviations: dict[str, list[tuple[float, ControlChart, float]]] = {}
        charts = {chart.name: chart for chart in self.charts}
        for outlier in self.outliers:
            distance = abs(outlier.z) / outlier.limit
            deviations.setdefault(outlier.serial, []).append(
                (distance, charts[outlier.figure], outlier.value)
            )
        lines = []
        for serial, device_deviations in sorted(
            deviations.items(), key=lambda pair: -max(d for d, _, _ in pair[1])
        ):
            _, chart, value = max(device_deviations, key=lambda deviation: deviation[0])
            count = (
                f"{len(device_deviations)} key values stand"
                if len(device_deviations) > 1
                else "1 key value stands"
            )
            other_values = np.delete(chart.values, list(chart.control.outliers))
            low, high = float(other_values.min()), float(other_values.max())
            places = _place_of(high - low or abs(value))
            unit = "" if chart.unit == "1" else f" {chart.unit}"
            lines.append(
                f"{serial}: {count} out, worst {chart.name} {value:.{places}f}{unit}, others"
                f" {low:.{places}f} to {high:.{places}f}"
            )
        return lines


def build_table(outcomes: Sequence[Outcome], data: Path) -> FleetTable:
    """Table of the outcomes of all devices; errors name files from the folder of the devices on."""
    ordered = sorted(outcomes, key=lambda outcome: outcome.serial)
    figures = {
        outcome.serial: {figure.identity: figure for figure in outcome.figures}
        for outcome in ordered
        if isinstance(outcome, Row)
    }
    identities = list(
        dict.fromkeys(
            identity for device_figures in figures.values() for identity in device_figures
        )
    )
    charts = tuple(_chart(identity, identities, figures, len(ordered)) for identity in identities)
    copied = _copies(ordered)
    return FleetTable(
        tuple(_entry(outcome, copied.get(outcome.serial, ""), data) for outcome in ordered),
        charts,
        tuple(outlier for chart in charts for outlier in _outliers(chart)),
    )


def _entry(outcome: Outcome, copied: str, data: Path) -> DeviceRow:
    """Row of one device; a verdict on a copy of another device's logs is no verdict on this one."""
    if isinstance(outcome, Failure):
        message = outcome.message.replace(f"{data}/", "").replace(str(data), "")
        return DeviceRow(outcome.serial, "", "", FAILED, f"{outcome.code}: {message}", 0)
    return DeviceRow(
        outcome.serial,
        outcome.run,
        outcome.run_sha256,
        COPIED if copied else outcome.verdict,
        f"the same logs as {copied}" if copied else "",
        outcome.flags,
        tuple(entry["name"] for entry in outcome.inputs),
        outcome.before,
        outcome.effective_from,
    )


def _copies(outcomes: Sequence[Outcome]) -> dict[str, str]:
    """Serial → the other serials whose logs are the same measurements: one of them has another
    device's coefficients.
    """
    rows = [outcome for outcome in outcomes if isinstance(outcome, Row)]
    owners: dict[str, list[Row]] = {}
    for row in rows:
        for mark in {mark for entry in row.inputs for mark in copies.digests_of_input(entry)}:
            owners.setdefault(mark, []).append(row)
    shared_with: dict[str, str] = {}
    for row in rows:
        candidates = {
            id(other): other
            for entry in row.inputs
            for mark in copies.digests_of_input(entry)
            for other in owners[mark]
        }
        same_serials = sorted(
            other.serial
            for other in candidates.values()
            if other is not row and _same_logs(row, other)
        )
        if same_serials:
            shared_with[row.serial] = ", ".join(same_serials)
    return shared_with


def _same_logs(row: Row, other: Row) -> bool:
    """Whether two devices have the same logs, all of them."""
    pairs = ((row.inputs, other.inputs), (other.inputs, row.inputs))
    return all(
        len(copies.shared_logs(inputs, other_inputs)) == len(inputs)
        for inputs, other_inputs in pairs
    )


def _chart(
    identity: _Identity,
    identities: Sequence[_Identity],
    figures: Mapping[str, Mapping[_Identity, KeyFigure]],
    units: int,
) -> ControlChart:
    """Control chart of the devices that have a key figure; its form or unit is part of its name
    where the name alone is not unique. The acceptance limit is drawn where all of them share one.
    """
    name, form, unit = identity
    namesakes = [other for other in identities if other[0] == name]
    if len({other[1] for other in namesakes}) > 1:
        name = f"{name} ({form})"
    elif len(namesakes) > 1:
        name = f"{name} ({unit})"
    figures_by_serial = {
        serial: device_figures[identity]
        for serial, device_figures in figures.items()
        if identity in device_figures
    }
    values = np.array([figure.value for figure in figures_by_serial.values()])
    uncertainties = np.array([figure.standard_uncertainty for figure in figures_by_serial.values()])
    dof = np.array([figure.dof for figure in figures_by_serial.values()])
    limits = {
        math.nan if figure.limit is None else figure.limit for figure in figures_by_serial.values()
    }
    return ControlChart(
        name=name,
        unit=unit,
        serials=tuple(figures_by_serial),
        values=values,
        standard_uncertainties=uncertainties,
        control=Control.chart(values, uncertainties, dof),
        acceptance=limits.pop() if len(limits) == 1 else math.nan,
        units=units,
    )


def _outliers(chart: ControlChart) -> list[_Outlier]:
    """Outliers of one chart, the furthest first."""
    return [
        _Outlier(
            chart.serials[k],
            chart.name,
            float(chart.values[k]),
            float(chart.control.z[k]),
            chart.control.limit,
        )
        for k in chart.control.outliers
    ]


def _place_of(spread: float) -> int:
    """Decimal places that show a spread in two significant digits."""
    return max(0, 1 - math.floor(math.log10(spread))) if spread > 0.0 else 0
