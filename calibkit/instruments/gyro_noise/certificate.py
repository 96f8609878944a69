"""Results of a sensor at rest: mean, noise terms, bias stability, Allan and wavelet deviation."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calibkit.certificate.results import (
    Block,
    Equation,
    Figure,
    GridTable,
    ListTable,
    Result,
    Series,
)
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
from calibkit.numeric import gum
from calibkit.numeric.noise.confidence import chi_square_limits
from calibkit.numeric.noise.laws import ACCELEROMETER_LAWS, LAWS

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


def blocks(stated: Stated) -> tuple[Block, ...]:
    """Block of gyro_noise.json."""
    record = stated.records.get("gyro_noise.json")
    if record is None:
        return ()
    points = {found: f for f in record.figures if (found := read_deviation(f.name)) is not None}
    terms = [figure for figure in record.figures if read_deviation(figure.name) is None]
    tables: list[ListTable | GridTable] = [
        ListTable(
            Words("Noise and bias stability", "噪声与零偏稳定性"),
            tuple(_state(stated, record, figure) for figure in terms),
        )
    ]
    figures = []
    for name in dict.fromkeys(point.record for point in points):
        curve = {point: figure for point, figure in points.items() if point.record == name}
        table = _deviations(stated, record, name, curve)
        tables.append(table)
        figures.append(_plot(table, sorted({point.tau_s for point in curve})))
    return (
        Block(
            record.stage,
            f"{record.stage}.json",
            Words("Noise at rest", "静态噪声"),
            (ALLAN,),
            tuple(tables),
            tuple(figures),
            _not_observable(terms),
        ),
    )


def _not_observable(terms: Sequence[Found]) -> tuple[Words, ...]:
    """Note on the terms of the Allan deviation that no record shows."""
    found = {read_term(figure.name)[0] for figure in terms}
    sensors = (("mean_rate", LAWS), ("mean_acceleration", ACCELEROMETER_LAWS))
    names = [law.name for mean, laws in sensors if mean in found for law in laws]
    absent = [NAMES[name] for name in dict.fromkeys(names) if name not in found]
    if not absent:
        return ()
    return (
        Words(
            f"Not stated, as no record shows it: {', '.join(one.en for one in absent)}.",
            f"数据中不可观测，未给出：{'、'.join(one.zh for one in absent)}。",
        ),
    )


def _state(stated: Stated, record: Record, figure: Found) -> Result:
    """A noise term; by an interval where it is within a few uncertainties of zero."""
    term, log = read_term(figure.name)
    words = NAMES.get(term, Words(term.replace("_", " "))) + Words(f", {log}" if log else "")
    near_zero = figure.value < FEW * figure.standard_uncertainty
    dof = figure.effective_dof or math.inf
    return stated.figure(
        record, figure, words, dof, magnitude=near_zero, principal=term in PRINCIPAL
    )


def _state_deviation(stated: Stated, record: Record, figure: Found, words: Words) -> Result:
    """A deviation within the chi-square limits that the report prints; type B terms take away
    degrees of freedom, as many as give σ/√(2 dof) the combined uncertainty.
    """
    result = stated.figure(record, figure, words, math.inf)
    if result.uncertainty is None:
        return result
    found = [c.value for c in record.conditions if c.name == PROBABILITY]
    probability = found[0] if found else gum.TWO_SIGMA
    dof = 0.5 * (figure.value / result.uncertainty.standard_uncertainty) ** 2
    low, high = chi_square_limits(np.array(figure.value), np.array(dof), probability)
    return replace(
        result,
        uncertainty=replace(result.uncertainty, probability=probability, effective_dof=dof),
        interval=(float(low), float(high)),
    )


def _deviations(
    stated: Stated, record: Record, name: str, curve: Mapping[Deviation, Found]
) -> GridTable:
    """Allan and wavelet deviation over τ of one record."""
    found = {(point.kind, point.tau_s): figure for point, figure in curve.items()}
    kinds = [kind for kind in KINDS if any(k == kind for k, _ in found)]
    taus = sorted({tau for _, tau in found})
    words = {
        "allan": Words("Allan deviation", "Allan 偏差"),
        "wavelet": Words("wavelet deviation", "小波偏差"),
    }
    cells = tuple(
        tuple(
            (
                _state_deviation(stated, record, found[kind, tau], words[kind])
                if (kind, tau) in found
                else None
            )
            for kind in kinds
        )
        for tau in taus
    )
    return GridTable(
        Words(f"Deviation over averaging time, {name}", f"随平均时间的偏差（{name}）"),
        Words("τ [s]"),
        tuple(words[kind] for kind in kinds),
        (next(iter(curve.values())).unit,) * len(kinds),
        tuple(f"{tau:g}" for tau in taus),
        cells,
    )


def _plot(table: GridTable, taus: Sequence[float]) -> Figure:
    """Deviation over τ, both logarithmic, with the limits of the table."""
    series = []
    for k, head in enumerate(table.heads):
        points = [
            (tau, r)
            for tau, row in zip(taus, table.cells, strict=True)
            if (r := row[k]) is not None
        ]
        series.append(
            Series(
                head,
                tuple(tau for tau, _ in points),
                tuple(r.value for _, r in points),
                ends=tuple(r.interval or (r.value, r.value) for _, r in points),
            )
        )
    unit = unit_mark(table.units[0])
    return Figure(table.title, Words("τ [s]"), Words(f"σ [{unit}]"), tuple(series), log=True)
