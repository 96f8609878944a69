"""What a certificate states: results with their uncertainty, in tables and blocks, whatever they
are rendered as.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Context, Decimal
from typing import Literal, Self

from calibkit.certificate.words import Words
from calibkit.numeric import gum


@dataclass(frozen=True, slots=True)
class Contribution:
    """One line of an uncertainty budget: an input in its unit, and what it contributes in the unit
    of the result.
    """

    name: Words
    kind: Literal["A", "B", "CMC"]
    quantity: str
    standard_uncertainty: float
    unit: str
    distribution: str
    dof: float
    sensitivity: float = 1.0

    @property
    def contribution(self) -> float:
        """Standard uncertainty of the result that comes from it."""
        return abs(self.sensitivity) * self.standard_uncertainty

    @property
    def component(self) -> gum.UncertaintyComponent:
        """The input as a component that can be combined with others."""
        return gum.UncertaintyComponent(
            self.name.en,
            0.0,
            self.standard_uncertainty,
            "A" if self.kind == "A" else "B",
            self.sensitivity,
            self.dof,
        )


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """A combined and expanded uncertainty, in the unit of the result, with the contributions that
    it comes from.
    """

    contributions: tuple[Contribution, ...]
    standard_uncertainty: float
    effective_dof: float
    coverage_factor: float
    expanded_uncertainty: float
    probability: float

    @classmethod
    def of(cls, contributions: Sequence[Contribution]) -> Self:
        """Combined and expanded uncertainty of contributions."""
        expanded = gum.combine_cautiously([part.component for part in contributions])
        return cls(
            tuple(contributions),
            expanded.standard_uncertainty,
            expanded.effective_dof,
            expanded.coverage_factor,
            expanded.expanded_uncertainty,
            expanded.probability,
        )


@dataclass(frozen=True, slots=True)
class Result:
    """One stated number.

    `quantity` is `<stage>.<model>.<name>`; profiles name a result by its `key`, which for a value
    at a condition has `@` and the condition behind it. A quantity that cannot be negative has a
    coverage interval instead of ± U. A result without an uncertainty is a descriptor: no statement
    of conformity can rest on it.
    """

    quantity: str
    symbol: str
    name: Words
    value: float
    unit: str
    uncertainty: Uncertainty | None = None
    interval: tuple[float, float] | None = None
    at: tuple[tuple[str, float, str], ...] = ()
    """Conditions that it holds at: name, value, unit."""
    standard: str = ""
    """Standard whose definition is meant where several define the same word."""
    principal: bool = False
    """Whether its budget is printed in full."""
    by_definition: bool = False
    """Whether it is the reference of others: it has no uncertainty, and no statement of conformity
    can rest on it.
    """
    undecided: Words | None = None
    """Why no limit on it is decided, whatever its U."""
    outside_scope: bool = False
    """Whether an accredited laboratory is not accredited for it."""
    condition: str = ""
    """What stands behind `@` in its key."""

    @property
    def contributions(self) -> tuple[Contribution, ...]:
        """Contributions to its uncertainty; none where no uncertainty is known."""
        return () if self.uncertainty is None else self.uncertainty.contributions

    @property
    def U(self) -> float:  # noqa: N802 (the symbol of GUM)
        """Expanded uncertainty; 0 where none is known."""
        return 0.0 if self.uncertainty is None else self.uncertainty.expanded_uncertainty

    @property
    def key(self) -> str:
        """Name of the result, unique on its certificate."""
        return f"{self.quantity}@{self.condition}" if self.condition else self.quantity


@dataclass(frozen=True, slots=True)
class ListTable:
    """Results one below the other: symbol, name, value, U, unit."""

    title: Words
    results: tuple[Result, ...]
    note: Words | None = None


@dataclass(frozen=True, slots=True)
class GridTable:
    """Results of several quantities (columns) at several conditions (rows); an absent one is
    outside its range.

    Units are those of the columns, or where by_row of the rows.
    """

    title: Words
    row_head: Words
    heads: tuple[Words, ...]
    units: tuple[str, ...]
    labels: tuple[str | Words, ...]
    cells: tuple[tuple[Result | None, ...], ...]
    note: Words | None = None
    by_row: bool = False
    points: tuple[float, ...] = ()
    """Value of the condition of each row, where it is a number: the abscissa of a plot."""


@dataclass(frozen=True, slots=True)
class Series:
    """One curve of a figure, with the ends of y ± U, or of its coverage interval."""

    label: Words
    x: tuple[float, ...]
    y: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class CertificateFigure:
    """A figure, as data."""

    title: Words
    x_label: Words
    y_label: Words
    series: tuple[Series, ...]
    log: bool = False
    """Whether both axes are logarithmic."""


@dataclass(frozen=True, slots=True)
class Equation:
    """A model's equation by the name of its form (the PDF's template knows it), in LaTeX, and what
    its letters mean.
    """

    form: str
    latex: str
    where: Words


@dataclass(frozen=True, slots=True)
class Block:
    """All results of one stage's coefficient file."""

    stage: str
    file: str
    title: Words
    equations: tuple[Equation, ...]
    tables: tuple[ListTable | GridTable, ...]
    figures: tuple[CertificateFigure, ...] = ()
    notes: tuple[Words, ...] = ()

    @property
    def results(self) -> tuple[Result, ...]:
        """Every result in the order of printing."""
        return tuple(result for table in self.tables for result in list_results(table))


