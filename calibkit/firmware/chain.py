"""The correction chain of a run as a short list of steps on normalised variables, with exact
coefficients; and the same with the numbers that a firmware holds.

Temperatures and other drivers enter as u = (x − middle)/half, within [−1, 1] over the fitted range.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction

from calibkit.firmware.exact import Poly
from calibkit.firmware.formats import Format
from calibkit.firmware.lanes import Call, Words
from calibkit.firmware.ranges import Ranges
from calibkit.firmware.steps import ChainStep, Code, Limit, Map, Memory, NumberTable, Slope, c_flag
from calibkit.numeric.arrays import Array


@dataclass(frozen=True, slots=True)
class ChainInput:
    """A quantity that the application hands over, in the unit that its name ends in; table: least
    and greatest value, and of an indication least and greatest value of its full scale too.
    """

    name: str
    unit: str
    meaning: str
    table: str
    flag: str = ""
    """Status that is returned when the value had to be brought into its range."""
    beyond: str = ""
    """Status of an indication outside its fitted range, which is used as it is."""

    def value(self, call: Call, x: Words) -> Words:
        """A value brought into its range; an indication as it is."""
        low, high = call.numbers(self.table)
        limited = call.limited(x, low, high, self.beyond or self.flag)
        return x if self.beyond else limited

    def c(self, code: Code) -> str:
        """Statement in C."""
        helper, flag = ("indicated", self.beyond) if self.beyond else ("limited", self.flag)
        arguments = f"in->{self.name}, {code.tables}{self.table}, {c_flag(flag)}, &status"
        return f"const @real {self.name} = @p_{helper}({arguments});"


@dataclass(frozen=True, slots=True)
class Output:
    """A result, in the unit that its name ends in."""

    name: str
    unit: str
    source: str
    meaning: str


@dataclass(frozen=True, slots=True)
class ChainCorrection:
    """An output that the application itself applies to an indication."""

    output: str
    column: str
    """Canonical column of the indication."""
    product: bool = False
    """Whether the output multiplies the indication; otherwise it is subtracted from it."""


@dataclass(frozen=True, slots=True)
class Pace:
    """How a chain with memory keeps time; table: updates until its lags have settled, and how far
    the input `followed` may move from one interval to the next.
    """

    followed: str
    longest: int
    """Most intervals that are bridged in a straight line."""
    table: str
    lags: tuple[str, ...]
    """Remembered values that a longer gap takes for 0."""
    flags: tuple[str, ...] = ("STARTING", "INTERVAL", "JUMPED")
    """Statuses of a start, of a call that is not one interval after the last, of a jump."""


@dataclass(frozen=True, slots=True)
class Structure:
    """What a chain does, without its numbers."""

    forms: tuple[str, ...]
    """Forms of the models, as they stand in the coefficient files."""
    formula: str
    """Direction of the correction, in words: corrected = …."""
    inputs: tuple[ChainInput, ...]
    steps: tuple[ChainStep, ...]
    outputs: tuple[Output, ...]
    interval_s: float | None
    """Interval [s] at which the chain has to be updated; none of a chain without memory."""
    pace: Pace | None = None
    """None of a chain without memory, and of one that was exported before 0.2."""

    @property
    def interval_ms(self) -> int:
        """Interval in whole milliseconds."""
        return round(1000.0 * (self.interval_s or 0.0))

    @property
    def flags(self) -> tuple[str, ...]:
        """Statuses in the order of their bits."""
        names = [entry.beyond or entry.flag for entry in self.inputs]
        names += [getattr(step, "flag", "") for step in self.steps]
        names += [entry.flag for entry in self.inputs]
        names += self.pace.flags if self.pace else ()
        return tuple(dict.fromkeys(flag for flag in names if flag))

    @property
    def has_memory(self) -> bool:
        """Whether the chain is updated at an interval and keeps values from update to update."""
        return self.interval_s is not None

    @property
    def summing(self) -> bool:
        """Whether the result is a sum of increments, whose error grows with every update: a limited
        value that is remembered.
        """
        remembered = {memory.source for memory in self.memories}
        # a sum is limited lest it grows without end
        return any(isinstance(step, Limit) and step.name in remembered for step in self.steps)

    @property
    def tables(self) -> dict[str, NumberTable]:
        """Tables by name, in the order in which a program meets them."""
        tables = [
            NumberTable(entry.table, "list", f"least and greatest {entry.name} [{entry.unit}]")
            for entry in self.inputs
        ]
        if self.pace:
            followed = f"farthest move of {self.pace.followed} an interval"
            remark = f"updates until the lags have settled; {followed}"
            tables.append(NumberTable(self.pace.table, "list", remark))
        for step in self.steps:
            tables += step.tables
        return {table.name: table for table in tables}

    @property
    def maps(self) -> tuple[Map, ...]:
        """Maps, whose tables are structs."""
        return tuple(step for step in self.steps if isinstance(step, Map))

    @property
    def memories(self) -> tuple[Memory, ...]:
        """Values kept from update to update, except those that slopes keep."""
        return tuple(step for step in self.steps if isinstance(step, Memory))

    @property
    def slopes(self) -> tuple[Slope, ...]:
        """Slopes, each with its own history."""
        return tuple(step for step in self.steps if isinstance(step, Slope))


@dataclass(frozen=True, slots=True)
class Trials:
    """Inputs of the self-test of a chain with memory, in turn from a reset: one row per call, how
    many updates each row lasts, and the milliseconds from call to call, 0 where the steps are taken
    without the clock.
    """

    inputs: Mapping[str, Array]
    updates: tuple[int, ...]
    elapsed_ms: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Chain:
    """A structure with its exact numbers: table → numbers.

    `limits` bounds values that depend on their own past, whatever the inputs do; `usual` bounds
    them, tighter, where the inputs keep to `condition`, under which alone the printed error bound
    holds. `gains` is the greatest error [u] of a remembered value for each unit of error of the
    mapped input that drives it.
    """

    structure: Structure
    tables: Mapping[str, Poly]
    limits: Mapping[str, Fraction] = field(default_factory=dict)
    usual: Mapping[str, Fraction] = field(default_factory=dict)
    gains: Mapping[str, Fraction] = field(default_factory=dict)
    ramped: Mapping[str, Fraction] = field(default_factory=dict)
    """Remembered values on the fastest fitted ramp, which a reset takes for 0."""
    condition: str = ""
    ranges: tuple[str, ...] = ()
    """Ranges in which the models were fitted, in words."""
    corrections: tuple[ChainCorrection, ...] = ()
    derived: Mapping[str, str] = field(default_factory=dict)
    """How inputs are made that are no columns of the logs, in words."""
    trials: Trials | None = None
    """None of a chain without memory, which is tested at any inputs within their ranges."""
    timing: tuple[str, ...] = ()
    """What start, gaps and jumps do to a chain with memory, in words."""

    def find_ranges(self, *, usual: bool, full: bool = False) -> Ranges:
        """Range of every input and step, of indications the fitted one or the full scale;
        remembered values have the chain's limits, or the tighter ones of usual use.
        """
        intervals = Ranges(self.tables, {**self.limits, **(self.usual if usual else {})})
        for entry in self.structure.inputs:
            low, high = self.tables[entry.table][-2:] if full else self.tables[entry.table][:2]
            intervals.values[entry.name] = (low, high)
        for step in self.structure.steps:
            bound = intervals.bounds.get(step.name)
            intervals.values[step.name] = (
                step.range(intervals) if bound is None else (-bound, bound)
            )
        return intervals

    def quantise(self, number: Format) -> "Program":
        """The same in a number format."""
        tables = {name: tuple(map(number.nearest, exact)) for name, exact in self.tables.items()}
        for entry in self.structure.inputs:  # the full scale is a fact of the header alone
            tables[entry.table] = tables[entry.table][:2]
        return Program(self.structure, number, tables)


@dataclass(frozen=True, slots=True)
class Program:
    """Steps and numbers of a firmware; everything that decides a result bit for bit."""

    structure: Structure
    format: Format
    tables: Mapping[str, tuple[float, ...]]
