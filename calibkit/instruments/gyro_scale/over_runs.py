"""Table runs of one gyro, repeated and over temperature: mean K and F0, polynomials over
temperature, response over rate, repeatability.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.coefficients import Figure, Model
from calibkit.fit import orders
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.forms import POLYNOMIAL, components_of
from calibkit.instruments.gyro_scale import (
    bent_response,
    contradictions,
    equation,
    forms,
    lines,
    ordering,
    table_runs,
)
from calibkit.instruments.gyro_scale.campaign import Campaign, Channel
from calibkit.instruments.gyro_scale.numeric import gjb_figures, line_terms
from calibkit.instruments.gyro_scale.numeric.gjb_figures import ROOM_DEGC
from calibkit.instruments.gyro_scale.recipe import OwnAxisRecipe, RateTableRecipe
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


def fit_runs(
    spec: RateTableRecipe,
    runs: Mapping[str, Sequence[table_runs.TableRun]],
    near: Campaign | None = None,
) -> Campaign:
    """Fit each gyro in each run, then its scale factor over the runs and over temperature; `near`
    is a fit of nearly the same runs.
    """
    about = tuple(runs[""])
    run_lines = lines.Lines.of_runs_about_one_axis(about, near.run_lines if near else None)
    before = near.channels if near else (None,) * len(spec.gyros)
    channels = tuple(
        _fit_over_runs(spec, gyro, about, run_lines, one)
        for gyro, one in zip(spec.gyros, before, strict=True)
    )
    return Campaign(channels, run_lines, () if near else _flag_runs(channels, run_lines, spec))


def _fit_over_runs(
    spec: RateTableRecipe,
    gyro: str,
    runs: tuple[table_runs.TableRun, ...],
    run_lines: lines.Lines,
    near: Channel | None,
) -> Channel:
    """Fit one gyro over all runs: the mean at the reference temperature, and K and F0 over
    temperature where the temperature varies.
    """
    temperature = np.array([run.temp_degc for run in runs])
    room = np.isnan(temperature) | (np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC)
    room = room if room.any() else ~room
    varies = bool(np.isfinite(temperature).all() and np.ptp(temperature) >= VARIES_DEGC)
    rows = _rows(gyro, runs)
    if near and near.over:
        over = near.over.refit(rows)
    else:
        terms = _terms(spec, rows, varies=varies)
        shared = list(equation.shared_errors(rows, terms, rows.slopes, rows.slopes))
        stated = shared_errors.state_sizes(spec.errors, [e for e in shared if e.group == "run"])
        errors = [*stated, *(e for e in shared if e.group != "run")]
        over = equation.Fitted(equation.fit(rows, terms, errors), rows, terms)
    in_time = _order_in_time(over)
    polynomials = _over_temperature(over, in_time)
    size = polynomials.parameters.size // 2
    terms = over.terms
    x = terms.mapped(temperature[room].mean(keepdims=True)) if varies else np.zeros(1)
    powers: Array = np.asarray(np.kron(np.eye(2), polynomial.powers(x, size - 1)))
    # what differs from run to run and from side to side
    sizes = [s for s in over.fit.shared if s.error.effect in ("scale", "zero") and s.dof]
    repeated = tuple(run for run, chosen in zip(runs, room, strict=True) if chosen)
    channel = Channel(
        gyro,
        "",
        own=True,
        runs=runs,
        repeated=repeated,
        line=polynomials.weighted(powers),
        over=over,
        in_time=in_time,
        components=components_of(sizes),
    )
    slope = None
    if varies:
        K, F0 = (polynomials.weighted(part) for part in np.vsplit(np.eye(2 * size), 2))
        K_name, F0_name = (forms.curve_name(channel.name, letter) for letter in ("K", "F0"))
        channel = replace(
            channel,
            curves=(
                curve_model(K_name, "1/deg", K, terms, runs),
                curve_model(F0_name, "1/s", F0, terms, runs),
            ),
        )
        # of the straight line through K(T) at the temperatures of the runs
        slope_of = np.linalg.pinv(np.column_stack((temperature, np.ones(temperature.size))))[0]
        weights = slope_of @ polynomial.powers(terms.mapped(temperature), size - 1)
        slope = K.of(lambda p: weights @ p)
    K_of_runs = run_lines.of_runs(runs, gyro)
    return replace(channel, figures=tuple(_figures(channel, K_of_runs, room, slope, spec)))


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


def list_undetermined(campaign: Campaign) -> tuple[str, ...]:
    """What the runs of single gyros do not determine, and what it takes."""
    lacks = []
    if not all(channel.curves for channel in campaign.channels):
        lacks.append(
            f"K and F0 over temperature: log runs at temperatures {VARIES_DEGC:g} °C apart or more"
        )
    if any(len(channel.repeated) < LEAST_REPEATED for channel in campaign.channels):
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


def _figures(
    channel: Channel,
    K_of_runs: Value,
    room: Mask,
    slope: Value | None,
    spec: RateTableRecipe,
) -> Iterator[Figure]:
    """Figures of repeatability and temperature sensitivity, where the runs [r] determine them:
    `room` are the repeated ones, `slope` is that of K over temperature [1/deg/°C].
    """

    def figure(what: str, standard: str, value: float, unit: str, u: float) -> Figure:
        return Figure(forms.FigureName(what, standard, channel.name).text, value, unit, u)

    GJB, IEEE = gjb_figures.GJB, gjb_figures.IEEE
    temperature, K = np.array([run.temp_degc for run in channel.runs]), K_of_runs.value
    alike = np.isnan(temperature[room]).any() or np.ptp(temperature[room]) <= 2.0 * ROOM_DEGC
    # variances of K between runs and their degrees of freedom
    scatters = []
    if len(channel.repeated) > 1 and alike:
        value = gjb_figures.repeatability(K[room])
        dof = int(np.sum(room)) - 1
        yield figure("repeatability", GJB, value, "ppm", value / float(np.sqrt(2.0 * dof)))
        scatters.append((dof, float(np.var(K[room], ddof=1))))
    if slope is None:
        return
    near = np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC
    if near.any() and not near.all():
        at = temperature, spec.reference_temp_degc
        value = gjb_figures.temperature_sensitivity(K, *at)
        curve = channel.curves[0]
        of_curve = curve.residual_rms**2 * (1.0 + len(curve.coefficients) / curve.dof)
        scatter = _pool([*scatters, (curve.dof, of_curve)])
        # each run's error by itself: the largest slope has no derivative
        changes = [
            gjb_figures.temperature_sensitivity(K + error, *at) - value
            for error in np.diag(np.hypot(K_of_runs.u, scatter))
        ]
        u = float(np.linalg.norm(changes))
        yield figure("temperature_sensitivity", GJB, value, "ppm/degC", u)
    size = gjb_figures.PPM / abs(float(channel.K.value))
    u = float(slope.u) * gum.widening(float(slope.dof)) * size
    yield figure("temperature_sensitivity", IEEE, float(slope.value) * size, "ppm/degC", u)


def _pool(scatters: Sequence[tuple[int, float]]) -> float:
    """Standard deviation of variances with degrees of freedom, raised by Student's t for few."""
    # runs at the reference temperature are in both: the larger count is that of independent ones
    dof = max(count for count, _ in scatters)
    variance = sum(count * square for count, square in scatters) / sum(
        count for count, _ in scatters
    )
    return float(np.sqrt(variance)) * gum.widening(dof)


