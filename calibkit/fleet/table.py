"""The fleet's table, one row per device: the same whatever process fitted them, in any order."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibkit.check import copies
from calibkit.fleet.device import Failure, Outcome, Row
from calibkit.fleet.keys import KeyFigure
from calibkit.numeric import gum
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

    @property
    def distance(self) -> float:
        """How far it stands out, 1 at the limit."""
        return abs(self.z) / self.limit


@dataclass(frozen=True, slots=True)
class FleetTable:
    """Rows in the order of the serials, and a control chart of each key figure in the order of
    their stages.
    """

    entries: tuple[Row, ...]
    charts: tuple[ControlChart, ...]
    outliers: tuple[_Outlier, ...]
    """In the order of the figures, then the furthest first."""

    @property
    def totals(self) -> str:
        """How many devices, with which verdicts."""
        counts = Counter(entry.verdict for entry in self.entries)
        counted = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
        return f"{len(self.entries)} device{'s' * (len(self.entries) != 1)}: {counted}"

    def list_outlying(self) -> list[str]:
        """A line per device that stands out, the furthest first: in how many key values, and the
        worst of them beside the values of the others.
        """
        charts = {chart.name: chart for chart in self.charts}
        furthest_first = sorted(self.outliers, key=lambda outlier: -outlier.distance)
        lines = []
        for serial, count in Counter(outlier.serial for outlier in furthest_first).items():
            worst = next(outlier for outlier in furthest_first if outlier.serial == serial)
            chart = charts[worst.figure]
            others = np.delete(chart.values, list(chart.control.outliers))
            low, high = float(others.min()), float(others.max())
            spread = high - low or abs(worst.value) or 1.0
            value, low_text, high_text = (
                gum.rounded(number, spread)[0] for number in (worst.value, low, high)
            )
            unit = "" if chart.unit == "1" else f" {chart.unit}"
            noun = "key values stand" if count > 1 else "key value stands"
            lines.append(
                f"{serial}: {count} {noun} out, worst {chart.name} {value}{unit}, others"
                f" {low_text} to {high_text}"
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


def _entry(outcome: Outcome, copied: str, data: Path) -> Row:
    """Row of one device; a verdict on a copy of another device's logs is no verdict on this one."""
    if isinstance(outcome, Failure):
        message = outcome.message.replace(f"{data}/", "").replace(str(data), "")
        error = f"{outcome.code}: {message}"
        return Row(outcome.serial, "", "", FAILED, (), (), (), 0, before=False, error=error)
    if copied:
        return replace(outcome, verdict=COPIED, error=f"the same logs as {copied}")
    return outcome


def _copies(outcomes: Sequence[Outcome]) -> dict[str, str]:
    """Serial → the other serials whose logs are the same measurements: one of them has another
    device's coefficients.
    """
    rows = [outcome for outcome in outcomes if isinstance(outcome, Row)]
    owners: dict[str, list[Row]] = {}
    for row in rows:
        for mark in _marks(row):
            owners.setdefault(mark, []).append(row)
    shared_with: dict[str, str] = {}
    for row in rows:
        candidates = {other.serial: other for mark in _marks(row) for other in owners[mark]}
        del candidates[row.serial]
        same = sorted(serial for serial, other in candidates.items() if _same_logs(row, other))
        if same:
            shared_with[row.serial] = ", ".join(same)
    return shared_with


def _marks(row: Row) -> set[str]:
    """Digests by which the logs of a device are known."""
    return {mark for entry in row.inputs for mark in copies.digests_of_input(entry)}


def _same_logs(row: Row, other: Row) -> bool:
    """Whether two devices have the same logs, all of them."""
    return all(
        len(copies.shared_logs(inputs, other_inputs)) == len(inputs)
        for inputs, other_inputs in ((row.inputs, other.inputs), (other.inputs, row.inputs))
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
    devices = {serial: own[identity] for serial, own in figures.items() if identity in own}
    values = np.array([figure.value for figure in devices.values()])
    uncertainties = np.array([figure.standard_uncertainty for figure in devices.values()])
    dof = np.array([figure.dof for figure in devices.values()])
    limits = {figure.limit for figure in devices.values()}
    shared_limit = limits.pop() if len(limits) == 1 else None
    return ControlChart(
        name=name,
        unit=unit,
        serials=tuple(devices),
        values=values,
        standard_uncertainties=uncertainties,
        control=Control.chart(values, uncertainties, dof),
        acceptance=math.nan if shared_limit is None else shared_limit,
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
