"""Small odd files after what laboratories and calibrators send: one clean log of a bias against
temperature, and how it was written, with the words of recipe that it needs.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass

import numpy as np
import openpyxl

ROWS = 120
NAMES = ("time_s", "temp_case_degc", "gyro_dph")
HEADER = ",".join(NAMES)
LISTED = 'names = ["time_s", "temp_case_degc", "gyro_dph"]'
DROP = 'text = { torn_lines = "drop" }'


def fields():
    """Rows of the clean log as texts: seconds, case temperature, rate."""
    rng = np.random.default_rng(18)
    time = 2.0 * np.arange(ROWS)
    case = -20.0 + 1.8 * (np.arange(ROWS) // 3)  # typed once for three rows
    rate = 9.0 + 0.02 * case - 1e-4 * case**2 + rng.normal(0.0, 0.05, ROWS)
    return [[f"{t:.1f}", f"{c:.3f}", f"{r:.4f}"] for t, c, r in zip(time, case, rate, strict=True)]


CLEAN = fields()
BODY = [",".join(row) for row in CLEAN]
BLANKS = [" ".join(row) for row in CLEAN]
GERMAN = [";".join(field.replace(".", ",") for field in row) for row in CLEAN]


@dataclass(frozen=True)
class Odd:
    """A file as it was written, its suffix, what [logs] says of it, and tables of the recipe."""

    content: str | bytes
    logs: str = ""
    tables: str = ""
    suffix: str = ".csv"
    head: str = ""

    @property
    def data(self):
        """Bytes of the file."""
        return self.content if isinstance(self.content, bytes) else self.content.encode()


def text(*lines, end="\n"):
    """Lines of text with their ends."""
    return end.join(lines) + end


def exclude(keys):
    """An exclusion at the head of a recipe."""
    return f'exclude = [{{ log = "a", {keys}, reason = "r", person = "p" }}]\n'


def grouped(mark, decimal):
    """Rates in thousandths with a mark between their thousands."""
    rows = []
    for row in CLEAN:
        rate = f"{float(row[2]) * 1000.0:,.1f}".replace(",", "T").replace(".", decimal)
        rows.append([row[0], row[1], rate.replace("T", mark)])
    return rows


def joined(rows, separator):
    """Rows as lines."""
    return [separator.join(row) for row in rows]


THOUSANDTHS = '[columns]\ngyro_dph = { from = "gyro_dph", scale = 0.001 }'

TORN = {
    "comments above headerless rows that look like rows": Odd(
        text("% 1 2 3", "% 0.5 -0.3 7.1", *BLANKS), LISTED, suffix=".txt"
    ),
    "comments above the header that look like rows": Odd(
        text("# 1,2,3", "# 0.5,0.3,0.1", HEADER, *BODY)
    ),
    "a header behind a comment's mark": Odd(text("# " + HEADER, *BODY)),
    "units behind a comment's mark": Odd(text(HEADER, "# s,degC,deg/h", *BODY)),
    "comments among the rows": Odd(text(HEADER, *BODY[:50], "# door opened", *BODY[50:])),
    "a blank line behind every row": Odd(text(HEADER, *(f"{row}\n" for row in BODY))),
    "a torn line in a serial capture": Odd(text(HEADER, *BODY[:6], "-0.3-0.31", *BODY[6:]), DROP),
    "two lines run into one": Odd(text(HEADER, *BODY[:6], BODY[5] + BODY[6], *BODY[6:]), DROP),
    "a capture that begins inside a line": Odd(
        text("7.3 8.9", *BLANKS), f"{LISTED}\n{DROP}", suffix=".txt"
    ),
    "more torn lines than usual": Odd(
        text(HEADER, *BODY[:6], *["-0.3-0.31"] * 14, *BODY[6:]),
        'text = { torn_lines = "drop", torn_limit = 20 }',
    ),
    "a torn line that a person left out": Odd(
        text(HEADER, *BODY[:6], "-0.3-0.31", *BODY[6:]), head=exclude("lines = [8]")
    ),
    "a last number that was still being written": Odd(
        (text(HEADER, *BODY) + "240.0,52.100,9.").encode(), 'text = { last_line = "drop" }'
    ),
    "another number of lines above each log": Odd(
        text("Logger v3 serial 7", "begin", *BLANKS),
        f'{LISTED}\ntext = {{ skip_lines = {{ "a.txt" = 2 }} }}',
        suffix=".txt",
    ),
    "a footer of three lines": Odd(
        text(HEADER, *BODY, "", "Operator: Huber, 21.3.2014", "Mean,12.3"),
        "text = { footer_lines = 3 }",
    ),
    "thousands behind commas in quotes": Odd(
        text(HEADER, *(f'{a},{b},"{c}"' for a, b, c in grouped(",", "."))), tables=THOUSANDTHS
    ),
    "thousands behind points, decimal commas": Odd(
        text(
            HEADER.replace(",", ";"),
            *(f"{a.replace('.', ',')};{b.replace('.', ',')};{c}" for a, b, c in grouped(".", ",")),
        ),
        tables=THOUSANDTHS,
    ),
    "rows that a person left out": Odd(
        text(HEADER, "0.0,80.0,1.0", *BODY[:9], "17.0,80.0,1.0", *BODY[9:]),
        head=exclude('rows = ["1-1", 11]'),
    ),
}


def clocked(form):
    """Rows with the time in another form."""
    return [f"{form(float(row[0]))},{row[1]},{row[2]}" for row in CLEAN]


def unit(words):
    """A mapping of the time that states its unit."""
    return f'[columns]\ntime_s = {{ from = "time_s", {words} }}'


TIMES = {
    "milliseconds without a unit": Odd(
        text(HEADER, *clocked(lambda s: round(s * 1e3))), tables=unit('unit = "ms"')
    ),
    "microseconds by the header": Odd(
        text("time [μs],temp_case_degc,gyro_dph", *clocked(lambda s: round(s * 1e6))),
        tables='[columns]\ntime_s = { from = "time" }',
    ),
    "ticks of a watch crystal": Odd(
        text(HEADER, *clocked(lambda s: round(s * 32768))),
        tables=unit(f'scale = {1.0 / 32768.0!r}, unit = "s"'),
    ),
    "a clock that starts at 2.5e8 s": Odd(
        text(
            HEADER,
            "256551298.25,80.0,1.0",
            *clocked(lambda s: f"{256551300.5 + s:.2f}"),
        ),
        head=exclude("to_s = 256551299.25"),
    ),
}


def workbook(rows, *, above=(), below=(), merged=(), more=None):
    """A workbook whose first sheet holds lines above the rows, the rows, and lines below them."""
    book = openpyxl.Workbook()
    sheet = book.active
    sheet.title = "Data"
    for row in (*above, *rows, *below):
        sheet.append(list(row))
    for cells in merged:
        sheet.merge_cells(cells)
    for name, content in (more or {}).items():
        other = book.create_sheet(name)
        for row in content:
            other.append(list(row))
    stream = io.BytesIO()
    book.save(stream)
    return stream.getvalue()


NUMBERS = [tuple(float(field) for field in row) for row in CLEAN]
ONCE = [(t, c if k % 3 == 0 else None, r) for k, (t, c, r) in enumerate(NUMBERS)]
TWO_SHEETS = {"Limits": [("name", "limit"), ("bias", 3.0)]}


def labview():
    """Lines of a LabVIEW file."""
    head = [
        "LabVIEW Measurement\t",
        "Separator\tTab",
        "X_Columns\tOne",
        "***End_of_Header***\t",
        "",
    ]
    names = "X_Value\ttemp_case_degc\tgyro_dph\tComment"
    segment = ["Channels\t2", f"Samples\t{ROWS}\t{ROWS}", "***End_of_Header***\t\t", names]
    return [*head, *segment, *joined(CLEAN, "\t")]


LABVIEW_TIME = '[columns]\ntime_s = { from = "X_Value" }'
REPLY_COLUMNS = """
[columns]
time_s = { from = "time" }
temp_case_degc = { from = "actual 1" }
gyro_dph = { from = "actual 2", unit = "deg/h", scale = 0.001 }
"""


def replies():
    """Lines of a chamber's replies that hold the clean log's columns among others."""
    return [
        f"{row[0]} $01I {0.0:06.1f} {float(row[1]):06.1f} {0.0:06.1f} {1000 * float(row[2]):06.1f}"
        + 8 * f" {0.0:06.1f}"
        + f" {'01' * 8}"
        for row in CLEAN
    ]


TABLES = {
    "a workbook with merged temperature cells": Odd(
        workbook(ONCE, above=[NAMES], merged=[f"B{k}:B{k + 2}" for k in range(2, ROWS + 2, 3)]),
        suffix=".xlsx",
    ),
    "a workbook with title, units row and merged heading": Odd(
        workbook(
            NUMBERS,
            above=[("Thermal run 17",), (), ("Log", "Gyro 7", None), NAMES, ("s", "°C", "°/h")],
            merged=["A1:C1", "B3:C3"],
        ),
        suffix=".xlsx",
    ),
    "a workbook with a footer": Odd(
        workbook(NUMBERS, above=[NAMES], below=[(), ("Mean", 15.7, 9.1), ("Huber",)]),
        "text = { footer_lines = 3 }",
        suffix=".xlsx",
    ),
    "a workbook with two sheets": Odd(
        workbook(NUMBERS, above=[NAMES], more=TWO_SHEETS), 'table = "Data"', suffix=".xlsx"
    ),
    "a LabVIEW file with a torn line": Odd(
        text(*labview()[:20], "-0.3\t-0.31", *labview()[20:]).replace(
            f"Samples\t{ROWS}\t{ROWS}", f"Samples\t{ROWS + 1}\t{ROWS + 1}"
        ),
        f'format = "lvm"\n{DROP}',
        LABVIEW_TIME,
        suffix=".lvm",
    ),
    "chamber replies with a torn line": Odd(
        text(*replies()[:50], replies()[50][:40], *replies()[50:]),
        f'format = "chamber"\n{DROP}',
        REPLY_COLUMNS,
        suffix=".txt",
    ),
    "pinned CSV with a footer and a torn line": Odd(
        text(HEADER, *BODY[:6], "-0.3-0.31", *BODY[6:], "end"),
        'format = "csv"\ntext = { footer_lines = 1, torn_lines = "drop" }',
    ),
    "JSON records": Odd(
        json.dumps({"by": "lab", "rows": [dict(zip(NAMES, row, strict=True)) for row in NUMBERS]}),
        suffix=".json",
    ),
}
