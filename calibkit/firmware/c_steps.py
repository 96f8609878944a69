"""Steps of a chain → C statements; @p and @P stand for the prefix in lower and upper case."""

from collections.abc import Iterator
from dataclasses import dataclass

from calibkit.firmware.chain import (
    ChainInput,
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

ONE_LINE = 70
"""Characters of a sum that stands on one line."""


@dataclass(frozen=True, slots=True)
class Home:
    """Where the functions of a chain find its tables: what stands before the name of one, and how
    they are declared and passed.
    """

    tables: str = "@p_"
    declared: str = ""
    passed: str = ""


@dataclass(frozen=True, slots=True)
class Body:
    """C statements of a program."""

    program: Program
    home: Home

    @property
    def type(self) -> str:
        """Type of a value."""
        return self.program.format.c_type

    def input(self, entry: ChainInput) -> str:
        """Input brought into its range; an indication as it is."""
        flag, helper = entry.flag, "limited"
        if entry.beyond:
            flag, helper = entry.beyond, "indicated"
        table = f"{self.home.tables}{entry.table}"
        call = f"@p_{helper}(in->{entry.name}, {table}, {self._flag(flag)}, &status)"
        return f"const {self.type} {entry.name} = {call};"

    def statements(self, step: Step) -> Iterator[str]:
        """Statements of one step."""
        if isinstance(step, Select):
            yield from self._select(step)
        else:
            yield f"const {self.type} {step.name} = {self._value(step)};"

    def _value(self, step: Map | Sum | Limit | Quotient | Memory | Play | Slope) -> str:  # noqa: PLR0911 (one return per kind of step)
        """Expression of a step."""
        match step:
            case Map():
                status = f"status_{step.group}" if step.group else "status"
                return f"@p_mapped({step.source}, &{self.home.tables}{step.table}, {self._flag(step.flag)}, &{status})"
            case Limit():
                flag = self._flag(step.flag)
                return f"@p_limited({step.source}, {self.home.tables}{step.table}, {flag}, &status)"
            case Sum():
                return self._sum(step)
            case Quotient():
                return f"{step.numerator} / {step.denominator}"
            case Memory():
                remembered = f"state->{step.source}"
                first = f"(state->updates == 0U) ? {step.source} : {remembered}"
                return first if step.start == "same" else remembered
            case Play():
                return f"@p_played({step.kept}, {step.source}, {self.home.tables}{step.table})"
            case Slope():
                return (
                    f"@p_slope(state->{step.name}_history, {step.source}, state->updates,"
                    f" {self.home.tables}{step.table},\n"
                    f"    {self._flag(step.flag)}, &status)"
                )

    def _flag(self, name: str) -> str:
        """Status bit of that name."""
        return f"@P_{name}" if name else "0U"

    def _sum(self, step: Sum) -> str:
        """Terms from left to right."""
        values = [self._term(entry) for entry in step.terms]
        if len(values) == 1 and values[0].startswith("(") and step.terms[0].sign > 0:
            return values[0][1:-1]
        signs = ["- " if entry.sign < 0 else "+ " for entry in step.terms]
        first = f"-{values[0]}" if step.terms[0].sign < 0 else values[0]
        parts = [first, *(sign + value for sign, value in zip(signs[1:], values[1:], strict=True))]
        return " ".join(parts) if sum(map(len, parts)) < ONE_LINE else "\n    ".join(parts)

    def _term(self, entry: ChainTerm) -> str:
        """One term, in parentheses where it is a product."""
        factors = list(entry.factors)
        value = self._polynomial(entry) if entry.table else factors.pop(0)
        for name in factors:
            value = f"({value} * {name})"
        return value

    def _polynomial(self, entry: ChainTerm) -> str:
        """Polynomial, or the plain number."""
        count = len(self.program.tables[entry.table])
        if not entry.over:
            return f"{self.home.tables}{entry.table}"
        return f"@p_polynomial({self.home.tables}{entry.table}, {count}U, {entry.over})"

    def _select(self, step: Select) -> Iterator[str]:
        """The first side that holds, with its status."""
        yield f"{self.type} {step.name} = {self.program.format.text(0.0)};"
        word = "if"
        for case in step.cases:
            up, down = (
                f"({step.source} >= {self.home.tables}{case.table})",
                f"({step.source} <= -{self.home.tables}{case.table})",
            )
            holds = {1: up, -1: down, 0: f"({up} || {down})"}[case.side]
            yield f"{word} {holds} {{"
            yield f"    {step.name} = {case.value};"
            yield f"    status |= status_{case.group};"
            word = "} else if"
        yield f"}} else {{\n    status |= {self._flag(step.flag)};\n}}"
