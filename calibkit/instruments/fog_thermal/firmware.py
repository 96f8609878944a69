"""drift_rate.json → chain of steps by which a gyro's firmware updates the drift once per interval:
level, lagged or recursive gradient form.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from math import comb

from calibkit.coefficients import Model, Record
from calibkit.errors import OutputError
from calibkit.firmware import exact
from calibkit.firmware.chain import Case, Chain, Map, Memory, Select, Slope, Term
from calibkit.firmware.draft import BEYOND, Draft, factor, numbers
from calibkit.firmware.sources import required_record
from calibkit.instruments import Firmware
from calibkit.instruments.fog_thermal import firmware_bank, firmware_updates
from calibkit.instruments.fog_thermal.forms import (
    BANK,
    CASE,
    DRIVERS,
    FILE,
    GRADIENT,
    LAGGED,
    OVER_RATES,
    RATE,
    rate_names,
)
from calibkit.instruments.fog_thermal.recipe import FogThermalRecipe
from calibkit.numeric.thermal.terms import LAGS, TERMS

GRADIENT_RATE = DRIVERS[3]
AIR, AIR_RATE = "temp_env_degc", "temp_env_rate_degc_min"
CASE_MEANING = "temperature of the sensor case, mean of the interval"
AIR_MEANING = "temperature of the air around the sensor, mean of the interval"
WIDEST = 2
"""Range of an input's word on each side of the middle, in half widths of the fitted range."""
FASTEST = 2
"""Multiple of the largest fitted rate up to which the printed error bound of a chain with memory
holds.
"""
LEAST_SAMPLES = 4
"""Fewest values for the rate of a level model; they must also span half a window."""
LONGEST_DRIFT = 1024
"""Bound of the recursive drift, in multiples of the largest increment per interval."""
FORMULA = (
    "corrected = indication - drift, both in deg/h; the drift is 0 at rest at {reference:g} degC"
)
RECURSIVE = (
    "corrected = indication - drift, both in deg/h; the drift is 0 at the reset, or where it is"
    " anchored"
)


def _chain(spec: FogThermalRecipe, records: Mapping[str, Record]) -> Chain:
    """Chain of the exported drift term with the trials of its self-test; OutputError if there is
    none, or if it removes the true rate.
    """
    models = required_record(records, FILE, spec).models
    if not models:
        raise OutputError(
            "the run has no drift term: no tested model was better than none",
            hint="there is nothing to export",
        )
    if models[0].form == OVER_RATES.name:
        if spec.drift.compensation == "one_step":
            raise OutputError(
                "compensation 'one_step' removes the true rate (rate gain 0)",
                hint="fit with drift.compensation = 'recursive'",
            )
        found = _recursive(models, spec.segments.slope_window_s)
    else:
        found = _on_levels(models[0], spec.reference_temp_degc)
    return replace(found, trials=firmware_updates.thermal_history(found))


def _output(draft: Draft, source: str) -> None:
    """Declare the drift as the only output."""
    draft.output(
        "drift_dph",
        "deg/h",
        source,
        "drift, to be subtracted from the indication",
        corrects="gyro_dph",
    )


def _on_levels(model: Model, reference_degc: float) -> Chain:
    """Chain of a level or lagged model: the sum of its terms, zero at rest at the reference
    temperature.
    """
    draft, h = Draft(), Fraction(model.value("interval"))
    middle, half = exact.span(*model.valid[CASE])
    reach = (middle - WIDEST * half, middle + WIDEST * half)
    draft.input(CASE, "degC", CASE_MEANING, reach)  # the map clamps it and sets the flag
    draft.map("x", CASE, model.valid[CASE], flag="TEMP_CLAMPED", beyond=BEYOND)
    fastest = FASTEST * _largest(model, RATE)
    lagged = model.form in (LAGGED.name, BANK.name)
    if model.form == BANK.name:
        pace = fastest / 60 / half
        _output(draft, firmware_bank.follow_bank(draft, model, h, pace, reference_degc))
    else:
        (_follow_coil if lagged else _follow_case)(draft, model, h, half)
        _output(draft, _terms(draft, model, reference_degc, middle, half))
    _ranges(draft, model, "coil" if lagged else "case")
    moved = f"the case moves by no more than {float(fastest):.3g} degC/min"
    return draft.chain(
        [model.form],
        FORMULA.format(reference=reference_degc),
        interval_s=float(h),
        condition=moved if lagged or _uses(model, RATE) else "",
    )