def _flag_between(channel: Channel, spec: RateTableRecipe) -> Iterator[str]:
    """Flags on what the runs cannot tell of their repeatability and of the response."""
    name, cure = channel.name, 'state [[errors.component]] group = "run"'
    assert channel.line is not None  # noqa: S101 (as of every gyro of a rate table)
    assert channel.over is not None  # noqa: S101
    _, rows, terms = channel.over
    stated = {entry.effect for entry in spec.errors.component}
    unknown = [effect for effect in ("scale", "zero") if effect not in stated]
    if len(channel.runs) == 1 and unknown:
        yield (
            f"{name}: one run does not show how runs repeat; u of K and F0 holds within this run"
            f" only: repeat it, or {cure}, effect = {' and '.join(map(repr, unknown))}"
        )
    line_dof = channel.line.of(lambda p: p).dof.tolist()
    for letter, dof in zip(("K", "F0"), line_dof, strict=True):
        if len(channel.runs) > 1 and dof < shared_errors.FEW_DOF:
            yield (
                f"{name}: {letter} has {dof:.2g} degrees of freedom between"
                f" {len(channel.runs)} runs, its interval is ±"
                f" {gum.coverage_factor(dof):.3g} standard uncertainties: add runs, or {cure}"
            )
    if terms.shapes and not line_terms.turns_both_ways(rows.rate_dps):
        yield (
            f"{name}: every run turns one way and the response is bent: F0, the bias and the other"
            " direction are not known from these runs; run the table both ways"
        )


def _flag_runs(
    channels: Sequence[Channel], run_lines: lines.Lines, spec: RateTableRecipe
) -> tuple[str, ...]:
    """Flags of figures over several runs."""
    runs = channels[0].runs
    flags = [flag for run in runs for flag in run.flags]
    flags += run_lines.flag_drifts()
    for channel in channels:
        name, gyro = channel.name, channel.gyro
        K = run_lines.of_runs(runs, gyro)
        if channel.response is None:  # a bend of the response is no noise of the line of a run
            names = [f"{name} in {run.log.file}" for run in runs]
            flags += table_runs.flag_uncertain(names, K)
        repeated = channel.repeated
        flags += contradictions.flag_runs(name, repeated, run_lines.of_runs(repeated, gyro))
        flags += _flag_between(channel, spec)
        if channel.curves:
            flags += contradictions.flag_runs(name, runs, K)
        flags += ordering.flag(name, channel.in_time, float(channel.K.value))
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
