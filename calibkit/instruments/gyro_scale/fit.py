"""Gyros in all runs about one, two or three axes of a table.

    F = K(T) Ω + bent response + F0(T) + errors that held rates share      (`equation`, (1))

One axis: (1) of each gyro over all its runs gives K and F0 at the reference temperature and over
temperature. Two axes: N, ε, γ and α (`published`, (2)) of the mean scale factors about the axis of
each gyro, at one temperature. Three axes: s_g = (K_gx, K_gy, K_gz) of the runs at each temperature,
the unit vectors s_g/|s_g| and the angles between them, and (1) of all lines over temperature.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.coefficients import Figure, Model
from calibkit.constants import DPH_PER_DPS
from calibkit.fit import orders
from calibkit.fit.complex_step import Numbers
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.forms import components_of
from calibkit.frame import Remark
from calibkit.instruments.gyro_scale import (
    bent_response,
    equation,
    flags,
    forms,
    ordering,
    published,
    table_runs,
)
from calibkit.instruments.gyro_scale.campaign import (
    AxesSet,
    Campaign,
    Channel,
    Runs,
)
from calibkit.instruments.gyro_scale.coefficient_files import (
    curve_model,
    figure_of,
    line_model,
    of_input_axes,
    stated_components,
    write_pair,
)
from calibkit.instruments.gyro_scale.lines import Lines
from calibkit.instruments.gyro_scale.published import GJB, IEEE, PPM, ROOM_DEGC, FigureName
from calibkit.instruments.gyro_scale.recipe import (
    AnyRecipe,
    GyroPairRecipe,
    GyroTriadRecipe,
    OwnAxisRecipe,
    RateTableRecipe,
)
from calibkit.instruments.gyro_scale.table_runs import TableRun
from calibkit.numeric import gum
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.recipe import shared_errors

VARIES_DEGC = 5.0
"""Least span of the runs' temperatures [°C] for a fit of K over temperature."""
LEAST_LEVELS = 3
"""Fewest temperatures that show a slope of K and F0."""
SMALL_SINE = 0.01
"""Sine of the angle between the gyros below which two γ do not tell the error of mounting."""
OWN_AND_CROSS = [0, 3, 2, 1]
"""Places of K_A, K_B, K_Ba, K_Ab among the lines of A about a, A about b, B about a, B about b."""
CHANNELS = (("a", "a"), ("b", "b"), ("b", "a"), ("a", "b"))
"""Gyro and table axis of each line of a pair, own axes first."""


def fit_campaign(spec: AnyRecipe, runs: Runs, near: Campaign | None = None) -> Campaign:
    """Fit a procedure's runs; `near` is a fit of nearly the same runs, whose sizes of errors and
    choices are kept, and which has the flags.
    """
    if isinstance(spec, GyroPairRecipe):
        return fit_pair(spec, runs, near)
    if isinstance(spec, GyroTriadRecipe):
        return fit_axes(spec, runs, near)
    return fit_runs(spec, runs, near)


def _lines_of(sets: Sequence[Sequence[tuple[int, TableRun]]], near: Campaign | None) -> Lines:
    """Lines of sets of runs, each with the number of its axis; raises FitError for a gyro that does
    not follow the table.
    """
    if near:
        return Lines.of(sets, near.run_lines)
    run_lines = Lines.of(sets)
    run_lines.require_followed()
    return run_lines


def fit_runs(spec: RateTableRecipe, runs: Runs, near: Campaign | None = None) -> Campaign:
    """Fit each gyro in each run about the one axis, then over the runs and over temperature."""
    about = tuple(runs[""])
    run_lines = _lines_of([[(0, run) for run in about]], near)
    channels = []
    for number, gyro in enumerate(spec.gyros):
        before = near.channels[number].over if near else None
        channels.append(_fit_over_runs(spec, gyro, about, run_lines, before))
    of_runs = () if near else flags.of_runs(channels, run_lines, spec)
    return Campaign(tuple(channels), run_lines, tuple(dict.fromkeys(of_runs)))


