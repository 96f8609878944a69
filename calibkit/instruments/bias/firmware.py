"""Coefficients of a bias over temperature → chain of steps by which firmware follows it, updated
once per interval; a polynomial has no memory.

    level, lagged   drift = Σ_k c_k x_k, as `forms` (steps in `firmware.thermal_steps`)
    gradient        D ← D + Σ_j a_j(r) G^j, the published scheme with `recursive` compensation
    bank            drift = Σ_k [(a_k + c_k z) ρ_k + b_k z_k ρ_k] + Σ_n s_n z^n + table(u)
                            + Σ h (p − T)/c + Σ w (1 − f) − the same at rest at the reference

k counts the lags of a bank (time constants τ_k); T_k is the case temperature behind lag k and ρ_k
its rate. x is the case temperature mapped to [−1, 1] over the fitted range, u the temperature T of
the coil (two further lags), mapped and clamped so; z and z_k are T and T_k about ORIGIN_DEGC in
SCALE_DEGC. p are play operators of half width c (hysteresis), f grows from 0 to 1 after the reset
(warm-up). A lag is kept as the difference x − T_k ("lag_k"), whose step is exact for a temperature
that is linear over an interval.

The self-test follows one thermal history, which reaches both ends of every range.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from math import comb

import numpy as np

from calibkit import units
from calibkit.errors import OutputError
from calibkit.firmware import exact, pace, thermal_steps, vectors
from calibkit.firmware.chain import Chain, Trials
from calibkit.firmware.draft import BEYOND, Draft, factor, number_or_zero, numbers, powers
from calibkit.firmware.sources import required_record
from calibkit.firmware.steps import Case, ChainTerm, Memory, Play, Select
from calibkit.instruments.bias.forms import (
    BANK,
    CASE_RANGE,
    FILE,
    LAGGED,
    LEVEL,
    OVER_RATES,
    POLYNOMIALS,
    THERMAL,
    rate_names,
    read_bank,
)
from calibkit.instruments.bias.numeric.bank import (
    ORIGIN_DEGC,
    POWERS,
    SCALE_DEGC,
    STATIC_LAGS,
    Bank,
)
from calibkit.instruments.bias.numeric.bank_fit import WARM_UP_S, WIDTHS_DEGC
from calibkit.instruments.bias.recipe import (
    HIGHEST_RATE_ORDER,
    BiasRecipe,
    BiasTemperatureRecipe,
    FogThermalRecipe,
    ThermalRecipe,
)
from calibkit.numeric.least_squares.polynomial import HIGHEST_ORDER
from calibkit.numeric.thermal.terms import CASE, GRADIENT, RATE
from calibkit.records.coefficients import Model, Record

CHANNEL_FORMULA = "corrected = indication - bias, each channel in its unit; the bias is 0 "
AT_REFERENCE = "at {:g} degC, or at the end of the fitted range nearest to it"


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
    return draft.chain([model.form for model in record.models], CHANNEL_FORMULA + zero)


AIR_RATE = "temp_env_rate_degc_min"
WHOSE = {LEVEL.name: "case", LAGGED.name: "coil", BANK.name: "coil"}
"""Which part of the gyro the fitted ranges of a form are of."""
LONGEST_DRIFT = 1024
"""Bound of the recursive drift, in multiples of the largest increment per interval."""
SUMMED = 3
"""Updates per row of HISTORY for a chain that sums increments, whose error bound grows with their
number.
"""
HISTORY = (
    (0.0, 0.0, 0.0, 1),
    (0.03, 0.1, 0.3, 1),
    (0.05, 0.3, 0.6, 1),
    (0.04, 0.5, 0.9, 1),
    (0.07, -0.3, 0.5, 1),
    (0.06, 0.4, 0.08, 1),
    (0.1, -0.2, -0.4, 1),
    (0.08, -0.5, -0.7, 1),
    (0.02, -0.8, -0.9, 1),
    (0.09, 0.05, -0.5, 1),
    (0.055, -0.3, -0.08, 1),
    (0.01, 0.05, 0.02, 1),
    (0.1, 0.9, 0.5, 3),
    (0.5, 1.2, 1.4, 3),
    (1.02, 1.2, 4.5, 1),
    (0.96, 2.6, 0.8, 8),
    *((0.96, 0.5, 0.2, updates) for updates in (5, 7, 25, 40, 40, 70, 200)),
    (0.2, -0.4, -0.3, 3),
    (-0.5, -1.2, -1.4, 3),
    (-1.02, -2.6, -4.5, 2),
    (-0.96, -0.7, -0.8, 8),
    *((-0.96, 0.3, 0.1, updates) for updates in (5, 7, 25, 40, 40, 70, 200)),
    (0.98, -0.6, 0.7, 4),
    (-0.2, 0.2, 0.5, 6),
    (0.1, -0.3, -0.2, 12),
    (-1.02, -4.0, 0.2, 500),
    *((1.02, 0.5, 0.2, updates) for updates in (3, 20, 40, 60, 90)),
    (1.02, 4.0, 0.2, 300),
    *((-1.02, -0.5, -0.2, updates) for updates in (3, 20, 40, 60, 90)),
)
"""Thermal history of the self-test from the reset on, one tuple per row: case temperature relative
to the half range of its input, beyond ±1 from the end of what is followed, air less case relative
to the largest gradient, air rate relative to the largest fitted rate, and number of updates. It
reaches both ends of every range.
"""
CHANNEL_HISTORY = (
    (0.0, 0.0, 0.0, 1),
    (0.05, 0.0, 0.0, 1),
    (0.1, 0.0, 0.0, 2),
    (0.3, 0.0, 0.0, 3),
    (1.02, 0.0, 0.0, 4),
    (0.96, 0.0, 0.0, 8),
    (0.96, 0.0, 0.0, 160),
    (0.2, 0.0, 0.0, 3),
    (-0.5, 0.0, 0.0, 3),
    (-1.02, 0.0, 0.0, 2),
    (-0.96, 0.0, 0.0, 8),
    (-0.96, 0.0, 0.0, 160),
    (0.98, 0.0, 0.0, 4),
    (-0.2, 0.0, 0.0, 6),
    (0.1, 0.0, 0.0, 12),
)
"""The same for channels, which see no air."""
FORMULA = (
    "corrected = indication - drift, both in deg/h; the drift is 0 at rest at {reference:g} degC,"
    " or at the end of the fitted range nearest to it"
)
RECURSIVE = (
    "corrected = indication - drift, both in deg/h; the drift is 0 at the reset, or where it is"
    " anchored"
)


def files(spec: BiasRecipe) -> tuple[str, ...]:
    """Coefficient file that the chain takes its numbers from."""
    return ({"fog_thermal": FILE, "thermal": THERMAL}.get(spec.procedure, POLYNOMIALS),)


def chain(spec: BiasRecipe, records: Mapping[str, Record]) -> Chain:
    """Chain of the bias of every channel, zero at the reference, with the trials of its self-test;
    OutputError if there is none, or if it removes the true rate.
    """
    if isinstance(spec, BiasTemperatureRecipe):
        return _polynomials(spec, records)
    (file,) = files(spec)
    models = [
        model
        for model in required_record(records, file, spec).models
        if any(coefficient.value for coefficient in model.coefficients[1:])
    ]
    if not models:
        raise OutputError(
            "the run has no drift term: no tested model was better than none",
            hint="there is nothing to export",
        )
    if isinstance(spec, FogThermalRecipe) and models[0].form == OVER_RATES.name:
        return _follow_increments(spec, models)
    return _follow_levels(spec, models)


def _follow_levels(spec: FogThermalRecipe | ThermalRecipe, models: Sequence[Model]) -> Chain:
    """Chain of models whose value is the bias, of each channel or of a gyro, zero at rest at the
    reference temperature.
    """
    of_gyro, reference_degc = isinstance(spec, FogThermalRecipe), spec.reference_temp_degc
    # channels have terms and lags of their own: no layout holds for all devices
    draft = Draft(padded=of_gyro and spec.export.layout == "padded")
    h, needs_pace = Fraction(models[0].value("interval")), not of_gyro
    reach = thermal_steps.reach_of(map(thermal_steps.followed, models))
    draft.input(CASE, "degC", thermal_steps.CASE_MEANING, reach)
    for model in models:
        followed, fitted, part = thermal_steps.followed(model), model.valid[CASE], draft
        if not of_gyro:
            fitted, part = (model.value(CASE_RANGE[0]), model.value(CASE_RANGE[1])), Draft()
        # the map clamps the case temperature and sets the flag
        mapped = part.map("x", CASE, fitted, flag="TEMP_CLAMPED", followed=followed)
        if model.form == BANK.name:
            fastest = pace.FASTEST * thermal_steps.largest(model, RATE) / 60 / mapped[1]
            source = follow_bank(part, model, h, fastest, reference_degc)
        else:
            source = thermal_steps.follow_terms(part, model, h, reference_degc, mapped)
        if of_gyro:
            _output_drift(draft, source, models)
            lagged = model.form != LEVEL.name
            needs_pace = lagged or draft.padded or thermal_steps.uses(model, RATE)
        else:
            draft.include(part, f"_{model.name}")
            meaning = f"bias of {model.name}, to be subtracted from it"
            source, unit = f"{source}_{model.name}", model.residual_unit
            draft.output(f"bias_{model.name}", unit, source, meaning, corrects=model.name)
            draft.ranges.append(f"{CASE} of {model.name} {exact.limits_text(*fitted)} degC")
        draft.ranges.append(thermal_steps.say_followed(followed))
    formula = FORMULA.format(reference=reference_degc)
    if not of_gyro:
        formula = CHANNEL_FORMULA + "at rest " + AT_REFERENCE.format(reference_degc)
    rate = min(thermal_steps.largest(model, RATE) for model in models)
    highest = exact.round_to(float(pace.FASTEST * rate), 3, up=False)
    condition = f"the case moves by no more than {highest:.3g} degC/min" if needs_pace else ""
    forms = [model.form for model in models]
    followed_chain = draft.chain(forms, formula, interval_s=float(h), condition=condition)
    gap_s = spec.thermal.max_gap_s if isinstance(spec, ThermalRecipe) else spec.largest_gap_s()
    followed_chain = pace.keep_time(followed_chain, CASE, rate, gap_s)
    return replace(followed_chain, trials=_thermal_history(followed_chain))


def _follow_increments(spec: FogThermalRecipe, models: Sequence[Model]) -> Chain:
    """Chain of the published scheme: D ← D + Δ, Δ = Σ_j a_j(r) G^j of the side (heating or cooling)
    by the inputs of the previous update.
    """
    if spec.drift.compensation == "one_step":
        raise OutputError(
            "compensation 'one_step' removes the true rate (rate gain 0)",
            hint="fit with drift.compensation = 'recursive'",
        )
    draft = Draft(padded=spec.export.layout == "padded")
    cases = [model.valid[CASE] for model in models]
    middle, half = exact.span(min(low for low, _ in cases), max(high for _, high in cases))
    reach = (middle - 2 * half, middle + 2 * half)
    draft.input(CASE, "degC", thermal_steps.CASE_MEANING, reach, "TEMP_CLAMPED")
    draft.input(thermal_steps.AIR, "degC", thermal_steps.AIR_MEANING, reach, "AIR_CLAMPED")
    rate = max(thermal_steps.largest(model, RATE) for model in models)
    window_s = spec.segments.slope_window_s
    window = f"by least squares over the {window_s:g} s before the end of the interval"
    # the sides clamp it and set the flag
    draft.input(
        AIR_RATE,
        "degC/min",
        f"rate of the air, slope {window}",
        (-4 * rate, 4 * rate),
        derived=f"slope of {thermal_steps.AIR} {window}",
    )
    draft.sum("apart", factor(CASE), factor(thermal_steps.AIR, -1))
    sides, largest = [], Fraction(0)
    for model in models:
        name, (low, high) = model.name, model.valid[RATE]
        r_middle, r_half = draft.map(
            f"rate_{name}", AIR_RATE, (low, high), flag="RATE_CLAMPED", group=name
        )
        g_middle, g_half = draft.map(
            f"gradient_{name}",
            "apart",
            model.valid[GRADIENT],
            flag="GRADIENT_CLAMPED",
            group=name,
        )
        over_rate = [
            exact.mapped(numbers(model, *names), r_middle, r_half)
            for names in rate_names(len(model.coefficients) // 3 - 1)
        ]
        # increment Σ_j a_j(r) G^j as polynomials of the mapped rate times powers of the mapped
        # gradient, and its largest magnitude [°/h]
        terms: list[list[ChainTerm]] = []
        bound = Fraction(0)
        for i in (2, 1, 0):
            parts = [
                exact.scale(over_rate[j], comb(j, i) * g_middle ** (j - i) * g_half**i)
                for j in range(i, 3)
            ]
            factors, polynomial = (f"gradient_{name}",) * i, exact.add(*parts)
            terms.append(
                draft.polynomial(
                    f"a_{name}_{i}", polynomial, f"rate_{name}", *factors, order=HIGHEST_RATE_ORDER
                )
            )
            bound += sum(map(abs, polynomial))
        value = draft.sum(f"increment_{name}", *terms)
        sign = 1 if low > 0 else -1 if high < 0 else 0
        moving = draft.table(f"moving_{name}", (Fraction(model.value("slowest_rate")) / 2,))
        sides.append(Case(value, sign, moving, name))
        largest = max(largest, bound)
    draft.steps.append(Select("increment", AIR_RATE, tuple(sides), "HELD"))
    longest = Fraction(2) ** exact.power_of_two(LONGEST_DRIFT * largest)
    draft.steps += [
        Memory("drift_before", "drift", "zero"),
        Memory("increment_before", "increment", "zero"),
    ]
    draft.sum("total", factor("increment_before"), factor("drift_before"))
    draft.limit("drift", "total", -longest, longest, "DRIFT_LIMITED")
    draft.limits |= {"drift_before": longest, "increment_before": largest}
    _output_drift(draft, "drift", models)
    interval_s = float(models[0].value("interval"))
    drift = draft.chain([model.form for model in models], RECURSIVE, interval_s=interval_s)
    drift = pace.keep_time(drift, CASE, rate, spec.largest_gap_s())
    return replace(drift, trials=_thermal_history(drift))


def _output_drift(draft: Draft, source: str, models: Sequence[Model]) -> None:
    """The drift of a gyro, and the ranges that its models were fitted in."""
    meaning = "drift, to be subtracted from the indication"
    draft.output("drift_dph", "deg/h", source, meaning, corrects="gyro_dph")
    for model in models:
        owner = WHOSE.get(model.form, f"{model.name} side")
        for column, (low, high) in model.valid.items():
            unit = "degC" if column in (CASE, GRADIENT) else "degC/min"
            draft.ranges.append(f"{column} of the {owner} {exact.limits_text(low, high)} {unit}")


def _thermal_history(chain: Chain) -> Trials:
    """Trials of a chain: one thermal history that covers every range from end to end."""
    ranges = {entry.name: chain.tables[entry.table] for entry in chain.structure.inputs}
    low, high = (float(limit) for limit in ranges[CASE])
    middle, half, history = (low + high) / 2.0, (high - low) / 2.0, HISTORY
    if "x_map" in chain.tables:  # the case is followed beyond the fitted range, its word further
        middle, reciprocal, *ends = map(float, chain.tables["x_map"])
        half = float(BEYOND) / reciprocal
        low, high = (middle + end / reciprocal for end in ends)
    elif not chain.structure.summing:  # channels, of which each has a map of its own
        half, history = half / float(1 + 2 * thermal_steps.WIDER), CHANNEL_HISTORY
        low, high = middle - half, middle + half
    case, ahead, climb, updates = (np.array(column) for column in zip(*history, strict=True))
    outer_cases = [high + (case - 1.0) * half, low + (case + 1.0) * half]
    physical = {CASE: np.select([case > 1.0, case < -1.0], outer_cases, middle + half * case)}
    gradients = [
        abs(chain.tables[step.table][0]) + 1 / chain.tables[step.table][1]
        for step in chain.structure.maps
        if step.source == "apart"
    ]
    physical[thermal_steps.AIR] = physical[CASE] + float(max(gradients, default=0)) * ahead
    if chain.structure.summing:
        physical[AIR_RATE] = float(ranges[AIR_RATE][1]) / 4.0 * climb
        updates = np.full_like(updates, SUMMED)
    coarse = {name: vectors.coarsen(physical[name], half) for name in ranges}
    return pace.by_the_clock(chain, Trials(coarse, tuple(updates.tolist())))


ROUNDED = Fraction(1025, 1024)
"""Bound of a play operator's distance, in half widths: it is a difference of rounded numbers."""


