"""One log, written as laboratories write it: each dialect is a function from the clean log's fields
to bytes and a recipe.

A clean log is a table of texts: names, and rows of fields as they stand in the clean CSV. Every
dialect holds the same decimal numbers, so that what is read must be the same float64.
"""

from __future__ import annotations

import datetime as dt
import io
import struct
from dataclasses import dataclass

import numpy as np

NAMES = ("time_s", "temp_case_degc", "temp_env_degc", "gyro_dph")
START = dt.datetime(2011, 12, 6, 23, 50, 6, 125000)  # noqa: DTZ001 (a logger's clock knows no zone)

MAPPED = """
[columns]
time_s = {{ from = "{0}" }}
temp_case_degc = {{ from = "{1}" }}
temp_env_degc = {{ from = "{2}" }}
gyro_dph = {{ from = "{3}" }}
"""


@dataclass(frozen=True)
class Clean:
    """Fields of a clean log, row by row."""

    rows: list[list[str]]

    @classmethod
    def of(cls, text):
        """The fields of a clean CSV."""
        return cls([line.split(",") for line in text.split("\n")[1:] if line])

    def column(self, number):
        """One column as float64."""
        return np.array([float(row[number]) for row in self.rows])


@dataclass(frozen=True)
class Dialect:
    """How a log is written: file name → bytes of one log, what [logs] says of it, and what the
    other tables say.
    """

    write: object
    logs: str = ""
    tables: str = ""
    suffix: str = ".csv"


def table(header, rows, separator=",", end="\n"):
    """Lines of text."""
    return end.join([*header, *(separator.join(row) for row in rows)]) + end


def german(log):
    """Rows with decimal commas."""
    return [[field.replace(".", ",") for field in row] for row in log.rows]


def instants(log):
    """The instant of each row: the start and its seconds."""
    return [START + dt.timedelta(seconds=float(row[0])) for row in log.rows]


def timed(log, form, rows=None):
    """Rows whose time is written in a form of strftime, `%L` standing for milliseconds."""
    stamps = [t.strftime(form.replace("%L", f"{t.microsecond // 1000:03d}")) for t in instants(log)]
    return [[stamp, *row[1:]] for stamp, row in zip(stamps, rows or log.rows, strict=True)]


def semicolons(log):
    """Semicolons, decimal commas."""
    return table([";".join(NAMES)], german(log), ";").encode()


def western(log):
    """Windows-1252 with units in brackets, semicolons, CRLF."""
    names = "Zeit (s);Gehäuse (°C);Kammer (°C);Drehrate (°/h)"
    return table([names], german(log), ";", "\r\n").encode("cp1252")


def unicode_text(log):
    """Excel's "Unicode text": UTF-16 with a mark, tabs."""
    return b"\xff\xfe" + table(["\t".join(NAMES)], log.rows, "\t", "\r\n").encode("utf-16-le")


def chinese(log):
    """GB18030 with Chinese names and units, commas."""
    return table(["时间(s),壳体温度(℃),箱体温度(摄氏度),陀螺输出(°/h)"], log.rows).encode("gb18030")


def marked(log):
    """UTF-8 with a mark, CRLF, units in brackets behind the canonical names."""
    names = "time_s (s),temp_case_degc (degC),temp_env_degc [°C],gyro_dph (deg/hr)"
    return b"\xef\xbb\xbf" + table([names], log.rows, ",", "\r\n").encode()


def blanks(log):
    """Columns parted by blanks, with a blank behind the sign."""
    rows = [[f"{'-' if f[0] == '-' else '+'} {f.lstrip('-'):>9}" for f in row] for row in log.rows]
    return table(["  ".join(f"{name:>14}" for name in NAMES)], rows, "   ").encode()


def fixed(log):
    """Fields of ten characters without anything between them."""
    rows = [["".join(f"{field:>10}" for field in row)] for row in log.rows]
    return table(["".join(f"{name[:10]:>10}" for name in NAMES)], rows).encode()


def unit_row(log):
    """Twelve lines of preamble, then names and units on lines of their own."""
    preamble = [
        "Messprotokoll Nr. 17",
        "Prüfer;Huber",
        "",
        *(f"Kanal {k};an;0,5" for k in range(8)),
        "",
    ]
    return table(
        [*preamble, "Zeit;Gehäuse;Kammer;Drehrate", "s;°C;°C;°/h"], german(log), ";"
    ).encode("cp1252")


