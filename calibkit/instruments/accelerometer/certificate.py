"""Accelerometer results: K-factor, Q-factor and triad, coefficients and values over temperature."""

from itertools import chain

from calibkit.certificate.blocks import (
    COEFFICIENT_NOTE,
    COEFFICIENTS,
    Table,
    column_results,
    fitted_coefficients,
    list_coefficients,
    make_block,
    note_models,
    plot,
    tabulate,
)
from calibkit.certificate.quantities import coefficient, state
from calibkit.certificate.results import Block, Equation, GridTable, ListTable
from calibkit.certificate.stated import Stated, range_words, residual_words
from calibkit.certificate.words import Words
from calibkit.instruments.accelerometer import forms
from calibkit.instruments.accelerometer.equation import AXES
from calibkit.instruments.accelerometer.quantities import over_temperature
from calibkit.records.coefficients import Record

K_EQUATION = Equation(
    forms.K.name,
    r"G_x' = G_x (K_0 + K_1 t + K_2 t^2 + K_3 t^3) - (K_4 + K_5 t + K_6 t^2 + K_7 t^3) - K_8 G_y -"
    r" K_9 G_z",
    Words(
        "G indications [g], G' corrected [g], t case temperature [°C], g local gravity; K₈ and K₉"
        " are of y and z for x, of z and x for y, of x and y for z."
    ),
)
AFFINE_EQUATION = Equation(
    forms.AFFINE.name,
    r"\mathbf{G}' = \mathbf{M}(t) (\mathbf{G} - \mathbf{b}(t)), \quad "
    r"M_{ij}(t) = \sum_k m_{ijk} t^k, \quad b_i(t) = \sum_k b_{ik} t^k",
    Words(
        "G indications [g], G' corrected [g], t case temperature [°C], g local gravity; n multiply"
        " products of indications."
    ),
)
TRIAD_EQUATION = Equation(
    forms.TRIAD.name,
    r"a_i = G_i \sum_k k_{ik} t^k - \sum_k z_{ik} t^k, \quad "
    r"G_i' = a_i - \sum_{j \neq i} (c_{ij} + d_{ij} t) a_j",
    Words(
        "G indications [g], G' corrected [g], t case temperature [°C], g local gravity; n multiply"
        " products of a."
    ),
)
Q_EQUATION = Equation(
    forms.Q.name,
    r"G_x' = G_x, \quad G_y' = Q_3 G_x + G_y, \quad G_z' = Q_2 G_x + Q_1 G_y + G_z",
    Words("G after scale factor and zero offset [g]."),
)
BLOCKS = {
    forms.K.name: (
        Words("K-factor: scale factor, zero offset and cross terms"),
        K_EQUATION,
    ),
    forms.AFFINE.name: (
        Words("Affine triad: matrix and bias"),
        AFFINE_EQUATION,
    ),
    forms.TRIAD.name: (
        Words("Triad: scale factor, zero offset and cross terms"),
        TRIAD_EQUATION,
    ),
}
"""Form → title and equation of its block."""
OVER = Words(" over temperature")
GRIDS = {
    ("m", False): Words("Diagonal of M"),
    ("m", True): Words("Cross terms of M"),
    ("k", False): Words("Scale factor"),
    ("c", True): Words("Cross terms"),
    ("z", False): Words("Zero offset"),
    ("b", False): Words("Bias"),
}
"""Kind of a quantity over temperature, and whether it is of a cross-axis term → table."""


def blocks(basis: Stated) -> tuple[Block, ...]:
    """Result blocks of the stages (K-factor, Q-factor, triad) that the run holds."""
    return tuple(
        (_q if file == "accel_q.json" else _over_temperature)(basis, basis.records[file])
        for file in ("accel_k.json", "accel_q.json", "accel_affine.json")
        if file in basis.records and basis.records[file].models
    )


def _over_temperature(basis: Stated, record: Record) -> Block:
    """Block of the K-factor or of the triad: every coefficient, and its polynomials against
    temperature.
    """
    models = record.models
    by_model = [over_temperature(record.stage, model) for model in models]
    curves = [curve for kinds in by_model for curve in chain.from_iterable(kinds.values())]
    grids, figures = [], []
    for kind, title in GRIDS.items():
        columns = [
            (Words.literal(c.symbol or ""), c) for kinds in by_model for c in kinds.get(kind, ())
        ]
        grid = tabulate(basis, title + OVER, columns) if columns else None
        if grid is None:
            continue
        grids.append(grid)
        if not kind[1]:  # the change of every column from its first row
            # 1e6 times what is shown: scale factors and cross terms are ratios, zeros are in g
            unit = "ppm" if grid.units[0] == "1" else "µg"
            low = f"{grid.points[0]:g}".replace("-", "−")
            change = Words(": change from {low} °C", low=low)
            origins = [column_results(grid, k)[0][1].value for k in range(len(grid.heads))]
            words = Words("change [{unit}]", unit=unit)
            figures.append(plot(grid, words, title=grid.title + change, origins=origins, scale=1e6))
    coefficients: Table
    if models[0].form == forms.K.name:  # K0 … K9 of the three axes side by side
        by_axis = []
        for model in models:
            of_model = [curve for curve in curves if curve.model == model.name]
            by_axis.append({c.name: c for c in fitted_coefficients(record, model, of_model)})
        units = {name: c.unit for axis in by_axis for name, c in axis.items()}
        coefficients = GridTable(
            COEFFICIENTS,
            Words(""),
            tuple(Words.literal(AXES[forms.K_MODELS.index(model.name)]) for model in models),
            tuple(units.values()),
            tuple(units),
            tuple(
                tuple(state(basis, axis[name], {}) if name in axis else None for axis in by_axis)
                for name in units
            ),
            COEFFICIENT_NOTE,
            by_row=True,
        )
        notes = [*map(residual_words, models), range_words(models[0]), *basis.left_out(models[0])]
    else:
        coefficients = list_coefficients(basis, record, models[0], values=curves)
        notes = note_models(basis, models)
    title, equation = BLOCKS[models[0].form]
    return make_block(record, title, (equation,), (coefficients, *grids), figures, notes)


def _q(basis: Stated, record: Record) -> Block:
    """Block of the Q-factor at the temperature that it was found at."""
    model = record.models[0]
    name = Words("Non-orthogonality")
    results = tuple(
        state(basis, coefficient(record, model, c.name, name), {}, principal=True)
        for c in model.coefficients
    )
    # Q is one determination, without a polynomial over temperature
    degc = model.value("temperature")
    notes = (
        Words("Q holds at {degc:g} °C.", degc=degc),
        residual_words(model),
        range_words(model),
    )
    title = Words("Q-factor: non-orthogonality of the axes")
    table = ListTable(COEFFICIENTS, results)
    return make_block(record, title, (Q_EQUATION,), (table,), (), notes)
