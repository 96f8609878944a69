"""The correction chain of a run as a short list of steps on normalised variables, with exact
coefficients.

A step names the values that it takes and the table with its numbers; the same steps are evaluated
by the numpy twin, bounded by the error analysis and printed as C. Temperatures and other drivers
enter as u = (x − middle)/half, within [−1, 1] over the fitted range.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal

from calibkit.arrays import Array
from calibkit.firmware.exact import Poly


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


@dataclass(frozen=True, slots=True)
class Map:
    """u = (x − middle)/half, brought into its range; table: middle, 1/half, least and greatest
    u.
    """

    name: str
    source: str
    table: str
    flag: str = ""
    group: str = ""
    """Side whose status the flag belongs to, where a later step selects one side of several."""


@dataclass(frozen=True, slots=True)
class ChainTerm:
    """± polynomial(over) · factors; without a table the polynomial is 1, without `over` the table
    holds one number.
    """

    table: str = ""
    over: str = ""
    factors: tuple[str, ...] = ()
    sign: int = 1


@dataclass(frozen=True, slots=True)
class Sum:
    """Sum of terms, added from left to right."""

    name: str
    terms: tuple[ChainTerm, ...]


@dataclass(frozen=True, slots=True)
class Limit:
    """A value brought into a range; table: least and greatest value."""

    name: str
    source: str
    table: str
    flag: str


@dataclass(frozen=True, slots=True)
class Quotient:
    """numerator / denominator; the denominator cannot vanish within the chain's ranges."""

    name: str
    numerator: str
    denominator: str


@dataclass(frozen=True, slots=True)
class Memory:
    """Value that `source` had at the update before; at the first update its present value ("same")
    or 0 ("zero").
    """

    name: str
    source: str
    start: Literal["same", "zero"]


@dataclass(frozen=True, slots=True)
class Play:
    """Play operator: the remembered value `kept` brought within the table's two distances of
    `source`; what is not pushed stays bit for bit.
    """

    name: str
    source: str
    kept: str
    table: str


@dataclass(frozen=True, slots=True)
class Slope:
    """Rate of `source` from its last values: Σ_i w_i (v_i − v_0), v_0 the newest.

    The table holds a row of `length` − 1 weights w_1 … for each number of values from `least` to
    `length`; with fewer values the rate is 0 and the flag is returned.
    """

    name: str
    source: str
    table: str
    length: int
    least: int
    flag: str


@dataclass(frozen=True, slots=True)
class Case:
    """A value that a Select takes on one side: where source ≥ threshold (side 1), ≤ −threshold
    (−1), either (0).
    """

    value: str
    side: int
    table: str
    group: str


@dataclass(frozen=True, slots=True)
class Select:
    """The first case that holds, else 0 and the flag."""

    name: str
    source: str
    cases: tuple[Case, ...]
    flag: str


Step = Map | Sum | Limit | Quotient | Memory | Play | Slope | Select


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
    steps: tuple[Step, ...]
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
        silent = Sum | Quotient | Memory | Play
        names += [step.flag for step in self.steps if not isinstance(step, silent)]
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
        return any(isinstance(step, Limit) and step.name in remembered for step in self.steps)

    @property
    def tables(self) -> tuple[str, ...]:
        """Tables in the order in which a program meets them, each once."""
        names = [entry.table for entry in self.inputs]
        names += [self.pace.table] if self.pace else []
        for step in self.steps:
            match step:
                case Map() | Limit() | Play() | Slope():
                    names.append(step.table)
                case Select():
                    names += [case.table for case in step.cases]
                case Sum():
                    names += [term.table for term in step.terms if term.table]
                case _:
                    pass
        return tuple(dict.fromkeys(names))

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
