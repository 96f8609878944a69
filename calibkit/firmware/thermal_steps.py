"""Steps by which firmware follows a bias that depends on the case temperature, its rate and lagged
temperatures, once per interval.
"""

from collections.abc import Iterable
from fractions import Fraction

from calibkit.firmware import exact
from calibkit.firmware.draft import Draft, factor, number_or_zero, numbers
from calibkit.firmware.pace import FASTEST
from calibkit.firmware.steps import Map, Memory, Slope
from calibkit.numeric.thermal import coil
from calibkit.numeric.thermal.terms import CASE, DRIVERS, GRADIENT, LAGS, RATE, TERMS
from calibkit.records.coefficients import Model

GRADIENT_RATE = DRIVERS[3]
AIR = "temp_env_degc"
CASE_MEANING = "temperature of the sensor case, mean of the interval"
AIR_MEANING = "temperature of the air around the sensor, mean of the interval"
UNWEIGHED = "weighed by 0: hand over the case temperature where there is no thermometer of the air"
WIDER = Fraction(1, 4)
"""How far an input's word reaches beyond each end of the range in which the case is followed, over
that range.
"""
AIR_APART_DEGC = 60
"""How far the air may be from a case that is followed."""
UNUSED = Fraction(2**20)
"""Limit of a driver that a padded chain follows though its model does not use it."""
LEAST_SAMPLES = 4
"""Fewest values for the rate of a level model; they must also span half a window."""


Mapped = tuple[Fraction, Fraction]
"""Middle and half range [°C] by which the case temperature is mapped to x."""


def followed(model: Model) -> tuple[float, float]:
    """Case temperatures [°C] that the chain of a model follows."""
    return coil.followed_range(*model.valid[CASE])


def say_followed(span: tuple[float, float]) -> str:
    """What a header states beside the fitted ranges."""
    return f"these; the case is followed from {exact.limits_text(*span)} degC, as by apply"


def reach_of(spans: Iterable[tuple[float, float]]) -> Mapped:
    """Range [°C] of the word of a case temperature that is followed over these."""
    ends = [*spans]
    low, high = Fraction(min(low for low, _ in ends)), Fraction(max(high for _, high in ends))
    return low - WIDER * (high - low), high + WIDER * (high - low)


def span_of_case(draft: Draft) -> Fraction:
    """Width [u] of the range in which "x" follows the case."""
    low, high = draft.tables["x_map"][2:]
    return high - low


def follow_terms(
    draft: Draft, model: Model, h: Fraction, reference_degc: float, mapped: Mapped
) -> str:
    """Bias of a level or lagged model from the mapped case temperature "x" at an interval h [s]:
    the sum of its terms, zero at rest at the reference temperature.
    """
    (_follow_lags if _is_lagged(model) else _follow_case)(draft, model, h, mapped)
    return _sum_terms(draft, model, reference_degc, *mapped)


def _is_lagged(model: Model) -> bool:
    """Whether a model has lags, so that it follows no window of the case temperature."""
    return any(coefficient.name == LAGS[0] for coefficient in model.coefficients)


def largest(model: Model, column: str) -> Fraction:
    """Largest magnitude of a fitted range; 1 if the range is only 0."""
    return max(abs(Fraction(limit)) for limit in model.valid[column]) or Fraction(1)


def _limited(draft: Draft, model: Model, name: str, source: str, column: str, flag: str) -> None:
    """Clamp a driver to its fitted range, in units of its largest fitted magnitude; one that the
    model does not use is never at its limit.
    """
    low, high = (Fraction(limit) / largest(model, column) for limit in model.valid[column])
    if not uses(model, column):
        low, high = -UNUSED, UNUSED
    draft.limit(name, source, low, high, flag)


def _limited_temperature(draft: Draft, model: Model, source: str, mapped: Mapped) -> None:
    """Clamp the mapped temperature u to its fitted range."""
    middle, half = mapped
    low, high = ((Fraction(limit) - middle) / half for limit in model.valid[CASE])
    draft.limit("u", source, low, high, "TEMP_CLAMPED")


def _sum_terms(
    draft: Draft, model: Model, reference_degc: float, middle: Fraction, half: Fraction
) -> str:
    """Sum of the drift terms of u, rate, gradient and gradient_rate, less the drift at rest at the
    reference temperature.
    """
    # drivers come in units of their largest fitted magnitude
    r, g, q = (largest(model, column) for column in DRIVERS[1:])
    low, high = model.valid[CASE]
    *powers, s_rate, s_grad, s_grad2, s_temp_rate, s_grad_rate = numbers(model, *TERMS)
    static = exact.mapped(powers, middle, half)
    # subtracted exactly here, not as a difference of two rounded polynomials in the product
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


