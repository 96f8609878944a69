"""Table runs of one gyro, repeated and over temperature: mean K and F0, polynomials over
temperature, response over rate, repeatability.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from calibkit.arrays import Array
from calibkit.coefficients import Figure
from calibkit.constants import DPH_PER_DPS
from calibkit.fit import orders
from calibkit.fit.solve import Fit
from calibkit.instruments.gyro_scale import (
    bent_response,
    contradictions,
    equation,
    forms,
    ordering,
    run_lines,
    table_runs,
)
from calibkit.instruments.gyro_scale.numeric import gjb_figures, line_terms, scale_factor
from calibkit.instruments.gyro_scale.recipe import GyroRecipe, OwnAxisRecipe
from calibkit.numeric import gum
from calibkit.numeric.least_squares import polynomial
from calibkit.numeric.least_squares.polynomial import TemperaturePolynomial
from calibkit.recipe import shared_errors

ROOM_DEGC = 5.0
"""Largest difference from the reference temperature [°C] of runs that count as repeated (GJB
2426A).
"""
VARIES_DEGC = 5.0
"""Least span of the runs' temperatures [°C] for a fit of K over temperature."""
LEAST_LEVELS = 3
"""Fewest temperatures that show a slope of K and F0."""
GRID = 9
"""Temperatures at which a polynomial's degrees of freedom are compared; the fewest are stated."""
LEAST_REPEATED = 2
"""Fewest repeated runs that show how they differ."""
UNLOGGED = (
    "temperature is not logged in every run: nothing is fitted over it, all runs count as repeated"
)


class Estimate(NamedTuple):
    """A result with its standard uncertainty and effective degrees of freedom."""

    value: float
    standard_uncertainty: float
    dof: float


@dataclass(frozen=True, slots=True)
class GyroOverRuns:
    """One gyro in all runs: the repeated runs at the reference temperature with their mean, and K
    and F0 over temperature.
    """

    gyro: str
    runs: tuple[table_runs.TableRun, ...]
    at_room: tuple[table_runs.TableRun, ...]
    K: Estimate
    """At the mean temperature of the repeated runs [1/deg]."""
    F0: Estimate
    """The same [1/s]."""
    correlation: float
    """Of K and F0."""
    response: tuple[Fit, equation.Terms] | None
    """Equation (1) where it has powers of the rate."""
    K_over_temperature: TemperaturePolynomial | None = None
    F0_over_temperature: TemperaturePolynomial | None = None
    slope: Estimate | None = None
    """Of the straight line through K over temperature [1/deg/°C]."""
    fitted: tuple[Fit, equation.Rows, equation.Terms] | None = None
    """Equation (1) of all runs, its rows and terms; None for a single run."""
    in_time: ordering.Ordering | None = None
    """Whether K changes with time since the runs began."""


def fit_over_runs(
    spec: OwnAxisRecipe,
    gyro: str,
    runs: Sequence[table_runs.TableRun],
    near: GyroOverRuns | None = None,
) -> GyroOverRuns:
    """Fit one gyro over all runs: the mean at the reference temperature, and K and F0 over
    temperature where the temperature varies. `near` is a fit of nearly the same runs.
    """
    temperature = np.array([run.temp_degc for run in runs])
    room = np.isnan(temperature) | (np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC)
    at_room = tuple(run for run, is_in in zip(runs, room, strict=True) if is_in) or tuple(runs)
    if len(runs) == 1:
        single = _of_single(runs[0].scale(gyro), spec)
        return GyroOverRuns(gyro, tuple(runs), at_room, *single, fit_response(spec, gyro, runs))
    varies = bool(np.isfinite(temperature).all() and np.ptp(temperature) >= VARIES_DEGC)
    rows = _rows(gyro, runs)
    if near and near.fitted:
        fitted, before, terms = near.fitted
        fitted = equation.refit(fitted, before, rows, terms)
    else:
        terms = _terms(spec, gyro, runs, rows, varies=varies)
        slope = np.array([np.mean([run.scale(gyro).K for run in runs])])
        shared = list(equation.shared_errors(rows, terms, slope, slope))
        stated = shared_errors.state_sizes(spec.errors, [e for e in shared if e.group == "run"])
        fitted = equation.fit(rows, terms, [*stated, *(e for e in shared if e.group != "run")])
    line = equation.best_line(terms, rows.rate_dps)
    K = fitted.restated(lambda p: line(p)[equation.SCALE][0])
    F0 = fitted.restated(lambda p: line(p)[equation.ZERO][0])
    if not line_terms.turns_both_ways(rows.rate_dps):
        # runs of one direction alone do not tell a bend of the response from F0
        hidden = F0.parameters[0] - terms.split(fitted.parameters).F0[0, 0]
        F0 = replace(F0, bounds=np.column_stack((F0.bounds, hidden * np.eye(len(F0.bounds), 1))))
    in_time = _order_in_time(fitted, rows, terms)
    if in_time and in_time.half_width:
        # a half-width that is known, as a rectangular distribution
        first = np.eye(len(K.parameters), 1)
        bounds = np.column_stack((K.bounds, in_time.half_width / np.sqrt(3.0) * first))
        K = replace(K, parameters=K.parameters + in_time.shift * first[:, 0], bounds=bounds)
    degc = np.array([np.mean([run.temp_degc for run in at_room])])
    at = terms.mapped(degc) if varies else np.zeros(1)
    K_at_room, F0_at_room = (_weigh(one, _powers(one, at)[0]) for one in (K, F0))
    both = fitted.restated(lambda p: np.stack([one[0, 0] for one in line(p)])).covariance
    size = float(np.sqrt(both[0, 0] * both[1, 1]))
    found = GyroOverRuns(
        gyro,
        tuple(runs),
        at_room,
        K_at_room,
        F0_at_room,
        float(both[0, 1]) / size if size > 0.0 else 0.0,
        (fitted, terms) if spec.response == "auto" and terms.powers else None,
        fitted=(fitted, rows, terms),
        in_time=in_time,
    )
    if not varies:
        return found
    # of the straight line through K(T) at the temperatures of the runs
    slope_of = np.linalg.pinv(np.column_stack((temperature, np.ones(temperature.size))))[0]
    return replace(
        found,
        K_over_temperature=curve_of(K, terms, temperature),
        F0_over_temperature=curve_of(F0, terms, temperature),
        slope=_weigh(K, slope_of @ _powers(K, terms.mapped(temperature))),
    )