def _fit_over_runs(
    spec: RateTableRecipe,
    gyro: str,
    runs: tuple[TableRun, ...],
    run_lines: Lines,
    near: equation.Fitted | None,
) -> Channel:
    """Fit one gyro over all runs: the mean at the reference temperature, and K and F0 over
    temperature where the temperature varies.
    """
    temperature = np.array([run.temp_degc for run in runs])
    room = np.isnan(temperature) | (np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC)
    room = room if room.any() else ~room
    varies = bool(np.isfinite(temperature).all() and np.ptp(temperature) >= VARIES_DEGC)
    rows = run_lines.rows_of(runs, gyro)
    if near:
        over = near.refit(rows)
    else:
        terms = _terms(spec, rows, varies=varies)
        shared = list(equation.shared_errors(rows, terms, rows.slopes, rows.slopes))
        stated = shared_errors.state_sizes(spec.errors, [e for e in shared if e.group == "run"])
        errors = [*stated, *(e for e in shared if e.group != "run")]
        over = equation.Fitted(equation.fit(rows, terms, errors), rows, terms)
    terms = over.terms
    polynomials, in_time = _over_temperature(over)
    size = len(polynomials.parameters) // 2
    K, F0 = polynomials.part(slice(size)), polynomials.part(slice(size, None))
    # at the mean temperature of the runs that count as repeated
    x = terms.mapped(temperature[room].mean(keepdims=True)) if varies else np.zeros(1)
    of_room: Array = np.asarray(np.kron(np.eye(2), polynomial.powers(x, size - 1)))
    name = forms.line_name(gyro)
    repeated = tuple(run for run, chosen in zip(runs, room, strict=True) if chosen)
    # what differs from run to run and from side to side
    sizes = [s for s in over.fit.shared if s.error.effect in ("scale", "zero") and s.dof]
    mean = line_model(
        *(name, polynomials.restated(lambda p: of_room @ p), run_lines, gyro, repeated),
        components_of(sizes),
    )
    channel = Channel(gyro, "", True, runs, repeated, mean, over, in_time)  # noqa: FBT003
    slope = None
    if varies:
        curves = (
            curve_model(forms.curve_name(name, "K"), "1/deg", K, terms, runs),
            curve_model(forms.curve_name(name, "F0"), "1/s", F0, terms, runs),
        )
        channel = replace(channel, curves=curves)
        # of the straight line through K(T) at the temperatures of the runs
        slope_of = np.linalg.pinv(np.column_stack((temperature, np.ones(temperature.size))))[0]
        weights = slope_of @ polynomial.powers(terms.mapped(temperature), size - 1)
        slope = K.of(lambda p: weights @ p)
    K_of_runs = run_lines.of_runs(runs, gyro)
    return replace(channel, figures=tuple(_figures(channel, K_of_runs, room, slope, spec)))


def _over_temperature(whole: equation.Fitted) -> tuple[Fit, ordering.Ordering | None]:
    """Polynomials of K, then of F0, of the best straight line [2 (order + 1)], with what the runs
    leave open, and whether K changes with time in the runs, beside what temperature changes.
    """
    fit, rows, terms = whole
    if max(terms.orders):
        mean, p = replace(rows, row_degc=rows.temp_degc[rows.run]), fit.parameters
        warmed = equation.response(p, rows, terms) - equation.response(p, mean, terms)
        in_time = ordering.decide(rows, rows.indication - warmed, np.inf, terms.powers)
    else:
        in_time = ordering.decide(rows, rows.indication, powers=terms.powers)
    line = equation.best_line(terms, rows.rate_dps)
    curves = fit.restated(lambda p: np.concatenate(line(p), axis=1)[0])
    F0 = curves.parameters.size // 2
    hidden, shift, half_width = 0.0, 0.0, 0.0
    if not equation.turns_both_ways(rows.rate_dps):
        # runs of one direction alone do not tell a bend of the response from F0
        hidden = curves.parameters[F0] - terms.split(fit.parameters).F0[0, 0]
    if in_time:
        shift, half_width = in_time.shift, in_time.half_width
    # a half-width that is known, as a rectangular distribution
    bounds = np.zeros((curves.parameters.size, 2))
    bounds[0, 0], bounds[F0, 1] = half_width / np.sqrt(3.0), hidden
    parameters = curves.parameters + shift * np.eye(curves.parameters.size)[0]
    bounds = np.hstack((curves.bounds, bounds))
    return replace(curves, parameters=parameters, bounds=bounds), in_time


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


