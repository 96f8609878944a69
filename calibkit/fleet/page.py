"""The page of a fleet: totals, devices that stand out, key values with their control charts, a line
per device.
"""

from collections import Counter

import numpy as np

from calibkit.fleet.table import FleetTable
from calibkit.report import figures, page, svg
from calibkit.report.blocks import Block, Chart, Findings, Fold, Heading, Page, Standing, Text
from calibkit.report.table import Cell, Column, Table

PAGE = "fleet.html"


def make_page(title: str, table: FleetTable) -> bytes:
    """The page as UTF-8; it loads nothing."""
    counts = Counter(entry.verdict for entry in table.entries)
    bad = any(counts[verdict] for verdict in counts if verdict not in ("accepted", "no verdict"))
    standing: Standing = "rejected" if bad else "accepted" if counts["accepted"] else "open"
    outlying = tuple(table.list_outlying())
    blocks: list[Block] = [
        Heading("Devices that stand out"),
        Findings(outlying) if outlying else Text("None."),
        Heading("Key values"),
        _key_values(table),
    ]
    if table.charts:
        with figures.styled():
            drawn = [chart.draw() for chart in table.charts]
        figures.settle(drawn)
        drawings, _ = svg.inline(drawn)
        names = [chart.name for chart in table.charts]
        blocks.append(Fold("Control charts", tuple(map(Chart, drawings, names))))
    blocks += [Heading("Devices"), _devices(table)]
    return page.render(Page(title, table.totals, standing, tuple(blocks)))


def _devices(table: FleetTable) -> Table:
    """A line per device."""
    rows: list[tuple[Cell, ...]] = []
    for entry in table.entries:
        outlying = [outlier.figure for outlier in table.outliers if outlier.serial == entry.serial]
        reason = " ".join(entry.error.split()) or ", ".join(outlying)
        run = entry.run or "-"
        rows.append((entry.serial, entry.verdict, run, entry.flags, len(outlying), reason))
    heads = ("serial", "verdict", "run", "flags", "stands out in", "error, or the key values")
    return Table("One line per device", heads, tuple(rows))


def _key_values(table: FleetTable) -> Table:
    """Smallest, median and largest of each key value."""
    rows: list[tuple[Cell, ...]] = []
    for chart in table.charts:
        ends = map(float, np.quantile(chart.values, (0.0, 0.5, 1.0)))
        rows.append((chart.name, *ends, chart.unit, len(chart.serials)))
    numbers = [Column(head, ".6g") for head in ("smallest", "median", "largest")]
    return Table("Of all devices", ("key value", *numbers, "unit", "devices"), tuple(rows))
