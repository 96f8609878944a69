"""Frozen coefficients compared with unseen runs: scale factors, rates before and after
compensation, and the ratios of a pair.

    e = K - K(T),   u² = u²(K) + u²(K(T)) + s² + u_B²

K is that of the unseen run, K(T) the quantity of the files at its temperature, s how runs repeat,
u_B the type B terms; `fit.unseen` judges e over u.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.certificate.quantities import Quantity
from calibkit.coefficients import Criterion, Model, Record, over_u
from calibkit.constants import DPH_PER_DPS
from calibkit.errors import CoefficientError, FrameError
from calibkit.fit.unseen import unseen
from calibkit.fit.value import Value
from calibkit.frame import Log, require
from calibkit.instruments.gyro_scale import (
    acceptance,
    compensate,
    fit,
    forms,
    published,
    quantities,
    table_runs,
)
from calibkit.instruments.gyro_scale.flags import WITHIN
from calibkit.instruments.gyro_scale.lines import Lines
from calibkit.instruments.gyro_scale.published import GJB, IEEE, PPM, FigureName, Line
from calibkit.instruments.gyro_scale.recipe import AnyRecipe, GyroPairRecipe, GyroTriadRecipe
from calibkit.numeric import gum
from calibkit.numeric.dispersion import rms
from calibkit.recipe import type_b
from calibkit.report.summary import Summary
from calibkit.report.table import Table

FULL_SCALE = 100.0
"""Table rate [°/s] taken as full scale where a model does not state its own."""
OF_SCALE = ("scale-factor error", "rate error")
"""Names of limits on scale factors."""
MOST_DOF = 1e6
"""Degrees of freedom that stand for any number above."""
OTHER_AXIS = 0.1
"""Departure of a rate gain from 1 above which the run is about another axis: no scale factor drifts
so far.
"""
SUFFIX = {GJB: "_gjb", IEEE: "_ieee"}
"""Standard → end of the key of an asymmetry in validation.json."""


ScaleFactors = tuple[Value, Value]
"""Scale factor of a gyro in an unseen run, and that of the files as another run shows it."""


@dataclass(frozen=True, slots=True)
class Compared:
    """One unseen run beside the files."""

    entry: dict[str, Any]
    """Of the run in validation.json."""
    errors: list[dict[str, Any]]
    """Errors before and after compensation, of each gyro or about the axes of the base."""
    scales: list[ScaleFactors]
    lines: list[Line]
    """Of compensated rates, or published ones of a triad."""


def validate(
    spec: AnyRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Compare scale factors and rates of unseen runs with the frozen coefficients; with both logs
    of a pair, also N and γ.
    """
    matrices = compensate.read_invertible(spec, records)
    frozen = {one.name: one for one in quantities.list_sensitivities(records, spec)}
    within_runs = quantities.hold_within_runs(records.values())
    runs: dict[str, tuple[table_runs.TableRun, ...]] = {}
    compared: list[Compared] = []
    flags: list[str] = []
    criteria: list[Criterion] = []
    for log in logs:
        axis = spec.find_axis(log.file)
        run = table_runs.fit_run(spec, log)
        run_lines = Lines.of([[(0, run)]])
        runs[axis] = (*runs.get(axis, ()), run)
        flags += [*run.flags, *run_lines.flag_drifts()]
        turned = matrices
        if not isinstance(spec, GyroTriadRecipe):
            turned = tuple(one for one in matrices if spec.own_axis(one.gyros[0]) == axis)
        one = _compare_run(spec, run_lines, run, axis, turned, frozen)
        compared.append(one)
        if np.isfinite(run.temp_degc):
            for matrix in turned:
                flags += compensate.flag_temperatures(log.file, matrix, run.plateaus.temp_degc)
        if not within_runs:
            error = np.array([K.value - frozen.value for K, frozen in one.scales])
            variance = np.array([K.u**2 + frozen.u**2 for K, frozen in one.scales])
            dof = np.inf, max(float(sum(frozen.dof for _, frozen in one.scales)), 1.0)
            judged = unseen(error, np.zeros((error.size, 1)), variance, dof=dof)
            criteria.append(over_u(f"{log.file}: rms error of K", judged.to_object()))
    body: dict[str, Any] = {"logs": [one.entry for one in compared]}
    tables, of_limits, undecided = _judge_errors(spec, compared, within=within_runs)
    if isinstance(spec, GyroPairRecipe) and len(runs) > 1:
        again = fit.fit_pair(spec, runs)
        body["pair"] = _compare_pair(records, again.pair, spec.type_b)
        tables.append(_tabulate_pair_again(body["pair"]))
        undecided += again.flags
        criteria += _judge_pair(body["pair"], within=within_runs)
    flags += undecided
    lines = [line for one in compared for line in one.lines]
    criteria += [*of_limits, *acceptance.judge_noise(lines, spec.acceptance)]
    return body, Summary("", tuple(tables), tuple(dict.fromkeys(flags)), tuple(criteria))