def headerless(log):
    """No header, blanks."""
    return table([], log.rows, "  ").encode()


def rows_end_with_a_tab(log):
    """Rows end with a tab, the header does not."""
    return table(["\t".join(NAMES)], [[*row, ""] for row in log.rows], "\t").encode()


def alarms(log):
    """Three hundred columns, every other one an alarm."""
    header = [name for k in range(147) for name in (f"Chan {k}", "Alarm")]
    header = [NAMES[0], *header, NAMES[1], "Alarm", NAMES[2], "Alarm", NAMES[3], "Alarm"]
    filler = ["1.5", "0"] * 147
    return table(
        [",".join(header)], [[r[0], *filler, r[1], "0", r[2], "0", r[3], "0"] for r in log.rows]
    ).encode()


def keysight(log):
    """The instrument's own file: sweeps, month first, milliseconds behind a colon, alarms between
    the channels.
    """
    rows = timed(log, "%m/%d/%Y %H:%M:%S:%L")
    made = [[str(k + 1), r[0], r[1], "0", r[2], "0", r[3], "0"] for k, r in enumerate(rows)]
    header = "Sweep #,Time,Chan 101 (C),Alarm,Chan 102 (C),Alarm,Chan 103 (VDC),Alarm"
    return table([header], made, ",", "\r\n").encode()


def benchlink(log):
    """BenchLink Data Logger: UTF-16, a preamble about instrument and channels, times with a
    comma.
    """
    rows = timed(log, "%m/%d/%Y %H:%M:%S:%L")
    made = [[str(k + 1), r[0], r[1], "0", r[2], "0", r[3], "0"] for k, r in enumerate(rows)]
    preamble = [
        "Name:,Data 17",
        "Owner:,Lab",
        "Comments:,",
        "Acquisition Date:,12/6/2011 11:50:06 PM",
        "Instrument:,34970A",
        "Total Channels:,3",
        "Channel,Name,Function,Range,Resolution",
        "101,<Case>,Temp (Type T),C,0.1",
        "102,<Air>,Temp (Type T),C,0.1",
        "",
        "Scan Control:",
        "Start Action:,Immediately",
        "Scan,Time,101 <Case> (C),Alarm 101,102 <Air> (C),Alarm 102,103 <Gyro> (VDC),Alarm 103",
    ]
    return b"\xff\xfe" + table(preamble, made, ",", "\r\n").encode("utf-16-le")


LVM_HEAD = (
    "LabVIEW Measurement\t",
    "Writer_Version\t2",
    "Reader_Version\t2",
    "Separator\tTab",
    "Multi_Headings\tNo",
    "Time_Pref\tRelative",
    "Operator\tlab",
    "Date\t2011/12/06",
    "Time\t23:50:06.125",
)


def lvm_segment(n, step):
    """Header of a segment with three channels."""
    return [
        "Channels\t3\t\t\t",
        f"Samples\t{n}\t{n}\t{n}\t",
        "Date\t2011/12/06\t2011/12/06\t2011/12/06\t",
        "Time\t23:50:06.125\t23:50:06.125\t23:50:06.125\t",
        "Y_Unit_Label\t°C\t°C\tdeg/h\t",
        "X_Dimension\tTime\tTime\tTime\t",
        f"X0\t{step}\t{step}\t{step}\t".replace(step, "0.0000000000000000E+0"),
        f"Delta_X\t{step}\t{step}\t{step}\t",
        "***End_of_Header***\t\t\t\t",
        "X_Value\ttemp_case_degc\ttemp_env_degc\tgyro_dph\tComment",
    ]


def lvm(log):
    """LabVIEW text with one X column."""
    head = [*LVM_HEAD, "X_Columns\tOne", "Decimal_Separator\t.", "***End_of_Header***\t", ""]
    return table([*head, *lvm_segment(len(log.rows), "1.000000")], log.rows, "\t", "\r\n").encode(
        "cp1252"
    )


def lvm_without_x(log):
    """LabVIEW text without X values, decimal commas, in two segments."""
    head = [*LVM_HEAD, "X_Columns\tNo", "Decimal_Separator\t,", "***End_of_Header***\t", ""]
    rows = [["", *row[1:]] for row in german(log)]
    return table([*head, *lvm_segment(len(rows), "1,000000")], rows, "\t", "\r\n").encode("cp1252")