def _figures(
    channel: Channel, K_of_runs: Value, room: Mask, slope: Value | None, spec: RateTableRecipe
) -> Iterator[Figure]:
    """Figures of repeatability and temperature sensitivity, where the runs [r] determine them:
    `room` are the repeated ones, `slope` is that of K over temperature [1/deg/°C].
    """

    def figure(what: str, standard: str, value: float, unit: str, u: float) -> Figure:
        return Figure(FigureName(what, standard, channel.name).text, value, unit, u)

    temperature, K = np.array([run.temp_degc for run in channel.runs]), K_of_runs.value
    alike = np.isnan(temperature[room]).any() or np.ptp(temperature[room]) <= 2.0 * ROOM_DEGC
    # variances of K between runs and their degrees of freedom
    scatters: list[tuple[float, float]] = []
    if len(channel.repeated) > 1 and alike:
        value = published.repeatability(K[room])
        dof = int(np.sum(room)) - 1
        yield figure("repeatability", GJB, value, "ppm", value / float(np.sqrt(2.0 * dof)))
        scatters.append((dof, float(np.var(K[room], ddof=1))))
    if slope is None:
        return
    near = np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC
    if near.any() and not near.all():
        at = temperature, spec.reference_temp_degc
        value = published.temperature_sensitivity(K, *at)
        curve = channel.curves[0]
        of_curve = curve.residual_rms**2 * (1.0 + len(curve.coefficients) / curve.dof)
        scatters.append((curve.dof, of_curve))
        # pooled and raised by Student's t for few; runs at the reference temperature are in both:
        # the larger count is that of independent ones
        dofs, variances = np.array(scatters).T
        scatter = np.sqrt(dofs @ variances / dofs.sum()) * gum.widening(float(dofs.max()))
        # each run's error by itself: the largest slope has no derivative
        changes = [
            published.temperature_sensitivity(K + error, *at) - value
            for error in np.diag(np.hypot(K_of_runs.u, scatter))
        ]
        u = float(np.linalg.norm(changes))
        yield figure("temperature_sensitivity", GJB, value, "ppm/degC", u)
    assert channel.mean is not None  # noqa: S101 (as of every gyro of a rate table)
    size = PPM / abs(channel.mean.value("K"))
    u = float(slope.u) * gum.widening(float(slope.dof)) * size
    yield figure("temperature_sensitivity", IEEE, float(slope.value) * size, "ppm/degC", u)


def fit_pair(spec: GyroPairRecipe, runs: Runs, near: Campaign | None = None) -> Campaign:
    """Fit N, ε, γ and α to the runs about both table axes; the covariance holds the errors of held
    rates, how runs repeat, the difference between the runs' temperatures, and the mounting.
    """
    about = [(k, run) for k, axis in enumerate("ab") for run in runs[axis]]
    run_lines = _lines_of([about], near)
    known = spec.known_errors()
    run_scale = run_lines.run_scale(known.get("scale"))
    # K [4], then F0 [4], of A about a, A about b, B about a, B about b: means over the runs
    means = run_lines.means(np.ones(run_lines.gyro_of.size, dtype=np.bool_)).reshape(4, -1)
    none = np.zeros_like(means)
    mean_lines = run_lines.combined(np.vstack((means, none)), np.vstack((none, means)))
    mean_lines = mean_lines.widened_by([run_scale] if run_scale else [])
    degc = {axis: float(np.mean([run.temp_degc for run in runs[axis]])) for axis in "ab"}
    apart = degc["b"] - degc["a"]
    K = mean_lines.part(OWN_AND_CROSS)
    if np.isfinite(apart):
        K = _at_one_temperature(K, apart, spec)
    from_a = K.of(lambda k: k[3] / k[0])
    K = K.part(slice(3))
    by_noise = published.indicate(K)
    flags.refuse_opposite(by_noise, from_a)
    tilt, tilt_dof = find_mounting(by_noise, from_a, known.get("angle"))
    # about the other gyro's axis a gyro loses its sine, K sin α per radian
    sine = np.sqrt(max(1.0 - float(by_noise.value) ** 2, 0.0))
    K_A, K_B = K.parameters[:2] * sine
    across = np.array([[[0.0], [K_A]], [[K_B], [0.0]]])
    mounting = run_lines.mounting(across, (float(np.degrees(tilt)), tilt_dof))
    K = K.widened_by([mounting])
    # about its own axis either gyro alone loses K (1 - cos tilt) at most, taken as large as K tilt²
    cosine = np.vstack((np.diag(K.parameters[:2] * tilt**2), np.zeros(2)))
    ratios = published.find_ratios(replace(K, bounds=np.column_stack((K.bounds, cosine))))
    channels = []
    for number, (gyro, axis) in enumerate(CHANNELS):
        line_at = 2 * "ab".index(gyro) + "ab".index(axis)
        line = mean_lines.part([line_at, line_at + 4])
        channel = Channel(
            gyro,
            axis,
            own=gyro == axis,
            runs=runs[axis],
            repeated=runs[axis],
            mean=line_model(
                *(forms.line_name(gyro, axis), line, run_lines, gyro, runs[axis]),
                stated_components(run_scale),
            ),
        )
        if channel.own:
            before = near.channels[number].over if near else None
            bent = _fit_response(spec, run_lines.rows_of(runs[axis], gyro), before)
            channel = replace(channel, over=bent)
        channels.append(channel)
    components = stated_components(run_scale, mounting)
    pair, figures = write_pair(run_lines, runs, ratios, from_a, components)
    of_pair: list[str] = []
    if not near:
        of_pair = [flag for _, run in about for flag in run.flags]
        of_pair += run_lines.flag_drifts()
        of_pair += flags.of_gamma(by_noise, from_a)
        known_by_gamma = (mounting, ratios.dof[2]) if tilt > 0.0 and "angle" not in known else None
        of_pair += flags.of_pair(
            spec, runs, run_lines, apart, known_by_gamma, within=run_scale is None
        )
    return Campaign(
        tuple(channels),
        run_lines,
        tuple(dict.fromkeys(of_pair)),
        run_scale is None,
        pair=pair,
        pair_figures=figures,
    )


