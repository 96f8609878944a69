"""Fits → gyro_scale.json and, for several gyros about several axes, gyro_orthogonality.json."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from calibkit.coefficients import Component, Condition, Figure, Model, Parameter, StageResult
from calibkit.constants import DPH_PER_DPS
from calibkit.fit.complex_step import Numbers
from calibkit.fit.shared import Shared
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.forms import components_of
from calibkit.instruments.gyro_scale import (
    equation,
    forms,
    over_runs,
    pair_fit,
    table_runs,
    triad_fit,
)
from calibkit.instruments.gyro_scale.lines import Lines
from calibkit.instruments.gyro_scale.numeric import gjb_figures
from calibkit.instruments.gyro_scale.recipe import GyroRecipe, OwnAxisRecipe
from calibkit.numeric.dispersion import rms

PAIR_LINES = (("a", "a"), ("b", "b"), ("b", "a"), ("a", "b"))
"""(gyro, table axis) of the lines of a pair, own axes first."""


def _result(
    file: str,
    spec: GyroRecipe,
    models: Sequence[Model],
    figures: Sequence[Figure],
    flags: Sequence[str],
) -> StageResult:
    """Content of a coefficient file; its conditions state the latitude and the earth's rate about
    the table axis, which F0 includes, where they are known.
    """
    vertical, latitude = table_runs.vertical_rate_dps(spec), spec.site.latitude_deg
    conditions: tuple[Condition, ...] = ()
    if vertical is not None and latitude is not None:
        conditions = (
            Condition("latitude", latitude, "deg"),
            Condition("earth_rate_about_table_axis", vertical, "deg/s"),
        )
    return StageResult(
        file.removesuffix(".json"), tuple(models), tuple(figures), tuple(flags), conditions
    )


def list_rate_table_results(
    gyros: Sequence[over_runs.GyroOverRuns],
    run_lines: Lines,
    flags: Sequence[str],
    spec: OwnAxisRecipe,
) -> tuple[StageResult, ...]:
    """Coefficient file of rate-table runs: for every gyro the mean at the reference temperature, K
    and F0 over temperature, the line of each run and the response; figures over all runs and of
    each run.
    """
    models: list[Model] = []
    figures: list[Figure] = []
    for one in gyros:
        name = forms.line_name(one.gyro)
        # what differs from run to run and from side to side
        sizes = [s for s in one.fitted.fit.shared if s.error.effect in ("scale", "zero") and s.dof]
        parts = components_of(sizes)
        models.append(_mean_model(name, one.gyro, one.at_room, run_lines, one.line, parts))
        models += one.curves
        figures += over_runs.run_figures(name, one, spec)
        for run in one.runs:
            line = f"{name}.{run.log.name}"
            models.append(_line_model(line, run_lines, run, one.gyro))
            figures += _line_figures(line, run_lines, run, one.gyro)
            figures += _bias_figures(line, run_lines.line(run, one.gyro), spec)
        if one.response is not None:
            models.append(_response_model(forms.response_name(name), one.response, one.runs))
    return (_result(forms.SCALE_FILE, spec, models, figures, flags),)


def list_pair_results(fitted: pair_fit.PairFit, spec: OwnAxisRecipe) -> tuple[StageResult, ...]:
    """Coefficient files of a pair: lines of each gyro about each axis with figures about the own
    axes; N, ε, γ, α as model and figures, the interval of α and both estimates of γ.
    """
    models: list[Model] = []
    figures: list[Figure] = []
    run_lines, stated = fitted.run_lines, _stated_components(fitted.run_scale)
    for g, axis in PAIR_LINES:
        name, runs = forms.line_name(g, axis), fitted.runs[axis]
        models.append(_mean_model(name, g, runs, run_lines, fitted.line(g, axis), stated))
        # a projection's bias is referred to the gyro's own K
        own_K = float(fitted.line(g, g).parameters[0]) if g != axis else None
        for run in runs:
            line = name if len(runs) == 1 else f"{name}.{run.log.name}"
            if line != name:
                models.append(_line_model(line, run_lines, run, g))
            if g == axis:
                figures += _line_figures(line, run_lines, run, g)
            figures += _bias_figures(line, run_lines.line(run, g), spec, own_K)
        response = fitted.responses[g]
        if g == axis and response is not None:
            models.append(_response_model(forms.response_name(name), response, runs))
    pair = _pair_model(fitted)
    return (
        _result(forms.SCALE_FILE, spec, models, figures, fitted.flags),
        _result(forms.ORTHOGONALITY_FILE, spec, [pair], _pair_figures(fitted, pair), fitted.flags),
    )


def list_triad_results(fitted: triad_fit.AxesFit, spec: GyroRecipe) -> tuple[StageResult, ...]:
    """Coefficient files of a triad: lines of each gyro about each axis in each run, polynomials,
    figures about main axes; sensitivities and biases of every set with covariance, angles and
    misalignment matrix.
    """
    models: list[Model] = []
    figures: list[Figure] = []
    for gyro in fitted.gyros:
        for axis in forms.AXES:
            for run in fitted.runs[axis]:
                name = fitted.name(gyro, axis, run)
                models.append(_line_model(name, fitted.run_lines, run, gyro))
                if axis == fitted.main_axis(gyro):
                    figures += _line_figures(name, fitted.run_lines, run, gyro)
    for one in fitted.sets:
        if one.bias is not None:  # the latitude is known
            dph = DPH_PER_DPS / one.triad.magnitude.value
            found = np.column_stack((one.bias.value * dph, one.bias.u * dph, one.bias.dof)).tolist()
            for gyro, (value, u, dof) in zip(fitted.gyros, found, strict=True):
                figures.append(Figure(fitted.named(f"bias.{gyro}", one), value, "deg/h", u, dof))
    angles = [figure for one in fitted.sets for figure in _triad_figures(fitted, one)]
    triads = [_triad_model(fitted, one) for one in fitted.sets]
    models += fitted.curves
    return (
        _result(forms.SCALE_FILE, spec, models, figures, fitted.flags),
        _result(forms.ORTHOGONALITY_FILE, spec, triads, angles, fitted.flags),
    )


LINE = (("K", "1/deg"), ("F0", "1/s"))
"""Coefficients of a line with their units."""


def _line_model(name: str, run_lines: Lines, run: table_runs.TableRun, gyro: str) -> Model:
    """Line model (K and F0) of one gyro in one run."""
    line = run_lines.published(run, gyro)
    model = forms.LINE.write_fit(
        name,
        run_lines.line(run, gyro).weighted(np.eye(2, 3)),
        LINE,
        residual_rms=line.fit.residual_rms,
        residual_unit="1/s",
        valid=table_runs.valid_ranges([run]),
        parameters=_temperature([run]),
    )
    return replace(model, dof=line.fit.dof, components=())


def _mean_model(
    name: str,
    gyro: str,
    runs: Sequence[table_runs.TableRun],
    run_lines: Lines,
    line: Fit,
    components: tuple[Component, ...],
) -> Model:
    """Line model (K and F0) of the mean over runs."""
    of_runs = [run_lines.published(run, gyro).fit for run in runs]
    model = forms.LINE.write_fit(
        name,
        line,
        LINE,
        residual_rms=rms([fit.residual_rms for fit in of_runs]),
        residual_unit="1/s",
        valid=table_runs.valid_ranges(runs),
        parameters=(Parameter("runs", float(len(runs)), "1"), *_temperature(runs)),
    )
    return replace(model, dof=sum(fit.dof for fit in of_runs), components=components)


def _temperature(runs: Sequence[table_runs.TableRun]) -> tuple[Parameter, ...]:
    """Mean case temperature of runs where it was logged."""
    degc = float(np.mean([run.temp_degc for run in runs]))
    return (Parameter("temp_case", degc, "degC"),) if np.isfinite(degc) else ()


def _stated_components(*errors: Shared | None) -> tuple[Component, ...]:
    """Components of errors that are in the uncertainty with their sizes."""
    return tuple(
        Component(
            error.group,
            error.effect,
            error.size,
            error.unit,
            error.size / float(np.sqrt(2.0 * error.size_dof)),
            error.levels,
        )
        for error in errors
        if error and error.size
    )


def _response_model(
    name: str, response: equation.Fitted, runs: Sequence[table_runs.TableRun]
) -> Model:
    """Model of the indication over table rate and temperature."""
    fitted, _, terms = response
    K_order, F0_order = terms.orders
    named = [(f"K{k}", "1/deg") for k in range(K_order + 1)]
    named += [(f"F{k}", "1/s") for k in range(F0_order + 1)]
    letters = forms.BEND_LETTERS[: terms.bend_order + 1]
    named += [(f"{letter}{k}", "1/s") for letter in letters for k in terms.powers]
    parameters, valid = (
        [Parameter("fastest_dps", terms.fastest_dps, "deg/s")],
        table_runs.valid_ranges(runs),
    )
    if max(terms.orders):
        middle, half = terms.middle_half
        parameters += [
            Parameter("temp_middle_degc", middle, "degC"),
            Parameter("temp_half_degc", half, "degC"),
        ]
    else:
        valid.pop(forms.TEMPERATURE, None)
    return forms.RESPONSE.write_fit(
        name,
        fitted,
        named,
        residual_rms=rms(fitted.noise_residual),
        residual_unit="1/s",
        valid=valid,
        parameters=tuple(parameters),
    )


def _pair_model(fitted: pair_fit.PairFit) -> Model:
    """Model of N, ε, γ and α of a pair."""
    found, run_lines = fitted.found, fitted.run_lines
    runs = [run for group in fitted.runs.values() for run in group]
    return forms.PAIR.write(
        "pair",
        [
            (name, value, unit)
            for (name, unit), value in zip(forms.PAIR_UNITS.items(), found.values, strict=True)
        ],
        found.covariance,
        dof=min(run.rate_dps.size for run in runs) - 2,
        residual_rms=rms(
            [run_lines.published(run, "b").fit.residual_rms for run in fitted.runs["b"]]
        ),
        residual_unit="1/s",
        valid=table_runs.valid_ranges(runs),
        effective_dof=np.array(found.dof),
        components=_stated_components(fitted.run_scale, fitted.mounting),
    )


def _pair_figures(fitted: pair_fit.PairFit, pair: Model) -> list[Figure]:
    """Figures of N, ε, γ and α, the interval of α, and the second estimate of γ."""
    found = fitted.found
    low, high = found.alpha_interval_deg
    _, _, u_gamma, u_alpha = (c.standard_uncertainty for c in pair.coefficients)
    second = found.gamma_from_a
    from_a = float(second.value), "1", float(second.u), float(second.dof)
    return [
        *pair.coefficients,
        Figure("orthogonality_error_deg", found.orthogonality_error_deg, "deg", u_alpha),
        Figure("alpha_low_95_deg", low, "deg", 0.0),
        Figure("alpha_high_95_deg", high, "deg", 0.0),
        Figure("side", 1.0 if found.side == "same" else -1.0, "1", 0.0),
        Figure("clamped", 1.0 if found.clamped else 0.0, "1", 0.0),
        Figure("gamma_indicated", found.gamma_indicated, "1", u_gamma),
        Figure("gamma_from_a_about_b", *from_a),
    ]


def _triad_model(fitted: triad_fit.AxesFit, one: triad_fit.AxesSet) -> Model:
    """Model of the sensitivities of one set and, where the latitude is known, of the biases."""
    names, biases = forms.triad_names(fitted.gyros)
    units = ["1/deg"] * len(names) + ["1/s"] * len(biases)
    of_runs = [fitted.run_lines.published(run, g).fit for run in one.runs for g in fitted.gyros]
    model = forms.TRIAD.write_fit(
        fitted.named("triad", one),
        one.fit,
        list(zip([*names, *biases], units, strict=True))[: one.fit.parameters.size],
        residual_rms=rms([fit.residual_rms for fit in of_runs]),
        residual_unit="1/s",
        valid=table_runs.valid_ranges(one.runs),
    )
    stated = _stated_components(fitted.run_scale, fitted.mounting)
    return replace(model, dof=min(fit.dof for fit in of_runs), components=stated)


def _triad_figures(fitted: triad_fit.AxesFit, one: triad_fit.AxesSet) -> Iterator[Figure]:
    """Figures of one set: scale factors about the input axes, misalignment matrix and pairwise
    angles.
    """

    def figure(name: str, unit: str, found: Value, at: Any) -> Figure:  # noqa: ANN401 (an index)
        numbers = (float(part[at]) for part in (found.u, found.dof))
        return Figure(fitted.named(name, one), float(found.value[at]), unit, *numbers)

    triad, gyros = one.triad, fitted.gyros
    for g, gyro in enumerate(gyros):
        yield figure(f"scale_factor.{gyro}", "1/deg", triad.magnitude, g)
        for a, axis in enumerate(forms.AXES):
            yield figure(f"misalignment.{gyro}{axis}", "1", triad.misalignment, (g, a))
    for pair in fitted.pairs:
        name = "_".join(gyros[g] for g in pair)
        angle = figure(f"angle_deg.{name}", "deg", triad.angles_deg, pair)
        yield angle
        name = fitted.named(f"orthogonality_error_deg.{name}", one)
        yield replace(angle, name=name, value=90.0 - angle.value)


def _line_figures(
    name: str, run_lines: Lines, run: table_runs.TableRun, gyro: str
) -> Iterator[Figure]:
    """Figures of one line in the terms of both standards."""
    u_K = float(run_lines.of_runs([run], gyro).u[0])
    for f in gjb_figures.figures(run_lines.published(run, gyro), u_K):
        text = forms.FigureName(f.name, f.standard, name).text
        yield Figure(text, f.value, f.unit, f.standard_uncertainty)


def _bias_figures(
    name: str, line: Fit, spec: GyroRecipe, own_K: float | None = None
) -> Iterator[Figure]:
    """Figures of a line's bias (F at rest − K ω)/K, ω the earth's rate about the table axis where
    it is known; `own_K` is the K that a projection is referred to.
    """
    vertical = table_runs.vertical_rate_dps(spec)
    if vertical is None:
        return

    def bias_dph(p: Numbers) -> Numbers:
        K, _, rest = p
        own = K if own_K is None else own_K
        return np.asarray((rest - K * vertical) / own * DPH_PER_DPS)

    found = line.of(bias_dph)
    yield Figure(f"bias.{name}", float(found.value), "deg/h", float(found.u), float(found.dof))