def follow_bank(
    draft: Draft, model: Model, h: Fraction, fastest: Fraction, reference_degc: float
) -> str:
    """Drift of a bank of lags from the mapped case temperature "x", which moves by at most
    `fastest` [1/s].
    """
    bank = read_bank(model)
    if draft.padded:
        bank = replace(bank, widths=bank.widths or WIDTHS_DEGC, warm_up=bank.warm_up or WARM_UP_S)
    middle, half = exact.span(*model.valid[CASE])
    low, high = ((Fraction(limit) - middle) / half for limit in model.valid[CASE])
    at_rest = min(max((Fraction(reference_degc) - middle) / half, low), high)
    draft.steps.append(Memory("x_before", "x", "same"))
    draft.sum("move", factor("x"), factor("x_before", -1))
    thermal_steps.bound_memory(draft, "move", thermal_steps.span_of_case(draft), fastest * h)

    # T = x − (1 − f) lag_fast − f lag_static, mapped as the case temperature: "coil", clamped "u"
    fast, slow, share = numbers(model, *STATIC_LAGS)
    thermal_steps.follow_lag(draft, "lag_fast", h, fast, fastest)
    thermal_steps.follow_lag(draft, "lag_static", h, slow, fastest)
    draft.sum(
        "coil",
        factor("x"),
        draft.polynomial("share_of_lag_fast", (share - 1,), "", "lag_fast"),
        draft.polynomial("share_of_lag_static", (-share,), "", "lag_static"),
    )
    draft.limit("u", "coil", low, high, "TEMP_CLAMPED")

    # static terms Σ_n s_n z^n as a polynomial of u, less their value at rest at the reference
    to_z = ((middle - Fraction(ORIGIN_DEGC)) / Fraction(SCALE_DEGC), half / Fraction(SCALE_DEGC))
    static: exact.Poly = (Fraction(0),)
    for weight in reversed(numbers(model, *(f"s{k}" for k in range(1, POWERS + 1)))):
        static = exact.product(exact.add(static, (weight,)), to_z)
    at_reference = exact.value(static, at_rest)

    # the table over temperature: of each segment between knots its slope times u limited to it
    knots = [(Fraction(knot) - middle) / half for knot in bank.knots]
    values = numbers(model, *(f"g{k}" for k in range(1, len(knots) + 1)))
    table: list[ChainTerm] = []
    segments = zip(pairwise(knots), pairwise(values), strict=True)
    for k, ((coldest, hottest), (first, last)) in enumerate(segments, start=1):
        slope = (last - first) / (hottest - coldest)
        draft.limit(f"segment_{k}", "u", coldest, hottest, "")
        table += draft.polynomial(f"slope_{k}", (slope,), "", f"segment_{k}")
        at_reference += slope * min(max(at_rest, coldest), hottest)

    # rates (a + c z) ρ + b z_k ρ, ρ limited to the largest fitted one on either side
    rates: list[ChainTerm] = []
    largest = thermal_steps.largest(model, RATE)
    for k, lag in enumerate(bank.lags, start=1):
        thermal_steps.follow_lag(draft, f"lag_{k}", h, Fraction(lag), fastest)
        to_rate = (60 * half / Fraction(lag) / largest,)
        rate = draft.sum(f"behind_{k}", draft.polynomial(f"rate_of_{k}", to_rate, "", f"lag_{k}"))
        # a slow lag cannot get that fast
        if draft.padded or to_rate[0] * draft.limits[f"lag_{k}"] > 1:
            rate = draft.limit(f"rate_{k}", rate, Fraction(-1), Fraction(1), "RATE_CLAMPED")
        draft.sum(f"layer_{k}", factor("x"), factor(f"lag_{k}", -1))
        draft.limit(f"at_{k}", f"layer_{k}", low, high, "TEMP_CLAMPED")
        a, b, c = numbers(model, f"a{k}", f"b{k}", f"c{k}")
        weight_of_coil = exact.scale(exact.add((a,), exact.scale(to_z, c)), largest)
        rates += draft.polynomial(f"by_rate_{k}", weight_of_coil, "u", rate)
        rates += draft.polynomial(f"by_own_{k}", exact.scale(to_z, b * largest), f"at_{k}", rate)

    hysteresis = _hysteresis(draft, model, bank, (middle, half))
    # the warm-up since the reset: w (1 − f), f ← f + (1 − a)(1 − f) from 0
    warm_up: list[ChainTerm] = []
    for k, theta in enumerate(bank.warm_up, start=1):
        a, name = exact.exp(-h / Fraction(theta)), f"warm_{k}"
        draft.steps.append(Memory(f"{name}_before", name, "zero"))
        draft.sum(
            name,
            draft.polynomial(f"{name}_kept", (a,), "", f"{name}_before"),
            draft.polynomial(f"{name}_grown", (1 - a,), ""),
        )
        thermal_steps.bound_memory(draft, name, Fraction(1), Fraction(1))
        weight = number_or_zero(model, f"w{k}")
        warm_up += draft.polynomial(f"{name}_weight", (weight,), "")
        warm_up += draft.polynomial(f"{name}_faded", (-weight,), "", f"{name}_before")
    statics = draft.polynomial("static_terms", exact.add(static, (-at_reference,)), "u")
    return draft.sum("drift", rates, table, hysteresis, warm_up, statics)


