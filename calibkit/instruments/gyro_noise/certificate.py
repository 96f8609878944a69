"""Results of a sensor at rest, with the recipe's limits, and its certificate: mean, noise terms,
bias stability, and the Allan and wavelet deviation over averaging time with chi-square limits
(`ALLAN` is the equation of the terms).
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from calibkit.certificate.blocks import make_block, plot
from calibkit.certificate.quantities import Quantity, ResultLimit, of_figure, state
from calibkit.certificate.results import Block, Equation, GridTable, ListTable, Result
from calibkit.certificate.stated import Stated
from calibkit.certificate.words import Words, unit_mark
from calibkit.coefficients import Figure as Found, Record
from calibkit.instruments.gyro_noise.forms import (
    ALLAN_DEVIATION,
    KINDS,
    PROBABILITY,
    Deviation,
    read_deviation,
    read_term,
)
from calibkit.instruments.gyro_noise.recipe import ACCELEROMETER, GYRO, GyroNoiseRecipe
from calibkit.numeric import gum
from calibkit.numeric.noise.confidence import chi_square_limits

ALLAN = Equation(
    ALLAN_DEVIATION,
    r"\sigma^2(\tau) = \frac{R^2\tau^2}{2} + \frac{K^2\tau}{3} + \frac{2 \ln 2}{\pi} B^2 "
    r"+ \frac{N^2}{\tau} + \frac{3 Q^2}{\tau^2}",
    Words(
        "σ Allan deviation, τ averaging time; N angle random walk (of an accelerometer: velocity"
        " random walk), B bias instability, K rate (acceleration) random walk, R rate"
        " (acceleration) ramp, Q quantization.",
        "σ 为 Allan 偏差，τ 为平均时间；N 角度随机游走（加速度计：速度随机游走），B"
        " 零偏不稳定性，K 速率（加速度）随机游走，R 速率（加速度）斜坡，Q 量化噪声。",
    ),
)
TAU = Words("τ [s]")

NAMES = {
    "angle_random_walk": Words("angle random walk N", "角度随机游走 N"),
    "bias_instability": Words("bias instability B", "零偏不稳定性 B"),
    "rate_random_walk": Words("rate random walk K", "速率随机游走 K"),
    "rate_ramp": Words("rate ramp R", "速率斜坡 R"),
    "quantization": Words("quantization Q", "量化噪声 Q"),
    "velocity_random_walk": Words("velocity random walk N", "速度随机游走 N"),
    "acceleration_random_walk": Words("acceleration random walk K", "加速度随机游走 K"),
    "acceleration_ramp": Words("acceleration ramp R", "加速度斜坡 R"),
    "mean_rate": Words("mean rate", "平均角速率"),
    "mean_acceleration": Words("mean acceleration", "平均加速度"),
    "bias_stability_10_s": Words(
        "bias stability, 10 s means (GJB 2426A)", "零偏稳定性（10 s 平均，GJB 2426A）"
    ),
    "bias_stability_100_s": Words(
        "bias stability, 100 s means (GJB 2426A)", "零偏稳定性（100 s 平均，GJB 2426A）"
    ),
}
PRINCIPAL = {"angle_random_walk", "velocity_random_walk", "bias_instability"}
FEW = 3.0
"""Standard uncertainties from zero within which a magnitude is stated by an interval."""


def _limit(term: str, unit: str, spec: GyroNoiseRecipe) -> ResultLimit | None:
    """Largest value of a term by the recipe; bias instability has a key per kind of sensor."""
    sensor = GYRO if unit.startswith("deg") else ACCELEROMETER
    key = next((key for name, key in sensor.limits.items() if term.startswith(name)), "")
    largest = getattr(spec.acceptance, key, None)
    return None if largest is None else ResultLimit(f"acceptance.{key}", upper=largest)


def list_terms(record: Record) -> list[Quantity]:
    """Mean, noise terms and bias stability of each record; by an interval where a term is within a
    few uncertainties of zero.
    """
    terms = []
    for figure in record.figures:
        if read_deviation(figure.name) is None:
            name, log = read_term(figure.name)
            words = NAMES.get(name, Words(name.replace("_", " "))) + Words(
                f", {log}" if log else ""
            )
            term = replace(
                of_figure(record, figure, words),
                magnitude=figure.value < FEW * figure.standard_uncertainty,
                principal=name in PRINCIPAL,
            )
            terms.append(term)
    return terms


def results(records: Mapping[str, Record], spec: GyroNoiseRecipe) -> tuple[Quantity, ...]:
    """Noise terms of each record but the mean, which holds the earth's rate or gravity; those of a
    run of one record are named without it.
    """
    terms = [(*read_term(term.name), term) for term in list_terms(records["gyro_noise.json"])]
    one_record = len({log for _, log, _ in terms}) == 1
    return tuple(
        replace(
            term,
            name=name if one_record else term.name,
            compared=(({},),),
            limit=_limit(name, term.unit, spec),
        )
        for name, _, term in terms
        if name not in (GYRO.mean, ACCELEROMETER.mean)
    )


def blocks(basis: Stated) -> tuple[Block, ...]:
    """Block of gyro_noise.json."""
    record = basis.records.get("gyro_noise.json")
    if record is None:
        return ()
    curves: dict[str, dict[Deviation, Found]] = {}
    for figure in record.figures:
        point = read_deviation(figure.name)
        if point is not None:
            curves.setdefault(point.record, {})[point] = figure
    terms = list_terms(record)
    tables: list[ListTable | GridTable] = [
        ListTable(
            Words("Noise and bias stability", "噪声与零偏稳定性"),
            tuple(state(basis, term, {}) for term in terms),
        )
    ]
    figures = []
    for name, curve in curves.items():
        table = _deviations(basis, record, name, curve)
        tables.append(table)
        label = Words(f"σ [{unit_mark(table.units[0])}]")
        figures.append(plot(table, label, x_label=TAU, log=True))
    stated_names = {read_term(figure.name)[0] for figure in terms}
    sensors = [sensor for sensor in (GYRO, ACCELEROMETER) if sensor.mean in stated_names]
    law_names = dict.fromkeys(law.name for sensor in sensors for law in sensor.laws)
    absent = [NAMES[name] for name in law_names if name not in stated_names]
    not_observable = Words(
        f"Not stated, as no record shows it: {', '.join(words.en for words in absent)}.",
        f"数据中不可观测，未给出：{'、'.join(words.zh for words in absent)}。",
    )
    title, notes = Words("Noise at rest", "静态噪声"), (not_observable,) if absent else ()
    return (make_block(record, title, (ALLAN,), tables, figures, notes),)


def _deviations(
    basis: Stated, record: Record, name: str, curve: Mapping[Deviation, Found]
) -> GridTable:
    """Allan and wavelet deviation over τ of one record, within the chi-square limits that the
    report prints; type B terms take away degrees of freedom, as many as give σ/√(2 dof) the
    combined uncertainty.
    """
    words = {
        "allan": Words("Allan deviation", "Allan 偏差"),
        "wavelet": Words("wavelet deviation", "小波偏差"),
    }
    conditions = {condition.name: condition.value for condition in record.conditions}
    probability = conditions.get(PROBABILITY, gum.TWO_SIGMA)
    results_at: dict[tuple[str, float], Result] = {}
    for point, figure in curve.items():
        result = state(basis, of_figure(record, figure, words[point.kind]), {})
        if result.uncertainty is not None:
            u = result.uncertainty.standard_uncertainty
            dof = 0.5 * (figure.value / u) ** 2
            low, high = chi_square_limits(np.array(figure.value), np.array(dof), probability)
            expanded = replace(result.uncertainty, probability=probability, effective_dof=dof)
            interval = float(low), float(high)
            result = replace(result, uncertainty=expanded, interval=interval)
        results_at[point.kind, point.tau_s] = result
    kinds = [kind for kind in KINDS if any(point.kind == kind for point in curve)]
    taus = sorted({point.tau_s for point in curve})
    cells = tuple(tuple(results_at.get((kind, tau)) for kind in kinds) for tau in taus)
    return GridTable(
        Words(f"Deviation over averaging time, {name}", f"随平均时间的偏差（{name}）"),
        TAU,
        tuple(words[kind] for kind in kinds),
        (next(iter(curve.values())).unit,) * len(kinds),
        tuple(f"{tau:g}" for tau in taus),
        cells,
        points=tuple(taus),
    )
