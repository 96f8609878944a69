"""Steps of a bank of lags in firmware.

    drift = Σ_k [(a_k + c_k z) ρ_k + b_k z_k ρ_k] + Σ_n s_n z^n + table(u) + Σ h (p − T)/c
            + Σ w (1 − f) − the same static terms at rest at the reference

k counts the lags of the bank (time constants τ_k); T_k is the case temperature behind lag k and ρ_k
its rate. x is the case temperature mapped to [−1, 1] over the fitted range, u the temperature T of
the coil (two further lags), mapped and clamped so; z and z_k are T and T_k about ORIGIN_DEGC in
SCALE_DEGC. p are play operators of half width c (hysteresis), f grows from 0 to 1 after the reset
(warm-up). A lag is kept as the difference x − T_k ("lag_k"), whose step is exact for a temperature
that is linear over an interval.
"""

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

from calibkit.coefficients import Model
from calibkit.firmware import exact, thermal_steps
from calibkit.firmware.chain import ChainTerm, Memory, Play
from calibkit.firmware.draft import Draft, factor, number_or_zero, numbers
from calibkit.instruments.bias.forms import read_bank
from calibkit.instruments.bias.numeric.bank import (
    ORIGIN_DEGC,
    POWERS,
    SCALE_DEGC,
    STATIC_LAGS,
    Bank,
)
from calibkit.instruments.bias.numeric.bank_fit import WARM_UP_S, WIDTHS_DEGC
from calibkit.numeric.thermal.terms import CASE, RATE

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
    coldest, hottest = map(Fraction, model.valid[CASE])
    low, high = (coldest - middle) / half, (hottest - middle) / half
    at_rest = (min(max(Fraction(reference_degc), coldest), hottest) - middle) / half
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
    table, offset = _table(draft, model, bank, (middle, half), at_rest)
    constant = -exact.value(static, at_rest) - offset

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
    return draft.sum(
        "drift",
        rates,
        table,
        _hysteresis(draft, model, bank, (middle, half)),
        _warm_up(draft, model, bank, h),
        draft.polynomial("static_terms", exact.add(static, (constant,)), "u"),
    )


def _table(
    draft: Draft,
    model: Model,
    bank: Bank,
    span: tuple[Fraction, Fraction],
    at_rest: Fraction,
) -> tuple[list[ChainTerm], Fraction]:
    """Terms of the table over temperature, one per segment between knots: slope times u limited to
    the segment; and their sum at rest at the reference.
    """
    middle, half = span
    knots = [(Fraction(knot) - middle) / half for knot in bank.knots]
    values = numbers(model, *(f"g{k}" for k in range(1, len(knots) + 1)))
    terms: list[ChainTerm] = []
    offset = Fraction(0)
    for k, ((low, high), (first, last)) in enumerate(
        zip(pairwise(knots), pairwise(values), strict=True), start=1
    ):
        slope = (last - first) / (high - low)
        draft.limit(f"segment_{k}", "u", low, high, "")
        terms += draft.polynomial(f"slope_{k}", (slope,), "", f"segment_{k}")
        offset += slope * min(max(at_rest, low), high)
    return terms, offset


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


def _warm_up(draft: Draft, model: Model, bank: Bank, h: Fraction) -> list[ChainTerm]:
    """Terms of the warm-up since the reset: w (1 − f), f ← f + (1 − a)(1 − f) from 0."""
    terms: list[ChainTerm] = []
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
        terms += draft.polynomial(f"{name}_weight", (weight,), "")
        terms += draft.polynomial(f"{name}_faded", (-weight,), "", f"{name}_before")
    return terms