def _largest(model: Model, column: str) -> Fraction:
    """Largest magnitude of a fitted range; 1 if the range is only 0."""
    return max(abs(Fraction(limit)) for limit in model.valid[column]) or Fraction(1)


def _limited(draft: Draft, model: Model, name: str, source: str, column: str, flag: str) -> None:
    """Clamp a driver to its fitted range, in units of its largest fitted magnitude."""
    low, high = (Fraction(limit) / _largest(model, column) for limit in model.valid[column])
    draft.limit(name, source, low, high, flag)


def _limited_temperature(draft: Draft, model: Model, source: str) -> None:
    """Clamp the mapped temperature u to its fitted range."""
    middle, half = exact.span(*model.valid[CASE])
    low, high = ((Fraction(limit) - middle) / half for limit in model.valid[CASE])
    draft.limit("u", source, low, high, "TEMP_CLAMPED")


def _terms(
    draft: Draft, model: Model, reference_degc: float, middle: Fraction, half: Fraction
) -> str:
    """Sum of the drift terms of u, rate, gradient and gradient_rate, less the drift at rest at the
    reference temperature.
    """
    r, g, q = (_largest(model, column) for column in DRIVERS[1:])
    low, high = model.valid[CASE]
    *powers, s_rate, s_grad, s_grad2, s_temp_rate, s_grad_rate = numbers(model, *TERMS)
    static = exact.mapped(powers, middle, half)
    at_rest = exact.value(static, (Fraction(min(max(reference_degc, low), high)) - middle) / half)
    return draft.sum(
        "drift",
        draft.polynomial("by_gradient_rate", (s_grad_rate * q,), "", "gradient_rate"),
        draft.polynomial("by_gradient_squared", (s_grad2 * g * g,), "", "gradient", "gradient"),
        draft.polynomial("by_gradient", (s_grad * g,), "", "gradient"),
        draft.polynomial(
            "by_rate",
            exact.scale((s_rate + s_temp_rate * middle, s_temp_rate * half), r),
            "u",
            "rate",
        ),
        draft.polynomial("static", exact.add(static, (-at_rest,)), "u"),
    )


def _uses(model: Model, driver: str) -> bool:
    """Whether a level or lagged model depends on a driver."""
    _, _, _, _, s_rate, s_grad, s_grad2, s_temp_rate, s_grad_rate = numbers(model, *TERMS)
    entering = {
        RATE: (s_rate, s_temp_rate),
        GRADIENT: (s_grad, s_grad2),
        GRADIENT_RATE: (s_grad_rate,),
    }
    return any(entering[driver])


def _ranges(draft: Draft, model: Model, whose: str) -> None:
    """Append the fitted ranges in words."""
    for column, (low, high) in model.valid.items():
        draft.ranges.append(f"{column} of the {whose} {low:.4g} to {high:.4g}")


def _follow_coil(draft: Draft, model: Model, h: Fraction, half: Fraction) -> None:
    """Coil temperatures as differences lag = T_case − T_o and fall = T_o − T_i, both in units of
    `half`.

    The equations are solved exactly for a case temperature linear over an interval h: with a =
    exp(−h/τ_o), b = exp(−h/τ_i), lag ← a lag + τ_o (1 − a)/h ΔT and fall ← b fall + κ lag + λ ΔT, κ
    = τ_i (a − b)/(τ_o − τ_i), λ = (τ_i (1 − b) − τ_o κ)/h. States that are zero at rest keep full
    precision there.
    """
    tau = Fraction(model.value(LAGS[0]))
    fastest = FASTEST * _largest(model, RATE) / 60 / half
    draft.steps.append(Memory("x_before", "x", "same"))
    draft.sum("move", factor("x"), factor("x_before", -1))
    firmware_bank.bound_memory(draft, "move", 2 * BEYOND, fastest * h)
    firmware_bank.follow_lag(draft, "lag", h, tau, fastest)
    if _uses(model, GRADIENT) or _uses(model, GRADIENT_RATE):
        _follow_inner_coil(draft, model, (h, tau, exact.exp(-h / tau)), half)
    draft.sum("coil", factor("x"), factor("lag", -1))
    _limited_temperature(draft, model, "coil")
    draft.sum(
        "coil_rate",
        draft.polynomial("rate_of_lag", (60 * half / tau / _largest(model, RATE),), "", "lag"),
    )
    _limited(draft, model, "rate", "coil_rate", RATE, "RATE_CLAMPED")


