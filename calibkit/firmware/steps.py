"""Steps of a correction chain, each with what the firmware computes, the range of that, its error
and its C.

A step names the values that it takes and the tables with its numbers. In C, @p and @P stand for the
prefix in lower and upper case, @real for the type of a number and @zero for 0.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np

from calibkit.firmware import ranges
from calibkit.firmware.lanes import Call, Words
from calibkit.firmware.ranges import Range, Ranges
from calibkit.firmware.rounding import Rounding

ONE_LINE = 70
"""Characters of a sum that stands on one line in C."""
Errors = Mapping[str, float]
"""Largest error of each value."""


@dataclass(frozen=True, slots=True)
class NumberTable:
    """A table of numbers: in C a map, a list, or a single number."""

    name: str
    kind: Literal["map", "list", "number"]
    remark: str = ""


@dataclass(frozen=True, slots=True)
class Code:
    """Where C finds the tables: what stands before the name of one, and how long each is."""

    tables: str
    lengths: Mapping[str, int]


@dataclass(frozen=True, slots=True)
class ChainStep(ABC):
    """A value of a chain, by its name."""

    name: str

    @property
    @abstractmethod
    def sources(self) -> tuple[str, ...]:
        """Values that it takes."""

    @property
    def tables(self) -> tuple[NumberTable, ...]:
        """Tables that hold its numbers."""
        return ()

    @abstractmethod
    def value(self, call: Call) -> Words:
        """What the firmware computes, bit for bit."""

    @abstractmethod
    def range(self, intervals: Ranges) -> Range:
        """Range of the exact value."""

    @abstractmethod
    def error(self, errors: Errors, rounding: Rounding) -> float:
        """Largest difference from the exact value, by the errors of what it takes."""

    @abstractmethod
    def expression(self, code: Code) -> str:
        """Value in C."""

    def c(self, code: Code) -> str:
        """Statement in C."""
        return f"const @real {self.name} = {self.expression(code)};"


def c_flag(name: str) -> str:
    """Bit of a status in C."""
    return f"@P_{name}" if name else "0U"


@dataclass(frozen=True, slots=True)
class _OfOne(ChainStep):
    """A step that takes one value."""

    source: str

    @property
    def sources(self) -> tuple[str, ...]:
        """Values that it takes."""
        return (self.source,)


@dataclass(frozen=True, slots=True)
class Map(_OfOne):
    """u = (x − middle)/half, brought into its range; table: middle, 1/half, least and greatest
    u.
    """

    table: str
    flag: str = ""
    group: str = ""
    """Side whose status the flag belongs to, where a later step selects one side of several."""

    @property
    def tables(self) -> tuple[NumberTable, ...]:
        """The numbers of the map."""
        return (NumberTable(self.table, "map"),)

    def value(self, call: Call) -> Words:
        """(x − middle) · reciprocal, brought into its range."""
        middle, reciprocal, low, high = call.numbers(self.table)
        u = (call.values[self.source] - middle) * reciprocal
        return call.limited(u, low, high, self.flag, self.group)

    def range(self, intervals: Ranges) -> Range:
        """The limits."""
        return intervals.tables[self.table][2], intervals.tables[self.table][3]

    def error(self, errors: Errors, rounding: Rounding) -> float:
        """Errors of the difference, the reciprocal, the product and the limits."""
        middle, inverse, *limits = rounding.stored[self.table]
        reciprocal = float(rounding.ranges.tables[self.table][1])
        reach = rounding.reaches[self.name]
        distance = reach / reciprocal
        difference = errors[self.source] + rounding.of(distance) + middle
        product = difference * reciprocal + distance * inverse + rounding.of(reach)
        return product + max(limits)

    def expression(self, code: Code) -> str:
        """Call of the map."""
        status = f"status_{self.group}" if self.group else "status"
        return (
            f"@p_mapped({self.source}, &{code.tables}{self.table}, {c_flag(self.flag)}, &{status})"
        )


@dataclass(frozen=True, slots=True)
class ChainTerm:
    """± polynomial(over) · factors; without a table the polynomial is 1, without `over` the table
    holds one number.
    """

    table: str = ""
    over: str = ""
    factors: tuple[str, ...] = ()
    sign: int = 1

    def value(self, call: Call) -> Words:
        """Horner's scheme from the highest power down, then the factors from left to right."""
        factors = [call.values[name] for name in self.factors]
        if self.table:
            *lower, highest = call.numbers(self.table)
            # in the order of the C code: another order rounds otherwise
            value: Words = np.full(call.status.shape, highest)
            for c in reversed(lower if self.over else ()):
                value = value * call.values[self.over] + c
        else:
            value = factors.pop(0)
        for factor in factors:
            value = value * factor
        return -value if self.sign < 0 else value

    def ranges(self, intervals: Ranges) -> list[Range]:
        """Ranges of the polynomial, then of each product with one more factor."""
        if self not in intervals.terms:
            first = ranges.ONE
            if self.table:
                variable = intervals.values[self.over] if self.over else ranges.ONE
                first = ranges.polynomial(intervals.tables[self.table], variable)
            term_ranges = [first if self.sign > 0 else (-first[1], -first[0])]
            for name in self.factors:
                term_ranges.append(ranges.product(term_ranges[-1], intervals.values[name]))
            intervals.terms[self] = term_ranges
        return intervals.terms[self]

    def error(self, errors: Errors, rounding: Rounding) -> float:
        """Roundings of the polynomial and of the products, the factors taken as exact."""
        parts, factors, error = self.ranges(rounding.ranges), list(self.factors), 0.0
        if self.table:
            error = self._error_of_polynomial(errors, rounding)
        else:
            parts, factors = parts[1:], factors[1:]
        reach = float(ranges.magnitude(parts[0]))
        for name in factors:
            reach *= rounding.reaches[name]
            error = error * rounding.reaches[name] + rounding.of(reach)
        return error

    def _error_of_polynomial(self, errors: Errors, rounding: Rounding) -> float:
        """Errors of Horner's scheme."""
        stored, c = rounding.stored[self.table], rounding.ranges.tables[self.table]
        error, total = stored[-1], float(abs(c[-1]))
        if not self.over:
            return error
        u, error_of_u = rounding.reaches[self.over], errors[self.over]
        for k in range(len(c) - 2, -1, -1):
            # of one step of Horner's scheme: what was there grows by u, then product and sum are
            # rounded
            error = error * u + total * error_of_u + rounding.of(total * u) + stored[k]
            total = total * u + float(abs(c[k]))
            error += rounding.of(total)
        return error

    def expression(self, code: Code) -> str:
        """Term in C, in parentheses where it is a product."""
        factors = list(self.factors)
        if self.over:
            count = code.lengths[self.table]
            value = f"@p_polynomial({code.tables}{self.table}, {count}U, {self.over})"
        else:
            value = f"{code.tables}{self.table}" if self.table else factors.pop(0)
        for name in factors:
            value = f"({value} * {name})"
        return value