def list_results(table: ListTable | GridTable) -> list[Result]:
    """Every result of a table in the order of printing."""
    if isinstance(table, ListTable):
        return [*table.results]
    return [cell for row in table.cells for cell in row if cell is not None]


@dataclass(frozen=True, slots=True)
class _Printed:
    """A value and its uncertainty as they are printed: mantissas and a power of ten common to both
    (0: none).
    """

    value: str
    uncertainty: str
    exponent: int = 0


PLAIN = range(-5, 7)
"""Decimal exponents of the larger of value and uncertainty for which no power of ten is printed."""


DIGITS = Context(prec=700)
"""Enough digits for any float64 beside any other."""
COUNTS = 100_000
"""Whole numbers below this are printed as they are."""


def round_result(value: float, uncertainty: float, *, digits: int = 2) -> _Printed:
    """Value and uncertainty with two significant digits of the uncertainty, the value to the same
    place (JCGM 100 7.2.6).
    """
    value_text, u = gum.rounded(value, uncertainty, digits=digits)
    exponent = max(
        Decimal(value_text).adjusted() if Decimal(value_text) else -999, Decimal(u).adjusted()
    )
    if exponent in PLAIN:
        return _Printed(value_text, u)
    place = Decimal(1).scaleb(
        Decimal(u).adjusted() - digits + 1 - exponent
    )  # zeros before the point are no digits behind it
    scaled = [
        Decimal(text).scaleb(-exponent).quantize(place, context=DIGITS) for text in (value_text, u)
    ]
    return _Printed(f"{scaled[0]:f}", f"{scaled[1]:f}", exponent)


def print_expanded(value: float, U: float) -> tuple[str, str]:
    """Value and U as they are printed on one line, with powers of ten in letters."""
    printed = round_result(value, U)
    power = f"e{printed.exponent:+d}" if printed.exponent else ""
    return printed.value + power, printed.uncertainty + power


def round_descriptor(value: float) -> _Printed:
    """A number without an uncertainty: a count as it is, anything else to three significant
    digits.
    """
    if value == int(value) and abs(value) < COUNTS:
        return _Printed(f"{int(value)}", "")
    exact = Decimal(f"{value:.2e}")
    if not exact or exact.adjusted() in PLAIN:
        return _Printed(f"{exact:f}", "")
    return _Printed(f"{exact.scaleb(-exact.adjusted()):f}", "", exact.adjusted())