def _fit_response(
    spec: OwnAxisRecipe, rows: equation.Rows, near: equation.Fitted | None
) -> equation.Fitted | None:
    """Equation (1) of the runs of a gyro without errors that they share; None where the recipe asks
    for the line alone, or no power of the rate is asked for.
    """
    if near or spec.response == "line":
        return near.refit(rows) if near else None
    terms = _terms(spec, rows, varies=False)
    return equation.Fitted(equation.fit(rows, terms, ()), rows, terms) if terms.powers else None


def _at_one_temperature(K: Fit, apart_degc: float, spec: GyroPairRecipe) -> Fit:
    """K_A, K_B, K_Ba and K_Ab at the temperature in the middle of both runs, by the stated
    temperature coefficients of the gyros, or by a coefficient of zero within the largest one that
    is possible, alike for both.
    """
    gyro, half, stated = [0, 1, 1, 0], apart_degc / 2.0, spec.pair.temperature_coefficients_ppm_degc
    warmer = np.array([half, -half, half, -half])
    if stated is None:
        coefficients = np.zeros(2)
        limit = spec.pair.largest_temperature_coefficient_ppm_degc / PPM
        unknown = np.full((2, 1), limit / np.sqrt(3.0))
    else:
        coefficients = np.array([stated.a, stated.b]) / PPM
        unknown = spec.pair.temperature_coefficient_uncertainty_ppm_degc / PPM * np.eye(2)
    by_coefficient = (K.parameters * warmer)[:, None] * unknown[gyro]
    at_middle = K.restated(lambda k: k * (1.0 + warmer * coefficients[gyro]))
    return replace(at_middle, bounds=np.column_stack((at_middle.bounds, by_coefficient)))


def find_mounting(
    indicated: Value, from_a: Value, known: tuple[float, float] | None
) -> tuple[float, float]:
    """Standard deviation [rad] of the angle between a gyro's axis and its table axis, and its
    degrees of freedom: what the two γ of a pair by noise alone differ by, or what is known [°]
    pooled with it.
    """
    cosine = min(abs(float(indicated.value)), 1.0)
    sine = max(float(np.sqrt(1.0 - cosine**2)), SMALL_SINE)
    apart = (float(from_a.value) - float(indicated.value)) ** 2 if sine > SMALL_SINE else 0.0
    if known is None:
        # noise is not taken off: two γ that agree by chance would hide the tilts
        return float(np.sqrt(apart)) / sine, 1.0
    value, dof = np.radians(known[0]), known[1]
    noise = float(from_a.u) ** 2 + float(indicated.u) ** 2
    square = 0.5 * max(apart - noise, 0.0) / sine**2
    pooled = (dof * value**2 + square) / (dof + 1.0) if np.isfinite(dof) else value**2
    return float(np.sqrt(pooled)), dof + 1.0


