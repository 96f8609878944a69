"""The page of a fleet: totals, devices that stand out, the distribution of each key value, a line
per device.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from calibkit.fleet.table import FleetTable
from calibkit.report import html
from calibkit.report.control_charts import ControlChart
from calibkit.report.markup import Markup, element, join_markup

PAGE = "fleet.html"
_WIDTH, _HEIGHT, _EDGE = 360.0, 26.0, 6.0
"""Size of a distribution and the space at its ends [px]."""


def make_page(title: str, table: FleetTable, outlying: Sequence[str]) -> bytes:
    """The page as UTF-8; it loads nothing."""
    counts = Counter(entry.verdict for entry in table.entries)
    counted = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
    bad = any(counts[verdict] for verdict in counts if verdict not in ("accepted", "no verdict"))
    kind = "rejected" if bad else "accepted" if counts["accepted"] else "open"
    items = [element("li", line) for line in outlying]
    standing = element("ul", join_markup(items)) if items else element("p", "None.")
    parts = {
        "Devices that stand out": [standing],
        "Distribution of each key value": [_distributions(table.charts)],
        "Devices": [_devices(table)],
    }
    return html.page_of_parts(title, f"{len(table.entries)} devices: {counted}", kind, parts)


def _devices(table: FleetTable) -> Markup:
    """A line per device."""
    outliers: dict[str, list[str]] = {}
    for outlier in table.outliers:
        outliers.setdefault(outlier.serial, []).append(outlier.figure)
    rows = [
        (
            entry.serial,
            entry.verdict,
            entry.run or "-",
            str(entry.flags),
            str(len(outliers.get(entry.serial, ()))),
            " ".join(entry.error.split()) or ", ".join(outliers.get(entry.serial, ())),
        )
        for entry in table.entries
    ]
    heads = ("serial", "verdict", "run", "flags", "stands out in", "error, or the key values")
    return html.list_rows("One line per device", heads, rows, (3, 4))


def _distributions(charts: tuple[ControlChart, ...]) -> Markup:
    """A row per key value: a mark for each device, those that stand out in another colour."""
    rows = [
        (
            chart.name,
            _strip(chart),
            f"{chart.values.min():.6g}",
            f"{np.median(chart.values):.6g}",
            f"{chart.values.max():.6g}",
            "" if chart.unit == "1" else chart.unit,
            str(len(chart.serials)),
        )
        for chart in charts
    ]
    heads = ("key value", "distribution", "smallest", "median", "largest", "unit", "devices")
    return html.list_rows("Red: devices that stand out", heads, rows, (2, 3, 4, 6))


def _strip(chart: ControlChart) -> Markup:
    """Marks of the devices along a line from the smallest value to the largest."""
    low, high = float(chart.values.min()), float(chart.values.max())
    share = (chart.values - low) / (high - low) if high > low else np.full(chart.values.size, 0.5)
    places = _EDGE + share * (_WIDTH - 2.0 * _EDGE)
    outliers = set(chart.control.outliers)
    usual = "".join(
        f"M{x:.1f} 6V20" for index, x in enumerate(places.tolist()) if index not in outliers
    )
    marks = [
        element("path", d=usual, stroke="#4477aa", stroke_width="1", stroke_opacity=".5"),
        *(
            element(
                "circle",
                element("title", f"{chart.serials[index]}: {chart.values[index]:.6g} {chart.unit}"),
                cx=f"{places[index]:.1f}",
                cy="13",
                r="4",
                fill="#cc3311",
            )
            for index in sorted(outliers)
        ),
    ]
    size = f"{_WIDTH:g}", f"{_HEIGHT:g}"
    return element(
        "svg",
        join_markup(marks),
        width=size[0],
        height=size[1],
        viewBox=f"0 0 {size[0]} {size[1]}",
        role="img",
        aria_label=f"distribution of {chart.name}",
    )