@dataclass(frozen=True, slots=True)
class Sum(ChainStep):
    """Sum of terms, added from left to right."""

    terms: tuple[ChainTerm, ...]

    @property
    def sources(self) -> tuple[str, ...]:
        """Variables and factors of the terms."""
        return tuple(name for term in self.terms for name in (term.over, *term.factors) if name)

    @property
    def tables(self) -> tuple[NumberTable, ...]:
        """Coefficients of the terms."""
        return tuple(
            NumberTable(term.table, "list" if term.over else "number")
            for term in self.terms
            if term.table
        )

    def value(self, call: Call) -> Words:
        """Terms from left to right."""
        total = self.terms[0].value(call)
        for term in self.terms[1:]:
            total = total + term.value(call)
        return total

    def range(self, intervals: Ranges) -> Range:
        """Sum of the ranges of the terms."""
        return ranges.total([term.ranges(intervals)[-1] for term in self.terms])

    def error(self, errors: Errors, rounding: Rounding) -> float:
        """Roundings of every term and partial sum; the errors of a value that stands in several
        terms together.
        """
        total = sum(term.error(errors, rounding) for term in self.terms)
        shared: dict[tuple[str, ...], list[Range]] = {}
        partial = Fraction(0)
        for number, term in enumerate(self.terms):
            parts = term.ranges(rounding.ranges)
            # by the factors: S V − K V has the derivative S − K by V, not S + K
            shared.setdefault(term.factors, []).append(parts[0])
            partial += ranges.magnitude(parts[-1])
            if number:
                last = number == len(self.terms) - 1  # the sum itself may have a bound of its own
                reach = min(float(partial), rounding.reaches[self.name]) if last else float(partial)
                total += rounding.of(reach)
        for factors, coefficients in shared.items():
            reaches = [rounding.reaches[name] for name in factors]
            for k, name in enumerate(factors):
                derivative = float(ranges.magnitude(ranges.total(coefficients)))
                for j, reach in enumerate(reaches):
                    derivative *= reach if j != k else 1.0
                total += derivative * errors[name]
        return total

    def expression(self, code: Code) -> str:
        """Terms from left to right."""
        values = [term.expression(code) for term in self.terms]
        if len(values) == 1 and values[0].startswith("(") and self.terms[0].sign > 0:
            return values[0][1:-1]
        signs = ["- " if term.sign < 0 else "+ " for term in self.terms]
        signs[0] = signs[0].strip("+ ")
        parts = [sign + value for sign, value in zip(signs, values, strict=True)]
        return " ".join(parts) if sum(map(len, parts)) < ONE_LINE else "\n    ".join(parts)


