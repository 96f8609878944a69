"""Steps of a chain → C statements; @p and @P stand for the prefix in lower and upper case."""

from collections.abc import Iterator
from dataclasses import dataclass

from calibkit.firmware.chain import (
    Input,
    Limit,
    Map,
    Memory,
    Play,
    Quotient,
    Select,
    Slope,
    Step,
    Sum,
    Term,
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
        return "int32_t" if self.program.format.fixed else self.program.format.c_type

    def input(self, entry: Input) -> str:
        """Input brought into its range; an indication as it is."""
        flags, helper = [self._flag(entry.flag)], "limited"
        if entry.beyond:
            full = flags if self.program.format.fixed else []
            flags, helper = [self._flag(entry.beyond), *full], "indicated"
        call = f"@p_{helper}(in->{entry.name}, {self.home.tables}{entry.table}, {', '.join(flags)}, &status)"
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
                return self._quotient(step)
            case Memory():
                kept = f"state->{step.source}"
                first = f"(state->updates == 0U) ? {step.source} : {kept}"
                return first if step.start == "same" else kept
            case Play():
                scales, source = self.program.scales, step.source
                if self.program.format.fixed:
                    source = self._shifted(source, scales[source] - scales[step.name])
                return f"@p_played({step.kept}, {source}, {self.home.tables}{step.table})"
            case Slope():
                fixed = self.program.format.fixed
                return (
                    f"@p_slope(state->{step.name}_history, {step.source}, state->updates,"
                    f" {self.home.tables}{step.table},{f' {self.program.slope_places(step)}U,' if fixed else ''}\n"
                    f"    {self._flag(step.flag)}, &status)"
                )

    def _flag(self, name: str) -> str:
        """Status bit of that name."""
        return f"@P_{name}" if name else "0U"

    def _sum(self, step: Sum) -> str:
        """Terms from left to right."""
        values = [self._term(step, number, entry) for number, entry in enumerate(step.terms)]
        product = values[0].startswith("(") and not values[0].startswith("(int32_t)")
        if len(values) == 1 and product and step.terms[0].sign > 0:
            return values[0][1:-1]
        signs = ["- " if entry.sign < 0 else "+ " for entry in step.terms]
        first = f"-{values[0]}" if step.terms[0].sign < 0 else values[0]
        parts = [first, *(sign + value for sign, value in zip(signs[1:], values[1:], strict=True))]
        return " ".join(parts) if sum(map(len, parts)) < ONE_LINE else "\n    ".join(parts)

    def _term(self, step: Sum, number: int, entry: Term) -> str:
        """One term, in parentheses where it is a product."""
        scales, factors = self.program.scales, list(enumerate(entry.factors, start=1))
        if entry.table:
            value, scale = self._polynomial(entry), scales.get(entry.table, 0)
        else:
            (_, value), *factors = factors
            scale = scales.get(value, 0)
        for k, name in factors:
            if self.program.format.fixed:
                target = scales[f"{step.name}.{number}.{k}"]
                value, scale = (
                    f"@p_scaled({value}, {name}, {scale + scales[name] - target}U)",
                    target,
                )
            else:
                value = f"({value} * {name})"
        return (
            self._shifted(value, scale - scales[step.name]) if self.program.format.fixed else value
        )

    def _polynomial(self, entry: Term) -> str:
        """Polynomial, or the plain number."""
        count = len(self.program.tables[entry.table])
        if not entry.over:
            return f"{self.home.tables}{entry.table}"
        places = f", {self.program.scales[entry.over]}U" if self.program.format.fixed else ""
        return f"@p_polynomial({self.home.tables}{entry.table}, {count}U, {entry.over}{places})"

    def _shifted(self, value: str, places: int) -> str:
        """A fixed-point value at another scale."""
        if places == 0:
            return value
        if places < 0:
            return f"({value} * {1 << -places})"
        return f"(int32_t)@p_rounded({value}, {places}U)"

    def _quotient(self, step: Quotient) -> str:
        """Quotient of two values."""
        if not self.program.format.fixed:
            return f"{step.numerator} / {step.denominator}"
        places = self.program.quotient_places(step)
        return f"@p_quotient({step.numerator}, {step.denominator}, {places}U)"

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
            value = case.value
            if self.program.format.fixed:
                scales = self.program.scales
                value = self._shifted(value, scales[case.value] - scales[step.name])
            yield (
                f"{word} {holds} {{\n    {step.name} = {value};\n    status |= status_{case.group};"
            )
            word = "} else if"
        yield f"}} else {{\n    status |= {self._flag(step.flag)};\n}}"
