"""Two thousand damaged logs: each is refused in one line, or read with every line accounted for;
never a traceback.
"""

import random
import re

import numpy as np
import pytest

from calibkit import instruments, recipe
from calibkit.errors import CalibkitError
from calibkit.logs import log_files
from calibkit.readers import tokens
from conftest import slow_after
from logs.dialects import DIALECTS, NAMES, Clean, Dialect

ROWS = 60
SEEDED = 1600
PLAIN = "clean CSV"


def plain(log):
    """Return the clean CSV itself."""
    return "\n".join([",".join(NAMES), *(",".join(row) for row in log.rows), ""]).encode()


WRITTEN = {PLAIN: Dialect(plain)} | {
    name: DIALECTS[name] for name in DIALECTS if "three hundred" not in name
}
CONTAINERS = {".xlsx", ".tdms", ".mat", ".h5", ".parquet", ".ulg", ".bin"}


def log_of(seed):
    """Return a small log whose columns differ in every row."""
    rng = np.random.default_rng(seed)
    air = -20.0 + 0.5 * np.arange(ROWS)
    columns = (np.arange(ROWS), air + 3.0, air, 9.0 + rng.normal(0.0, 0.5, ROWS))
    forms = ("{:.0f}", "{:.4f}", "{:.1f}", "{:.3f}")
    return Clean(
        [
            [form.format(column[k]) for form, column in zip(forms, columns, strict=True)]
            for k in range(ROWS)
        ]
    )


BASE = log_of(1)
BYTES = {name: dialect.write(BASE) for name, dialect in WRITTEN.items()}


def cut(data, rng):
    """Cut the file off, mostly inside a number."""
    return data[: rng.randrange(1, len(data))]


def flipped(data, rng):
    """Flip one to four bits."""
    made = bytearray(data)
    for _ in range(rng.randrange(1, 5)):
        made[rng.randrange(len(made))] ^= 1 << rng.randrange(8)
    return bytes(made)


def hole(data, rng):
    """Lose a run of bytes."""
    start = rng.randrange(len(data))
    return data[:start] + data[start + rng.randrange(1, 200) :]


def inserted(data, rng):
    """Gain a few bytes."""
    at = rng.randrange(len(data))
    return (
        data[:at]
        + bytes(rng.choices(b"\n\r,;\t\"' x-+.eE0123456789\0\xff\xb0", k=rng.randrange(1, 6)))
        + data[at:]
    )


def zeroed(data, rng):
    """Hold a block of zeros, as after a power cut."""
    at = rng.randrange(len(data))
    size = rng.randrange(1, 300)
    return data[:at] + bytes(min(size, len(data) - at)) + data[at + size :]


def twice(data, rng):
    """Hold a line twice, and so its stamp."""
    lines = data.split(b"\n")
    k = rng.randrange(len(lines))
    return b"\n".join([*lines[: k + 1], *lines[k:]])


def lost_line(data, rng):
    """Lose a line."""
    lines = data.split(b"\n")
    del lines[rng.randrange(len(lines))]
    return b"\n".join(lines)


def joined(data, rng):
    """Lose a line end."""
    ends = [match.start() for match in re.finditer(rb"\n", data)] or [0]
    at = rng.choice(ends)
    return data[:at] + data[at + 1 :]


def swapped(data, rng):
    """Swap two fields of the first lines, or two lines."""
    lines = data.split(b"\n")
    a, b = rng.randrange(len(lines)), rng.randrange(min(len(lines), 4))
    lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines)


def recoded(data, rng):
    """Have been saved in another encoding by somebody's editor."""
    before, after = (
        rng.choice(["utf-8", "cp1252", "gb18030", "utf-16-le"]),
        rng.choice(["utf-16", "cp1252", "gb18030"]),
    )
    return data.decode(before, errors="replace").encode(after, errors="replace")


def letters(data, rng):
    """Have a letter where a digit was."""
    digits = [match.start() for match in re.finditer(rb"\d", data)] or [0]
    at = rng.choice(digits)
    return data[:at] + rng.choice([b"O", b"l", b"x", b"?", b" ", b",", b"."]) + data[at + 1 :]