def comma_milliseconds(log):
    """`2011-12-06 10:05:06,125` between semicolons."""
    return table([";".join(NAMES)], timed(log, "%Y-%m-%d %H:%M:%S,%L"), ";").encode()


def dotted_dates(log):
    """`dd.MM.yyyy HH:mm:ss` and decimal commas."""
    return table([";".join(NAMES)], timed(log, "%d.%m.%Y %H:%M:%S", german(log)), ";").encode()


def time_of_day(log):
    """Times of day that pass midnight."""
    return table([",".join(NAMES)], timed(log, "%H:%M:%S.%L")).encode()


def two_columns(log):
    """Date and time in columns of their own, with AM and PM."""
    stamps = [t.strftime("%d-%m-%Y,%I:%M:%S %p") for t in instants(log)]
    rows = [[stamp, *row[1:]] for stamp, row in zip(stamps, log.rows, strict=True)]
    return table(["Date,Time,temp_case_degc,temp_env_degc,gyro_dph"], rows).encode()


def microseconds(log):
    """Whole microseconds of a counter that the recipe knows to be microseconds."""
    rows = [[str(round(float(row[0]) * 1e6)), *row[1:]] for row in log.rows]
    return table([",".join(["tick", *NAMES[1:]])], rows).encode()


def long_seconds(log):
    """Seconds since 1904 with nineteen digits."""
    rows = [[f"{3406056606 + int(float(row[0]))}.123456789", *row[1:]] for row in log.rows]
    return table(["\t".join(NAMES)], rows, "\t").encode()


def spreadsheet_days(log):
    """Days as spreadsheets count them."""
    rows = [[repr(40883.75 + float(row[0]) / 86400.0), *row[1:]] for row in log.rows]
    return table([",".join(NAMES)], rows).encode()


def wrapped_clock(log):
    """Milliseconds in sixteen bits."""
    rows = [[str(round(float(row[0]) * 1000) % 65536), *row[1:]] for row in log.rows]
    return table([",".join(["ticks", *NAMES[1:]])], rows).encode()


def datataker(log):
    """`2007/12/15 20:49:45.905,n,…`, no header."""
    return table(
        [], [[row[0], "n", *row[1:]] for row in timed(log, "%Y/%m/%d %H:%M:%S.%L")]
    ).encode()


def graphtec(log):
    """Thirty-six lines above the rows, units below the names, signs before every value."""
    preamble = [
        "Vendor,GRAPHTEC Corporation",
        "Model,GL840",
        *(f"CH{k},TEMP,TC_T,Off,{k}.0" for k in range(32)),
    ]
    header = ["Number,Date&Time,CH1,CH2,CH3,A1234567890", "NO.,Time,degC,degC,deg/h,A1234567890"]
    rows = timed(log, "%Y/%m/%d %H:%M:%S")
    made = [
        [str(k + 1), r[0], *(f if f[0] == "-" else "+" + f for f in r[1:]), "LLLLLLLLLL"]
        for k, r in enumerate(rows)
    ]
    return table([*preamble, *header], made).encode()


def bars(log):
    """Bars between fields with blanks around them, blank lines at the end."""
    return table([" | ".join(NAMES)], log.rows, " | ").encode() + b"\n \n"


def excel(log):
    """A workbook with a title, and dates as cells."""
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Thermal run 17"])
    sheet.append([])
    sheet.append(["Time", "Case (°C)", "Air (°C)", "Gyro (deg/h)"])
    for instant, row in zip(instants(log), log.rows, strict=True):
        sheet.append([instant.replace(microsecond=0), *(float(field) for field in row[1:])])
    return saved(book.save)


def saved(save):
    """Bytes that a function writes into a file object."""
    stream = io.BytesIO()
    save(stream)
    return stream.getvalue()


def tdms(log):
    """A group with units and a waveform's increment."""
    import nptdms

    stated = ["degC", "degC", "deg/h"]
    channels = [
        nptdms.ChannelObject(
            "run", NAMES[k], log.column(k), {"unit_string": stated[k - 1], "wf_increment": 1.0}
        )
        for k in (1, 2, 3)
    ]

    def write(stream):
        with nptdms.TdmsWriter(stream) as writer:
            writer.write_segment(channels)

    return saved(write)