def _order_in_time(
    fitted: Fit, rows: equation.Rows, terms: equation.Terms
) -> ordering.Ordering | None:
    """Whether K changes with time in the runs, beside what temperature changes."""
    if not max(terms.orders):
        return ordering.decide(rows, rows.indication, powers=terms.powers)
    mean, p = replace(rows, row_degc=rows.temp_degc[rows.run]), fitted.parameters
    warmed = equation.response(p, rows, terms) - equation.response(p, mean, terms)
    return ordering.decide(rows, rows.indication - warmed, np.inf, terms.powers)


def _rows(gyro: str, runs: Sequence[table_runs.TableRun]) -> equation.Rows:
    """Held rates of a gyro in all runs."""
    rates = [run.scale(gyro).rate_dps for run in runs]
    one = np.zeros(sum(map(len, rates)), dtype=np.int64)
    return equation.Rows(
        np.concatenate(rates),
        np.concatenate([run.indication(gyro) for run in runs]),
        np.repeat(np.arange(len(runs)), list(map(len, rates))),
        np.concatenate([run.plateaus.temp_degc for run in runs]),
        np.concatenate([run.plateaus.hours for run in runs]),
        one,
        one,
    )


def _terms(
    spec: OwnAxisRecipe,
    gyro: str,
    runs: Sequence[table_runs.TableRun],
    rows: equation.Rows,
    *,
    varies: bool,
) -> equation.Terms:
    """Terms of the equation that the runs carry and ask for."""
    levels = np.unique(np.round(rows.temp_degc)).size if varies else 1
    order = orders.orders(len(runs), levels, polynomial.HIGHEST_ORDER)[-1]
    if levels >= LEAST_LEVELS:
        order = max(order, equation.LOWEST_ORDER)
    terms = equation.Terms(
        orders=(order, order),
        middle_half=polynomial.middle_and_half(rows.row_degc) if order else (0.0, 1.0),
        fastest_dps=float(np.max(np.abs(rows.rate_dps))),
    )
    if spec.response == "auto":
        bent = bent_response.choose(rows, terms)
        if bent.powers:
            return bent
    corrected = np.concatenate([run.scale(gyro).indication for run in runs])
    shapes = run_lines.find_shapes(rows, corrected)
    return replace(terms, shapes=shapes, bends="constant" if rows.both_ways else "as K")


def _powers(curve: Fit, x: Array) -> Array:
    """Powers [n, order + 1] of mapped temperatures [n] for the polynomial of a fit."""
    return polynomial.powers(x, curve.parameters.size - 1)


def _weigh(curve: Fit, weights: Array) -> Estimate:
    """Sum of the coefficients of a polynomial with weights [order + 1]."""
    found = curve.of(lambda p: weights @ p)
    return Estimate(float(found.value), float(found.u), float(found.dof))