def uses(model: Model, driver: str) -> bool:
    """Whether a level or lagged model depends on a driver."""
    _, _, _, _, s_rate, s_grad, s_grad2, s_temp_rate, s_grad_rate = numbers(model, *TERMS)
    entering = {
        RATE: (s_rate, s_temp_rate),
        GRADIENT: (s_grad, s_grad2),
        GRADIENT_RATE: (s_grad_rate,),
    }
    return any(entering[driver])


def _follow_lags(draft: Draft, model: Model, h: Fraction, mapped: Mapped) -> None:
    """Coil temperatures as differences lag = T_case − T_o and fall = T_o − T_i, both in units of
    `half`.

    The equations are solved exactly for a case temperature linear over an interval h: with a =
    exp(−h/τ_o), b = exp(−h/τ_i), lag ← a lag + τ_o (1 − a)/h ΔT and fall ← b fall + κ lag + λ ΔT, κ
    = τ_i (a − b)/(τ_o − τ_i), λ = (τ_i (1 − b) − τ_o κ)/h. States that are zero at rest keep full
    precision there.
    """
    tau, half = Fraction(model.value(LAGS[0])), mapped[1]
    gradient, gradient_rate = (draft.padded or uses(model, name) for name in DRIVERS[2:])
    fastest = FASTEST * largest(model, RATE) / 60 / half
    draft.steps.append(Memory("x_before", "x", "same"))
    draft.sum("move", factor("x"), factor("x_before", -1))
    bound_memory(draft, "move", span_of_case(draft), fastest * h)
    follow_lag(draft, "lag", h, tau, fastest)
    if gradient or gradient_rate:
        _follow_inner(draft, model, (h, tau, exact.exp(-h / tau)), half)
    draft.sum("coil", factor("x"), factor("lag", -1))
    _limited_temperature(draft, model, "coil", mapped)
    draft.sum(
        "coil_rate",
        draft.polynomial("rate_of_lag", (60 * half / tau / largest(model, RATE),), "", "lag"),
    )
    _limited(draft, model, "rate", "coil_rate", RATE, "RATE_CLAMPED")


def _follow_inner(
    draft: Draft, model: Model, outer: tuple[Fraction, Fraction, Fraction], half: Fraction
) -> None:
    """Gradient of the outer to the inner coil temperature, and the rate of the gradient."""
    h, tau, a = outer
    # a model without an inner lag has no gradient: a padded chain follows one and weighs it by 0
    tau_i = number_or_zero(model, LAGS[1]) or tau
    b = exact.exp(-h / tau_i)
    lag_weight = tau_i * (a - b) / (tau - tau_i) if tau != tau_i else h / tau * a
    move_weight = (tau_i * (1 - b) - tau * lag_weight) / h
    draft.steps.append(Memory("fall_before", "fall", "zero"))
    draft.sum(
        "fall",
        draft.polynomial("fall_move", (move_weight,), "", "move"),
        draft.polynomial("fall_lag", (lag_weight,), "", "lag_before"),
        draft.polynomial("fall_decay", (1 - b,), "", "fall_before", sign=-1),
        factor("fall_before"),
    )
    share = min(Fraction(1), tau_i / tau)
    draft.ramped["fall"] = draft.ramped["lag"] * share
    bound_memory(draft, "fall", span_of_case(draft) * share, draft.usual["lag"] * share)
    draft.sum(
        "coil_gradient",
        draft.polynomial("gradient_of_fall", (half / largest(model, GRADIENT),), "", "fall"),
    )
    _limited(draft, model, "gradient", "coil_gradient", GRADIENT, "GRADIENT_CLAMPED")
    if draft.padded or uses(model, GRADIENT_RATE):
        scale = 60 * half / largest(model, GRADIENT_RATE)
        draft.sum(
            "coil_gradient_rate",
            draft.polynomial("gradient_rate_of_fall", (scale / tau_i,), "", "fall", sign=-1),
            draft.polynomial("gradient_rate_of_lag", (scale / tau,), "", "lag"),
        )
        _limited(draft, model, "gradient_rate", "coil_gradient_rate", GRADIENT_RATE, "RATE_CLAMPED")