def matlab(log):
    """MATLAB v5: a struct of vectors."""
    from scipy import io as scipy_io

    vectors = {name: log.column(k) for k, name in enumerate(NAMES)}
    return saved(lambda stream: scipy_io.savemat(stream, {"log": vectors}))


def matlab_matrix(log):
    """MATLAB v5: one matrix."""
    from scipy import io as scipy_io

    matrix = np.column_stack([log.column(k) for k in range(4)])
    return saved(lambda stream: scipy_io.savemat(stream, {"M": matrix}))


def matlab_73(log):
    """MATLAB v7.3: HDF5 behind a header of 512 bytes, vectors as columns."""
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w", userblock_size=512) as made:
        for k, name in enumerate(NAMES):
            made.create_dataset(f"log/{name}", data=log.column(k).reshape(1, -1))
    content = bytearray(stream.getvalue())
    head = (
        b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Tue Dec  6 23:50:06 2011 HDF5 schema"
        b" 1.00 ."
    )
    content[: len(head)] = head
    return bytes(content)


def hdf5(log):
    """HDF5: a compound dataset."""
    import h5py

    records = np.zeros(len(log.rows), dtype=[(name, "<f8") for name in NAMES])
    for k, name in enumerate(NAMES):
        records[name] = log.column(k)
    stream = io.BytesIO()
    with h5py.File(stream, "w") as made:
        made.create_dataset("runs/r1", data=records)
    return stream.getvalue()


def parquet(log):
    """Parquet, time as instants."""
    import pyarrow as pa
    from pyarrow import parquet as pq

    columns = {name: pa.array(log.column(k)) for k, name in enumerate(NAMES)}
    columns["time_s"] = pa.array(instants(log), pa.timestamp("us"))
    return saved(lambda stream: pq.write_table(pa.table(columns), stream))


def ulog(log):
    """ULog: two topics, time in whole microseconds."""

    def message(kind, content):
        return struct.pack("<HB", len(content), ord(kind)) + content

    made = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 112574)
    made += message("B", bytes(40))
    made += message("F", b"fog_run:uint64_t timestamp;double case;double air;double gyro;")
    made += message("F", b"battery:uint64_t timestamp;float voltage;")
    made += message("A", struct.pack("<BH", 0, 0) + b"fog_run") + message(
        "A", struct.pack("<BH", 0, 1) + b"battery"
    )
    for row in log.rows:
        stamp = round(float(row[0]) * 1e6)
        made += message("D", struct.pack("<HQddd", 0, stamp, *(float(field) for field in row[1:])))
        if stamp % 10_000_000 == 0:
            made += message("D", struct.pack("<HQf", 1, stamp, 12.5))
    return made


def binary(log):
    """Big-endian records behind a header: a sync word, int32 of scaled decimals, bytes of no
    meaning.
    """
    made = b"HEADER-16-BYTES."
    for row in log.rows:
        scaled = [round(float(f) * s) for f, s in zip(row, (1000, 10000, 10, 1000), strict=True)]
        made += b"\xaa\x55" + struct.pack(">Iihi", *scaled) + b"\0\0\0"
    return made


BINARY = """
[logs.binary]
byte_order = "big"
header_bytes = 16
sync = "AA55"
fields = [
    { name = "sync", type = "u2" },
    { name = "time_s", type = "u4", scale = 0.001, unit = "s" },
    { name = "temp_case_degc", type = "i4", scale = 0.0001 },
    { name = "temp_env_degc", type = "i2", scale = 0.1 },
    { name = "gyro_dph", type = "i4", scale = 0.001, unit = "°/h" },
    { name = "spare", type = "skip", bytes = 3 },
]
"""

KEYSIGHT_COLUMNS = """
[columns]
time_s = {{ from = "Time" }}
temp_case_degc = {{ from = "{0}" }}
temp_env_degc = {{ from = "{1}" }}
gyro_dph = {{ from = "{2}", unit = "deg/h", header_unit = "ignored" }}
"""