def curve_of(curve: Fit, terms: equation.Terms, temp_degc: Array) -> TemperaturePolynomial:
    """Polynomial of a fit in raw powers, over the temperatures [r] [°C] of the runs."""
    order = curve.parameters.size - 1
    raw, covariance = polynomial.in_raw_powers(
        curve.parameters,
        curve.total_covariance,
        polynomial.to_raw_powers(*terms.middle_half, order),
    )
    low, high = float(temp_degc.min()), float(temp_degc.max())
    x = terms.mapped(np.linspace(low, high, GRID))
    dof = curve.of(lambda p: polynomial.powers(x, order) @ p).dof
    noise = float(curve.noise[0])
    return TemperaturePolynomial(raw, covariance, max(int(np.min(dof)), 1), noise, (low, high))


def list_undetermined(gyros: Sequence[GyroOverRuns]) -> tuple[str, ...]:
    """What the runs of the gyros do not determine, and what it takes."""
    lacks = []
    if any(gyro.K_over_temperature is None for gyro in gyros):
        lacks.append(
            f"K and F0 over temperature: log runs at temperatures {VARIES_DEGC:g} °C apart or more"
        )
    if any(len(gyro.at_room) < LEAST_REPEATED for gyro in gyros):
        lacks.append("repeatability: log two runs or more at the reference temperature")
    return tuple(lacks)


def _of_single(
    line: scale_factor.ScaleFactor, spec: OwnAxisRecipe
) -> tuple[Estimate, Estimate, float]:
    """K and F0 of a single run with the repeatability that the recipe states, and their
    correlation.
    """
    size = {"scale": abs(line.K) / gjb_figures.PPM, "zero": abs(line.K) / DPH_PER_DPS}
    known = {effect: (value * size[effect], dof) for effect, value, dof in spec.known_errors()}
    found = []
    for value, effect, variance in zip(
        (line.K, line.F0), ("scale", "zero"), np.diag(line.covariance).tolist(), strict=True
    ):
        between, between_dof = known.get(effect, (0.0, np.inf))
        total = variance + between**2
        spread = variance**2 / max(line.dof, 1) + between**4 / between_dof
        dof = total**2 / spread if spread > 0.0 else float(line.dof)
        found.append(Estimate(value, float(np.sqrt(total)), dof))
    K, F0 = found
    product = K.standard_uncertainty * F0.standard_uncertainty
    return K, F0, float(line.covariance[0, 1]) / product if product > 0.0 else 0.0


def _points(gyro: str, runs: Sequence[table_runs.TableRun], name: str) -> tuple[Array, Array]:
    """K or F0 of a gyro in q runs [q], and their standard uncertainties [q]."""
    lines, number = [run.scale(gyro) for run in runs], scale_factor.TERMS.index(name)
    return (
        np.array([getattr(line, name) for line in lines]),
        np.array([float(line.standard_uncertainty[number]) for line in lines]),
    )


def fit_response(
    spec: OwnAxisRecipe, gyro: str, runs: Sequence[table_runs.TableRun]
) -> tuple[Fit, equation.Terms] | None:
    """Equation (1) of the runs of a gyro without errors that they share; None where the recipe asks
    for the line alone, or no power of the rate is asked for.
    """
    rows = _rows(gyro, runs)
    terms = _terms(spec, gyro, runs, rows, varies=False)
    if spec.response == "line" or not terms.powers:
        return None
    return equation.fit(rows, terms, ()), terms


def run_figures(name: str, one: GyroOverRuns, spec: OwnAxisRecipe) -> list[Figure]:
    """Figures of repeatability and temperature sensitivity, where the runs determine them."""
    figures = []
    if _repeats(one):
        at_room, _ = _points(one.gyro, one.at_room, "K")
        value = gjb_figures.repeatability(at_room)
        u = value / float(np.sqrt(2.0 * (at_room.size - 1)))
        figures.append(
            Figure(forms.FigureName("repeatability", gjb_figures.GJB, name).text, value, "ppm", u)
        )
    if one.K_over_temperature is None:
        return figures
    temperature = np.array([run.temp_degc for run in one.runs])
    size = gjb_figures.PPM / abs(one.K[0])
    assert one.slope is not None  # noqa: S101 (there is a curve)
    u_slope = one.slope.standard_uncertainty * gum.widening(one.slope.dof)
    kinds = [(gjb_figures.IEEE, one.slope.value, u_slope)]
    room = np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC
    if room.any() and not room.all():
        K, u_K = _points(one.gyro, one.runs, "K")
        value, u = _propagated(
            lambda values: gjb_figures.temperature_sensitivity(
                values, temperature, spec.reference_temp_degc
            ),
            K,
            np.hypot(u_K, _scatter(one)),
        )
        kinds.insert(0, (gjb_figures.GJB, value / size, u / size))
    for standard, value, u in kinds:
        text = forms.FigureName("temperature_sensitivity", standard, name).text
        figures.append(Figure(text, value * size, "ppm/degC", u * size))
    return figures


