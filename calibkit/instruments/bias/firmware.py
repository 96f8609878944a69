"""bias.json → chain without memory; thermal.json → chain of steps by which firmware follows the
bias of every channel, updated once per interval.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction

import numpy as np

from calibkit import units
from calibkit.coefficients import Record
from calibkit.errors import OutputError
from calibkit.firmware import exact, pace, thermal_steps, vectors
from calibkit.firmware.chain import Chain, Trials
from calibkit.firmware.draft import BEYOND, Draft, powers
from calibkit.firmware.sources import required_record
from calibkit.instruments.bias.forms import CASE_RANGE, POLYNOMIALS, THERMAL
from calibkit.instruments.bias.recipe import BiasTemperatureRecipe, ThermalRecipe
from calibkit.numeric.least_squares.polynomial import HIGHEST_ORDER
from calibkit.thermal_forms import CASE, RATE

HISTORY = (
    (0.0, 1),
    (0.05, 1),
    (0.1, 2),
    (0.3, 3),
    (1.02, 4),
    (0.96, 8),
    (0.96, 160),
    (0.2, 3),
    (-0.5, 3),
    (-1.02, 2),
    (-0.96, 8),
    (-0.96, 160),
    (0.98, 4),
    (-0.2, 6),
    (0.1, 12),
)
"""Thermal history of the self-test from the reset on: case temperature relative to the half range
of its input, and number of updates.
"""
FORMULA = "corrected = indication - bias, each channel in its unit; the bias is 0 "
AT_REFERENCE = "at {:g} degC, or at the end of the fitted range nearest to it"


def files(spec: BiasTemperatureRecipe | ThermalRecipe) -> tuple[str, ...]:
    """Coefficient file that the chain takes its numbers from."""
    return (THERMAL if isinstance(spec, ThermalRecipe) else POLYNOMIALS,)


def chain(spec: BiasTemperatureRecipe | ThermalRecipe, records: Mapping[str, Record]) -> Chain:
    """Chain of the bias of every channel, which is zero at the reference."""
    if isinstance(spec, ThermalRecipe):
        return _follow_terms(spec, records)
    return _polynomials(spec, records)


def _polynomials(spec: BiasTemperatureRecipe, records: Mapping[str, Record]) -> Chain:
    """Bias of each channel, zero at the reference temperature; of an abscissa that is no
    temperature at the middle of its range.
    """
    record = required_record(records, POLYNOMIALS, spec)
    draft = Draft(padded=spec.export.layout == "padded")
    for number, model in enumerate(record.models):
        (column, valid), name = next(iter(model.valid.items())), model.name
        for text in (column, name):
            if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", text):
                raise OutputError(
                    f"column '{text}' cannot be a name in C",
                    hint="rename it in the recipe's [columns]",
                )
        unit = units.column_unit(column)
        middle, half = exact.span(*valid)
        reach = (middle - BEYOND * half, middle + BEYOND * half)
        draft.input(column, unit, "abscissa of the bias", reach)
        if number == 0:
            draft.ranges.append(f"{column} {exact.limits_text(*valid, 6)} {unit}")
            draft.map("u", column, valid, flag="TEMP_CLAMPED")
        low, high = (Fraction(limit) for limit in valid)
        reference = (
            Fraction(spec.reference_temp_degc) if column.endswith("_degc") else (low + high) / 2
        )
        mapped_powers = exact.mapped(powers(model, "p"), middle, half)
        at_rest = exact.value(mapped_powers, (min(max(reference, low), high) - middle) / half)
        bias = exact.add(mapped_powers, (-at_rest,))
        if not exact.trimmed(bias):
            raise OutputError(
                f"{name}: the bias does not vary", hint="there is nothing to correct: leave it out"
            )
        terms = draft.polynomial(f"p_{name}", bias, "u", order=HIGHEST_ORDER)
        source = draft.sum(f"bias_{name}", terms)
        meaning = f"bias of {name}, to be subtracted from it"
        draft.output(f"bias_{name}", units.column_unit(name), source, meaning, corrects=name)
    column = spec.polynomials.abscissa
    zero = f"in the middle of the fitted range of {column}"
    if column.endswith("_degc"):
        zero = AT_REFERENCE.format(spec.reference_temp_degc)
    return draft.chain([model.form for model in record.models], FORMULA + zero)


def _follow_terms(spec: ThermalRecipe, records: Mapping[str, Record]) -> Chain:
    """Chain of all channels that vary, each zero at rest at the reference temperature; OutputError
    where none does.
    """
    models = [
        model
        for model in required_record(records, THERMAL, spec).models
        if any(coefficient.value for coefficient in model.coefficients[1:])
    ]
    if not models:
        raise OutputError(
            "no channel has a drift term: no tested model was better than none",
            hint="there is nothing to export",
        )
    # channels have terms and lags of their own: no layout holds for all devices
    draft = Draft()
    h = Fraction(models[0].value("interval"))
    reach = thermal_steps.reach_of(map(thermal_steps.followed, models))
    draft.input(CASE, "degC", thermal_steps.CASE_MEANING, reach)
    paces = []
    for model in models:
        channel_draft, name = Draft(), f"bias_{model.name}"
        low, high = (model.value(end) for end in CASE_RANGE)
        followed = thermal_steps.followed(model)
        mapped = channel_draft.map("x", CASE, (low, high), flag="TEMP_CLAMPED", followed=followed)
        source = thermal_steps.follow_terms(
            channel_draft, model, h, spec.reference_temp_degc, mapped
        )
        draft.include(channel_draft, f"_{model.name}")
        source, unit = f"{source}_{model.name}", model.residual_unit
        meaning = f"bias of {model.name}, to be subtracted from it"
        draft.output(name, unit, source, meaning, corrects=model.name)
        draft.ranges.append(f"{CASE} of {model.name} {exact.limits_text(low, high)} degC")
        draft.ranges.append(thermal_steps.say_followed(followed))
        paces.append(pace.FASTEST * thermal_steps.largest(model, RATE))
    highest = exact.round_to(float(min(paces)), 3, up=False)
    followed_chain = draft.chain(
        [model.form for model in models],
        FORMULA + "at rest " + AT_REFERENCE.format(spec.reference_temp_degc),
        interval_s=float(h),
        condition=f"the case moves by no more than {highest:.3g} degC/min",
    )
    rate = min(paces) / pace.FASTEST
    followed_chain = pace.keep_time(followed_chain, CASE, rate, spec.thermal.max_gap_s)
    return replace(followed_chain, trials=_thermal_history(followed_chain))


def _thermal_history(chain: Chain) -> Trials:
    """Trials of a chain: one thermal history that covers its range from end to end."""
    low, high = (float(limit) for limit in chain.tables[chain.structure.inputs[0].table])
    # the input's word reaches beyond what is followed
    half = (high - low) / 2.0 / float(1 + 2 * thermal_steps.WIDER)
    positions, updates = zip(*HISTORY, strict=True)
    case = (low + high) / 2.0 + half * np.array(positions)
    return pace.by_the_clock(chain, Trials({CASE: vectors.coarsen(case, half)}, updates))