def _compare_run(
    spec: AnyRecipe,
    run_lines: Lines,
    run: table_runs.TableRun,
    axis: str,
    turned: Sequence[forms.GyroMatrix],
    frozen: Mapping[str, Quantity],
) -> Compared:
    """Gyros of a run about their own axes, or all of a triad, beside the files."""
    log = run.log
    entry: dict[str, Any] = {"name": log.file, "sha256": log.sha256, "rows": log.rows}
    triad = isinstance(spec, GyroTriadRecipe)
    scales = [
        _scale_factor(spec, run_lines, run, matrix, gyro, axis if triad else "", frozen)
        for matrix in turned
        for gyro in matrix.gyros
    ]
    if isinstance(spec, GyroTriadRecipe):
        vertical_dps = table_runs.vertical_rate_dps(spec) or 0.0
        entry |= _compare_base(run, axis, turned[0], vertical_dps)
        return Compared(entry, [entry], scales, list(run_lines.straightened({})))
    of_gyros = [
        _compare_line(spec, run_lines, run, matrix, scale)
        for matrix, scale in zip(turned, scales, strict=True)
    ]
    errors = [error for error, _ in of_gyros]
    return Compared(entry | {"gyros": errors}, errors, scales, [line for _, line in of_gyros])


def _judge_errors(
    spec: AnyRecipe, compared: Sequence[Compared], *, within: bool
) -> tuple[list[Table], list[Criterion], list[str]]:
    """Table of the errors of all runs, criteria of the recipe's limits, and flags for those that
    decide nothing: where scale factors hold within their runs, a run beyond a limit of theirs
    rejects, and one within it accepts nothing.
    """
    shown = [(one.entry["name"], error) for one in compared for error in one.errors]
    errors = [error for _, error in shown]
    if isinstance(spec, GyroTriadRecipe):
        table, limits = _tabulate_base_errors(shown), acceptance.UNSEEN_BASE_LIMITS
        errors = [error["after"] for error in errors]
    else:
        table, limits = _tabulate_line_errors(shown), acceptance.UNSEEN_LINE_LIMITS
    criteria: list[Criterion] = []
    flags: list[str] = []
    for one in acceptance.judge_unseen(errors, limits, spec.acceptance):
        if within and one.passed and one.name in OF_SCALE:
            size = f"{one.name} {one.value:.3g} {one.unit}"
            flags.append(f"{size} of these runs decides no limit: {WITHIN}")
        else:
            criteria.append(one)
    return [table], criteria, flags


def _judge_pair(compared: Sequence[Mapping[str, Any]], *, within: bool) -> Iterator[Criterion]:
    """Criteria that γ of unseen runs, and N where runs tell how scale factors repeat, differ as
    their uncertainties state.
    """
    for one in compared:
        if one["name"] == "gamma" or (one["name"] == "N" and not within):
            error, u = np.array([one["difference"]]), np.array([[one["standard_uncertainty"]]])
            over = unseen(error, u, dof=(one["dof"], np.inf)).to_object()
            yield over_u(f"pair: error of {one['name']}", over)


def _scale_factor(
    spec: AnyRecipe,
    run_lines: Lines,
    run: table_runs.TableRun,
    matrix: forms.GyroMatrix,
    gyro: str,
    axis: str,
    frozen: Mapping[str, Quantity],
) -> ScaleFactors:
    """Scale factor of a gyro about an axis in a run and in the files: with how runs repeat and type
    B terms, at the run's temperature, clamped to the fitted range.
    """
    quantity, model = frozen[quantities.sensitivity_name(gyro, axis)], matrix.model
    degc = float(_temperatures(run).mean())
    inputs = quantity.inputs
    point = quantity.point({one.column: min(max(degc, one.low), one.high) for one in inputs})
    ((_, u, dof),) = point.type_a()
    K = point.value
    fastest = max(map(abs, model.valid.get(forms.RATE, ())), default=0.0) or FULL_SCALE
    slopes = {forms.RATE: (fastest, -K / fastest), "time_s": (1.0, K), **point.influences}
    other = type_b.combine_terms(spec.type_b, quantity.called, K, quantity.unit, slopes)
    repeats = [
        part.value / PPM * abs(K)
        for part in model.components
        if (part.effect, part.unit) == ("scale", "ppm")
    ]
    if matrix.curves and not repeats:
        repeats = [point.parts[0][0].residual_rms]
    of_run = run_lines.of_runs([run], gyro)
    u_frozen = float(np.linalg.norm([u, max(repeats, default=0.0), other]))
    of_files = Value(*(np.array(number) for number in (K, u_frozen, dof)))
    return Value(of_run.value[0], of_run.u[0], of_run.dof[0]), of_files


