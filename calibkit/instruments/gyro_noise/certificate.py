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
from calibkit.certificate.words import Words
from calibkit.instruments.gyro_noise.forms import (
    ALLAN_DEVIATION,
    PROBABILITY,
    FigureName,
    read_name,
)
from calibkit.instruments.gyro_noise.recipe import ACCELEROMETER, GYRO, GyroNoiseRecipe
from calibkit.numeric import gum
from calibkit.numeric.noise.confidence import chi_square_limits
from calibkit.records.coefficients import Record
from calibkit.units import unit_mark

ALLAN = Equation(
    ALLAN_DEVIATION,
    r"\sigma^2(\tau) = \frac{R^2\tau^2}{2} + \frac{K^2\tau}{3} + \frac{2 \ln 2}{\pi} B^2 "
    r"+ \frac{N^2}{\tau} + \frac{3 Q^2}{\tau^2}",
    Words(
        "σ Allan deviation, τ averaging time; N angle random walk (of an accelerometer: velocity"
        " random walk), B bias instability, K rate (acceleration) random walk, R rate"
        " (acceleration) ramp, Q quantization."
    ),
)
TAU = Words.literal("τ [s]")

NAMES = {
    "angle_random_walk": Words("angle random walk N"),
    "bias_instability": Words("bias instability B"),
    "rate_random_walk": Words("rate random walk K"),
    "rate_ramp": Words("rate ramp R"),
    "quantization": Words("quantization Q"),
    "velocity_random_walk": Words("velocity random walk N"),
    "acceleration_random_walk": Words("acceleration random walk K"),
    "acceleration_ramp": Words("acceleration ramp R"),
    "mean_rate": Words("mean rate"),
    "mean_acceleration": Words("mean acceleration"),
    "bias_stability_10_s": Words("bias stability, 10 s means (GJB 2426A)"),
    "bias_stability_100_s": Words("bias stability, 100 s means (GJB 2426A)"),
}
DEVIATIONS = {
    "allan": Words("Allan deviation"),
    "wavelet": Words("wavelet deviation"),
}
PRINCIPAL = {"angle_random_walk", "velocity_random_walk", "bias_instability"}
FEW = 3.0
"""Standard uncertainties from zero within which a magnitude is stated by an interval."""


def name_term(term: str) -> Words:
    """Name of a noise term, mean or bias stability."""
    return NAMES.get(term, Words.literal(term.replace("_", " ")))


def list_terms(record: Record) -> list[tuple[FigureName, Quantity]]:
    """Mean, noise terms and bias stability of each record; by an interval where a term is within a
    few uncertainties of zero.
    """
    terms = []
    for figure in record.figures:
        name = read_name(figure.name)
        if name.tau_s is None:
            words = name_term(name.term) + Words.literal(f", {name.record}" if name.record else "")
            term = replace(
                of_figure(record, figure, words),
                # a symmetric U would reach below zero, where no magnitude lies
                magnitude=figure.value < FEW * figure.standard_uncertainty,
                principal=name.term in PRINCIPAL,
            )
            terms.append((name, term))
    return terms


def results(records: Mapping[str, Record], spec: GyroNoiseRecipe) -> tuple[Quantity, ...]:
    """Noise terms of each record but the mean, which holds the earth's rate or gravity, with the
    largest value that the recipe allows; those of a run of one record are named without it.
    """
    terms, quantities = list_terms(records["gyro_noise.json"]), []
    one_record = len({name.record for name, _ in terms}) == 1
    for name, term in terms:
        sensor = spec.sensor_of(name.record)
        if name.term == sensor.mean:
            continue
        key = next((key for start, key in sensor.limits.items() if name.term.startswith(start)), "")
        largest = getattr(spec.acceptance, key, None)
        limit = None if largest is None else ResultLimit(f"acceptance.{key}", upper=largest)
        called = name.term if one_record else term.name
        quantities.append(replace(term, name=called, compared=(({},),), limit=limit))
    return tuple(quantities)


def blocks(basis: Stated) -> tuple[Block, ...]:
    """Block of gyro_noise.json: terms, and of each record the Allan and wavelet deviation over τ
    within their chi-square limits.
    """
    record = basis.records.get("gyro_noise.json")
    if record is None:
        return ()
    terms = list_terms(record)
    listed = tuple(state(basis, term, {}) for _, term in terms)
    title = Words("Noise and bias stability")
    tables: list[ListTable | GridTable] = [ListTable(title, listed)]
    # type B terms take away degrees of freedom: as many as give σ/√(2 dof) the combined uncertainty
    conditions = {condition.name: condition.value for condition in record.conditions}
    probability = conditions.get(PROBABILITY, gum.TWO_SIGMA)
    curves: dict[str, dict[tuple[str, float], Result]] = {}
    for figure in record.figures:
        name = read_name(figure.name)
        if name.tau_s is None:
            continue
        result = state(basis, of_figure(record, figure, DEVIATIONS[name.term]), {})
        if result.uncertainty is not None:
            u = result.uncertainty.standard_uncertainty
            # u = σ/√(2 dof), solved for the degrees of freedom
            dof = 0.5 * (figure.value / u) ** 2
            low, high = chi_square_limits(np.array(figure.value), np.array(dof), probability)
            expanded = replace(result.uncertainty, probability=probability, effective_dof=dof)
            result = replace(result, uncertainty=expanded, interval=(float(low), float(high)))
        curves.setdefault(name.record, {})[name.term, name.tau_s] = result
    figures = []
    for of_record, curve in curves.items():
        kinds = [kind for kind in DEVIATIONS if any(kind == of_point for of_point, _ in curve)]
        taus = sorted({tau for _, tau in curve})
        unit = next(iter(curve.values())).unit
        table = GridTable(
            Words(
                "Deviation over averaging time with {percent:g} % limits, {record}",
                percent=100.0 * probability,
                record=of_record,
            ),
            TAU,
            tuple(DEVIATIONS[kind] for kind in kinds),
            (unit,) * len(kinds),
            tuple(f"{tau:g}" for tau in taus),
            tuple(tuple(curve.get((kind, tau)) for kind in kinds) for tau in taus),
            points=tuple(taus),
        )
        tables.append(table)
        figures.append(plot(table, Words.literal(f"σ [{unit_mark(unit)}]"), x_label=TAU, log=True))
    stated_names = {name.term for name, _ in terms}
    sensors = [sensor for sensor in (GYRO, ACCELEROMETER) if sensor.mean in stated_names]
    law_names = dict.fromkeys(law.name for sensor in sensors for law in sensor.laws)
    absent = [NAMES[name] for name in law_names if name not in stated_names]
    not_observable = Words(
        "Not stated, as no record shows it: {terms}.", terms=Words(", |of terms").join(absent)
    )
    title, notes = Words("Noise at rest"), (not_observable,) if absent else ()
    return (make_block(record, title, (ALLAN,), tables, figures, notes),)
