"""Blocks of a certificate from quantities: lists of coefficients and figures, tables over an input,
plots of value ± U, notes. What an instrument does not lay out itself is laid out from its
quantities alone.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from types import MappingProxyType

from calibkit.certificate.names import name_condition, name_model
from calibkit.certificate.quantities import At, Point, Quantity, coefficient, state
from calibkit.certificate.results import (
    Block,
    CertificateFigure,
    Equation,
    GridTable,
    ListTable,
    Result,
    Series,
    list_results,
)
from calibkit.certificate.stated import TEMPERATURE, Stated, range_words, residual_words
from calibkit.certificate.words import Words
from calibkit.records.coefficients import Model, Record
from calibkit.units import unit_mark

COEFFICIENTS = Words("Coefficients")
COEFFICIENT_NOTE = Words(
    "Rounded values cannot be recombined: their uncertainties are correlated. Compute with the"
    " attached file."
)
TEMPERATURE_HEAD = Words.literal("T [°C]")
Table = ListTable | GridTable


def list_coefficients(
    basis: Stated,
    record: Record,
    model: Model,
    title: Words = COEFFICIENTS,
    values: Sequence[Quantity] = (),
    origin: At = MappingProxyType({}),
) -> ListTable:
    """Every fitted coefficient of a model; one that is the value of a quantity at the origin (0 of
    inputs that are not given) is stated as that.
    """
    results = tuple(
        state(basis, quantity, {})
        for quantity in fitted_coefficients(record, model, values, origin)
    )
    return ListTable(title, results, COEFFICIENT_NOTE)


def fitted_coefficients(
    record: Record,
    model: Model,
    values: Sequence[Quantity] = (),
    origin: At = MappingProxyType({}),
) -> list[Quantity]:
    """The coefficients of a model that were fitted, as quantities, by those of the values that are
    coefficients; type B terms on a value, and its further uncertainties, are those of the
    coefficient that it is at the origin.
    """
    constants = {value.key: value for value in values if not value.inputs}
    quantities = {}
    for c in model.coefficients:
        if c.value or c.standard_uncertainty:
            fitted = coefficient(record, model, c.name)
            quantities[c.name] = constants.get(fitted.key, fitted)
    for value in values:
        point = value.point({entry.column: origin.get(entry.column, 0.0) for entry in value.inputs})
        if len(point.parts) != 1:
            continue
        weights = point.parts[0][1]
        (places,) = weights.nonzero()
        if places.size == 1 and weights[places[0]] == 1.0:
            name = model.coefficients[int(places[0])].name
            if name in quantities.keys() - {value.name}:
                quantities[name] = _stated_as(quantities[name], value, point)
    return [*quantities.values()]


def _stated_as(fitted: Quantity, value: Quantity, point: Point) -> Quantity:
    """A coefficient that is the value of a quantity at the origin, which has this point."""
    constant = replace(fitted.point({}), more=point.more)
    aliases = value.key, f"{value.model}.{value.name}", value.name
    return replace(fitted, called=aliases, point=lambda _: constant)


def tabulate(
    basis: Stated,
    title: Words,
    columns: Sequence[tuple[Words, Quantity]],
    points: Sequence[float] | None = None,
    *,
    row_head: Words = TEMPERATURE_HEAD,
    note: Words | None = None,
    principal_at: float | None = None,
) -> GridTable | None:
    """Quantities, each under its head, over their first input: at the points of its range that a
    certificate states, further inputs at rest; None where there is no such point. A principal
    quantity is so at `principal_at`, else at the reference temperature, else in the middle.
    """
    abscissa = columns[0][1].inputs[0]
    column = abscissa.column
    if points is None:
        points = basis.grid(column, abscissa.low, abscissa.high)
    if not points:
        return None
    if principal_at is None:
        principal_at = basis.reference_degc if column == TEMPERATURE else points[len(points) // 2]

    def cell(quantity: Quantity, x: float) -> Result | None:
        input_values = quantity.complete({column: x})
        if quantity.outside(input_values):
            return None
        principal = quantity.principal and x == principal_at
        return state(basis, quantity, input_values, principal=principal)

    return GridTable(
        title,
        row_head,
        tuple(head for head, _ in columns),
        tuple(quantity.unit for _, quantity in columns),
        tuple(f"{x:g}" for x in points),
        tuple(tuple(cell(quantity, x) for _, quantity in columns) for x in points),
        note,
        points=tuple(points),
    )


def column_results(table: GridTable, k: int) -> list[tuple[float, Result]]:
    """Abscissae and results of a column that have an uncertainty, or need none."""
    points = []
    for x, row in zip(table.points, table.cells, strict=True):
        result = row[k]
        if result is not None and (result.uncertainty or result.by_definition):
            points.append((x, result))
    return points


def plot(
    table: GridTable,
    y_label: Words,
    *,
    x_label: Words | None = None,
    title: Words | None = None,
    labels: Sequence[Words] = (),
    origins: Sequence[float] = (),
    scale: float = 1.0,
    log: bool = False,
) -> CertificateFigure:
    """Values ± U of a table over its input, or scale (value − origin) of each column; of as many
    columns as `labels` has, all without them. Results with intervals are drawn with these.
    """
    series = []
    for k, label in enumerate(labels or table.heads):
        origin = origins[k] if origins else 0.0
        points = []
        for x, result in column_results(table, k):
            ends = result.interval or (result.value - result.U, result.value + result.U)
            points.append((x, *(scale * (y - origin) for y in (result.value, *ends))))
        if points:
            series.append(Series(label, *zip(*points, strict=True)))
    x_label = x_label or name_input(TEMPERATURE, "degC")
    return CertificateFigure(title or table.title, x_label, y_label, tuple(series), log)


def name_input(column: str, unit: str) -> Words:
    """Name and unit of an input, as the head of a table or the label of an axis."""
    return name_condition(column) + Words.literal(f" [{unit_mark(unit) or 1}]")


def note_models(basis: Stated, models: Iterable[Model]) -> list[Words]:
    """Notes of models: what their fits left, in which ranges they hold, and what is not stated."""
    return [
        note
        for model in models
        for note in (residual_words(model), range_words(model), *basis.left_out(model))
    ]


def lay_out_models(
    basis: Stated,
    record: Record,
    title: Words,
    equations: Sequence[Equation],
    values: Sequence[Quantity],
) -> Block:
    """Block of a coefficient file whose models stand one below the other: of each its coefficients,
    and its values over their first input as a table and a plot; then the values that depend on
    nothing.
    """
    tables: list[Table] = []
    figures = []
    for model in record.models:
        name = name_model(model.name)
        of_model = [value for value in values if value.model == model.name]
        coefficients = Words("{model}: coefficients", model=name)
        tables.append(list_coefficients(basis, record, model, coefficients, of_model))
        for value in of_model:
            if not value.inputs or any(entry.rest is None for entry in value.inputs[1:]):
                continue
            head = name_input(value.inputs[0].column, value.inputs[0].unit)
            table_title = name + Words(": ") + value.words
            table = tabulate(basis, table_title, [(value.words, value)], row_head=head)
            if table is not None:
                unit = Words.literal(f" [{unit_mark(value.unit) or 1}]")
                labels = [value.words + Words.literal(" ± U")]
                tables.append(table)
                figures.append(plot(table, value.words + unit, x_label=head, labels=labels))
    tabulated_keys = {result.quantity for table in tables for result in list_results(table)}
    constants = tuple(
        state(basis, value, {})
        for value in values
        if not value.inputs and value.key not in tabulated_keys
    )
    if constants:
        tables.append(ListTable(Words("Results"), constants))
    return make_block(record, title, equations, tables, figures, note_models(basis, record.models))


def lay_out_records(basis: Stated, quantities: Iterable[Quantity]) -> tuple[Block, ...]:
    """Blocks of a procedure that lays out none itself: each of its coefficient files with the
    quantities that are of it.
    """
    all_quantities = [*quantities]
    blocks = []
    for record in basis.records.values():
        title = Words.literal(record.stage.replace("_", " "))
        stage_quantities = [q for q in all_quantities if q.stage == record.stage]
        blocks.append(lay_out_models(basis, record, title, (), stage_quantities))
    return tuple(blocks)


def make_block(
    record: Record,
    title: Words,
    equations: Sequence[Equation],
    tables: Iterable[Table | None],
    figures: Iterable[CertificateFigure] = (),
    notes: Iterable[Words] = (),
) -> Block:
    """Block of a coefficient file; tables that are None and figures without a curve are left
    out.
    """
    return Block(
        record.stage,
        f"{record.stage}.json",
        title,
        tuple(equations),
        tuple(table for table in tables if table is not None),
        tuple(figure for figure in figures if figure.series),
        tuple(notes),
    )
