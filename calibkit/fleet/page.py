"""The page of a fleet: totals, devices that stand out, the distribution of each key value, a line
per device.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from calibkit.fleet.table import FleetTable
from calibkit.report import figures, page, svg
from calibkit.report.blocks import Chart, Findings, Heading, Page, Standing, Text
from calibkit.report.control_charts import ControlChart
from calibkit.report.table import Cell, Column, Table

PAGE = "fleet.html"


def make_page(title: str, table: FleetTable) -> bytes:
    """The page as UTF-8; it loads nothing."""
    counts = Counter(entry.verdict for entry in table.entries)
    counted = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
    bad = any(counts[verdict] for verdict in counts if verdict not in ("accepted", "no verdict"))
    standing: Standing = "rejected" if bad else "accepted" if counts["accepted"] else "open"
    outlying = tuple(table.list_outlying())
    blocks = (
        Heading("Devices that stand out"),
        Findings(outlying) if outlying else Text("None."),
        Heading("Distribution of each key value"),
        *_distributions(table.charts),
        Heading("Devices"),
        _devices(table),
    )
    verdict = f"{len(table.entries)} devices: {counted}"
    return page.render(Page(title, verdict, standing, blocks))


def _devices(table: FleetTable) -> Table:
    """A line per device."""
    outliers: dict[str, list[str]] = {}
    for outlier in table.outliers:
        outliers.setdefault(outlier.serial, []).append(outlier.figure)
    rows = tuple(
        (
            entry.serial,
            entry.verdict,
            entry.run or "-",
            entry.flags,
            len(outliers.get(entry.serial, ())),
            " ".join(entry.error.split()) or ", ".join(outliers.get(entry.serial, ())),
        )
        for entry in table.entries
    )
    heads = ("serial", "verdict", "run", "flags", "stands out in", "error, or the key values")
    return Table("One line per device", heads, rows)


def _distributions(charts: Sequence[ControlChart]) -> tuple[Chart | Table | Text, ...]:
    """Where the devices lie between the smallest and the largest of each key value, and both."""
    if not charts:
        return (Text("No device has a key value."),)
    title = (
        "Devices between the smallest and the largest of each key value; red: those that stand out"
    )
    figure, (ax,) = figures.page(1, 1, title=title, height=1.2 + 0.3 * len(charts))
    for row, chart in enumerate(charts):
        low, spread = chart.values.min(), np.ptp(chart.values)
        share = (chart.values - low) / spread if spread else np.full(chart.values.size, 0.5)
        outliers = list(chart.control.outliers)
        usual = np.delete(share, outliers)
        ax.plot(usual, np.full(usual.size, row), "|", color=figures.DENOISED, ms=9.0)
        ax.plot(share[outliers], np.full(len(outliers), row), "o", color=figures.ALERT, ms=5.0)
    ax.set_yticks(range(len(charts)), [chart.name for chart in charts])
    ax.set_ylim(len(charts) - 0.5, -0.5)
    ax.set_xticks([0.0, 1.0], ["smallest", "largest"])
    figures.settle([figure])
    (drawing,), _ = svg.inline([figure])
    numbers = [Column(head, ".6g") for head in ("smallest", "median", "largest")]
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            chart.name,
            *map(float, np.quantile(chart.values, (0.0, 0.5, 1.0))),
            "" if chart.unit == "1" else chart.unit,
            len(chart.serials),
        )
        for chart in charts
    )
    columns: tuple[Column | str, ...] = ("key value", *numbers, "unit", "devices")
    return Chart(drawing, title), Table("Key values", columns, rows)
