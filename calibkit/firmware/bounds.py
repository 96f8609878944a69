"""Worst-case difference between what a firmware computes and the exact chain, over the whole range
of its inputs.

First-order running error analysis with the program's own rounding of every number (Higham 2002,
Accuracy and Stability of Numerical Algorithms, chapter 3). A polynomial of degree n comes out
within 2⁻²⁴ (S (1 + 2n) + 3 D), S = Σ|c_k|, D = Σ k|c_k|, in single precision; here each rounding is
counted where it stands, which is tighter. Contraction to fused multiply-add only leaves roundings
out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import ROUND_CEILING, Context, Decimal
from fractions import Fraction
from typing import Self

from calibkit.firmware import exact, ranges
from calibkit.firmware.chain import (
    Chain,
    ChainTerm,
    Limit,
    Map,
    Memory,
    Play,
    Quotient,
    Select,
    Slope,
    Step,
    Sum,
)
from calibkit.firmware.program import Program
from calibkit.firmware.ranges import Range

ALLOWANCE = 1.01
"""For products of errors, which first order leaves out, and for the roundings of this analysis
itself.
"""


def find_bounds(chain: Chain, program: Program, *, full: bool = False) -> dict[str, float]:
    """Bound of each output in its unit, two digits rounded up, for indications in their fitted
    range or up to the full scale; of a chain that sums, the largest error that one update may add.
    """
    value_ranges = ranges.find_ranges(chain, usual=True, full=full)
    driven = [memory for memory in chain.structure.memories if memory.source in chain.gains]
    zero_errors = {memory.name: 0.0 for memory in driven}
    analysis = _Analysis(chain, program, value_ranges, zero_errors).run()
    start = analysis.inner
    # errors of remembered values go on linearly: an error of 1 in each gives a column of the matrix
    columns = [analysis.again(zero_errors | {m.name: 1.0}).inner for m in driven]
    growth = [[column[m.source] - start[m.source] for column in columns] for m in driven]
    settled_errors = _settled(growth, [start[m.source] for m in driven])
    states = {m.name: error for m, error in zip(driven, settled_errors, strict=True)}
    errors = analysis.again(states).errors
    return {
        output.name: _rounded_up(errors[output.source] * ALLOWANCE)
        for output in chain.structure.outputs
    }


def find_gains(chain: Chain, program: Program) -> dict[str, dict[str, float]]:
    """Output → remembered value → largest derivative of the output by it, for values that a reset
    takes for 0.
    """
    value_ranges = ranges.find_ranges(chain, usual=True)
    driven = [memory for memory in chain.structure.memories if memory.source in chain.gains]
    zero_errors = {memory.name: 0.0 for memory in driven}
    outputs = chain.structure.outputs
    analysis = _Analysis(chain, program, value_ranges, zero_errors).run()
    gains: dict[str, dict[str, float]] = {output.name: {} for output in outputs}
    for memory in driven:
        if memory.source not in chain.ramped:
            continue
        shifted_errors = analysis.again(zero_errors | {memory.name: 1.0}).errors
        for output in outputs:
            gain = shifted_errors[output.source] - analysis.errors[output.source]
            gains[output.name][memory.source] = gain
    return gains


def _settled(growth: Sequence[Sequence[float]], fed: Sequence[float]) -> list[float]:
    """Errors e = growth · e + fed of remembered values after any number of updates."""
    size = range(len(fed))
    matrix = [[Fraction(int(i == j)) - Fraction(growth[i][j]) for j in size] for i in size]
    return [float(x) for x in exact.solve(matrix, [Fraction(x) for x in fed])]


def _rounded_up(x: float) -> float:
    """Two significant digits, upwards."""
    return float(Decimal(x).normalize(Context(prec=2, rounding=ROUND_CEILING)))


@dataclass(slots=True)
class _Analysis:
    """Errors of every value, given those of remembered states."""

    chain: Chain
    program: Program
    value_ranges: Mapping[str, Range]
    states: Mapping[str, float]
    errors: dict[str, float] = field(default_factory=dict)
    inner: dict[str, float] = field(default_factory=dict)
    """Errors of filtered values by rounding alone, without the error of the map that drives them.
    """
    reaches: dict[str, float] = field(default_factory=dict)
    storage_error_cache: dict[str, list[float]] = field(default_factory=dict)
    parts: dict[ChainTerm, list[Range]] = field(default_factory=dict)
    """What `reach`, `storage_errors` and `part` found: exact arithmetic is slow."""

    def again(self, states: Mapping[str, float]) -> Self:
        """The same with other errors of remembered states."""
        return replace(self, states=states, errors={}, inner={}).run()

    def run(self) -> Self:
        """Walk the steps."""
        for entry in self.chain.structure.inputs:
            self.errors[entry.name] = 0.0
        # the mapped value that the filters follow, and what is remembered of it
        followed = next((m for m in self.chain.structure.memories if m.start == "same"), None)
        for step in self.chain.structure.steps:
            if followed is not None and step.name in self.chain.gains:
                mapped = (followed.name, followed.source)
                quiet = {**self.errors, **self.inner, **dict.fromkeys(mapped, 0.0)}
                self.inner[step.name] = self.step(step, quiet)
                driven = max(self.errors[name] for name in mapped)
                self.errors[step.name] = (
                    self.inner[step.name] + float(self.chain.gains[step.name]) * driven
                )
            else:
                self.errors[step.name] = self.step(step, self.errors)
        return self

    def reach(self, name: str) -> float:
        """Largest magnitude of a value."""
        if name not in self.reaches:
            self.reaches[name] = float(ranges.magnitude(self.value_ranges[name]))
        return self.reaches[name]

    def storage_errors(self, table: str) -> list[float]:
        """How far each number of a table is from the exact one."""
        if table not in self.storage_error_cache:
            pairs = zip(self.chain.tables[table], self.program.tables[table], strict=True)
            self.storage_error_cache[table] = [
                float(abs(exact - Fraction(stored))) for exact, stored in pairs
            ]
        return self.storage_error_cache[table]

    def part(self, entry: ChainTerm) -> list[Range]:
        """Ranges of a term: of its polynomial, then of each product with one more factor."""
        if entry not in self.parts:
            self.parts[entry] = ranges.term(self.chain, entry, self.value_ranges)
        return self.parts[entry]

    def rounding(self, reach: float) -> float:
        """Error of one rounding of a number of that magnitude."""
        return float(2.0**-self.program.format.bits) * reach

    def step(self, step: Step, errors: Mapping[str, float]) -> float:  # noqa: PLR0911 (one return per kind of step)
        """Error of one step."""
        match step:
            case Map():
                return self.map(step, errors)
            case Sum():
                return self.sum(step, errors)
            case Limit():
                return errors[step.source] + self.limit(step)
            case Memory():
                if step.name in self.states:
                    return self.states[step.name]
                return errors.get(step.source, 0.0) if step.start == "same" else 0.0
            case Play():  # what it keeps it took from the source at some update
                rounding = self.rounding(self.reach(step.name))
                return errors[step.source] + max(self.storage_errors(step.table)) + rounding
            case Quotient():
                return self.quotient(step, errors)
            case Slope():
                return self.slope(step, errors)
            case Select():
                return max(errors[case.value] for case in step.cases)

    def limit(self, step: Limit) -> float:
        """How far a limit is off, where its source reaches it."""
        ends = zip(self.storage_errors(step.table), self.chain.tables[step.table], strict=True)
        return max((x for x, end in ends if abs(end) <= self.reach(step.source)), default=0.0)

    def map(self, step: Map, errors: Mapping[str, float]) -> float:
        """u: the difference, the reciprocal, the product, the limits."""
        middle, inverse, *limits = self.storage_errors(step.table)
        reciprocal, reach = float(self.chain.tables[step.table][1]), self.reach(step.name)
        distance = reach / reciprocal
        difference = errors[step.source] + self.rounding(distance) + middle
        product = difference * reciprocal + distance * inverse + self.rounding(reach)
        return product + max(limits)

    def sum(self, step: Sum, errors: Mapping[str, float]) -> float:
        """Roundings of every term and partial sum; the errors of a value that stands in several
        terms together.
        """
        total = sum(self.term(entry, errors) for entry in step.terms)
        shared: dict[tuple[str, ...], list[Range]] = {}
        partial = Fraction(0)
        for number, entry in enumerate(step.terms):
            parts = self.part(entry)
            shared.setdefault(entry.factors, []).append(parts[0])
            partial += ranges.magnitude(parts[-1])
            if number:
                last = number == len(step.terms) - 1  # the sum itself may have a bound of its own
                reach = min(float(partial), self.reach(step.name)) if last else float(partial)
                total += self.rounding(reach)
        for factors, coefficients in shared.items():
            reaches = [self.reach(name) for name in factors]
            for k, name in enumerate(factors):
                derivative = float(ranges.magnitude(ranges.total(coefficients)))
                for j, reach in enumerate(reaches):
                    derivative *= reach if j != k else 1.0
                total += derivative * errors[name]
        return total

    def term(self, entry: ChainTerm, errors: Mapping[str, float]) -> float:
        """Rounding of a term's polynomial and products, the factors taken as exact."""
        parts = self.part(entry)
        factors, error = list(entry.factors), 0.0
        if entry.table:
            error = self.polynomial(entry, errors)
        else:
            parts, factors = parts[1:], factors[1:]
        reach = float(ranges.magnitude(parts[0]))
        for name in factors:
            reach *= self.reach(name)
            error = error * self.reach(name) + self.rounding(reach)
        return error

    def polynomial(self, entry: ChainTerm, errors: Mapping[str, float]) -> float:
        """Horner's scheme."""
        stored, c = self.storage_errors(entry.table), self.chain.tables[entry.table]
        error, total = stored[-1], float(abs(c[-1]))
        if not entry.over:
            return error
        u, e_u = self.reach(entry.over), errors[entry.over]
        for k in range(len(c) - 2, -1, -1):
            error = error * u + total * e_u + self.rounding(total * u) + stored[k]
            total = total * u + float(abs(c[k]))
            error += self.rounding(total)
        return error

    def quotient(self, step: Quotient, errors: Mapping[str, float]) -> float:
        """Quotient."""
        low, high = self.value_ranges[step.denominator]
        smallest_denominator, reach = float(min(abs(low), abs(high))), self.reach(step.name)
        error = (errors[step.numerator] + reach * errors[step.denominator]) / (
            smallest_denominator - errors[step.denominator]
        )
        return error + self.rounding(reach)

    def slope(self, step: Slope, errors: Mapping[str, float]) -> float:
        """Weighted differences."""
        bounds = {**self.chain.limits, **self.chain.usual}
        difference = float(ranges.difference(step, self.value_ranges, bounds))
        weights = float(ranges.heaviest(self.chain, step))
        weight_error = max(self.storage_errors(step.table)) * (step.length - 1)
        error = weights * 2.0 * errors[step.source] + weight_error * difference
        # a difference, a product and a sum of each weight, the partial sums no larger than all
        # together
        return error + self.rounding(weights * difference) * (step.length + 1)