DIALECTS = {
    "semicolons and decimal commas": Dialect(semicolons),
    "Windows-1252 and German units": Dialect(
        western, "", MAPPED.format("Zeit (s)", "Gehäuse (°C)", "Kammer (°C)", "Drehrate (°/h)")
    ),
    "Excel Unicode text": Dialect(unicode_text, "", "", ".txt"),
    "Chinese names and units in GB18030": Dialect(
        chinese, "", MAPPED.format("时间", "壳体温度", "箱体温度", "陀螺输出")
    ),
    "a mark, CRLF and bracketed units": Dialect(marked),
    "blanks, and a blank behind the sign": Dialect(blanks, "", "", ".dat"),
    "fixed width": Dialect(
        fixed,
        'names = ["time_s", "temp_case_degc", "temp_env_degc", "gyro_dph"]\ntext = { delimiter ='
        ' "fixed", widths = [10, 10, 10, 10], skip_lines = 1, header_lines = 0 }',
        "",
        ".dat",
    ),
    "preamble, names and units on two lines": Dialect(
        unit_row, "", MAPPED.format("Zeit", "Gehäuse", "Kammer", "Drehrate")
    ),
    "no header": Dialect(
        headerless, 'names = ["time_s", "temp_case_degc", "temp_env_degc", "gyro_dph"]', "", ".log"
    ),
    "rows that end with a tab": Dialect(rows_end_with_a_tab),
    "three hundred columns with alarms": Dialect(alarms),
    "Keysight sweeps": Dialect(
        keysight,
        'format = "keysight"',
        KEYSIGHT_COLUMNS.format("Chan 101 (C)", "Chan 102 (C)", "Chan 103 (VDC)"),
    ),
    "BenchLink": Dialect(
        benchlink,
        "",
        KEYSIGHT_COLUMNS.format("101 <Case> (C)", "102 <Air> (C)", "103 <Gyro> (VDC)"),
    ),
    "LVM": Dialect(lvm, 'format = "lvm"', '[columns]\ntime_s = { from = "X_Value" }', ".lvm"),
    "LVM without X values": Dialect(
        lvm_without_x, "", '[columns]\ntime_s = { from = "X_Value" }', ".lvm"
    ),
    "comma before the milliseconds": Dialect(comma_milliseconds),
    "dd.MM.yyyy": Dialect(dotted_dates),
    "time of day past midnight": Dialect(time_of_day),
    "date and time apart": Dialect(
        two_columns, "", '[columns]\ntime_s = { from = "Time", date = "Date" }'
    ),
    "microseconds by the recipe": Dialect(
        microseconds, "", '[columns]\ntime_s = { from = "tick", unit = "us" }'
    ),
    "nineteen digits": Dialect(long_seconds, "", "", ".txt"),
    "spreadsheet days": Dialect(
        spreadsheet_days, "", '[columns]\ntime_s = { from = "time_s", time_format = "excel" }'
    ),
    "a clock of sixteen bits": Dialect(
        wrapped_clock, "", '[columns]\ntime_s = { from = "ticks", unit = "ms", wraps_at = 65536.0 }'
    ),
    "Datataker": Dialect(
        datataker, 'names = ["time_s", "flag", "temp_case_degc", "temp_env_degc", "gyro_dph"]'
    ),
    "Graphtec": Dialect(graphtec, "", MAPPED.format("Date&Time", "CH1", "CH2", "CH3")),
    "bars and blank lines at the end": Dialect(bars, "", "", ".txt"),
    "Excel": Dialect(
        excel, 'format = "excel"', MAPPED.format("Time", "Case", "Air", "Gyro"), ".xlsx"
    ),
    "TDMS": Dialect(tdms, 'format = "tdms"', "", ".tdms"),
    "MATLAB v5": Dialect(matlab, 'format = "matlab"\ntable = "log"', "", ".mat"),
    "MATLAB v5, one matrix": Dialect(
        matlab_matrix,
        'format = "matlab"\nnames = ["time_s", "temp_case_degc", "temp_env_degc", "gyro_dph"]',
        "",
        ".mat",
    ),
    "MATLAB v7.3": Dialect(matlab_73, 'format = "matlab"', "", ".mat"),
    "HDF5": Dialect(hdf5, 'format = "hdf5"\ntable = "runs/r1"', "", ".h5"),
    "Parquet": Dialect(parquet, 'format = "parquet"', "", ".parquet"),
    "ULog": Dialect(
        ulog,
        'format = "ulog"\ntable = "fog_run"',
        MAPPED.format("timestamp", "case", "air", "gyro"),
        ".ulg",
    ),
    "binary records": Dialect(binary, 'format = "binary"' + BINARY, "", ".bin"),
}