@dataclass(frozen=True, slots=True)
class Limit(_OfOne):
    """A value brought into a range; table: least and greatest value."""

    table: str
    flag: str

    @property
    def tables(self) -> tuple[NumberTable, ...]:
        """The limits."""
        return (NumberTable(self.table, "list", f"least and greatest {self.name}"),)

    def value(self, call: Call) -> Words:
        """The source, or the limit that it is beyond."""
        low, high = call.numbers(self.table)
        return call.limited(call.values[self.source], low, high, self.flag)

    def range(self, intervals: Ranges) -> Range:
        """Range of the source within the limits."""
        (low, high), (lower, upper) = intervals.values[self.source], intervals.tables[self.table]
        return min(max(low, lower), upper), max(min(high, upper), lower)

    def error(self, errors: Errors, rounding: Rounding) -> float:
        """Error of the source, and of the limits that it reaches."""
        ends = zip(rounding.stored[self.table], rounding.ranges.tables[self.table], strict=True)
        reached = [error for error, end in ends if abs(end) <= rounding.reaches[self.source]]
        return errors[self.source] + max(reached, default=0.0)

    def expression(self, code: Code) -> str:
        """Call of the limit."""
        return f"@p_limited({self.source}, {code.tables}{self.table}, {c_flag(self.flag)}, &status)"


@dataclass(frozen=True, slots=True)
class Quotient(ChainStep):
    """numerator / denominator; the denominator cannot vanish within the chain's ranges."""

    numerator: str
    denominator: str

    @property
    def sources(self) -> tuple[str, ...]:
        """Both."""
        return (self.numerator, self.denominator)

    def value(self, call: Call) -> Words:
        """One division."""
        return np.asarray(call.values[self.numerator] / call.values[self.denominator])

    def range(self, intervals: Ranges) -> Range:
        """Product with the reciprocal."""
        low, high = intervals.values[self.denominator]
        # the denominator has one sign
        return ranges.product(intervals.values[self.numerator], (1 / high, 1 / low))

    def error(self, errors: Errors, rounding: Rounding) -> float:
        """Errors of both over the smallest denominator."""
        low, high = rounding.ranges.values[self.denominator]
        reach, error = rounding.reaches[self.name], errors[self.denominator]
        smallest = float(min(abs(low), abs(high)))
        # d(a/b) = (da − (a/b) db)/b
        return (errors[self.numerator] + reach * error) / (smallest - error) + rounding.of(reach)

    def expression(self, code: Code) -> str:
        """One division."""
        del code
        return f"{self.numerator} / {self.denominator}"