def _follow_inner_coil(
    draft: Draft, model: Model, outer: tuple[Fraction, Fraction, Fraction], half: Fraction
) -> None:
    """Gradient of the outer to the inner coil temperature, and the rate of the gradient."""
    (h, tau, a), tau_i = outer, Fraction(model.value(LAGS[1]))
    b = exact.exp(-h / tau_i)
    carried = tau_i * (a - b) / (tau - tau_i) if tau != tau_i else h / tau * a
    moved = (tau_i * (1 - b) - tau * carried) / h
    draft.steps.append(Memory("fall_before", "fall", "zero"))
    draft.sum(
        "fall",
        draft.polynomial("fall_move", (moved,), "", "move"),
        draft.polynomial("fall_lag", (carried,), "", "lag_before"),
        draft.polynomial("fall_decay", (1 - b,), "", "fall_before", sign=-1),
        factor("fall_before"),
    )
    share = min(Fraction(1), tau_i / tau)
    firmware_bank.bound_memory(draft, "fall", 2 * BEYOND * share, draft.usual["lag"] * share)
    draft.sum(
        "coil_gradient",
        draft.polynomial("gradient_of_fall", (half / _largest(model, GRADIENT),), "", "fall"),
    )
    _limited(draft, model, "gradient", "coil_gradient", GRADIENT, "GRADIENT_CLAMPED")
    if _uses(model, GRADIENT_RATE):
        scale = 60 * half / _largest(model, GRADIENT_RATE)
        draft.sum(
            "coil_gradient_rate",
            draft.polynomial("gradient_rate_of_fall", (scale / tau_i,), "", "fall", sign=-1),
            draft.polynomial("gradient_rate_of_lag", (scale / tau,), "", "lag"),
        )
        _limited(draft, model, "gradient_rate", "coil_gradient_rate", GRADIENT_RATE, "RATE_CLAMPED")


def _follow_case(draft: Draft, model: Model, h: Fraction, half: Fraction) -> None:
    """Case temperature, its gradient to the air, and their rates from parabolas over the trailing
    window.
    """
    _limited_temperature(draft, model, "x")
    length, least = _window(h, Fraction(model.value("window")))

    def slope(name: str, source: str, column: str, unit: Fraction) -> None:
        table = draft.table(
            f"case_{name}_weights",
            exact.scale(_weights(h, length, least), unit / _largest(model, column)),
        )
        draft.steps.append(Slope(f"case_{name}", source, table, length, least, "RATE_STARTING"))
        _limited(draft, model, name, f"case_{name}", column, "RATE_CLAMPED")

    if _uses(model, RATE):
        fastest = FASTEST * _largest(model, RATE)
        draft.usual["case_rate.difference"] = min(2 * BEYOND, fastest * length * h / 60 / half)
        slope("rate", "x", RATE, half)
    if _uses(model, GRADIENT) or _uses(model, GRADIENT_RATE):
        middle, scale = exact.span(*model.valid[CASE])[0], _largest(model, GRADIENT)
        reach = (middle - 2 * BEYOND * half, middle + 2 * BEYOND * half)
        draft.input(AIR, "degC", AIR_MEANING, reach, "AIR_CLAMPED")
        draft.sum("apart", factor(CASE), factor(AIR, -1))
        table = draft.table(
            "wide_gradient_map", (Fraction(0), 1 / scale, Fraction(-2), Fraction(2))
        )
        draft.steps.append(Map("wide_gradient", "apart", table, "GRADIENT_CLAMPED"))
        if _uses(model, GRADIENT):
            _limited(draft, model, "gradient", "wide_gradient", GRADIENT, "GRADIENT_CLAMPED")
        if _uses(model, GRADIENT_RATE):
            slope("gradient_rate", "wide_gradient", GRADIENT_RATE, scale)