def fit_axes(spec: GyroTriadRecipe, runs: Runs, near: Campaign | None = None) -> Campaign:
    """Fit sensitivities and angles of each set of runs, and each sensitivity over temperature where
    the temperature varies.

    Raises FitError for a table axis without a run at some temperature.
    """
    all_runs = [run for axis in forms.AXES for run in runs[axis]]
    logged = bool(np.isfinite([run.temp_degc for run in all_runs]).all())
    groups = table_runs.group_by_temperature(runs) if logged else [dict(runs)]
    about = [
        [(a, run) for a, axis in enumerate(forms.AXES) for run in group[axis]] for group in groups
    ]
    run_lines = _lines_of(about, near)
    known = spec.known_errors()
    run_scale, mounting = run_lines.run_scale(known.get("scale")), None
    if "angle" in known:
        S = run_lines.sensitivity()
        # a tilt toward one of the other axes
        across = np.array([np.delete(S, axis, axis=1) for axis in range(S.shape[1])])
        mounting = run_lines.mounting(np.swapaxes(across, 0, 1), known["angle"])
    stated = [error for error in (run_scale, mounting) if error]
    degc = [np.mean([run.temp_degc for _, run in group]) for group in about]
    suffixes = [f".at_{one:.0f}" for one in degc]
    reference = int(np.argmin(np.abs(np.array(degc) - spec.reference_temp_degc))) if logged else 0
    suffixes[reference] = ""
    sets = [
        _fit_set(spec, run_lines, stated, group, s, suffixes[s]) for s, group in enumerate(groups)
    ]
    flags.require_own_axes(sets, spec.gyros)
    over: equation.Fitted | None = None
    curves: list[Model] = []
    if len(sets) > 1:
        over = _fit_polynomials(run_lines, run_scale, near.over if near else None)
        vertical = table_runs.vertical_rate_dps(spec)
        curves = list(_list_curves(over, spec.gyros, all_runs, mounting, vertical))
    channels = []
    for at, (g, a) in enumerate(product(range(len(spec.gyros)), range(len(forms.AXES)))):
        axis, curve = forms.AXES[a], tuple(curves[at : at + 1])
        own = a == np.argmax(np.abs(sets[reference].misalignment(spec.gyros[g])))
        channels.append(Channel(spec.gyros[g], axis, bool(own), runs[axis], curves=curve))
    of_axes: list[str] = []
    if not near:
        of_axes = [flag for run in all_runs for flag in run.flags]
        if not logged and len(all_runs) > len(forms.AXES):
            of_axes.append(flags.UNLOGGED)
        of_axes += flags.of_axes_lines(
            spec, [run for group in about for _, run in group], run_lines
        )
        of_axes += flags.of_sets(spec, sets, mounting)
        if run_scale is None:
            of_axes.append(Remark(flags.WITHIN))
    return Campaign(
        tuple(channels),
        run_lines,
        tuple(dict.fromkeys(of_axes)),
        run_scale is None,
        sets=tuple(sets),
        over=over,
        bias_curves=tuple(curves[len(channels) :]),
    )