@dataclass(frozen=True, slots=True)
class Memory(_OfOne):
    """Value that `source` had at the update before; at the first update its present value ("same")
    or 0 ("zero").
    """

    start: Literal["same", "zero"]

    def value(self, call: Call) -> Words:
        """What was kept."""
        remembered = call.before.values[self.name]
        if self.start == "zero":
            return remembered
        return np.where(call.before.updates == 0, call.values[self.source], remembered)

    def range(self, intervals: Ranges) -> Range:
        """That of the source, which is mapped or limited; others have bounds of their own."""
        return intervals.values[self.source]

    def error(self, errors: Errors, rounding: Rounding) -> float:
        """Error of the source; of one that follows later the errors are added up elsewhere."""
        del rounding
        return errors.get(self.source, 0.0) if self.start == "same" else 0.0

    def expression(self, code: Code) -> str:
        """What was kept."""
        del code
        remembered = f"state->{self.source}"
        if self.start == "zero":
            return remembered
        return f"(state->updates == 0U) ? {self.source} : {remembered}"


@dataclass(frozen=True, slots=True)
class Play(_OfOne):
    """Play operator: the remembered value `kept` brought within the table's two distances of
    `source`; what is not pushed stays bit for bit.
    """

    kept: str
    table: str

    @property
    def sources(self) -> tuple[str, ...]:
        """The value that pushes, and the one that is pushed."""
        return (self.source, self.kept)

    @property
    def tables(self) -> tuple[NumberTable, ...]:
        """The distances."""
        return (NumberTable(self.table, "list", f"reach of {self.name}"),)

    def value(self, call: Call) -> Words:
        """What is kept, brought to within the distances of the source."""
        low, high = call.numbers(self.table)
        x = call.values[self.source]
        return call.limited(call.values[self.kept], x + low, x + high)

    def range(self, intervals: Ranges) -> Range:
        """Range of the source, wider by the distances."""
        low, high = intervals.tables[self.table]
        return ranges.total([intervals.values[self.source], (low, high)])

    def error(self, errors: Errors, rounding: Rounding) -> float:
        """That of one sum: what it keeps it took from the source at some update."""
        stored = max(rounding.stored[self.table])
        return errors[self.source] + stored + rounding.of(rounding.reaches[self.name])

    def expression(self, code: Code) -> str:
        """Call of the play operator."""
        return f"@p_played({self.kept}, {self.source}, {code.tables}{self.table})"


