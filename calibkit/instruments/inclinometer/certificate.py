"""Inclinometer results: the in-situ scale factor s of each gyro over temperature."""

from calibkit.certificate.blocks import list_coefficients, make_block, plot, tabulate
from calibkit.certificate.quantities import of_figure, state
from calibkit.certificate.results import Block, Equation, ListTable
from calibkit.certificate.stated import Stated, range_words, residual_words
from calibkit.certificate.words import Words
from calibkit.instruments.inclinometer import quantities
from calibkit.instruments.inclinometer.forms import FILE, SCALE as SCALE_FORM

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


def blocks(basis: Stated) -> tuple[Block, ...]:
    """Block of inclinometer_scale.json."""
    record = basis.records.get(FILE)
    if record is None:
        return ()
    models = record.models
    scales = [quantities.scale(record, model) for model in models]
    coefficients = [
        list_coefficients(
            *(basis, record, model),
            Words(f"Coefficients of gyro {model.name}", f"{model.name} 陀螺系数"),
            [scale],
        )
        for model, scale in zip(models, scales, strict=True)
    ]
    over_temperature = None
    if any(scale.inputs for scale in scales[:1]):
        columns = [
            (Words(f"s, gyro {scale.model}", f"s，{scale.model} 陀螺"), scale) for scale in scales
        ]
        title = Words("In-situ scale factor s over temperature", "原位标度因数 s 随温度")
        over_temperature = tabulate(basis, title, columns)
    figures = []
    if over_temperature is not None:
        unit_scales = [1.0] * len(scales)
        figures.append(plot(over_temperature, Words("s − 1 [ppm]"), origins=unit_scales, scale=1e6))
    stations = ListTable(
        Words("Stations", "测站"),
        tuple(
            state(basis, of_figure(record, figure, FIGURES[figure.name]), {})
            for figure in record.figures
            if figure.name in FIGURES
        ),
    )
    notes = [residual_words(model) for model in models]
    for model in models[:1]:
        notes += [range_words(model), *basis.left_out(model)]
    title = Words("In-situ scale factor of the north-seeking gyros", "寻北陀螺原位标度因数")
    tables = (*coefficients, over_temperature, stations)
    return (make_block(record, title, (SCALE,), tables, figures, notes),)
