"""Bias results: each channel's bias as a polynomial of its abscissa."""

from calibkit import units
from calibkit.certificate.names import name_condition, name_model
from calibkit.certificate.quantities import state
from calibkit.certificate.results import (
    Block,
    Equation,
    Figure,
    GridTable,
    ListTable,
    Result,
    Series,
)
from calibkit.certificate.stated import TEMPERATURE, Stated, range_words, residual_words
from calibkit.certificate.words import Words, unit_mark
from calibkit.coefficients import Model, Record
from calibkit.forms import POLYNOMIAL
from calibkit.instruments.bias_temperature import quantities

CURVE = Equation(
    POLYNOMIAL.name,
    r"p(T) = \sum_k p_k T^k",
    Words("T the abscissa named in the tables.", "T 为表中所示自变量。"),
)


def blocks(stated: Stated) -> tuple[Block, ...]:
    """Block of bias.json."""
    record = stated.records.get("bias.json")
    if record is None:
        return ()
    tables: list[ListTable | GridTable] = []
    figures: list[Figure] = []
    notes: list[Words] = []
    for model in record.models:
        tables.append(
            stated.coefficients(
                record,
                model,
                name_model(model.name) + Words(": coefficients", "：系数"),
                also={"p0": ("bias",)},
            )
        )
        abscissa = next(iter(model.valid))
        table = _values(stated, record, model, abscissa)
        if table is not None:
            tables.append(table)
            figures.append(_plot(model, table, abscissa))
        notes += [residual_words(model), range_words(model), *stated.left_out(model)]
    return (
        Block(
            record.stage,
            "bias.json",
            Words("Bias over temperature", "零偏随温度"),
            (CURVE,),
            tuple(tables),
            tuple(figures),
            tuple(notes),
        ),
    )


def _values(stated: Stated, record: Record, model: Model, abscissa: str) -> GridTable | None:
    """Bias of one channel over its abscissa."""
    points = stated.grid(model, abscissa)
    if not points:
        return None
    quantity = quantities.bias(record.stage, model)
    # an abscissa that is no temperature has no reference: the middle stands for it
    chosen = stated.reference_degc if abscissa == TEMPERATURE else points[len(points) // 2]

    def at(x: float) -> Result:
        principal = x == chosen
        return state(stated, quantity, {abscissa: x}, principal=principal)

    return stated.over(
        name_model(model.name) + Words(": bias", "：零偏"),
        points,
        [(quantity.words, quantity.unit, at)],
        row_head=_head(abscissa),
    )


def _head(abscissa: str) -> Words:
    """Name and unit of the abscissa."""
    unit = unit_mark(units.column_unit(abscissa)) or "1"
    return name_condition(abscissa) + Words(f" [{unit}]")


def _plot(model: Model, table: GridTable, abscissa: str) -> Figure:
    """Bias over the abscissa with its expanded uncertainty."""
    points = [
        (r, r.uncertainty.expanded_uncertainty)
        for (r,) in table.cells
        if r is not None and r.uncertainty is not None
    ]
    series = Series(
        Words("bias ± U", "零偏 ± U"),
        tuple(r.at[0][1] for r, _ in points),
        tuple(r.value for r, _ in points),
        tuple(U for _, U in points),
    )
    unit = unit_mark(units.column_unit(model.name)) or "1"
    return Figure(
        table.title, _head(abscissa), Words(f"bias [{unit}]", f"零偏 [{unit}]"), (series,)
    )
