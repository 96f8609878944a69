"""Mutated logs: every one is read, or refused in one line with exit code 3."""

import io
import json
import random

import numpy as np

from calibkit.errors import CalibkitError
from calibkit.readers import registry
from calibkit.recipe.logs import Logs

NEEDED = ("time_s", "temp_case_degc", "gyro_dph")
ROWS = 60
TOKENS = (
    b"nan", b"inf", b"1e400", b"-", b"", b",", b";", b"\t", b'"', b"\0", b"\r", b"\n", b"#", b"(",
    b"\xff\xfe", b"\xef\xbb\xbf", b"1e308", b"0x1p3", b"1_0", "１".encode(), "−1".encode(), b"TRUE",
    b"2026-01-01", b"12:00:00", b"$", b"{", b"[", b"]", b"}", b"\\", b"=1+1", b"A" * 3000,
)  # fmt: skip


def samples():
    """One small log of each format that can be written here: name → bytes."""
    time, case = np.arange(ROWS, dtype=float), np.linspace(-20.0, 60.0, ROWS)
    columns = dict(zip(NEEDED, (time, case, 0.5 + 0.01 * case), strict=True))
    rows = [",".join(f"{v:.5f}" for v in row) for row in zip(*columns.values(), strict=True)]
    text = "\n".join([",".join(NEEDED), *rows, ""])
    found = {
        "a.csv": text.encode(),
        "b.csv": text.replace(",", ";").replace(".", ",").encode("utf-16"),
        "c.txt": ("# logger\n\n" + text.replace(",", "\t")).encode(),
        "d.json": json.dumps({name: list(values) for name, values in columns.items()}).encode(),
        "e.lvm": _lvm(columns),
    }
    return found | _binary(columns)


def _lvm(columns):
    """The columns as a LabVIEW measurement file."""
    end = "***End_of_Header***\n"
    rows = "".join(f"{a}\t{b}\t{c}\n" for a, b, c in zip(*columns.values(), strict=True))
    head = f"LabVIEW Measurement\nSeparator\tTab\nMulti_Headings\tYes\nX_Columns\tOne\n{end}"
    head += f"Channels\t2\nSamples\t{ROWS}\t{ROWS}\nX0\t0\t0\nDelta_X\t1\t1\n{end}"
    return (head + "X_Value\ttemp_case_degc\tgyro_dph\n" + rows).encode()


def _binary(columns):
    """The columns in the formats whose libraries are installed."""
    import h5py
    import nptdms
    import openpyxl
    import pyarrow as pa
    from pyarrow import parquet
    from scipy import io as scipy_io

    names = ("f.h5", "g.tdms", "h.xlsx", "i.parquet", "j.mat")
    found, sinks = {}, {name: io.BytesIO() for name in names}
    with h5py.File(sinks["f.h5"], "w") as made:
        for name, values in columns.items():
            made[name] = values
    with nptdms.TdmsWriter(sinks["g.tdms"]) as writer:
        writer.write_segment([nptdms.ChannelObject("run", *item) for item in columns.items()])
    book = openpyxl.Workbook()
    for row in (NEEDED, *zip(*columns.values(), strict=True)):
        book.active.append([one if isinstance(one, str) else float(one) for one in row])
    book.save(sinks["h.xlsx"])
    parquet.write_table(pa.table(columns), sinks["i.parquet"])
    scipy_io.savemat(sinks["j.mat"], columns)
    for name, sink in sinks.items():
        found[name] = sink.getvalue()
    return found


def mutate(content, generator):
    """One to four changes: bits, bytes, tokens, blocks cut, doubled or moved."""
    changed = bytearray(content)
    for _ in range(generator.randrange(1, 5)):
        at, kind = generator.randrange(len(changed) + 1), generator.randrange(6)
        until = min(len(changed), at + generator.randrange(1, 64))
        if kind == 0 and at < len(changed):
            changed[at] ^= 1 << generator.randrange(8)
        elif kind == 1:
            changed[at:at] = generator.randbytes(generator.randrange(1, 9))
        elif kind == 2:
            changed[at:until] = generator.choice(TOKENS)
        elif kind == 3:
            del changed[at:until]
        elif kind == 4:
            changed[at:at] = changed[at:until]
        elif generator.random() < 0.2:
            del changed[at:]
    return bytes(changed)


def attack(folder, count, seed):
    """Return number of mutated logs, how many were refused, and what was not survived."""
    generator = random.Random(seed)  # noqa: S311 (a fixed seed, not a secret)
    originals, refused, bad = list(samples().items()), 0, []
    for number in range(count):
        name, content = originals[number % len(originals)]
        path = folder / name
        path.write_bytes(mutate(content, generator))
        try:
            registry.read(path, name, Logs(files=("*",)), NEEDED)
        except CalibkitError as error:
            refused += 1
            if error.exit_code != 3 or "\n" in error.message:
                bad.append(f"{name}: exit code {error.exit_code}: {error}")
        except Exception as error:  # noqa: BLE001 (what is not calibkit's own is what is looked for)
            bad.append(f"{name}: {type(error).__name__}: {error}")
    return count, refused, bad
