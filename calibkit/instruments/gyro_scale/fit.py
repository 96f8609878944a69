"""Gyros in all runs about one, two or three axes of a table.

    F = K(T) Ω + bent response + F0(T) + errors that held rates share      (`equation`, (1))

One axis: (1) of each gyro over all its runs gives K and F0 at the reference temperature and over
temperature. Two axes: N, ε, γ and α (`published`, (2)) of the mean scale factors about the axis of
each gyro, at one temperature. Three axes: s_g = (K_gx, K_gy, K_gz) of the runs at each temperature,
the unit vectors s_g/|s_g| and the angles between them, and (1) of all lines over temperature.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from calibkit.fit.complex_step import Numbers
from calibkit.fit.shared import Shared
from calibkit.fit.value import Value
from calibkit.instruments.gyro_scale import (
    equation,
    flags,
    forms,
    ordering,
    published,
    table_runs,
)
from calibkit.instruments.gyro_scale.coefficient_files import (
    AxesSet,
    CampaignFit,
    Channel,
    Runs,
    curve_model,
    figure_of,
    line_model,
    of_input_axes,
    stated_components,
    temperature_difference,
)
from calibkit.instruments.gyro_scale.lines import Lines
from calibkit.instruments.gyro_scale.published import GJB, IEEE, PPM, ROOM_DEGC, FigureName
from calibkit.instruments.gyro_scale.recipe import (
    AnyRecipe,
    GyroPairRecipe,
    GyroTriadRecipe,
    RateTableRecipe,
)
from calibkit.instruments.gyro_scale.table_runs import TableRun
from calibkit.numeric import gum
from calibkit.numeric.arrays import Array, Mask
from calibkit.numeric.constants import DPH_PER_DPS
from calibkit.numeric.dispersion import rms
from calibkit.numeric.least_squares import polynomial
from calibkit.recipe import shared_errors
from calibkit.records.coefficients import Figure, Model
from calibkit.records.forms import components_of

SMALL_SINE = 0.01
"""Sine of the angle between the gyros below which two γ do not tell the error of mounting."""
PAIR = (("a", "a"), ("b", "b"), ("b", "a"), ("a", "b"))
"""Gyro and table axis of K_A, K_B, K_Ba and K_Ab."""


def fit_campaign(spec: AnyRecipe, runs: Runs, earlier: CampaignFit | None = None) -> CampaignFit:
    """Fit a procedure's runs; `earlier` is a fit of nearly the same runs, of whose results only the
    values move, and which has the flags.

    Raises FitError for a gyro that does not follow the table, for two γ of opposite sign, and for
    a table axis without a run at some temperature.
    """
    groups: Sequence[Runs] = [runs]
    all_runs = [run for group in runs.values() for run in group]
    if isinstance(spec, GyroTriadRecipe) and np.isfinite([run.temp_degc for run in all_runs]).all():
        groups = table_runs.group_by_temperature(runs)
    sets = [
        [(number, run) for number, axis in enumerate(spec.logs_of_axes) for run in group[axis]]
        for group in groups
    ]
    fits = equation.Fits(earlier.fits if earlier else {})
    run_lines = Lines.of(sets, fits, earlier.run_lines if earlier else None)
    if not earlier:
        run_lines.require_followed()
    if isinstance(spec, GyroPairRecipe):
        campaign = _fit_pair(spec, runs, run_lines, fits)
    elif isinstance(spec, GyroTriadRecipe):
        campaign = _fit_axes(spec, runs, groups, run_lines, fits)
    else:
        channels = [_fit_over_runs(spec, gyro, runs[""], run_lines, fits) for gyro in spec.gyros]
        campaign = CampaignFit(tuple(channels), run_lines)
    campaign = replace(campaign, fits=fits.by_name)
    return campaign if earlier else replace(campaign, flags=flags.of_campaign(spec, runs, campaign))


def _fit_over_runs(
    spec: RateTableRecipe,
    gyro: str,
    runs: tuple[TableRun, ...],
    run_lines: Lines,
    fits: equation.Fits,
) -> Channel:
    """Fit one gyro over all runs: the mean at the reference temperature, and K and F0 over
    temperature where the temperature varies.
    """
    temperature = np.array([run.temp_degc for run in runs])
    off_reference = np.abs(temperature - spec.reference_temp_degc)
    repeated_mask = np.isnan(temperature) | (off_reference <= ROOM_DEGC)
    repeated_mask = repeated_mask if repeated_mask.any() else ~repeated_mask
    repeated = tuple(runs[k] for k in np.flatnonzero(repeated_mask))
    # 5 °C are the least span for K over temperature
    varies = bool(np.isfinite(temperature).all() and np.ptp(temperature) >= 5.0)
    rows = run_lines.rows_of(runs, gyro)
    terms = equation.find_terms(rows, varies=varies, bent=spec.response == "auto")
    shared = list(equation.shared_errors(rows, terms, rows.slopes, rows.slopes))
    errors = shared_errors.state_sizes(spec.errors, [e for e in shared if e.group == "run"])
    errors += [e for e in shared if e.group != "run"]
    fitted = fits.fit(gyro, rows, terms, errors)
    fit, _, terms = fitted

    # whether K changes with time in the runs, beside what temperature changes
    steady, known_degc = rows.indication, ordering.STEADY_DEGC
    if terms.order:
        mean_rows, p = replace(rows, row_degc=rows.temp_degc[rows.run]), fit.parameters
        warmed = equation.response(p, rows, terms) - equation.response(p, mean_rows, terms)
        steady, known_degc = rows.indication - warmed, np.inf
    in_time = ordering.decide(rows, steady, known_degc, terms.powers)

    # polynomials of K, then of F0, of the best straight line, with what the runs leave open
    line = equation.best_line(terms, rows.rate_dps)
    curves = fit.restated(lambda p: np.concatenate(line(p), axis=1)[0])
    parameters = curves.parameters.copy()
    size, bounds = parameters.size // 2, np.zeros((parameters.size, 2))
    if not equation.turns_both_ways(rows.rate_dps):
        # runs of one direction alone do not tell a bend of the response from F0
        bounds[size, 1] = parameters[size] - terms.split(fit.parameters)[equation.ZERO][0, 0]
    if in_time:
        # a half-width that is known, as a rectangular distribution
        bounds[0, 0] = in_time.half_width / np.sqrt(3.0)
        parameters[0] += in_time.shift
    curves = replace(curves, parameters=parameters, bounds=np.hstack((curves.bounds, bounds)))

    # at the mean temperature of the runs that count as repeated
    x = terms.mapped(temperature[repeated_mask].mean(keepdims=True)) if varies else np.zeros(1)
    to_mean_degc: Array = np.asarray(np.kron(np.eye(2), polynomial.powers(x, size - 1)))
    mean_line = curves.combined(to_mean_degc)
    name = forms.line_name(gyro)
    # what differs from run to run and from side to side
    sizes = [s for s in fit.shared if s.error.effect in ("scale", "zero") and s.dof]
    mean = line_model(name, mean_line, run_lines, gyro, repeated, components_of(sizes))
    channel = Channel(gyro, "", True, runs, repeated, mean, fitted, in_time)  # noqa: FBT003
    slope = None
    if varies:
        K, F0 = curves.part(slice(size)), curves.part(slice(size, None))
        degc, K_r, F0_r = run_lines.over_temperature(runs, gyro)
        of_K = curve_model(forms.curve_name(name, "K"), "1/deg", K, terms, runs, (degc, K_r))
        of_F0 = curve_model(forms.curve_name(name, "F0"), "1/s", F0, terms, runs, (degc, F0_r))
        channel = replace(channel, curves=(of_K, of_F0))
        # of the straight line through K(T) at the temperatures of the runs
        slope_of = np.linalg.pinv(np.column_stack((temperature, np.ones(temperature.size))))[0]
        weights = slope_of @ polynomial.powers(terms.mapped(temperature), size - 1)
        slope = K.of(lambda p: weights @ p)
    K_of_runs = run_lines.of_runs(runs, gyro)
    return replace(channel, figures=tuple(_figures(channel, K_of_runs, repeated_mask, slope, spec)))


def _figures(
    channel: Channel,
    K_of_runs: Value,
    repeated_mask: Mask,
    slope: Value | None,
    spec: RateTableRecipe,
) -> Iterator[Figure]:
    """Figures of repeatability and temperature sensitivity, where the runs [r] determine them:
    `repeated_mask` tells the repeated ones, `slope` is that of K over temperature [1/deg/°C].
    """

    def figure(kind: str, standard: str, value: float, unit: str, u: float) -> Figure:
        return Figure(FigureName(kind, standard, channel.name).text, value, unit, u)

    temperature, K = np.array([run.temp_degc for run in channel.runs]), K_of_runs.value
    repeated_degc = temperature[repeated_mask]
    one_temperature = np.isnan(repeated_degc).any() or np.ptp(repeated_degc) <= 2.0 * ROOM_DEGC
    if len(channel.repeated) > 1 and one_temperature:
        value = published.repeatability(K[repeated_mask])
        dof = int(np.sum(repeated_mask)) - 1
        yield figure("repeatability", GJB, value, "ppm", value / float(np.sqrt(2.0 * dof)))
    if slope is None:
        return
    at_reference = np.abs(temperature - spec.reference_temp_degc) <= ROOM_DEGC
    if at_reference.any() and not at_reference.all():
        reference_degc = spec.reference_temp_degc
        value = published.temperature_sensitivity(K, temperature, reference_degc)
        # what runs are off the curve by, raised by Student's t for few, at least the noise in them
        curve = channel.curves[0]
        free = np.sqrt(temperature.size / max(temperature.size - len(curve.coefficients), 1))
        scatter = curve.residual_rms * free * gum.widening(curve.dof)
        # each run's error by itself: the largest slope has no derivative
        changes = [
            published.temperature_sensitivity(K + error, temperature, reference_degc) - value
            for error in np.diag(np.maximum(K_of_runs.u, scatter))
        ]
        u = float(np.linalg.norm(changes))
        yield figure("temperature_sensitivity", GJB, value, "ppm/degC", u)
    assert channel.mean is not None  # noqa: S101 (as of every gyro of a rate table)
    ppm = PPM / channel.mean.value("K")
    u = float(slope.u) * gum.widening(float(slope.dof)) * abs(ppm)
    yield figure("temperature_sensitivity", IEEE, float(slope.value) * ppm, "ppm/degC", u)


def _fit_pair(
    spec: GyroPairRecipe, runs: Runs, run_lines: Lines, fits: equation.Fits
) -> CampaignFit:
    """Fit N, ε, γ and α to the runs about both table axes; the covariance holds the errors of held
    rates, how runs repeat, the difference between the runs' temperatures, and the mounting.
    """
    known_sizes = spec.known_errors()
    run_scale = run_lines.run_scale(known_sizes.get("scale"))
    mean_lines = run_lines.mean_lines().widened_by([run_scale] if run_scale else [])
    # K and F0 of A about a, A about b, B about a, B about b
    places = [2 * "ab".index(gyro) + "ab".index(axis) for gyro, axis in PAIR]
    K = mean_lines.part(places)
    apart_degc = temperature_difference(runs)
    if np.isfinite(apart_degc):
        # K_A, K_B, K_Ba, K_Ab at the temperature in the middle of both runs, by the relative
        # temperature coefficients of both gyros [1/°C]: as stated, or 0 within the largest possible
        # one, rectangular and alike for both
        gyro_of, warmer_degc = [0, 1, 1, 0], np.array([1.0, -1.0, 1.0, -1.0]) * apart_degc / 2.0
        stated = spec.pair.temperature_coefficients_ppm_degc
        if stated is None:
            limit = spec.pair.largest_temperature_coefficient_ppm_degc / PPM
            coefficients, unknown = np.zeros(2), np.full((2, 1), limit / np.sqrt(3.0))
        else:
            coefficients = np.array([stated.a, stated.b]) / PPM
            unknown = spec.pair.temperature_coefficient_uncertainty_ppm_degc / PPM * np.eye(2)
        bounds = (K.parameters * warmer_degc)[:, None] * unknown[gyro_of]
        K = K.combined(np.diag(1.0 + warmer_degc * coefficients[gyro_of]))
        K = replace(K, bounds=np.column_stack((K.bounds, bounds)))
    from_a = K.of(lambda k: k[3] / k[0])
    K = K.part(slice(3))
    by_noise = published.indicate(K)
    flags.refuse_opposite(by_noise, from_a)

    tilt, tilt_dof = find_mounting(by_noise, from_a, known_sizes.get("angle"))
    # about the other gyro's axis a gyro loses its sine, K sin α per radian
    K_A, K_B = K.parameters[:2] * np.sqrt(max(1.0 - float(by_noise.value) ** 2, 0.0))
    tilt_response = np.array([[[0.0], [K_A]], [[K_B], [0.0]]])
    mounting = run_lines.mounting(tilt_response, (float(np.degrees(tilt)), tilt_dof))
    K = K.widened_by([mounting])
    # about its own axis either gyro alone loses K (1 - cos tilt) at most, taken as large as K tilt²
    cosine = np.vstack((np.diag(K.parameters[:2] * tilt**2), np.zeros(2)))
    ratios = published.find_ratios(replace(K, bounds=np.column_stack((K.bounds, cosine))))

    channels = []
    for (gyro, axis), place in zip(PAIR, places, strict=True):
        name, of_runs = forms.line_name(gyro, axis), stated_components(run_scale)
        line = mean_lines.part([place, place + 4])
        mean = line_model(name, line, run_lines, gyro, runs[axis], of_runs)
        bent, rows = None, run_lines.rows_of(runs[axis], gyro)
        if gyro == axis and spec.response == "auto":
            terms = equation.find_terms(rows, varies=False, bent=True)
            if terms.powers:  # without errors that the runs share
                bent = fits.fit(gyro, rows, terms, ())
        channels.append(Channel(gyro, axis, gyro == axis, runs[axis], runs[axis], mean, bent))
    # N, ε, γ and α, the interval of α, which values of a refit do not have, and γ of A about B
    all_runs = [run for axis in "ab" for run in runs[axis]]
    of_b = [run_lines.published(run, "b").fit for run in runs["b"]]
    units = forms.PAIR_UNITS.items()
    pair = forms.PAIR.write(
        "pair",
        [(name, value, unit) for (name, unit), value in zip(units, ratios.results, strict=True)],
        ratios.covariance,
        dof=min(run.rate_dps.size for run in all_runs) - 2,
        residual_rms=rms([fit.residual_rms for fit in of_b]),
        residual_unit="1/s",
        valid=table_runs.valid_ranges(all_runs),
        effective_dof=np.array(ratios.dof),
        components=stated_components(run_scale, mounting),
    )
    low, high = ratios.alpha_interval_deg
    ends = (
        Figure("alpha_low_95_deg", low, "deg", 0.0),
        Figure("alpha_high_95_deg", high, "deg", 0.0),
    )
    _, _, gamma, alpha = pair.coefficients
    indicated = float(ratios.indicated.value)
    figures = (
        *pair.coefficients,
        replace(alpha, name="orthogonality_error_deg", value=90.0 - alpha.value),
        *(() if fits.earlier else ends),
        Figure("side", 1.0 if gamma.value >= 0.0 else -1.0, "1", 0.0),
        Figure("clamped", float(abs(indicated) > 1.0), "1", 0.0),
        replace(gamma, name="gamma_indicated", value=indicated),
        figure_of("gamma_from_a_about_b", from_a, "1"),
    )
    return CampaignFit(
        tuple(channels),
        run_lines,
        within_runs=run_scale is None,
        pair=pair,
        pair_figures=figures,
        gammas=(by_noise, from_a),
    )


def find_mounting(
    indicated: Value, from_a: Value, known_sizes: tuple[float, float] | None
) -> tuple[float, float]:
    """Standard deviation [rad] of the angle between a gyro's axis and its table axis, and its
    degrees of freedom: what the two γ of a pair by noise alone differ by, or what is known [°]
    pooled with it.
    """
    cosine = min(abs(float(indicated.value)), 1.0)
    sine = max(float(np.sqrt(1.0 - cosine**2)), SMALL_SINE)
    squared_difference = (
        (float(from_a.value) - float(indicated.value)) ** 2 if sine > SMALL_SINE else 0.0
    )
    if known_sizes is None:
        # noise is not taken off: two γ that agree by chance would hide the tilts
        return float(np.sqrt(squared_difference)) / sine, 1.0
    value, dof = np.radians(known_sizes[0]), known_sizes[1]
    noise = float(from_a.u) ** 2 + float(indicated.u) ** 2
    square = 0.5 * max(squared_difference - noise, 0.0) / sine**2
    pooled = (dof * value**2 + square) / (dof + 1.0) if np.isfinite(dof) else value**2
    return float(np.sqrt(pooled)), dof + 1.0


def _fit_axes(
    spec: GyroTriadRecipe,
    runs: Runs,
    groups: Sequence[Runs],
    run_lines: Lines,
    fits: equation.Fits,
) -> CampaignFit:
    """Fit sensitivities and angles of each set of runs, and each sensitivity over temperature where
    the temperature varies.
    """
    known_sizes = spec.known_errors()
    S, mounting = run_lines.sensitivity(), list[Shared]()
    run_scale = run_lines.run_scale(known_sizes.get("scale"))
    if "angle" in known_sizes:
        # a tilt toward one of the other axes
        tilt_response = np.array([np.delete(S, axis, axis=1) for axis in range(S.shape[1])])
        tilt_response = np.swapaxes(tilt_response, 0, 1)
        mounting.append(run_lines.mounting(tilt_response, known_sizes["angle"]))
    sized_errors = [*([run_scale] if run_scale else []), *mounting]
    of_groups = [[run for axis in forms.AXES for run in group[axis]] for group in groups]
    degc = np.array([np.mean([run.temp_degc for run in group]) for group in of_groups])
    logged = bool(np.isfinite(degc).all())
    reference = int(np.argmin(np.abs(degc - spec.reference_temp_degc))) if logged else 0
    sets = []
    for s, group in enumerate(of_groups):
        suffix = "" if s == reference else f".at_{degc[s]:.0f}"
        sets.append(_fit_set(spec, run_lines, sized_errors, group, s, suffix))
    flags.require_own_axes(sets, spec.gyros)

    all_runs = [run for axis in forms.AXES for run in runs[axis]]
    curves = list[Model]()
    if len(sets) > 1:
        rows = replace(run_lines.rows, line=run_lines.rows.channel)
        order = max(min(polynomial.HIGHEST_ORDER, len(sets) - 2), 0)
        shapes = (equation.ASYMMETRY,) if rows.shows_asymmetry else ()
        middle_half = polynomial.middle_and_half(rows.row_degc)
        terms = equation.ResponseTerms(S.size, order, middle_half, shapes)
        own_K = np.repeat(np.linalg.norm(S, axis=1), S.shape[1])
        errors = [*equation.shared_errors(rows, terms, S.ravel(), own_K)]
        for number, error in enumerate(errors):
            if run_scale and error.name == run_scale.name:
                size, dof = run_scale.size, run_scale.size_dof
                errors[number] = replace(error, size=size, size_dof=dof)
        fitted = fits.fit("axes", rows, terms, errors)
        # over temperature: K of each line and, where the earth's rate ω is known, the bias of each
        # gyro, the mean of F0 − K ω over the axes
        terms, vertical_dps = fitted.terms, table_runs.vertical_rate_dps(spec)
        best_line = equation.best_line(terms, rows.rate_dps)

        def polynomials(p: Numbers) -> Numbers:
            K, F0 = best_line(p)
            if vertical_dps is None:
                return K.ravel()
            biases = np.mean((F0 - vertical_dps * K).reshape(len(spec.gyros), 3, -1), axis=1)
            return np.concatenate((K, biases)).ravel()

        of_all, powers = fitted.fit.restated(polynomials), terms.order + 1
        of_K = of_all.part(slice(powers * terms.lines)).widened_by(mounting)
        for k, (gyro, axis) in enumerate(product(spec.gyros, forms.AXES)):
            K, name = of_K.part(slice(powers * k, powers * (k + 1))), forms.line_name(gyro, axis)
            degc, K_r, _ = run_lines.over_temperature(runs[axis], gyro)
            name = forms.curve_name(name, "K")
            curves.append(curve_model(name, "1/deg", K, terms, all_runs, (degc, K_r)))
        if vertical_dps is not None:
            for k, gyro in enumerate(spec.gyros, terms.lines):
                bias = of_all.part(slice(powers * k, powers * (k + 1)))
                degc, K_r, F0_r = run_lines.over_temperature(all_runs, gyro)
                of_runs, name = (degc, F0_r - vertical_dps * K_r), forms.curve_name(gyro, "bias")
                curves.append(curve_model(name, "1/s", bias, terms, all_runs, of_runs))
    channels = []
    for index, (gyro, axis) in enumerate(product(spec.gyros, forms.AXES)):
        senses = forms.AXES[int(np.argmax(np.abs(sets[reference].misalignment(gyro))))]
        curve = tuple(curves[index : index + 1])
        channels.append(Channel(gyro, axis, axis == senses, runs[axis], curves=curve))
    return CampaignFit(
        tuple(channels),
        run_lines,
        within_runs=run_scale is None,
        sets=tuple(sets),
        bias_curves=tuple(curves[len(channels) :]),
    )


def _fit_set(
    spec: GyroTriadRecipe,
    run_lines: Lines,
    sized_errors: Sequence[Shared],
    runs: Sequence[TableRun],
    number: int,
    suffix: str,
) -> AxesSet:
    """Sensitivities of one set of runs, what follows from them, and biases F0 − K ω where ω, the
    earth's rate about the table's axis, is known; `sized_errors` are errors of known size.
    """
    line_mask, count = run_lines.set_of == number, len(spec.gyros)
    vertical_dps = table_runs.vertical_rate_dps(spec)
    runs_about = np.bincount(run_lines.axis_of[line_mask])
    errors = [*sized_errors]
    if vertical_dps is not None:
        errors += run_lines.run_zeros(line_mask, vertical_dps)

    def S_and_B(p: Numbers) -> Numbers:  # noqa: N802 (the letters of the form)
        K, F0 = p.reshape(2, count, 3)
        if vertical_dps is None:
            return K.ravel()
        biases = np.average(F0 - vertical_dps * K, axis=1, weights=runs_about)
        return np.concatenate((K.ravel(), biases))

    fit = run_lines.mean_lines(line_mask).restated(S_and_B).widened_by(errors)
    figures = [*of_input_axes(fit.part(slice(3 * count)), spec.gyros)]
    if vertical_dps is not None:
        sizes = np.linalg.norm(fit.parameters[: 3 * count].reshape(-1, 3), axis=1)
        biases = fit.of(lambda p: p[3 * count :] / sizes * DPH_PER_DPS)
        for g, gyro in enumerate(spec.gyros):
            figures.append(figure_of(f"bias.{gyro}", biases, "deg/h", g))
    sensitivities, names_of_biases = forms.triad_names(spec.gyros)
    names_and_units = [(name, "1/deg") for name in sensitivities] + [
        (name, "1/s") for name in names_of_biases
    ]
    of_runs = [run_lines.published(run, gyro).fit for run in runs for gyro in spec.gyros]
    model = forms.TRIAD.write_fit(
        f"triad{suffix}",
        fit,
        names_and_units[: len(fit.parameters)],
        residual_rms=rms([line_fit.residual_rms for line_fit in of_runs]),
        residual_unit="1/s",
        valid=table_runs.valid_ranges(runs),
    )
    model = replace(
        model,
        dof=min(line_fit.dof for line_fit in of_runs),
        components=stated_components(*sized_errors),
    )
    degc = float(np.mean([run.temp_degc for run in runs]))
    return AxesSet(degc, suffix, model, {figure.name: figure for figure in figures})