def _follow_case(draft: Draft, model: Model, h: Fraction, mapped: Mapped) -> None:
    """Case temperature, its gradient to the air, and their rates from parabolas over the trailing
    window.
    """
    _limited_temperature(draft, model, "x", mapped)
    half = mapped[1]
    length, fewest = _window(h, Fraction(model.value("window")))

    def slope(name: str, source: str, column: str, unit: Fraction) -> None:
        table = draft.table(
            f"case_{name}_weights",
            exact.scale(_weights(h, length, fewest), unit / largest(model, column)),
        )
        draft.steps.append(Slope(f"case_{name}", source, table, length, fewest, "STARTING"))
        _limited(draft, model, name, f"case_{name}", column, "RATE_CLAMPED")

    rate, gradient, gradient_rate = (draft.padded or uses(model, name) for name in DRIVERS[1:])
    if rate:
        fastest = FASTEST * largest(model, RATE)
        largest_move = fastest * length * h / 60 / half
        draft.usual["case_rate.difference"] = min(span_of_case(draft), largest_move)
        slope("rate", "x", RATE, half)
    if gradient or gradient_rate:
        scale = largest(model, GRADIENT)
        low, high = map(Fraction, followed(model))
        reach = (low - AIR_APART_DEGC, high + AIR_APART_DEGC)
        weighs_gradient = uses(model, GRADIENT) or uses(model, GRADIENT_RATE)
        draft.input(
            AIR, "degC", AIR_MEANING, reach, "AIR_CLAMPED", "" if weighs_gradient else UNWEIGHED
        )
        draft.sum("apart", factor(CASE), factor(AIR, -1))
        wide = Fraction(2) if uses(model, GRADIENT) else (reach[1] - reach[0]) / scale
        table = draft.table("wide_gradient_map", (Fraction(0), 1 / scale, -wide, wide))
        draft.steps.append(Map("wide_gradient", "apart", table, "GRADIENT_CLAMPED"))
        if gradient:
            _limited(draft, model, "gradient", "wide_gradient", GRADIENT, "GRADIENT_CLAMPED")
        if gradient_rate:
            slope("gradient_rate", "wide_gradient", GRADIENT_RATE, scale)


def _window(h: Fraction, window: Fraction) -> tuple[int, int]:
    """Number of values in a full window, and the smallest that gives a rate: LEAST_SAMPLES and half
    a window.
    """
    length = int(window / h) + 1
    half_window = -(-window // (2 * h)) + 1
    return length, max(LEAST_SAMPLES, int(half_window))


def _weights(h: Fraction, length: int, fewest: int) -> exact.Poly:
    """Rows of exact weights [1/min] of v_i − v_0, i = 1 … length − 1: slope of the least-squares
    parabola at its newest sample.

    With x = −i the parabola fitted to m values has the slope e₂ᵀ (AᵀA)⁻¹ Aᵀ v at its newest sample,
    A = (1, x, x²).
    """
    rows: list[Fraction] = []
    for m in range(fewest, length + 1):
        design = [(Fraction(1), Fraction(-i), Fraction(i * i)) for i in range(m)]
        normal = [
            [sum((row[j] * row[k] for row in design), Fraction(0)) for k in range(3)]
            for j in range(3)
        ]
        # (AᵀA)⁻¹ e₂, whose product with a row of A is the weight of that row's value
        picked = exact.solve(normal, (Fraction(0), Fraction(1), Fraction(0)))
        weights = []
        for row in design:
            weight = sum((p * entry for p, entry in zip(picked, row, strict=True)), Fraction(0))
            weights.append(weight * 60 / h)
        rows += [*weights[1:], *[Fraction(0)] * (length - m)]
    return tuple(rows)


def follow_lag(draft: Draft, name: str, h: Fraction, tau: Fraction, fastest: Fraction) -> None:
    """Difference x − L(τ) x of the mapped case temperature x, from its change "move" over an
    interval h: lag ← a lag + τ (1 − a)/h ΔT, a = exp(−h/τ).
    """
    a = exact.exp(-h / tau)
    draft.steps.append(Memory(f"{name}_before", name, "zero"))
    draft.sum(
        name,
        draft.polynomial(f"{name}_decay", (1 - a,), "", f"{name}_before", sign=-1),
        draft.polynomial(f"{name}_move", (tau * (1 - a) / h,), "", "move"),
        factor(f"{name}_before"),
    )
    # behind a case that crosses all of its range at that pace
    width, largest_lag = span_of_case(draft), fastest * tau
    draft.ramped[name] = largest_lag / FASTEST
    bound_memory(draft, name, width, largest_lag * (1 - exact.exp(-width / largest_lag)))


def bound_memory(draft: Draft, name: str, limit: Fraction, usual: Fraction) -> None:
    """Bounds of a value and of its memory; the filters amplify an error of x by at most 2."""
    for key in (name, f"{name}_before"):
        draft.limits[key], draft.usual[key] = limit, usual
    draft.gains[name] = Fraction(2)
