"""A correction chain while it is built: inputs, steps and outputs are added one by one."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from fractions import Fraction
from typing import Any

from calibkit.firmware import exact
from calibkit.firmware.chain import Chain, ChainCorrection, ChainInput, Output, Structure
from calibkit.firmware.steps import ChainStep, ChainTerm, Limit, Map, Sum
from calibkit.records.coefficients import Model

BEYOND = Fraction(5, 4)
"""How far [u] the word of an input reaches beyond the fitted range."""


@dataclass(slots=True)
class Draft:
    """Inputs, steps, outputs and tables so far."""

    padded: bool = False
    """Whether tables have the same lengths for all devices: no power and no term is left out that
    happens to be 0, or that a fit left out.
    """
    inputs: list[ChainInput] = field(default_factory=list)
    steps: list[ChainStep] = field(default_factory=list)
    outputs: list[Output] = field(default_factory=list)
    tables: dict[str, exact.Poly] = field(default_factory=dict)
    limits: dict[str, Fraction] = field(default_factory=dict)
    usual: dict[str, Fraction] = field(default_factory=dict)
    gains: dict[str, Fraction] = field(default_factory=dict)
    ramped: dict[str, Fraction] = field(default_factory=dict)
    ranges: list[str] = field(default_factory=list)
    derived: dict[str, str] = field(default_factory=dict)
    corrections: list[ChainCorrection] = field(default_factory=list)

    def table(self, name: str, numbers: Iterable[Fraction]) -> str:
        """Store a table and return its name."""
        self.tables[name] = tuple(numbers)
        return name

    def input(
        self,
        name: str,
        unit: str,
        meaning: str,
        span: tuple[Fraction, Fraction],
        flag: str = "",
        derived: str = "",
    ) -> str:
        """Add an input once; without a flag its range only says how large it can be. `derived` says
        how one is made that is no column of the logs.
        """
        if name not in [entry.name for entry in self.inputs]:
            self.derived |= {name: derived} if derived else {}
            self.inputs.append(
                ChainInput(name, unit, meaning, self.table(f"{name}_range", span), flag)
            )
        return name

    def indication(
        self, name: str, unit: str, meaning: str, fitted: Fraction, full: Fraction, beyond_flag: str
    ) -> str:
        """Add an indication, which is handed on as it is: its largest fitted magnitude and its full
        scale.
        """
        full = max(fitted, full)
        table = self.table(f"{name}_range", (-fitted, fitted, -full, full))
        self.inputs.append(ChainInput(name, unit, meaning, table, "FULL_SCALE", beyond_flag))
        return name

    def map(
        self,
        name: str,
        source: str,
        valid: tuple[float, float],
        *,
        flag: str,
        group: str = "",
        followed: tuple[float, float] | None = None,
    ) -> tuple[Fraction, Fraction]:
        """Map a value to u over its fitted range, clamped to it, or to the range in which it is
        followed; returns middle and half.
        """
        middle, half = exact.span(*valid)
        low, high = ((Fraction(limit) - middle) / half for limit in followed or valid)
        table = self.table(f"{name}_map", (middle, 1 / half, low, high))
        self.steps.append(Map(name, source, table, flag, group))
        return middle, half

    def temperature(
        self, valid: tuple[float, float], name: str = "u", column: str = "temp_case_degc"
    ) -> exact.Poly:
        """Case temperature as u, clamped to its fitted range; returns middle and half [°C]."""
        middle, half = exact.span(*valid)
        self.input(
            column,
            "degC",
            "temperature of the sensor case",
            # an input is limited to this: the error bound holds for any number that is handed over
            (middle - BEYOND * half, middle + BEYOND * half),
        )
        self.ranges.append(f"{column} {exact.limits_text(*valid)} degC")
        return self.map(name, column, valid, flag="TEMP_CLAMPED")

    def limit(self, name: str, source: str, low: Fraction, high: Fraction, flag: str) -> str:
        """Add a limited value."""
        self.steps.append(Limit(name, source, self.table(f"{name}_limits", (low, high)), flag))
        return name

    def polynomial(
        self,
        table: str,
        numbers: Sequence[Fraction],
        variable: str,
        *factors: str,
        sign: int = 1,
        order: int = 0,
    ) -> list[ChainTerm]:
        """Term sign · polynomial(variable) · factors: none where it vanishes, a plain number where
        it does not vary; of a padded chain always the term, at least to the order.
        """
        coefficients = exact.trimmed(numbers)
        if self.padded:
            varies = any(step.name == variable for step in self.steps)
            # a layout is that of all devices of a type, whatever this one's fit left out
            self.table(table, exact.padded(numbers, order) if varies else numbers[:1])
            return [ChainTerm(table, variable if varies else "", factors, sign)]
        if not coefficients:
            return []
        # a multiplication by 1 is a rounding and a number for nothing
        if coefficients == (Fraction(1),) and factors:
            return [ChainTerm("", "", factors, sign)]
        self.table(table, coefficients)
        return [ChainTerm(table, variable if len(coefficients) > 1 else "", factors, sign)]

    def output(
        self,
        name: str,
        unit: str,
        source: str,
        meaning: str,
        *,
        corrects: str = "",
        product: bool = False,
    ) -> None:
        """Add a result, and the indication that the application subtracts it from or, for a
        product, multiplies by it.
        """
        self.outputs.append(Output(name, unit, source, meaning))
        if corrects:
            self.corrections.append(ChainCorrection(name, corrects, product))

    def sum(self, name: str, *terms: Sequence[ChainTerm]) -> str:
        """Add a sum of terms."""
        self.steps.append(Sum(name, tuple(term for part in terms for term in part)))
        return name

    def include(self, part: "Draft", suffix: str) -> None:
        """Add the steps of another draft, whose values and tables get a suffix; inputs are
        shared.
        """
        step_names = {step.name for step in part.steps}

        def named(name: str) -> str:
            return f"{name}{suffix}" if name in step_names or name in part.tables else name

        self.steps += [_renamed(step, named) for step in part.steps]
        self.tables |= {named(name): table for name, table in part.tables.items()}
        for mine, added in (
            (self.limits, part.limits),
            (self.usual, part.usual),
            (self.gains, part.gains),
            (self.ramped, part.ramped),
        ):
            for key, value in added.items():
                name, dot, quantity = key.partition(".")
                mine[f"{named(name)}{dot}{quantity}"] = value

    def chain(
        self,
        forms: Iterable[str],
        formula: str,
        *,
        interval_s: float | None = None,
        condition: str = "",
    ) -> Chain:
        """The finished chain."""
        used = _used(self.steps, [output.source for output in self.outputs])
        return Chain(
            Structure(
                tuple(dict.fromkeys(forms)),
                formula,
                tuple(entry for entry in self.inputs if entry.name in used),
                tuple(step for step in self.steps if step.name in used),
                tuple(self.outputs),
                interval_s,
            ),
            self.tables,
            self.limits,
            self.usual,
            self.gains,
            self.ramped,
            condition,
            tuple(self.ranges),
            tuple(self.corrections),
            self.derived,
        )


def _renamed(part: Any, new_name: Callable[[str], str]) -> Any:  # noqa: ANN401 (a step, or what it consists of)
    """A step, a term or a case, the names in which are new; other words keep theirs."""
    if isinstance(part, str):
        return new_name(part)
    if isinstance(part, tuple):
        return tuple(_renamed(entry, new_name) for entry in part)
    if not is_dataclass(part) or isinstance(part, type):
        return part
    names = [entry.name for entry in fields(part)]
    return replace(part, **{name: _renamed(getattr(part, name), new_name) for name in names})


def _used(steps: Sequence[ChainStep], values: Sequence[str]) -> set[str]:
    """Names of inputs and steps that these values depend on, through remembered values too."""
    steps_by_name = {step.name: step for step in steps}
    remaining, used = list(values), set()
    while remaining:
        name = remaining.pop()
        if name not in used:
            used.add(name)
            # what nothing depends on is not computed, and its input not asked for
            remaining += steps_by_name[name].sources if name in steps_by_name else ()
    return used


def factor(name: str, sign: int = 1) -> list[ChainTerm]:
    """Term ± value."""
    return [ChainTerm("", "", (name,), sign)]


def numbers(model: Model, *names: str) -> exact.Poly:
    """Coefficients of a model, exactly as the file has them."""
    return tuple(Fraction(model.value(name)) for name in names)


def number_or_zero(model: Model, name: str) -> Fraction:
    """A coefficient that a model need not have, exactly; 0 where it has none."""
    return sum((Fraction(c.value) for c in model.coefficients if c.name == name), Fraction(0))


def powers(model: Model, letter: str) -> exact.Poly:
    """Coefficients letter0, letter1, … of a model, as many as there are; CoefficientError without
    the first.
    """
    present = {c.name for c in model.coefficients}
    count = next(k for k in range(len(present) + 1) if f"{letter}{k}" not in present)
    return numbers(model, *(f"{letter}{k}" for k in range(max(count, 1))))