def _window(h: Fraction, window: Fraction) -> tuple[int, int]:
    """Number of values in a full window, and the smallest that gives a rate: LEAST_SAMPLES and half
    a window.
    """
    length = int(window / h) + 1
    half_window = -(-window // (2 * h)) + 1
    return length, max(LEAST_SAMPLES, int(half_window))


def _weights(h: Fraction, length: int, least: int) -> exact.Poly:
    """Rows of exact weights [1/min] of v_i − v_0, i = 1 … length − 1: slope of the least-squares
    parabola at its newest sample.

    With x = −i the parabola fitted to m values has the slope e₂ᵀ (AᵀA)⁻¹ Aᵀ v at its newest sample,
    A = (1, x, x²).
    """
    rows: list[Fraction] = []
    for m in range(least, length + 1):
        design = [(Fraction(1), Fraction(-i), Fraction(i * i)) for i in range(m)]
        normal = [
            [sum((row[j] * row[k] for row in design), Fraction(0)) for k in range(3)]
            for j in range(3)
        ]
        picked = exact.solve(normal, (Fraction(0), Fraction(1), Fraction(0)))
        weights = [
            sum((p * entry for p, entry in zip(picked, row, strict=True)), Fraction(0)) * 60 / h
            for row in design
        ]
        rows += [*weights[1:], *[Fraction(0)] * (length - m)]
    return tuple(rows)


def _recursive(models: Sequence[Model], slope_window_s: float) -> Chain:
    """Chain D ← D + Δ with Δ = Σ_j a_j(r) G^j of the side (heating or cooling) by the inputs of the
    previous update.
    """
    draft, h = Draft(), Fraction(models[0].value("interval"))
    cases = [model.valid[CASE] for model in models]
    middle, half = exact.span(min(low for low, _ in cases), max(high for _, high in cases))
    reach = (middle - 2 * half, middle + 2 * half)
    draft.input(CASE, "degC", CASE_MEANING, reach, "TEMP_CLAMPED")
    draft.input(AIR, "degC", AIR_MEANING, reach, "AIR_CLAMPED")
    fastest = 4 * max(_largest(model, RATE) for model in models)
    meaning = (
        f"rate of the air, slope by least squares over the {slope_window_s:g} s before the end of"
        " the interval"
    )
    draft.input(
        AIR_RATE, "degC/min", meaning, (-fastest, fastest)
    )  # the sides clamp it and set the flag
    draft.sum("apart", factor(CASE), factor(AIR, -1))
    sides, bounds = zip(*(_side(draft, model) for model in models), strict=True)
    draft.steps.append(Select("increment", AIR_RATE, sides, "HELD"))
    largest = max(bounds)
    longest = Fraction(2) ** exact.power_of_two(LONGEST_DRIFT * largest)
    draft.steps += [
        Memory("drift_before", "drift", "zero"),
        Memory("increment_before", "increment", "zero"),
    ]
    draft.sum("total", factor("increment_before"), factor("drift_before"))
    draft.limit("drift", "total", -longest, longest, "DRIFT_LIMITED")
    draft.limits |= {"drift_before": longest, "increment_before": largest}
    _output(draft, "drift")
    for model in models:
        _ranges(draft, model, f"{model.name} side")
    return draft.chain([model.form for model in models], RECURSIVE, interval_s=float(h))


def _side(draft: Draft, model: Model) -> tuple[Case, Fraction]:
    """Increment of one side as polynomials of the mapped rate times powers of the mapped gradient,
    and its largest magnitude [°/h].
    """
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
    terms: list[list[Term]] = []
    largest = Fraction(0)
    for i in (2, 1, 0):
        parts = [
            exact.scale(over_rate[j], comb(j, i) * g_middle ** (j - i) * g_half**i)
            for j in range(i, 3)
        ]
        factors, polynomial = (f"gradient_{name}",) * i, exact.add(*parts)
        terms.append(draft.polynomial(f"a_{name}_{i}", polynomial, f"rate_{name}", *factors))
        largest += sum(map(abs, polynomial))
    value = draft.sum(f"increment_{name}", *terms)
    return Case(
        value,
        1 if low > 0 else -1 if high < 0 else 0,
        draft.table(f"moving_{name}", (Fraction(model.value("slowest_rate")) / 2,)),
        name,
    ), largest


FIRMWARE = Firmware(files=lambda _: (FILE,), chain=_chain, apply=firmware_updates.apply)
