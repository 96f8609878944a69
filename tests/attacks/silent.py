"""Damages that leave a log readable: none may change a coefficient by more than its expanded
uncertainty without a finding or a refusal.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy import stats

from calibkit import instruments, recipe
from calibkit.errors import CalibkitError
from calibkit.logs import log_files
from calibkit.readers.table import Guess

PROBABILITY = 0.95
"""Coverage probability of the expanded uncertainty that a change is held against."""


@dataclass(frozen=True)
class Text:
    """A log as text: names and rows of fields."""

    names: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    @classmethod
    def parse(cls, content):
        """Log of comma-separated text."""
        names, *rows = (tuple(line.split(",")) for line in content.splitlines())
        return cls(names, tuple(rows))

    def format(self):
        """Comma-separated text."""
        return "".join(",".join(row) + "\n" for row in (self.names, *self.rows))

    def column(self, name):
        """Numbers of a column."""
        return np.array([float(row[self.names.index(name)]) for row in self.rows])

    def put(self, name, values):
        """Log with other values in a column, to as many decimals as it has."""
        at = self.names.index(name)
        decimals = max(len(row[at].partition(".")[2]) for row in self.rows)
        rows = [
            (*row[:at], f"{value:.{decimals}f}", *row[at + 1 :])
            for row, value in zip(self.rows, values, strict=True)
        ]
        return Text(self.names, tuple(rows))

    def take(self, order):
        """Log of these rows."""
        return Text(self.names, tuple(self.rows[k] for k in order))


@dataclass
class Campaign:
    """Logs of a procedure, a folder for damaged ones, and what the whole ones give."""

    procedure: str
    logs: dict[str, Text]
    folder: Path
    overrides: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    """Columns that are damaged; the time is one where the log has it."""
    usual: dict[str, tuple[float, float]] = field(default_factory=dict)
    spoken: set[str] = field(default_factory=set)

    def __post_init__(self):
        self.spec = instruments.parse_recipe(recipe.find(self.procedure, self.overrides))
        for name, log in self.logs.items():
            (self.folder / name).write_text(log.format(), encoding="utf-8")
        self.usual, self.spoken = self.fit()

    def fit(self):
        """Coefficient → value and expanded uncertainty, and the flags, failed limits and guesses
        without their digits.
        """
        instrument = instruments.find(self.spec.procedure)
        files = log_files.find_logs(self.spec, self.folder)
        fitted = instrument.fit(self.spec, self.folder, files, instruments.silent)
        found = {
            f"{result.stage}.{model.name}.{one.name}": (
                one.value,
                _expand(one.standard_uncertainty, one.effective_dof or model.dof),
            )
            for result in fitted.results
            for model in result.models
            for one in model.coefficients
        }
        found |= {
            f"{result.stage}.{one.name}": (
                one.value,
                _expand(one.standard_uncertainty, one.effective_dof),
            )
            for result in fitted.results
            for one in result.figures
            if one.standard_uncertainty > 0.0
        }
        said = [
            *fitted.summary.flags,
            *(text for log in fitted.inputs for text in log.reading if isinstance(text, Guess)),
        ]
        said += [f"failed: {one.name}" for one in fitted.summary.criteria if not one.passed]
        # which model was chosen, and how far it is from the next, is no finding
        told = (text for text in said if not text.startswith("exported:"))
        return found, {re.sub(r"\d", "", text) for text in told}

    def outcome(self, name, damaged):
        """Return how a fit with one damaged log ends: refused, found, harmless or silent; and the
        largest change of a coefficient in its expanded uncertainties.
        """
        path = self.folder / name
        path.write_bytes(damaged)
        try:
            found, said = self.fit()
        except CalibkitError as error:
            return "refused", 0.0, str(error)
        finally:
            path.write_text(self.logs[name].format(), encoding="utf-8")
        worst, where = 0.0, ""
        for key in self.usual.keys() | found.keys():
            value, u = found.get(key, (0.0, 0.0))
            before, other = self.usual.get(key, (0.0, u))
            change = abs(value - before)
            if change:
                expanded = u if key in found else other
                ratio = change / expanded if expanded else np.inf
                worst, where = max((worst, where), (ratio, key))
        if said - self.spoken:
            return "found", worst, "; ".join(said - self.spoken)
        return ("silent" if worst > 1.0 else "harmless"), worst, where


def _expand(u, dof):
    """Expanded uncertainty of a standard uncertainty with its degrees of freedom."""
    return u * float(stats.t.ppf((1.0 + PROBABILITY) / 2.0, dof or np.inf))


def _stretch(generator, count, shortest=1):
    """First and last row behind a stretch of a log, from a few rows to half of it."""
    length = int(np.clip(np.exp(generator.uniform(np.log(shortest), np.log(count / 2))), 1, count))
    start = int(generator.integers(0, count - length + 1))
    return start, start + length


def shift_values(log, columns, generator):
    """Values of one column against the rest by some rows, in a stretch or to the end."""
    name, count = generator.choice(columns), len(log.rows)
    start, stop = _stretch(generator, count, 4)
    stop = count if generator.random() < 0.5 else stop
    by = int(generator.integers(1, max(2, (stop - start) // 4))) * generator.choice([-1, 1])
    values = log.column(name)
    values[start:stop] = np.roll(values[start:stop], by)
    return log.put(name, values)


def repeat_values(log, columns, generator):
    """A stretch repeated over the rows behind it, a value that stays, or rows written twice."""
    kind, count = generator.integers(3), len(log.rows)
    start, stop = _stretch(generator, count, 2)
    length = min(stop - start, count - stop)
    if kind == 0 and length:
        for name in columns:
            values = log.column(name)
            values[stop : stop + length] = values[start : start + length]
            log = log.put(name, values)
        return log
    if kind == 1:
        name = generator.choice(columns)
        values = log.column(name)
        values[start:stop] = values[start]
        return log.put(name, values)
    order = [*range(stop), *range(start, count)]
    return log.take(order)


def swap_values(log, columns, generator):
    """Rows exchanged but for their stamps, digits of a number, or two columns in a stretch."""
    kind, count = generator.integers(3), len(log.rows)
    a, b = sorted(generator.choice(count, 2, replace=False))
    if kind == 0:
        order = np.arange(count)
        order[[a, b]] = order[[b, a]]
        for name in columns:
            log = log.put(name, log.column(name)[order])
        return log
    if kind == 1 or len(columns) < 2:
        name = generator.choice(columns)
        at = log.names.index(name)
        token = log.rows[a][at]
        places = [k for k, c in enumerate(token) if c.isdigit()]
        if len(places) > 1:
            i, j = sorted(generator.choice(places, 2, replace=False))
            token = token[:i] + token[j] + token[i + 1 : j] + token[i] + token[j + 1 :]
        row = (*log.rows[a][:at], token, *log.rows[a][at + 1 :])
        return Text(log.names, (*log.rows[:a], row, *log.rows[a + 1 :]))
    one, other = generator.choice(columns, 2, replace=False)
    first, second = log.column(one), log.column(other)
    start, stop = _stretch(generator, count)
    first[start:stop], second[start:stop] = second[start:stop].copy(), first[start:stop].copy()
    return log.put(one, first).put(other, second)


def cut_values(log, columns, generator):
    """Rows out of the middle, the end, digits of a number."""
    kind, count = generator.integers(3), len(log.rows)
    start, stop = _stretch(generator, count)
    if kind == 0:
        return log.take([*range(start), *range(stop, count)])
    if kind == 1:
        return log.take(range(count - (stop - start)))
    at = log.names.index(generator.choice(columns))
    token = log.rows[start][at]
    token = token[: generator.integers(1, len(token))] if generator.random() < 0.5 else token[1:]
    row = (*log.rows[start][:at], token, *log.rows[start][at + 1 :])
    return Text(log.names, (*log.rows[:start], row, *log.rows[start + 1 :]))


def flip_bits(log, columns, generator):
    """One to twenty bits, each of which makes a digit of the rows another digit."""
    del columns
    content = bytearray(log.format().encode())
    first = content.index(b"\n") + 1
    left = generator.integers(1, 21)
    while left:
        at, bit = generator.integers(first, len(content)), 1 << int(generator.integers(4))
        if chr(content[at]).isdigit() and chr(content[at] ^ bit).isdigit():
            content[at] ^= bit
            left -= 1
    return bytes(content)


ALIKE = (
    (r"dph$", ("deg/s", "rad/s", "deg/min", "mdeg/s", "urad/s", "deg/d")),
    (r"degc$", ("K", "degF")),
    (r"_g$", ("m/s2", "mg", "ug", "Gal")),
    (r"_dps$", ("rad/s", "deg/h", "rpm", "deg/min")),
    (r"_deg$", ("rad", "arcmin", "arcsec", "mrad")),
    (r"^time_s$", ("ms", "min", "h", "us")),
)
"""Column → units that its log may wrongly state."""
FACTORS = (3600.0, 60.0, 1000.0, 9.80665, 57.29578, 1.8)
"""Factors between units that are mistaken for each other."""


def mistake_units(log, columns, generator):
    """The header states another unit, or values are in another from a row on or for a stretch."""
    name = generator.choice([*columns, *({"time_s"} & set(log.names))])
    stated = next((units for pattern, units in ALIKE if re.search(pattern, name)), ())
    if stated and generator.random() < 0.5:
        names = [f"{n} ({generator.choice(stated)})" if n == name else n for n in log.names]
        return Text(tuple(names), log.rows)
    factor = float(generator.choice(FACTORS)) ** generator.choice([-1, 1])
    count = len(log.rows)
    start, stop = _stretch(generator, count, 4)
    stop = count if generator.random() < 0.5 else stop
    start = max(start, count // 20) if stop == count else start  # throughout: see APART
    values = log.column(name)
    if name.endswith("degc"):
        values[start:stop] = values[start:stop] * 1.8 + 32.0
    else:
        values[start:stop] *= factor
    return log.put(name, values)


def mistake_stamps(log, columns, generator):
    """Stamps that jump, stand still, run at another rate for a stretch, backwards, or are those of
    other rows.
    """
    if "time_s" not in log.names:
        return shift_values(log, columns, generator)
    time, count = log.column("time_s"), len(log.rows)
    start, stop = _stretch(generator, count, 3)
    kind = generator.integers(6)
    if kind == 0:
        time[start:] += generator.choice([-1, 1]) * 10.0 ** generator.uniform(-1, 4)
    elif kind == 1:
        time[start:stop] = time[start]
    elif kind == 2:
        time[start:stop] = time[start] + (time[start:stop] - time[start]) * generator.uniform(
            0.1, 4
        )
    elif kind == 3:
        time[start:stop] = time[start:stop][::-1].copy()
    elif kind == 4:
        time = time * float(generator.choice([1e-3, 1e3, 60.0, 1 / 60.0, 3600.0]))
    else:
        time[start:stop] = np.sort(generator.choice(time, stop - start))
    return log.put("time_s", time)


KINDS = {
    "shifted values": shift_values,
    "repeated values": repeat_values,
    "swapped values": swap_values,
    "cut values": cut_values,
    "flipped bits": flip_bits,
    "wrong units": mistake_units,
    "wrong stamps": mistake_stamps,
}


def scale_column(log, columns, generator):
    """A column times a plausible factor."""
    name = generator.choice(columns)
    return log.put(name, log.column(name) * generator.uniform(0.98, 1.02))


def offset_column(log, columns, generator):
    """A constant added to a column."""
    name = generator.choice(columns)
    values = log.column(name)
    return log.put(name, values + generator.uniform(-0.05, 0.05) * (np.ptp(values) or 1.0))


def swap_columns(log, columns, generator):
    """Two columns of one kind under each other's names."""
    kinds = {}
    for name in columns:
        kinds.setdefault(name.rpartition("_")[2], []).append(name)
    pairs = [names for names in kinds.values() if len(names) > 1]
    if not pairs:
        return scale_column(log, columns, generator)
    one, other = generator.choice(pairs[generator.integers(len(pairs))], 2, replace=False)
    return log.put(one, log.column(other)).put(other, log.column(one))


def state_fahrenheit(log, columns, generator):
    """A temperature in °F throughout."""
    name = generator.choice([name for name in columns if name.endswith("degc")])
    return log.put(name, 1.8 * log.column(name) + 32.0)


APART = {
    "a column times 0.98 to 1.02": scale_column,
    "a constant added to a column": offset_column,
    "two columns of one kind swapped": swap_columns,
    "a temperature in °F throughout": state_fahrenheit,
}
"""Damages after which a log is as plausible as before."""


def attack(campaign, kind, seed):
    """Return the outcome of one damage of a kind to a campaign."""
    generator = np.random.default_rng(seed)
    name = generator.choice(sorted(campaign.logs))
    damage = (KINDS | APART)[kind]
    damaged = damage(campaign.logs[name], campaign.columns, generator)
    content = damaged if isinstance(damaged, bytes) else damaged.format().encode()
    if content == campaign.logs[name].format().encode():
        return "harmless", 0.0, "nothing was changed"
    return campaign.outcome(name, content)