DAMAGES = (
    cut,
    cut,
    flipped,
    flipped,
    hole,
    inserted,
    zeroed,
    twice,
    lost_line,
    joined,
    swapped,
    recoded,
    letters,
)


def source(name):
    """Return a recipe that reads a dialect."""
    dialect = WRITTEN[name]
    text = (
        'procedure = "fog_thermal"\n[logs]\nfiles ='
        f' ["*{dialect.suffix}"]\n{dialect.logs}\n{dialect.tables}\n'
    )
    return instruments.parse_recipe(recipe.Source("r.toml", text))


RECIPES = {name: source(name) for name in WRITTEN}


def outcome(name, data, folder):
    """Read a damaged log: the log, or the error; anything else is raised."""
    path = folder / f"log{WRITTEN[name].suffix}"
    path.write_bytes(data)
    try:
        return log_files.read_log(RECIPES[name], path, path.name, NAMES)
    except CalibkitError as refused:
        found = refused
    assert "\n" not in str(found)
    assert path.name in str(found)
    assert found.exit_code in {2, 3}
    return found


def accounts(log, name, data):
    """Check that every line of a text log is a row, header, preamble or blank, and that no row is
    taken for another.
    """
    assert len(log.frame) == log.rows
    if WRITTEN[name].suffix in {".bin", ".ulg"}:
        # records without a count of their own: a file that ends between two of them is whole
        assert log.rows == (
            (len(data) - 16) // 19 if WRITTEN[name].suffix == ".bin" else data.count(b"D\0\0")
        )
        return
    if WRITTEN[name].suffix in CONTAINERS or WRITTEN[name].suffix == ".lvm":
        # containers say how many values they hold, and an .lvm file how many samples
        assert log.rows == ROWS
        return
    said = next((line for line in log.reading if re.match(r"\d+ lines: ", line)), None)
    if said is None:
        assert log.rows == len([line for line in data.replace(b"\r", b"").split(b"\n") if line]) - 1
        return
    total, above, header, rows = map(int, re.findall(r"\d+", said)[:4])
    blank = sum(
        int(line.split()[0]) for line in log.reading if line.endswith("blank lines at the end")
    )
    assert total == above + header + rows + blank
    assert rows == log.rows
    encoding = next(
        re.search(r"'(.*?)'", line)[1] for line in log.reading if line.startswith("encoding")
    )
    delimiter = next(
        re.search(r"'(.*?)'", line)[1] for line in log.reading if line.startswith("delimiter")
    )
    text = data.decode(encoding).lstrip("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    assert total == len(lines) - (lines[-1] == "")
    delimiter = delimiter.replace("\\t", "\t")
    for line in lines[: above + header]:
        measured = [
            field
            for field in tokens.split_line(line, delimiter, (10,) * 4)
            if tokens.is_measured(field)
        ]
        assert len(measured) < len(NAMES) or "skip_lines = 1 (from the recipe)" in log.reading, line


@pytest.mark.parametrize("part", slow_after(1, range(8)))
def test_seeded_damage_is_refused_or_accounted_for(part, tmp_path):
    """Every dialect, every damage, from fixed seeds."""
    names, accepted = list(WRITTEN), 0
    for k in range(part, SEEDED, 8):
        name, rng = names[k % len(names)], random.Random(k)  # noqa: S311 (damage, not secrets)
        data = rng.choice(DAMAGES)(BYTES[name], rng)
        found = outcome(name, data, tmp_path)
        if isinstance(found, CalibkitError):
            continue
        accepted += 1
        accounts(found, name, data)
    assert 0 < accepted < SEEDED // 8


@pytest.mark.parametrize("name", WRITTEN)
def test_the_undamaged_log_is_read(name, tmp_path):
    """What is damaged here is read whole when it is not."""
    found = outcome(name, BYTES[name], tmp_path)
    assert found.rows == ROWS
    accounts(found, name, BYTES[name])