def _scatter(one: GyroOverRuns) -> float:
    """Standard deviation of K between runs, at the reference temperature and about K(T); raised by
    Student's t for few runs.
    """
    found = []
    if _repeats(one):
        K, _ = _points(one.gyro, one.at_room, "K")
        found.append((K.size - 1, float(np.var(K, ddof=1))))
    curve = one.K_over_temperature
    if curve is not None and curve.dof > 0:
        found.append(
            (curve.dof, curve.residual_rms**2 * (1.0 + curve.coefficients.size / curve.dof))
        )
    if not found:
        return 0.0
    # runs at the reference temperature are in both: the larger count is that of independent ones
    dof = max(count for count, _ in found)
    variance = sum(count * square for count, square in found) / sum(count for count, _ in found)
    return float(np.sqrt(variance)) * gum.widening(dof)


def _repeats(one: GyroOverRuns) -> bool:
    """Whether the mean is of several runs, all at one temperature or all without a known
    temperature.
    """
    temperature = np.array([run.temp_degc for run in one.at_room])
    alike = np.isnan(temperature).any() or np.ptp(temperature) <= 2.0 * ROOM_DEGC
    return bool(temperature.size > 1 and alike)


def _propagated(
    function: Callable[[Array], float], values: Array, uncertainty: Array
) -> tuple[float, float]:
    """Value of a function and its standard uncertainty from those of independent values, by finite
    differences.
    """
    at = function(values)
    steps = [
        function(values + u * row) - at
        for u, row in zip(uncertainty, np.eye(values.size), strict=True)
    ]
    return at, float(np.sqrt(np.sum(np.square(steps))))


def _flag_between(one: GyroOverRuns, spec: GyroRecipe) -> Iterator[str]:
    """Flags on what the runs cannot tell of their repeatability and of the response."""
    name, cure = forms.line_name(one.gyro), 'state [[errors.component]] group = "run"'
    stated = {entry.effect for entry in spec.errors.component}
    unknown = [effect for effect in ("scale", "zero") if effect not in stated]
    if one.fitted is None and unknown:
        yield (
            f"{name}: one run does not show how runs repeat; u of K and F0 holds within this run"
            f" only: repeat it, or {cure}, effect = {' and '.join(map(repr, unknown))}"
        )
    for letter, found in (("K", one.K), ("F0", one.F0)):
        if one.fitted is not None and found.dof < shared_errors.FEW_DOF:
            factor = gum.coverage_factor(found.dof)
            yield (
                f"{name}: {letter} has {found.dof:.2g} degrees of freedom between"
                f" {len(one.runs)} runs, its interval is ± {factor:.3g} standard uncertainties:"
                f" add runs, or {cure}"
            )
    sides = {float(s) for run in one.runs for s in np.sign(run.plateaus.rate_dps) if s}
    if len(sides) == 1 and (
        (one.fitted and one.fitted[2].shapes)
        or set(one.runs[0].scale(one.gyro).terms) & set(line_terms.CURVATURES)
    ):
        yield (
            f"{name}: every run turns one way and the response is bent: F0, the bias and the other"
            " direction are not known from these runs; run the table both ways"
        )


def flag_runs(gyros: Sequence[GyroOverRuns], spec: GyroRecipe) -> tuple[str, ...]:
    """Flags of figures over several runs."""
    runs = gyros[0].runs
    flags = [flag for run in runs for flag in run.flags]
    # a bend of the response is no noise of the line of a run
    straight = [one for one in gyros if one.response is None]
    for one in straight:
        for run in runs:
            flags += table_runs.flag_uncertain(
                f"{forms.line_name(one.gyro)} in {run.log.file}", run.scale(one.gyro)
            )
    for one in gyros:
        flags += contradictions.flag_runs(forms.line_name(one.gyro), one.gyro, one.at_room)
        flags += _flag_between(one, spec)
        if one.K_over_temperature is not None:
            flags += contradictions.flag_runs(forms.line_name(one.gyro), one.gyro, one.runs)
        flags += ordering.flag(forms.line_name(one.gyro), one.in_time, one.K.value)
    temperature = np.array([run.temp_degc for run in runs])
    near = np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC
    if len(temperature) > 1 and np.isnan(temperature).any():
        flags.append(UNLOGGED)
    elif not near.any() and np.isfinite(temperature).all():
        flags.append(
            f"no run within {ROOM_DEGC:g} °C of {spec.reference_temp_degc:g} °C: the mean is that"
            f" of all runs, {temperature.min():.1f} to {temperature.max():.1f} °C"
        )
    return tuple(dict.fromkeys(flags))