@dataclass(frozen=True, slots=True)
class Slope(_OfOne):
    """Rate of `source` from its last values: Σ_i w_i (v_i − v_0), v_0 the newest.

    The table holds a row of `length` − 1 weights w_1 … for each number of values from `least` to
    `length`; with fewer values the rate is 0 and the flag is returned.
    """

    table: str
    length: int
    least: int
    flag: str

    @property
    def tables(self) -> tuple[NumberTable, ...]:
        """The weights."""
        return (NumberTable(self.table, "list", "a row for each number of values"),)

    def value(self, call: Call) -> Words:
        """Sum of the weighted differences, the newest first."""
        older = call.before.histories[self.name][:-1]
        # differences from the newest value: the level drops out before anything is rounded
        history = np.vstack([call.values[self.source][None, :], older])
        call.histories[self.name] = history
        count = np.minimum(call.before.updates + 1, self.length)
        call.flag(self.flag, count < self.least)
        weights = np.array(call.numbers(self.table)).reshape(-1, self.length - 1)
        row = weights[np.maximum(count - self.least, 0)]
        total = np.zeros_like(history[0])
        for i in range(1, self.length):
            product = row[:, i - 1] * (history[i] - history[0])
            total = np.where(i < count, total + product, total)
        return np.asarray(np.where(count < self.least, np.zeros_like(total), total))

    def range(self, intervals: Ranges) -> Range:
        """Heaviest row of weights times the largest difference."""
        reach = self._heaviest(intervals) * self._largest_difference(intervals)
        return -reach, reach

    def _largest_difference(self, intervals: Ranges) -> Fraction:
        """Largest difference between two values that it keeps."""
        low, high = intervals.values[self.source]
        return min(high - low, intervals.bounds.get(f"{self.name}.difference", high - low))

    def _heaviest(self, intervals: Ranges) -> Fraction:
        """Largest sum of magnitudes of the weights for one number of values."""
        weights, width = intervals.tables[self.table], self.length - 1
        rows = [weights[k : k + width] for k in range(0, len(weights), width)]
        return max(sum(map(abs, row), Fraction(0)) for row in rows)

    def error(self, errors: Errors, rounding: Rounding) -> float:
        """Errors of the values, of the weights, and of a difference, a product and a sum of each
        weight; the partial sums are no larger than all together.
        """
        difference = float(self._largest_difference(rounding.ranges))
        weights = float(self._heaviest(rounding.ranges))
        weight_error = max(rounding.stored[self.table]) * (self.length - 1)
        error = weights * 2.0 * errors[self.source] + weight_error * difference
        return error + rounding.of(weights * difference) * (self.length + 1)

    def expression(self, code: Code) -> str:
        """Call of the slope."""
        values = f"state->{self.name}_history, {self.source}, state->updates"
        return f"@p_slope({values}, {code.tables}{self.table},\n    {c_flag(self.flag)}, &status)"


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
class Select(_OfOne):
    """The first case that holds, else 0 and the flag."""

    cases: tuple[Case, ...]
    flag: str

    @property
    def sources(self) -> tuple[str, ...]:
        """What decides, and the values of the cases."""
        return (self.source, *(case.value for case in self.cases))

    @property
    def tables(self) -> tuple[NumberTable, ...]:
        """The thresholds."""
        return tuple(NumberTable(case.table, "number") for case in self.cases)

    def value(self, call: Call) -> Words:
        """Value of the first side that holds, with its status."""
        source = call.values[self.source]
        total = np.zeros_like(call.values[self.cases[0].value])
        undecided = np.ones(source.shape, dtype=bool)
        for case in self.cases:
            (threshold,) = call.numbers(case.table)
            up, down = source >= threshold, source <= -threshold
            # as else-if in C: a case is asked only where none before it held
            lanes = undecided & {1: up, -1: down, 0: up | down}[case.side]
            total = np.where(lanes, call.values[case.value], total)
            side = call.sides.get(case.group, np.zeros_like(call.status))
            call.status = call.status | np.where(lanes, side, 0)
            undecided = undecided & ~lanes
        call.flag(self.flag, undecided)
        return total

    def range(self, intervals: Ranges) -> Range:
        """Range of all cases; 0 where none holds."""
        ends = [end for case in self.cases for end in intervals.values[case.value]]
        return min(Fraction(0), *ends), max(Fraction(0), *ends)

    def error(self, errors: Errors, rounding: Rounding) -> float:
        """Largest error of a case."""
        del rounding
        return max(errors[case.value] for case in self.cases)

    def expression(self, code: Code) -> str:
        """0, until a case holds."""
        del code
        return "@zero"

    def c(self, code: Code) -> str:
        """The first side that holds, with its status."""
        lines, word = [f"@real {self.name} = @zero;"], "if"
        for case in self.cases:
            up = f"({self.source} >= {code.tables}{case.table})"
            down = f"({self.source} <= -{code.tables}{case.table})"
            holds = {1: up, -1: down, 0: f"({up} || {down})"}[case.side]
            lines += [f"{word} {holds} {{", f"    {self.name} = {case.value};"]
            # the clamps of the sides that were not taken say nothing
            lines.append(f"    status |= status_{case.group};")
            word = "} else if"
        lines += ["} else {", f"    status |= {c_flag(self.flag)};", "}"]
        return "\n".join(lines)