def _temperatures(run: table_runs.TableRun) -> Array:
    """Temperatures [p, °C] of the held rates, 0 where they were not logged."""
    return np.nan_to_num(run.plateaus.temp_degc)


def _compare_line(
    spec: AnyRecipe,
    run_lines: Lines,
    run: table_runs.TableRun,
    matrix: forms.GyroMatrix,
    scale: ScaleFactors,
) -> tuple[dict[str, Any], Line]:
    """JSON object of one gyro of a run about its own axis, and the line of its compensated
    rates.
    """
    (gyro,), (of_run, of_files) = matrix.gyros, scale
    u_found, frozen = float(of_run.u), float(of_files.value)
    line, temperature = run_lines.published(run, gyro), _temperatures(run)
    if matrix.over_temperature and not np.isfinite(run.temp_degc):
        require(run.log.file, run.log.frame.columns, [forms.TEMPERATURE])
    indication = run.scale(gyro).indication
    after = matrix.rates(indication[:, None], temperature)[:, 0]
    K_of_rows, zero_of_rows = matrix.at(temperature)
    compensated = Line(line.rate_dps, after, line.noise / np.abs(K_of_rows[:, 0, 0]))
    K_before, F0_before = (part.item() for part in matrix.reference)
    before_is = "K and F0 of the mean model"
    if spec.nominal_scale_factor is not None:
        K_before, F0_before = spec.nominal_scale_factor, 0.0
        before_is = "nominal scale factor"
    compared = {
        "gyro": gyro,
        "K": line.K,
        "K_standard_uncertainty": u_found,
        "K_frozen": frozen,
        "K_frozen_standard_uncertainty": float(of_files.u),
        "scale_factor_error_ppm": (line.K / frozen - 1.0) * PPM,
        "scale_factor_error_standard_uncertainty_ppm": (
            float(np.hypot(u_found, of_files.u)) / abs(frozen) * PPM
        ),
        "scale_factor_error_dof": min(float(of_files.dof), MOST_DOF),
        "zero_error_dph": (line.F0 / line.K - float(zero_of_rows.mean()) / frozen) * DPH_PER_DPS,
        "rate_gain": compensated.K,
        "before_is": before_is,
        "before": _line_errors((indication - F0_before) / K_before, line),
        "after": _line_errors(after, line),
    }
    for figure in published.figures(line, u_found, gyro):
        if figure.unit == "ppm":
            what, standard, _ = FigureName.of(figure.name)
            key = what + SUFFIX[standard] if what == "asymmetry" else what
            compared[f"{key}_ppm"] = figure.value
    return compared, compensated


def _line_errors(rate: Array, line: Line) -> dict[str, float]:
    """Errors of rates [p] against the table's: slope error, rms and largest error relative to full
    scale.
    """
    error = rate - line.rate_dps
    full = float(np.max(np.abs(line.rate_dps)))
    return {
        "scale_factor_error_ppm": (Line(line.rate_dps, rate, line.noise).K - 1.0) * PPM,
        "rate_error_rms_dps": rms(error),
        "rate_error_max_ppm_of_full_scale": float(np.max(np.abs(error))) / full * PPM,
    }


def _compare_base(
    run: table_runs.TableRun, axis: str, matrix: forms.GyroMatrix, vertical_dps: float
) -> dict[str, Any]:
    """JSON object of the rates of a run along and across the turned axis; the uncompensated rates
    use each gyro alone, with its scale factor about its main axis.
    """
    plateaus, temperature = run.plateaus, _temperatures(run)
    if matrix.over_temperature and not np.isfinite(run.temp_degc):
        raise CoefficientError(
            f"{run.log.file}: no column '{forms.TEMPERATURE}'",
            hint="the coefficients are over temperature",
        )
    rates = matrix.rates(plateaus.indication, temperature)
    S, _ = matrix.reference
    main = np.argmax(np.abs(S), axis=1)
    alone = (plateaus.indication - matrix.at(temperature)[1]) / S[np.arange(main.size), main]
    a = forms.AXES.index(axis)
    true = np.zeros_like(rates)
    true[:, a] = plateaus.rate_dps + vertical_dps
    gain = float(np.polyfit(plateaus.rate_dps, rates[:, a], 1)[0])
    if not abs(gain - 1.0) < OTHER_AXIS:
        raise FrameError(
            f"{run.log.file}: the rate about {axis} comes out {gain:.4f} times the table's,"
            " expected about 1",
            hint=(
                "it turns about another axis ([axes]), is in another unit or sign, or is of another"
                " unit's gyros"
            ),
        )
    return {
        "axis": axis,
        "before_is": "each gyro by its scale factor about the axis that it senses most",
        "before": _base_errors(alone - true[:, main], main == a, plateaus.rate_dps),
        "after": _base_errors(rates - true, np.arange(len(forms.AXES)) == a, plateaus.rate_dps),
        "rate_gain": gain,
    }


