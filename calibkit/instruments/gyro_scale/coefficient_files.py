"""Fits → gyro_scale.json and, for several gyros about several axes, gyro_orthogonality.json."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from calibkit.coefficients import Component, Condition, Figure, Model, Parameter, StageResult
from calibkit.constants import DPH_PER_DPS
from calibkit.fit.complex_step import Numbers
from calibkit.fit.solve import Fit
from calibkit.fit.value import Value
from calibkit.instruments.gyro_scale import equation, forms, table_runs
from calibkit.instruments.gyro_scale.campaign import AxesSet, Campaign, GyroPair
from calibkit.instruments.gyro_scale.numeric import gjb_figures
from calibkit.instruments.gyro_scale.recipe import GyroRecipe
from calibkit.numeric.dispersion import rms

LINE = (("K", "1/deg"), ("F0", "1/s"))
"""Coefficients of a line with their units."""


def list_results(campaign: Campaign, spec: GyroRecipe) -> tuple[StageResult, ...]:
    """Coefficient files of a campaign: what each gyro is about each axis, and what is between the
    gyros of a pair or a triad.
    """
    models, figures = _list_scales(campaign, spec)
    files = [(forms.SCALE_FILE, models, figures)]
    if campaign.pair is not None:
        pair = _pair_model(campaign, campaign.pair)
        files.append((forms.ORTHOGONALITY_FILE, [pair], _pair_figures(campaign.pair, pair)))
    if campaign.sets:
        gyros = [channel.gyro for channel in campaign.own]
        triads = [_triad_model(campaign, one, gyros) for one in campaign.sets]
        angles = [figure for one in campaign.sets for figure in _triad_figures(one, gyros)]
        files.append((forms.ORTHOGONALITY_FILE, triads, angles))
    # the latitude, and the earth's rate about the table axis, which F0 includes
    vertical, latitude = table_runs.vertical_rate_dps(spec), spec.site.latitude_deg
    conditions: tuple[Condition, ...] = ()
    if vertical is not None and latitude is not None:
        conditions = (
            Condition("latitude", latitude, "deg"),
            Condition("earth_rate_about_table_axis", vertical, "deg/s"),
        )
    return tuple(
        StageResult(
            file.removesuffix(".json"), tuple(models), tuple(figures), campaign.flags, conditions
        )
        for file, models, figures in files
    )


def _list_scales(campaign: Campaign, spec: GyroRecipe) -> tuple[list[Model], list[Figure]]:
    """Models and figures of each gyro about each axis: of the mean over repeated runs, over
    temperature, of each run, and of the response; the biases of a triad.
    """
    models: list[Model] = []
    figures: list[Figure] = []
    run_lines = campaign.run_lines
    own_K = {one.gyro: float(one.K.value) for one in campaign.own if one.line is not None}
    for channel in campaign.channels:
        if channel.line is not None:
            lines = [run_lines.published(run, channel.gyro) for run in channel.repeated]
            models.append(
                _line_model(
                    channel.name,
                    channel.line,
                    channel.repeated,
                    lines,
                    (Parameter("runs", float(len(lines)), "1"),),
                    channel.components,
                )
            )
        models += channel.curves
        figures += channel.figures
        for run in channel.runs:
            name = channel.name_in(run)
            published = run_lines.published(run, channel.gyro)
            found = run_lines.line(run, channel.gyro)
            if channel.line is None or name != channel.name:
                models.append(_line_model(name, found.weighted(np.eye(2, 3)), [run], [published]))
            if channel.own:
                u_K = float(found.of(lambda p: p[0]).u)
                for one in gjb_figures.figures(published, u_K):
                    text = forms.FigureName(one.name, one.standard, name).text
                    figures.append(Figure(text, one.value, one.unit, one.standard_uncertainty))
            if channel.line is not None:
                # a projection's bias is referred to the gyro's own K
                K = None if channel.own else own_K[channel.gyro]
                figures += _bias_figures(name, found, spec, K)
        if channel.response is not None:
            models.append(_response_model(channel.name, channel.response, channel.runs))
    figures += [figure for one in campaign.sets for figure in _set_biases(campaign, one)]
    return [*models, *campaign.bias_curves], figures


def _set_biases(campaign: Campaign, one: AxesSet) -> Iterator[Figure]:
    """Figures of the biases of a set, where the latitude is known."""
    if one.bias is None:
        return
    dph = DPH_PER_DPS / one.triad.magnitude.value
    found = np.column_stack((one.bias.value * dph, one.bias.u * dph, one.bias.dof)).tolist()
    for channel, (value, u, dof) in zip(campaign.own, found, strict=True):
        yield Figure(f"bias.{channel.gyro}{one.suffix}", value, "deg/h", u, dof)


def _line_model(
    name: str,
    line: Fit,
    runs: Sequence[table_runs.TableRun],
    lines: Sequence[gjb_figures.Line],
    parameters: tuple[Parameter, ...] = (),
    components: tuple[Component, ...] = (),
) -> Model:
    """Line model (K and F0) of one gyro in one run, or of the mean over runs with these published
    lines.
    """
    degc = float(np.mean([run.temp_degc for run in runs]))
    if np.isfinite(degc):
        parameters = (*parameters, Parameter("temp_case", degc, "degC"))
    model = forms.LINE.write_fit(
        name,
        line,
        LINE,
        residual_rms=rms([one.fit.residual_rms for one in lines]),
        residual_unit="1/s",
        valid=table_runs.valid_ranges(runs),
        parameters=parameters,
    )
    return replace(model, dof=sum(one.fit.dof for one in lines), components=components)


def _response_model(
    line: str, response: equation.Fitted, runs: Sequence[table_runs.TableRun]
) -> Model:
    """Model of the indication over table rate and temperature."""
    fitted, _, terms = response
    K_order, F0_order = terms.orders
    named = [(f"K{k}", "1/deg") for k in range(K_order + 1)]
    named += [(f"F{k}", "1/s") for k in range(F0_order + 1)]
    letters = forms.BEND_LETTERS[: terms.bend_order + 1]
    named += [(f"{letter}{k}", "1/s") for letter in letters for k in terms.powers]
    parameters = [Parameter("fastest_dps", terms.fastest_dps, "deg/s")]
    valid = table_runs.valid_ranges(runs)
    if max(terms.orders):
        middle, half = terms.middle_half
        parameters += [
            Parameter("temp_middle_degc", middle, "degC"),
            Parameter("temp_half_degc", half, "degC"),
        ]
    else:
        valid.pop(forms.TEMPERATURE, None)
    return forms.RESPONSE.write_fit(
        forms.response_name(line),
        fitted,
        named,
        residual_rms=rms(fitted.noise_residual),
        residual_unit="1/s",
        valid=valid,
        parameters=tuple(parameters),
    )


def _pair_model(campaign: Campaign, found: GyroPair) -> Model:
    """Model of N, ε, γ and α of a pair."""
    runs = [run for channel in campaign.own for run in channel.runs]
    of_b = [line.fit for channel, _, line in campaign.own_lines() if channel.gyro == "b"]
    return forms.PAIR.write(
        "pair",
        [
            (name, value, unit)
            for (name, unit), value in zip(forms.PAIR_UNITS.items(), found.values, strict=True)
        ],
        found.covariance,
        dof=min(run.rate_dps.size for run in runs) - 2,
        residual_rms=rms([fit.residual_rms for fit in of_b]),
        residual_unit="1/s",
        valid=table_runs.valid_ranges(runs),
        effective_dof=np.array(found.dof),
        components=campaign.components,
    )


def _pair_figures(found: GyroPair, pair: Model) -> list[Figure]:
    """Figures of N, ε, γ and α, the interval of α, and the second estimate of γ."""
    low, high = found.alpha_interval_deg
    _, _, u_gamma, u_alpha = (c.standard_uncertainty for c in pair.coefficients)
    indicated, second = float(found.indicated.value), found.from_a
    from_a = float(second.value), "1", float(second.u), float(second.dof)
    return [
        *pair.coefficients,
        Figure("orthogonality_error_deg", found.orthogonality_error_deg, "deg", u_alpha),
        Figure("alpha_low_95_deg", low, "deg", 0.0),
        Figure("alpha_high_95_deg", high, "deg", 0.0),
        Figure("side", 1.0 if found.same_side else -1.0, "1", 0.0),
        Figure("clamped", float(abs(indicated) > 1.0), "1", 0.0),
        Figure("gamma_indicated", indicated, "1", u_gamma),
        Figure("gamma_from_a_about_b", *from_a),
    ]


def _triad_model(campaign: Campaign, one: AxesSet, gyros: Sequence[str]) -> Model:
    """Model of the sensitivities of one set and, where the latitude is known, of the biases."""
    names, biases = forms.triad_names(gyros)
    units = ["1/deg"] * len(names) + ["1/s"] * len(biases)
    of_runs = [campaign.run_lines.published(run, g).fit for run in one.runs for g in gyros]
    model = forms.TRIAD.write_fit(
        f"triad{one.suffix}",
        one.fit,
        list(zip([*names, *biases], units, strict=True))[: one.fit.parameters.size],
        residual_rms=rms([fit.residual_rms for fit in of_runs]),
        residual_unit="1/s",
        valid=table_runs.valid_ranges(one.runs),
    )
    return replace(model, dof=min(fit.dof for fit in of_runs), components=campaign.components)


def _triad_figures(one: AxesSet, gyros: Sequence[str]) -> Iterator[Figure]:
    """Figures of one set: scale factors about the input axes, misalignment matrix and pairwise
    angles.
    """

    def figure(name: str, unit: str, found: Value, at: Any) -> Figure:  # noqa: ANN401 (an index)
        numbers = (float(part[at]) for part in (found.u, found.dof))
        return Figure(f"{name}{one.suffix}", float(found.value[at]), unit, *numbers)

    triad = one.triad
    for g, gyro in enumerate(gyros):
        yield figure(f"scale_factor.{gyro}", "1/deg", triad.magnitude, g)
        for a, axis in enumerate(forms.AXES):
            yield figure(f"misalignment.{gyro}{axis}", "1", triad.misalignment, (g, a))
    for g, h in triad.pairs:
        name = f"{gyros[g]}_{gyros[h]}"
        angle = figure(f"angle_deg.{name}", "deg", triad.angles_deg, (g, h))
        yield angle
        off = f"orthogonality_error_deg.{name}{one.suffix}"
        yield replace(angle, name=off, value=90.0 - angle.value)


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
