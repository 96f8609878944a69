"""Tables of a fit from the blocks of its certificate: value ± U of every result."""

from collections.abc import Callable, Iterator, Sequence

from calibkit.certificate.names import show_symbol
from calibkit.certificate.results import Block, GridTable, ListTable, Result
from calibkit.certificate.stated import Stated
from calibkit.certificate.tables import format_result
from calibkit.certificate.uncertainty import TypeBTerms
from calibkit.recipe import Recipe
from calibkit.records.coefficients import Identity, StageResult
from calibkit.records.sensitivities import Sensitivity
from calibkit.report.table import Table
from calibkit.units import unit_mark

COLUMNS = 3
"""Results side by side."""
UNNAMED = Identity("", 0, "", "", "", ())
"""Whose results are tabulated before they have a serial and a revision."""


def tabulate_fit(
    results: Sequence[StageResult],
    spec: Recipe,
    sensitivities: Sequence[Sensitivity],
    lay_out: Callable[[Stated], tuple[Block, ...]],
) -> list[Table]:
    """Every table of the certificate that `lay_out` makes of a fit, with the type B terms of the
    recipe.
    """
    records = {result.file: result.as_record(UNNAMED, "") for result in results}
    source = TypeBTerms(tuple(spec.type_b))
    basis = Stated(records, source, (), spec.reference_temp_degc, tuple(sensitivities))
    tables: list[Table] = []
    for block in lay_out(basis):
        for table in block.tables:
            if isinstance(table, ListTable):
                tables.append(_tabulate_list(table))
            else:
                tables += _tabulate_grid(table)
    return tables


def _tabulate_list(table: ListTable) -> Table:
    """A row for each result: symbol, name, value ± U, unit."""
    rows = []
    for result in table.results:
        name = result.name.en + (f" ({result.standard})" if result.standard else "")
        rows.append((show_symbol(result.symbol), name, _state(result), unit_mark(result.unit)))
    return Table(table.title.en, ("", "", "value ± U", "unit"), tuple(rows))


def _tabulate_grid(table: GridTable) -> Iterator[Table]:
    """Rows and columns as on the certificate, value ± U in each cell, three columns a table."""
    units = [unit_mark(unit) or "1" for unit in table.units]
    heads = [head.en for head in table.heads]
    if not table.by_row:
        heads = [f"{head} [{unit}]" for head, unit in zip(heads, units, strict=True)]
    labels = [show_symbol(x) if isinstance(x, str) else x.en for x in table.labels]
    for start in range(0, len(heads), COLUMNS):
        part = slice(start, start + COLUMNS)
        rows = [
            (label, *map(_state, row[part])) for label, row in zip(labels, table.cells, strict=True)
        ]
        last: tuple[str, ...] = ()
        if table.by_row:
            last = ("unit",)
            rows = [(*row, unit) for row, unit in zip(rows, units, strict=True)]
        yield Table(table.title.en, (table.row_head.en, *heads[part], *last), tuple(rows))


def _state(result: Result | None) -> str:
    """Value ± U, or with its interval; the value alone where no uncertainty is known."""
    value, U = format_result(result)
    if not U:
        return value
    return f"{value} {U}" if U.startswith(("[", "ref")) else f"{value} ± {U}"