def _fit_set(
    spec: GyroTriadRecipe,
    run_lines: Lines,
    stated: Sequence[Shared],
    group: Mapping[str, tuple[TableRun, ...]],
    number: int,
    suffix: str,
) -> AxesSet:
    """Sensitivities of one set of runs, what follows from them, and biases F0 − K ω where ω, the
    earth's rate about the table's axis, is known.
    """
    chosen, gyros = run_lines.set_of == number, len(spec.gyros)
    of_K = run_lines.means(chosen).reshape(3 * gyros, -1)
    of_F0 = np.zeros_like(of_K)
    errors = [*stated]
    vertical_dps = table_runs.vertical_rate_dps(spec)
    if vertical_dps is not None:
        unit = np.eye(chosen.size)
        bias = run_lines.combined(-vertical_dps * unit, unit).of(lambda p: p)
        errors += [run_lines.run_zero(g, chosen, bias) for g in range(gyros)]
        of_gyro = chosen & (run_lines.gyro_of == np.arange(gyros)[:, None])
        mean = of_gyro / np.sum(of_gyro, axis=1, keepdims=True)
        of_K, of_F0 = np.vstack((of_K, -vertical_dps * mean)), np.vstack((of_F0, mean))
    fit = run_lines.combined(of_K, of_F0).widened_by(errors)
    figures = [*of_input_axes(fit.part(slice(3 * gyros)), spec.gyros)]
    if vertical_dps is not None:
        sizes = np.linalg.norm(fit.parameters[: 3 * gyros].reshape(-1, 3), axis=1)
        biases = fit.of(lambda p: p[3 * gyros :] / sizes * DPH_PER_DPS)
        figures += [
            figure_of(f"bias.{gyro}", biases, "deg/h", g) for g, gyro in enumerate(spec.gyros)
        ]
    runs = [run for axis in forms.AXES for run in group[axis]]
    sensitivities, names_of_biases = forms.triad_names(spec.gyros)
    units = ["1/deg"] * len(sensitivities) + ["1/s"] * gyros
    named = list(zip([*sensitivities, *names_of_biases], units, strict=True))
    of_runs = [run_lines.published(run, gyro).fit for run in runs for gyro in spec.gyros]
    model = forms.TRIAD.write_fit(
        f"triad{suffix}",
        fit,
        named[: len(of_K)],
        residual_rms=rms([one.residual_rms for one in of_runs]),
        residual_unit="1/s",
        valid=table_runs.valid_ranges(runs),
    )
    model = replace(
        model, dof=min(one.dof for one in of_runs), components=stated_components(*stated)
    )
    degc = float(np.mean([run.temp_degc for run in runs]))
    return AxesSet(degc, suffix, model, {figure.name: figure for figure in figures})


def _list_curves(
    over: equation.Fitted,
    gyros: Sequence[str],
    runs: Sequence[TableRun],
    mounting: Shared | None,
    vertical_dps: float | None,
) -> Iterator[Model]:
    """Sensitivities and biases over temperature."""
    fit, rows, terms = over
    line = equation.best_line(terms, rows.rate_dps)
    K = fit.restated(lambda p: line(p)[equation.SCALE].ravel())
    K = K.widened_by([mounting] if mounting else [])
    powers = max(terms.orders) + 1
    for number, (gyro, axis) in enumerate(product(gyros, forms.AXES)):
        name = forms.curve_name(forms.line_name(gyro, axis), "K")
        of_line = K.part(slice(powers * number, powers * (number + 1)))
        yield curve_model(name, "1/deg", of_line, terms, runs)
    for g, gyro in enumerate(gyros if vertical_dps is not None else ()):

        def bias(p: Numbers, g: int = g) -> Numbers:
            scale, zero = line(p)
            return np.asarray(np.mean((zero - vertical_dps * scale)[3 * g : 3 * g + 3], axis=0))

        yield curve_model(forms.curve_name(gyro, "bias"), "1/s", fit.restated(bias), terms, runs)


def _fit_polynomials(
    run_lines: Lines, run_scale: Shared | None, near: equation.Fitted | None
) -> equation.Fitted:
    """Equation (1) of all runs with polynomials over temperature."""
    S, rows = run_lines.sensitivity(), replace(run_lines.rows, line=run_lines.rows.channel)
    if near:
        return near.refit(rows)
    order = max(min(polynomial.HIGHEST_ORDER, int(run_lines.set_of.max()) - 1), 0)
    shapes = (equation.ASYMMETRY,) if rows.shows_asymmetry else ()
    middle_half = polynomial.middle_and_half(rows.row_degc)
    terms = equation.Terms(S.size, (order, order), middle_half, shapes)
    own = np.repeat(np.linalg.norm(S, axis=1), S.shape[1])
    shared = []
    for error in equation.shared_errors(rows, terms, S.ravel(), own):
        if run_scale and error.name == run_scale.name:
            shared.append(replace(error, size=run_scale.size, size_dof=run_scale.size_dof))
        else:
            shared.append(error)
    return equation.Fitted(equation.fit(rows, terms, shared), rows, terms)
