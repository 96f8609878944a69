"""Inclinometer results: the in-situ scale factor s of each gyro over temperature."""

from collections.abc import Callable

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
from calibkit.certificate.stated import Stated, range_words, residual_words
from calibkit.certificate.words import Words
from calibkit.coefficients import Model, Record
from calibkit.instruments.inclinometer import quantities
from calibkit.instruments.inclinometer.forms import FILE, SCALE as SCALE_FORM, TEMPERATURE

SCALE = Equation(
    SCALE_FORM.name,
    r"\omega' = s(T)\,\omega, \quad s(T) = \sum_k s_k T^k",
    Words(
        "ω indicated rate, ω' corrected rate, T case temperature [°C].",
        "ω 为示值角速率，ω' 为修正值，T 为壳温 [°C]。",
    ),
)
FIGURES = {
    "stations_used": Words("stations used", "采用测站数"),
    "stations_refused": Words("stations refused", "拒用测站数"),
}


def blocks(stated: Stated) -> tuple[Block, ...]:
    """Block of inclinometer_scale.json."""
    record = stated.records.get(FILE)
    if record is None:
        return ()
    tables: list[ListTable | GridTable] = [
        stated.coefficients(
            record,
            model,
            Words(f"Coefficients of gyro {model.name}", f"{model.name} 陀螺系数"),
            more={"s0": quantities.choice_of_order(model)},
            also={"s0": ("s",)},
        )
        for model in record.models
    ]
    figures: list[Figure] = []
    temperatures = stated.grid(record.models[0]) if record.models else ()
    if temperatures:
        table = stated.over(
            Words("In-situ scale factor s over temperature", "原位标度因数 s 随温度"),
            temperatures,
            [_column(stated, record, model) for model in record.models],
        )
        tables.append(table)
        figures.append(_plot_scale(table))
    tables.append(_stations(stated, record))
    notes = [*(residual_words(m) for m in record.models), *map(range_words, record.models[:1])]
    notes += [note for m in record.models[:1] for note in stated.left_out(m)]
    title = Words("In-situ scale factor of the north-seeking gyros", "寻北陀螺原位标度因数")
    return (
        Block(
            record.stage,
            f"{record.stage}.json",
            title,
            (SCALE,),
            tuple(tables),
            tuple(figures),
            tuple(notes),
        ),
    )


def _stations(stated: Stated, record: Record) -> ListTable:
    """List of s at the reference temperature and the numbers of stations."""
    results = tuple(
        stated.figure(
            record,
            figure,
            FIGURES.get(figure.name, Words(figure.name)),
            record.models[0].dof,
        )
        for figure in record.figures
        if figure.name in FIGURES
    )
    return ListTable(Words("Stations", "测站"), results)


def _column(
    stated: Stated, record: Record, model: Model
) -> tuple[Words, str, Callable[[float], Result | None]]:
    """s(T) of one gyro."""
    quantity = quantities.scale(record, model)

    def at(t: float) -> Result | None:
        at = {TEMPERATURE: t}
        if quantity.outside(at):
            return None
        return state(stated, quantity, at, principal=t == stated.reference_degc)

    return Words(f"s, gyro {model.name}", f"s，{model.name} 陀螺"), "1", at


def _plot_scale(table: GridTable) -> Figure:
    """Scale factor s over temperature with its expanded uncertainty, as ppm from 1."""
    series = []
    for k, head in enumerate(table.heads):
        column = [row[k] for row in table.cells]
        points = [r for r in column if r is not None and r.uncertainty is not None]
        U = tuple(
            1e6 * r.uncertainty.expanded_uncertainty for r in points if r.uncertainty is not None
        )
        series.append(
            Series(
                head,
                tuple(r.at[0][1] for r in points),
                tuple(1e6 * (r.value - 1.0) for r in points),
                U,
            )
        )
    return Figure(
        table.title,
        Words("case temperature [°C]", "壳温 [°C]"),
        Words("s − 1 [ppm]"),
        tuple(series),
    )
