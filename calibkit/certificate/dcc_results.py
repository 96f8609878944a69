"""Results of a certificate as the template dcc_results.xml.j2 asks for them: values in the units of
D-SI, columns that become one list, numbers as the schema spells them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from calibkit.certificate.dcc_units import dsi
from calibkit.certificate.dcc_xml import one_line
from calibkit.certificate.results import ListTable
from calibkit.certificate.words import AS_FOUND, AS_LEFT, Words
from calibkit.errors import OutputError
from calibkit.units import unit_mark

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from calibkit.certificate.dcc_units import DccUnit
    from calibkit.certificate.results import GridTable, Result
    from calibkit.certificate.run_files import AsFoundAsLeft, BeforeAfter
    from calibkit.certificate.words import Lang
    from calibkit.records.coefficients import Coefficient, Model

LANGUAGES: dict[Lang, tuple[str, ...]] = {"en": ("en",), "zh": ("zh",), "both": ("en", "zh")}
REGION = 0.95
"""Coverage probability of the region that the covariance of parameters spans."""
PARAMETERS = Words(
    "All parameters of the model with their covariance: type A, from the fit alone. Type B"
    " contributions are in the expanded uncertainties of the other results."
)
RATIO = Words("Accelerations are ratios to the local gravity, which was not stated.")


@dataclass(frozen=True, slots=True)
class Notation:
    """How a document writes texts and values: its languages, the local gravity [m/s²] that values
    in g are converted with, where it is known, and whether results state that they are in the scope
    of an accreditation.
    """

    lang: Lang
    gravity: float | None
    accredited: bool = False

    def unit(self, unit: str) -> DccUnit:
        """D-SI unit of a unit."""
        return dsi(unit).with_gravity(self.gravity)

    def has_unit(self, unit: str) -> bool:
        """Whether D-SI can spell a unit, which a laboratory may have of its own."""
        try:
            self.unit(unit)
        except OutputError:
            return False
        return True

    def is_ratio_to_gravity(self, unit: str) -> bool:
        """Whether values in a unit are ratios to a local gravity that is not known."""
        return bool(dsi(unit).gravity) and self.unit(unit).text == r"\one"

    def contents(self, words: Words | str) -> list[tuple[str, str]]:
        """Text on one line for each language of the certificate, with its code; a user's text and
        what is the same in both have no language of their own.
        """
        if isinstance(words, str):
            return [("", one_line(words))]
        if not words.zh and self.lang != "en":
            return [("", one_line(words.en))]
        return [
            (code, one_line(words.zh if code == "zh" else words.en))
            for code in LANGUAGES[self.lang]
        ]


def stated(texts: Iterable[Words | str]) -> list[Words | str]:
    """Texts that are not empty."""
    return [words for words in texts if (words if isinstance(words, str) else words.en).strip()]


@dataclass(frozen=True, slots=True)
class ResultColumn:
    """Results of a table below one head: those that stand alone, and those that are one list."""

    head: Words
    single: tuple[Result, ...]
    series: tuple[Result, ...]


def split_columns(table: ListTable | GridTable) -> list[ResultColumn]:
    """Columns of a table; none for an empty one. A reference by definition stands alone."""
    if isinstance(table, ListTable):
        heads, columns = [table.title], [table.results]
    else:
        heads = list(table.heads)
        columns = [tuple(filter(None, column)) for column in zip(*table.cells, strict=True)]
    if not any(columns):
        return []
    split = []
    for head, column in zip(heads, columns, strict=True):
        certain = tuple(r for r in column if not r.by_definition)
        series = certain if len(certain) > 1 and _uniform(certain) else ()
        single = tuple(r for r in column if r.by_definition or not series)
        split.append(ResultColumn(head, single, series))
    return split


def _uniform(column: Sequence[Result]) -> bool:
    """Whether results have one unit, an expanded uncertainty each, and are values of one quantity
    at conditions.
    """
    return (
        len({(r.quantity, r.unit, tuple(name for name, _, _ in r.at)) for r in column}) == 1
        and bool(column[0].at)
        and all(r.uncertainty is not None and r.interval is None for r in column)
    )


def table_notes(
    table: ListTable | GridTable, columns: Sequence[ResultColumn], notation: Notation
) -> list[Words]:
    """Note of a table, and whether its accelerations are ratios to an unknown gravity."""
    results = [r for column in columns for r in (*column.single, *column.series)]
    ratio = notation.gravity is None and any(dsi(r.unit).gravity for r in results)
    return [*([table.note] if table.note else []), *([RATIO] if ratio else [])]


def name_result(result: Result) -> Words:
    """Name of a result, with the standard whose definition is meant."""
    name = result.name if result.name.en else Words.literal(result.symbol or result.key)
    return name + Words.literal(f" ({result.standard})") if result.standard else name


def name_model(model: Model) -> Words:
    """Title of the parameters of a model."""
    return Words("{name}: parameters ({form})", name=model.name, form=model.form)


def model_notes(model: Model) -> list[Words]:
    """What the covariance of a model holds, how it fits, and its ranges."""
    rms = f"{model.residual_rms:.6g} {unit_mark(model.residual_unit)}"
    spread = Words(
        "Residual rms of the fit {rms}, {dof} degrees of freedom: a descriptor, not an"
        " uncertainty.",
        rms=rms,
        dof=model.dof,
    )
    ranges = [f"{column}: {low!r} … {high!r}" for column, (low, high) in model.valid.items()]
    return [PARAMETERS, spread, Words.literal("; ".join(ranges))]


def parameter_key(coefficient: Coefficient, stage: str, model: Model) -> str:
    """Key of a parameter of a coefficient file."""
    return f"{stage}.{model.name}.{coefficient.name}"


def covariance_columns(model: Model, units: Sequence[DccUnit]) -> list[list[tuple[float, str]]]:
    """Covariance of all parameters of a model, column by column, each with its unit.

    One triangle is written twice: in raw units the other differs by rounding, up to 2e-9 of the
    standard uncertainties.
    """
    columns = []
    for j, second in enumerate(units):
        column = []
        for i, first in enumerate(units):
            covariance = model.covariance[max(i, j)][min(i, j)] * first.factor * second.factor
            column.append((covariance, (first * second).text))
        columns.append(column)
    return columns


def region_factor(model: Model) -> float:
    """Factor of the ellipsoid that holds all parameters of a model at once with 95 %: √(n·F) (JCGM
    102, 6.5).
    """
    from scipy.special import fdtri

    count, dof = len(model.coefficients), min(map(model.dof_of, model.coefficients))
    return math.sqrt(count * float(fdtri(count, max(dof, 1.0), REGION)))


_Validated = list[tuple["BeforeAfter", float, float, float]]


def split_states(validation: AsFoundAsLeft | None) -> list[tuple[Words, str, _Validated]]:
    """Rows of a validation as found and as left: the value, and its U and k, 0 where it has
    none.
    """
    rows = () if validation is None else (*validation.rows, *validation.check_points)
    before = [(row, row.as_found, 0.0, 0.0) for row in rows if row.as_found is not None]
    after = [
        (row, row.as_left, row.left_u or 0.0, row.left_k or 0.0)
        for row in rows
        if row.as_left is not None
    ]
    return [(AS_FOUND, "calibkit_asFound", before), (AS_LEFT, "calibkit_asLeft", after)]


def name_row(row: BeforeAfter) -> Words:
    """Name of a value of a validation, behind its log."""
    return (Words.literal(f"{row.log}: ") if row.log else Words("")) + row.quantity


def spell_number(value: float) -> str:
    """A decimal number with all its digits and a decimal point."""
    if not math.isfinite(value):
        raise OutputError(
            f"{value} is no number that a certificate can state", hint="this is a bug"
        )
    mantissa, e, exponent = repr(float(value)).partition("e")
    return f"{mantissa if '.' in mantissa else mantissa + '.0'}{e}{exponent}"


def spell_share(value: float, least: float = 0.0) -> str:
    """A coverage probability, or a coverage factor of at least 1, without an exponent."""
    return f"{max(value, least):.12f}".rstrip("0").ljust(3, "0")


def spell_label(key: str) -> str:
    """A key as an item of an XML list, which blanks would split."""
    return one_line(key).replace(" ", "_")