def _base_errors(error: Array, along: Mask, rate_dps: Array) -> dict[str, float]:
    """Largest errors [n, m] along and across the turned axis, relative to full scale; zero where
    there is no such column.
    """
    full = float(np.max(np.abs(rate_dps))) / PPM
    return {
        f"{kind}_max_ppm_of_full_scale": float(np.max(np.abs(error[:, chosen]), initial=0.0)) / full
        for kind, chosen in (("rate_error", along), ("cross_axis", ~along))
    }


def _compare_pair(
    records: Mapping[str, Record], again: Model | None, terms: Sequence[type_b.TypeB]
) -> list[dict[str, Any]]:
    """JSON objects of N, ε, γ, α of unseen runs against the frozen values."""
    if forms.ORTHOGONALITY_FILE not in records:
        raise CoefficientError(
            f"the run holds no {forms.ORTHOGONALITY_FILE}", hint="it is not a run of gyro_pair"
        )
    frozen, compared = records[forms.ORTHOGONALITY_FILE].model("pair"), []
    for c in frozen.coefficients:
        assert again is not None  # noqa: S101 (a fit of a pair has one)
        unseen_c = next(one for one in again.coefficients if one.name == c.name)
        # terms on the ratio itself, or on α
        slopes, names = quantities.by_angle(frozen, c.name), (f"pair.{c.name}", c.name)
        type_b_u = type_b.combine_terms(terms, names, c.value, c.unit, slopes)
        difference = gum.combine(
            [
                gum.UncertaintyComponent(
                    *(
                        "found",
                        unseen_c.value,
                        unseen_c.standard_uncertainty,
                        "A",
                    ),
                    dof=again.dof_of(unseen_c),
                ),
                gum.UncertaintyComponent(
                    "frozen", c.value, c.standard_uncertainty, "A", dof=frozen.dof_of(c)
                ),
                gum.UncertaintyComponent("type B", c.value, type_b_u, "B"),
            ]
        )
        compared.append(
            {
                "name": c.name,
                "frozen": c.value,
                "found": unseen_c.value,
                "difference": unseen_c.value - c.value,
                "standard_uncertainty": difference.standard_uncertainty,
                "dof": min(difference.effective_dof, MOST_DOF),
                "unit": c.unit,
            }
        )
    return compared


def _tabulate_line_errors(compared: Sequence[tuple[str, Mapping[str, Any]]]) -> Table:
    """Table of the lines of unseen runs: frozen and found K, errors before and after."""
    rows = []
    for name, one in compared:
        before, after = one["before"], one["after"]
        u = one["scale_factor_error_standard_uncertainty_ppm"]
        rows.append(
            (
                f"{name} {one['gyro']}",
                f"{one['K']:.4f}",
                f"{one['K_frozen']:.4f}",
                f"{before['scale_factor_error_ppm']:+.1f}",
                f"{after['scale_factor_error_ppm']:+.1f} ± {u:.1g}",
                f"{before['rate_error_max_ppm_of_full_scale']:.1f}",
                f"{after['rate_error_max_ppm_of_full_scale']:.1f}",
                f"{one['rate_gain']:.6f}",
            )
        )
    heads = ("", "K", "frozen", "K error", "after", "rate error", "after", "gain")
    title = (
        "Frozen coefficients on unseen runs: K error in ppm, largest rate error in ppm of full"
        " scale"
    )
    return Table(title, heads, tuple(rows))


def _tabulate_base_errors(compared: Sequence[tuple[str, Mapping[str, Any]]]) -> Table:
    """Table of rates of unseen runs along and across the turned axis, before and after
    compensation.
    """
    kinds = ("rate_error_max_ppm_of_full_scale", "cross_axis_max_ppm_of_full_scale")
    rows = tuple(
        (
            f"{name} about {one['axis']}",
            *(f"{one[when][kind]:.1f}" for kind in kinds for when in ("before", "after")),
            f"{one['rate_gain']:.6f}",
        )
        for name, one in compared
    )
    title = (
        "Compensated rates of unseen runs: largest error along and across the turned axis, ppm of"
        " full scale"
    )
    return Table(title, ("", "along", "after", "across", "after", "gain"), rows)


def _tabulate_pair_again(entries: Sequence[Mapping[str, Any]]) -> Table:
    """Table of N, ε, γ, α of unseen runs, frozen and found."""
    rows = tuple(
        (
            e["name"],
            f"{e['frozen']:.9f}",
            f"{e['found']:.9f}",
            f"{e['difference']:+.1e} ± {e['standard_uncertainty']:.0e}",
            e["unit"],
        )
        for e in entries
    )
    return Table("The pair again", ("", "frozen", "found", "difference", "unit"), rows)
