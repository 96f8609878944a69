"""Results of gyros over three table axes: sensitivities, unit vectors of the input axes, angles
between them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibkit.certificate.results import Block, Equation, GridTable, Result
from calibkit.certificate.stated import COEFFICIENT_NOTE, range_words, residual_words
from calibkit.certificate.words import Words

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from calibkit.certificate.stated import Stated
    from calibkit.coefficients import Model, Record

TRIAD = Equation(
    "gyro-triad/1",
    r"\mathbf{F} = \mathbf{S}\,\boldsymbol{\Omega} + \mathbf{F}_0, \quad \mathbf{u}_g ="
    r" \mathbf{s}_g / |\mathbf{s}_g|, "
    r"\quad \cos\alpha_{gh} = \mathbf{u}_g \cdot \mathbf{u}_h",
    Words(
        "F indications [1/s], Ω rate about the axes of the base [°/s]; the rows of S are the"
        " sensitivities of the gyros.",
        "F 为示值 [1/s]，Ω 为绕基准轴的角速率 [°/s]，S 的各行为各陀螺的灵敏度。",
    ),
)
AXES = "xyz"


def block(
    stated: Stated, record: Record, rates: Callable[[float, float], dict[str, tuple[float, float]]]
) -> Block:
    """Block of a gyro_orthogonality.json that holds triads; `rates` gives what table rate and time
    base do to S.
    """
    models = [model for model in record.models if model.form == "gyro-triad/1"]
    notes = [words for model in models for words in (residual_words(model), range_words(model))]
    tables = (
        _sensitivities(stated, record, models, rates),
        _figures(
            stated,
            record,
            models,
            "misalignment",
            Words("Unit vectors of the input axes", "输入轴单位矢量"),
            "1",
        ),
        _figures(
            stated,
            record,
            models,
            "angle_deg",
            Words("Angles between the input axes", "输入轴夹角"),
            "deg",
        ),
    )
    title = Words("Sensitivities and angles of the gyros", "陀螺灵敏度与夹角")
    return Block(record.stage, f"{record.stage}.json", title, (TRIAD,), tables, (), tuple(notes))


def _sensitivities(
    stated: Stated,
    record: Record,
    models: Sequence[Model],
    rates: Callable[[float, float], dict[str, tuple[float, float]]],
) -> GridTable:
    """Rows of S, one a gyro and temperature."""
    labels, cells = [], []
    for model in models:
        full_scale = max(map(abs, model.valid.get("table_rate_dps", ())), default=0.0) or 1.0
        names = [c.name for c in model.coefficients if c.name.startswith("S_")]
        for gyro in dict.fromkeys(name[2:-1] for name in names):
            row = [f"S_{gyro}{axis}" for axis in AXES if f"S_{gyro}{axis}" in names]
            labels.append(f"{gyro} ({_where(model)})")
            cells.append(
                tuple(
                    stated.linear(
                        record,
                        model,
                        name,
                        Words("sensitivity", "灵敏度"),
                        {name: 1.0},
                        "1/deg",
                        sensitivities=rates(model.value(name), full_scale),
                        principal=model.name == "triad" and name[2:-1] == name[-1],
                    )
                    for name in row
                )
            )
    heads = tuple(Words(f"about {axis}", f"绕 {axis} 轴") for axis in AXES)
    title = Words("Sensitivities about the axes of the base", "绕基准轴的灵敏度")
    return GridTable(
        title,
        Words("gyro", "陀螺"),
        heads,
        ("1/deg",) * 3,
        tuple(labels),
        tuple(cells),
        COEFFICIENT_NOTE,
    )


def _where(model: Model) -> str:
    """Temperature that a triad was found at, where it was logged."""
    span = model.valid.get("temp_case_degc")
    return model.name if span is None else f"{sum(span) / 2.0:.1f} °C".replace("-", "−")


def _figures(
    stated: Stated, record: Record, models: Sequence[Model], what: str, title: Words, unit: str
) -> GridTable:
    """Figures named what.<pair>[.<temperature>], one row a triad and first letter."""
    found = {figure.name: figure for figure in record.figures}
    labels: list[str] = []
    cells: list[tuple[Result | None, ...]] = []
    columns: list[str] = []
    for model in models:
        suffix = model.name.removeprefix("triad")
        names = [
            n
            for n in found
            if n.startswith(f"{what}.")
            and n.removeprefix(f"{what}.").partition(".")[2] == suffix[1:]
        ]
        rows: dict[str, list[str]] = {}
        for name in names:
            key = name.removeprefix(f"{what}.").partition(".")[0]
            rows.setdefault("" if "_" in key else key[0], []).append(name)
        for row, members in rows.items():
            keys = [name.removeprefix(f"{what}.").partition(".")[0] for name in members]
            columns = [key if "_" in key else key[-1] for key in keys]
            labels.append(f"{row} ({_where(model)})".strip())
            cells.append(
                tuple(
                    stated.figure(record, found[name], Words(title.en.lower(), title.zh), model.dof)
                    for name in members
                )
            )
    heads = tuple(Words(column.replace("_", " – ")) for column in columns)
    return GridTable(
        title, Words("gyro", "陀螺"), heads, (unit,) * len(heads), tuple(labels), tuple(cells)
    )