def _hysteresis(
    draft: Draft, model: Model, bank: Bank, span: tuple[Fraction, Fraction]
) -> list[ChainTerm]:
    """Terms h (p − T)/c of the play operators p of half width c; T is relative to the origin, so
    that p is 0 at the reset.
    """
    middle, half = span
    origin = (middle - Fraction(ORIGIN_DEGC)) / half
    share = numbers(model, STATIC_LAGS[2])[0]
    shares = {"lag_fast": abs(1 - share), "lag_static": abs(share)}
    terms: list[ChainTerm] = []
    if bank.widths:
        draft.sum("swing", factor("coil"), draft.polynomial("origin", (origin,), ""))
    for k, width in enumerate((Fraction(width) / half for width in bank.widths), start=1):
        name, name_before, distance = f"play_{k}", f"play_{k}_before", f"behind_play_{k}"
        for bounds in (draft.limits, draft.usual):
            coil = max(map(abs, draft.tables["x_map"][2:])) + sum(
                part * bounds[lag] for lag, part in shares.items()
            )
            bounds[name] = bounds[name_before] = coil + abs(origin) + width
            bounds[distance] = width * ROUNDED
        draft.steps.append(Memory(name_before, name, "zero"))
        table = draft.table(f"{name}_distances", (-width, width))
        draft.steps.append(Play(name, "swing", name_before, table))
        draft.sum(distance, factor(name), factor("swing", -1))
        weight = number_or_zero(model, f"h{k}")
        terms += draft.polynomial(f"hysteresis_{k}", (weight / width,), "", distance)
    return terms
