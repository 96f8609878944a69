"""Table runs of one gyro, repeated and over temperature: mean K and F0, polynomials over
temperature, response over rate, repeatability.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.coefficients import Figure, Model
from calibkit.fit import orders
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.forms import POLYNOMIAL
from calibkit.instruments.gyro_scale import (
    bent_response,
    contradictions,
    equation,
    forms,
    lines,
    ordering,
    table_runs,
)
from calibkit.instruments.gyro_scale.numeric import gjb_figures, line_terms
from calibkit.instruments.gyro_scale.numeric.gjb_figures import ROOM_DEGC
from calibkit.instruments.gyro_scale.recipe import GyroRecipe, OwnAxisRecipe
from calibkit.numeric import gum
from calibkit.numeric.least_squares import polynomial
from calibkit.recipe import shared_errors

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


@dataclass(frozen=True, slots=True)
class GyroOverRuns:
    """One gyro in all runs: the repeated runs at the reference temperature with their mean, and K
    and F0 over temperature.
    """

    gyro: str
    runs: tuple[table_runs.TableRun, ...]
    room: Mask
    """Which runs [r] are repeated ones."""
    K_of_runs: Value
    """[r, 1/deg], within each run."""
    line: Fit
    """K [1/deg] and F0 [1/s] at the mean temperature of the repeated runs."""
    fitted: equation.Fitted
    """Equation (1) of all runs."""
    in_time: ordering.Ordering | None
    """Whether K changes with time since the runs began."""
    response: equation.Fitted | None
    """The same where it has powers of the rate."""
    curves: tuple[Model, ...] = ()
    """K and F0 over temperature, where it varies."""
    slope: Value | None = None
    """Of the straight line through K over temperature [1/deg/°C]."""

    @property
    def at_room(self) -> tuple[table_runs.TableRun, ...]:
        """The repeated runs."""
        return tuple(run for run, chosen in zip(self.runs, self.room, strict=True) if chosen)

    @property
    def temp_degc(self) -> Array:
        """Temperatures [r] of the runs, NaN where they are not known."""
        return np.array([run.temp_degc for run in self.runs])

    @property
    def K(self) -> Value:  # noqa: N802 - the letter of the standards
        """Scale factor [1/deg] at the mean temperature of the repeated runs."""
        return self.line.of(lambda p: p[0])

    @property
    def F0(self) -> Value:  # noqa: N802 - the letter of the standards
        """Zero-rate indication [1/s] there."""
        return self.line.of(lambda p: p[1])


def fit_over_runs(
    spec: OwnAxisRecipe,
    gyro: str,
    runs: Sequence[table_runs.TableRun],
    run_lines: lines.Lines,
    near: GyroOverRuns | None = None,
) -> GyroOverRuns:
    """Fit one gyro over all runs: the mean at the reference temperature, and K and F0 over
    temperature where the temperature varies. `run_lines` are the lines of the single runs, `near`
    is a fit of nearly the same runs.
    """
    temperature = np.array([run.temp_degc for run in runs])
    room = np.isnan(temperature) | (np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC)
    room = room if room.any() else ~room
    varies = bool(np.isfinite(temperature).all() and np.ptp(temperature) >= VARIES_DEGC)
    rows = _rows(gyro, runs)
    if near:
        fitted, _, terms = near.fitted.refit(rows)
    else:
        terms = _terms(spec, rows, varies=varies)
        shared = list(equation.shared_errors(rows, terms, rows.slopes, rows.slopes))
        stated = shared_errors.state_sizes(spec.errors, [e for e in shared if e.group == "run"])
        fitted = equation.fit(rows, terms, [*stated, *(e for e in shared if e.group != "run")])
    whole = equation.Fitted(fitted, rows, terms)
    in_time = _order_in_time(whole)
    curves = _over_temperature(whole, in_time)
    size = curves.parameters.size // 2
    x = terms.mapped(temperature[room].mean(keepdims=True)) if varies else np.zeros(1)
    powers: Array = np.asarray(np.kron(np.eye(2), polynomial.powers(x, size - 1)))
    found = GyroOverRuns(
        gyro,
        tuple(runs),
        room,
        run_lines.of_runs(runs, gyro),
        curves.weighted(powers),
        whole,
        in_time,
        whole if spec.response == "auto" and terms.powers else None,
    )
    if not varies:
        return found
    K, F0 = (curves.weighted(part) for part in np.vsplit(np.eye(2 * size), 2))
    name = forms.line_name(gyro)
    # of the straight line through K(T) at the temperatures of the runs
    slope_of = np.linalg.pinv(np.column_stack((temperature, np.ones(temperature.size))))[0]
    weights = slope_of @ polynomial.powers(terms.mapped(temperature), size - 1)
    return replace(
        found,
        curves=(
            curve_model(forms.curve_name(name, "K"), "1/deg", K, terms, runs),
            curve_model(forms.curve_name(name, "F0"), "1/s", F0, terms, runs),
        ),
        slope=K.of(lambda p: weights @ p),
    )


def _over_temperature(whole: equation.Fitted, in_time: ordering.Ordering | None) -> Fit:
    """Polynomials of K, then of F0, of the best straight line [2 (order + 1)], with what the runs
    leave open.
    """
    fitted, rows, terms = whole
    line = equation.best_line(terms, rows.rate_dps)
    curves = fitted.restated(lambda p: np.concatenate(line(p), axis=1)[0])
    F0 = curves.parameters.size // 2
    hidden, shift, half_width = 0.0, 0.0, 0.0
    if not line_terms.turns_both_ways(rows.rate_dps):
        # runs of one direction alone do not tell a bend of the response from F0
        hidden = curves.parameters[F0] - terms.split(fitted.parameters).F0[0, 0]
    if in_time:
        shift, half_width = in_time.shift, in_time.half_width
    # a half-width that is known, as a rectangular distribution
    bounds = np.zeros((curves.parameters.size, 2))
    bounds[0, 0], bounds[F0, 1] = half_width / np.sqrt(3.0), hidden
    parameters = curves.parameters + shift * np.eye(curves.parameters.size)[0]
    return replace(curves, parameters=parameters, bounds=np.hstack((curves.bounds, bounds)))


def _order_in_time(whole: equation.Fitted) -> ordering.Ordering | None:
    """Whether K changes with time in the runs, beside what temperature changes."""
    fitted, rows, terms = whole
    if not max(terms.orders):
        return ordering.decide(rows, rows.indication, powers=terms.powers)
    mean, p = replace(rows, row_degc=rows.temp_degc[rows.run]), fitted.parameters
    warmed = equation.response(p, rows, terms) - equation.response(p, mean, terms)
    return ordering.decide(rows, rows.indication - warmed, np.inf, terms.powers)


def _rows(gyro: str, runs: Sequence[table_runs.TableRun]) -> equation.Rows:
    """Held rates of a gyro in all runs."""
    shown = [run.scale(gyro) for run in runs]
    sizes = [line.rate_dps.size for line in shown]
    one_line = np.zeros(sum(sizes), dtype=np.int64)
    return equation.Rows(
        np.concatenate([line.rate_dps for line in shown]),
        np.concatenate([line.indication for line in shown]),
        np.repeat(np.arange(len(runs)), sizes),
        np.concatenate([run.plateaus.temp_degc for run in runs]),
        np.concatenate([run.plateaus.hours for run in runs]),
        one_line,
        one_line,
    )


def _terms(spec: OwnAxisRecipe, rows: equation.Rows, *, varies: bool) -> equation.Terms:
    """Terms of the equation that the runs carry and ask for."""
    levels = np.unique(np.round(rows.temp_degc)).size if varies else 1
    order = orders.orders(rows.temp_degc.size, levels, polynomial.HIGHEST_ORDER)[-1]
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
    return bent_response.beside_line(rows, terms)


def curve_model(
    name: str,
    unit: str,
    curve: Fit,
    terms: equation.Terms,
    runs: Sequence[table_runs.TableRun],
) -> Model:
    """Polynomial of a fit in raw powers, valid over the range of all runs; its degrees of freedom
    are the fewest at the temperatures of the runs.
    """
    order = curve.parameters.size - 1
    raw, covariance = polynomial.in_raw_powers(
        curve.parameters,
        curve.total_covariance,
        polynomial.to_raw_powers(*terms.middle_half, order),
    )
    temp_degc = [run.temp_degc for run in runs]
    x = terms.mapped(np.linspace(min(temp_degc), max(temp_degc), GRID))
    dof = curve.of(lambda p: polynomial.powers(x, order) @ p).dof
    per = ["", "/degC", *(f"/degC^{k}" for k in range(2, order + 1))]
    return POLYNOMIAL.write(
        name,
        [(f"p{k}", value, f"{unit}{per[k]}") for k, value in enumerate(raw.tolist())],
        covariance,
        dof=max(int(np.min(dof)), 1),
        residual_rms=float(curve.noise[0]),
        residual_unit=unit,
        valid={forms.TEMPERATURE: table_runs.valid_ranges(runs)[forms.TEMPERATURE]},
    )


def list_undetermined(gyros: Sequence[GyroOverRuns]) -> tuple[str, ...]:
    """What the runs of the gyros do not determine, and what it takes."""
    lacks = []
    if not all(gyro.curves for gyro in gyros):
        lacks.append(
            f"K and F0 over temperature: log runs at temperatures {VARIES_DEGC:g} °C apart or more"
        )
    if any(len(gyro.at_room) < LEAST_REPEATED for gyro in gyros):
        lacks.append("repeatability: log two runs or more at the reference temperature")
    return tuple(lacks)


def fit_response(
    spec: OwnAxisRecipe,
    gyro: str,
    runs: Sequence[table_runs.TableRun],
    near: equation.Fitted | None,
) -> equation.Fitted | None:
    """Equation (1) of the runs of a gyro without errors that they share; None where the recipe asks
    for the line alone, or no power of the rate is asked for. `near` is that of nearly the same
    runs.
    """
    rows = _rows(gyro, runs)
    if near or spec.response == "line":
        return near.refit(rows) if near else None
    terms = _terms(spec, rows, varies=False)
    return equation.Fitted(equation.fit(rows, terms, ()), rows, terms) if terms.powers else None


def run_figures(name: str, one: GyroOverRuns, spec: OwnAxisRecipe) -> Iterator[Figure]:
    """Figures of repeatability and temperature sensitivity, where the runs determine them."""

    def figure(what: str, standard: str, value: float, unit: str, u: float) -> Figure:
        return Figure(forms.FigureName(what, standard, name).text, value, unit, u)

    GJB, IEEE = gjb_figures.GJB, gjb_figures.IEEE
    if _repeats(one):
        value = gjb_figures.repeatability(one.K_of_runs.value[one.room])
        u = value / float(np.sqrt(2.0 * (np.sum(one.room) - 1)))
        yield figure("repeatability", GJB, value, "ppm", u)
    if one.slope is None:
        return
    room = np.abs(one.temp_degc - spec.reference_temp_degc) <= ROOM_DEGC
    if room.any() and not room.all():
        K, at = one.K_of_runs.value, (one.temp_degc, spec.reference_temp_degc)
        value = gjb_figures.temperature_sensitivity(K, *at)
        # each run's error by itself: the largest slope has no derivative
        changes = [
            gjb_figures.temperature_sensitivity(K + error, *at) - value
            for error in np.diag(np.hypot(one.K_of_runs.u, _scatter(one)))
        ]
        u = float(np.linalg.norm(changes))
        yield figure("temperature_sensitivity", GJB, value, "ppm/degC", u)
    size = gjb_figures.PPM / abs(float(one.K.value))
    u = float(one.slope.u) * gum.widening(float(one.slope.dof)) * size
    yield figure("temperature_sensitivity", IEEE, float(one.slope.value) * size, "ppm/degC", u)


def _scatter(one: GyroOverRuns) -> float:
    """Standard deviation of K between runs, at the reference temperature and about K(T); raised by
    Student's t for few runs.
    """
    found = []
    if _repeats(one):
        K = one.K_of_runs.value[one.room]
        found.append((K.size - 1, float(np.var(K, ddof=1))))
    for curve in one.curves[:1]:
        square = curve.residual_rms**2 * (1.0 + len(curve.coefficients) / curve.dof)
        found.append((curve.dof, square))
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
    temperature = one.temp_degc[one.room]
    alike = np.isnan(temperature).any() or np.ptp(temperature) <= 2.0 * ROOM_DEGC
    return bool(temperature.size > 1 and alike)


def _flag_between(one: GyroOverRuns, spec: GyroRecipe) -> Iterator[str]:
    """Flags on what the runs cannot tell of their repeatability and of the response."""
    name, cure = forms.line_name(one.gyro), 'state [[errors.component]] group = "run"'
    _, rows, terms = one.fitted
    stated = {entry.effect for entry in spec.errors.component}
    unknown = [effect for effect in ("scale", "zero") if effect not in stated]
    if len(one.runs) == 1 and unknown:
        yield (
            f"{name}: one run does not show how runs repeat; u of K and F0 holds within this run"
            f" only: repeat it, or {cure}, effect = {' and '.join(map(repr, unknown))}"
        )
    for letter, found in (("K", one.K), ("F0", one.F0)):
        if len(one.runs) > 1 and found.dof < shared_errors.FEW_DOF:
            factor = gum.coverage_factor(float(found.dof))
            yield (
                f"{name}: {letter} has {found.dof:.2g} degrees of freedom between"
                f" {len(one.runs)} runs, its interval is ± {factor:.3g} standard uncertainties:"
                f" add runs, or {cure}"
            )
    if terms.shapes and not line_terms.turns_both_ways(rows.rate_dps):
        yield (
            f"{name}: every run turns one way and the response is bent: F0, the bias and the other"
            " direction are not known from these runs; run the table both ways"
        )


def flag_runs(
    gyros: Sequence[GyroOverRuns], run_lines: lines.Lines, spec: GyroRecipe
) -> tuple[str, ...]:
    """Flags of figures over several runs."""
    runs = gyros[0].runs
    flags = [flag for run in runs for flag in run.flags]
    flags += run_lines.flag_drifts()
    for one in gyros:
        name, of_runs = forms.line_name(one.gyro), one.K_of_runs
        if one.response is None:  # a bend of the response is no noise of the line of a run
            names = [f"{name} in {run.log.file}" for run in runs]
            flags += table_runs.flag_uncertain(names, of_runs)
        flags += contradictions.flag_runs(
            name, one.at_room, run_lines.of_runs(one.at_room, one.gyro)
        )
        flags += _flag_between(one, spec)
        if one.curves:
            flags += contradictions.flag_runs(name, one.runs, of_runs)
        flags += ordering.flag(name, one.in_time, float(one.K.value))
    temperature = gyros[0].temp_degc
    near = np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC
    if len(temperature) > 1 and np.isnan(temperature).any():
        flags.append(UNLOGGED)
    elif not near.any() and np.isfinite(temperature).all():
        flags.append(
            f"no run within {ROOM_DEGC:g} °C of {spec.reference_temp_degc:g} °C: the mean is that"
            f" of all runs, {temperature.min():.1f} to {temperature.max():.1f} °C"
        )
    return tuple(dict.fromkeys(flags))
