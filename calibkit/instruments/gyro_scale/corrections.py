"""Coefficients of a run → compensated rates of a log, and how far they are off in unseen runs.

    Ω = S(T)⁻¹ (F − B(T)),   or (SᵀS)⁻¹ Sᵀ (F − B) of several gyros about the axes of a base   (1)
    e = K − K(T),   u² = u²(K) + u²(K(T)) + s² + u_B²                                          (2)

A bent response is solved for Ω by Newton's steps (`GyroMatrix.rates`). K is that of the
unseen run, K(T) the quantity of the files at its temperature, s how runs repeat, u_B the type B
terms; `calibkit.fit.unseen` judges e over u. Rates are compared before and after compensation, and
the ratios of a pair.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibkit import check
from calibkit.certificate.quantities import Quantity
from calibkit.errors import CoefficientError, FrameError
from calibkit.fit.unseen import unseen
from calibkit.fit.value import Value
from calibkit.instruments.gyro_scale import (
    certificate,
    fit,
    forms,
    published,
    table_runs,
)
from calibkit.instruments.gyro_scale.coefficient_files import CampaignFit
from calibkit.instruments.gyro_scale.flags import judge_noise, judge_unseen, undecided_limits
from calibkit.instruments.gyro_scale.forms import AXES, TEMPERATURE, GyroMatrix, gyro_column
from calibkit.instruments.gyro_scale.lines import Lines
from calibkit.instruments.gyro_scale.published import GJB, IEEE, PPM, FigureName, Line
from calibkit.instruments.gyro_scale.recipe import AnyRecipe, GyroPairRecipe, GyroTriadRecipe
from calibkit.logs import log_files, write_back
from calibkit.logs.write_back import Applied
from calibkit.numeric import gum
from calibkit.numeric.arrays import Array
from calibkit.numeric.constants import DPH_PER_DPS
from calibkit.numeric.dispersion import rms
from calibkit.recipe import type_b
from calibkit.records.coefficients import Criterion, Record, over_u
from calibkit.records.frame import Log, refuse, require, values
from calibkit.report.summary import Summary
from calibkit.report.table import Table

MOST_DOF = 1e6
"""Degrees of freedom that stand for any number above."""
ALONG, ACROSS = "rate_error_max_ppm_of_full_scale", "cross_axis_max_ppm_of_full_scale"
"""Keys of the largest errors along and across the turned axis."""
Entry = dict[str, Any]
"""JSON object of validation.json."""
RESTED = (
    "rates are zero where the gyro rested on the laboratory's table: the earth's rate there"
    " is taken out with the bias (compensation = 'inertial' leaves it in)"
)


def read_invertible(spec: AnyRecipe, records: Mapping[str, Record]) -> tuple[GyroMatrix, ...]:
    """Matrices of a run; raises CoefficientError where they cannot be solved for rates."""
    matrices = forms.read_matrices(spec, records)
    for matrix in matrices if isinstance(spec, GyroTriadRecipe) else ():
        matrix.require_biases()
        rows, _ = matrix.reference
        unit = rows / np.linalg.norm(rows, axis=1, keepdims=True)
        # noise of the gyros is amplified by at most this factor
        if len(unit) < unit.shape[1] or not np.linalg.cond(unit) < 1e3:
            raise CoefficientError(
                f"the gyros {', '.join(matrix.gyros)} do not sense three axes: rates about them"
                " cannot be had",
                hint="log a gyro of the missing direction too",
            )
    return matrices


def correct(spec: AnyRecipe, records: Mapping[str, Record], data: Path) -> Applied:
    """Add compensated rates to every row of a log: of each gyro about its own axis, or about the
    axes of the base.
    """
    matrices = read_invertible(spec, records)
    # with its temperature where it is needed or logged; a triad needs all its gyros, else the gyros
    # in the log are read
    gyros = tuple(gyro_column(gyro) for matrix in matrices for gyro in matrix.gyros)
    inertial_dps, triad = 0.0, isinstance(spec, GyroTriadRecipe)
    if isinstance(spec, GyroTriadRecipe):
        required_columns = (*gyros, TEMPERATURE) if matrices[0].over_temperature else gyros
        optional = (TEMPERATURE, "time_s")
        log = log_files.read_log(spec, data, data.name, required_columns, optional)
    else:
        inertial_dps = forms.read_earth_rate(spec, records, CoefficientError)
        log = log_files.read_log(spec, data, data.name, (), ("time_s", TEMPERATURE, *gyros))
        if not {*gyros} & {*log.frame.columns}:
            require(log.file, log.frame.columns, gyros[:1])
    columns, rows, flags = list(log.frame.columns), len(log.frame), [*log.notes]
    refuse([*check.find_too_few_rows(log, 1), *check.find_missing_values(log, columns)])
    if "time_s" in columns:
        refuse(check.find_unordered_times(log))
    if TEMPERATURE in columns:
        refuse(check.find_implausible_temperatures(log, [TEMPERATURE]))
    temperature = np.broadcast_to(0.0, rows)
    if TEMPERATURE in columns:
        temperature = values(log.frame, TEMPERATURE)
    derived: dict[str, Array] = {}
    for matrix in matrices:
        if missing := {*map(gyro_column, matrix.gyros)} - {*columns}:
            left_out = f"gyro {matrix.gyros[0]} is left out"
            flags.append(f"{log.file}: no column '{missing.pop()}', {left_out}")
            continue
        if matrix.over_temperature:
            require(log.file, columns, [TEMPERATURE])
        indications = [values(log.frame, gyro_column(gyro)) for gyro in matrix.gyros]
        rates = matrix.rates(np.column_stack(indications), temperature)
        low, high = matrix.rate_limits
        rates_outside = int(np.count_nonzero((rates < low) | (rates > high)))
        derived |= dict(zip(matrix.outputs, (rates + inertial_dps).T, strict=True))
        if TEMPERATURE in columns:
            flags += flag_temperatures(log.file, matrix, temperature)
        if rates_outside:
            flags.append(
                f"{log.file}: gyro {matrix.gyros[0]} beyond the fitted {low:g} to {high:g} °/s over"
                f" {100.0 * (rates_outside / rows):.1f} % of the rows"
            )
    flags += [RESTED] * (not triad and inertial_dps == 0.0)
    return write_back.rewrite_log(spec, data, log, {}, derived), tuple(dict.fromkeys(flags))


def flag_temperatures(file: str, matrix: GyroMatrix, temperature: Array) -> list[str]:
    """Flags for temperatures [n, °C] that are clamped, or outside the range of coefficients without
    a temperature model.
    """
    if matrix.temperature is None:
        return []
    slack, consequence = 0.0, "clamped"
    if not matrix.over_temperature:
        letters = "sensitivities and biases" if len(matrix.outputs) == len(AXES) else "K and F0"
        slack, consequence = forms.TEMPERATURE_SLACK, f"but {letters} are taken as constant"
    low, high = matrix.temperature
    rows_outside = np.count_nonzero((temperature < low - slack) | (temperature > high + slack))
    if not rows_outside:
        return []
    share = f"{100.0 * rows_outside / temperature.size:.1f} % of the rows"
    return [f"{file}: temperature outside {low:.1f} … {high:.1f} °C over {share}, {consequence}"]


def validate(
    spec: AnyRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[Entry, Summary]:
    """Compare scale factors and rates of unseen runs with the frozen coefficients; with both logs
    of a pair, also N and γ.
    """
    matrices = read_invertible(spec, records)
    sensitivities = {
        quantity.name: quantity for quantity in certificate.list_sensitivities(records, spec)
    }
    within_runs = any(certificate.undecided_scale(record) for record in records.values())
    triad = isinstance(spec, GyroTriadRecipe)
    runs: dict[str, tuple[table_runs.TableRun, ...]] = {}
    entries: list[Entry] = []
    straight: list[Line] = []
    criteria: list[Criterion] = []
    flags: list[str] = []
    for log in logs:
        axis = spec.find_axis(log.file)
        run = table_runs.fit_run(spec, log)
        run_lines = Lines.of([[(0, run)]])
        runs[axis] = (*runs.get(axis, ()), run)
        flags += [*run.flags, *run_lines.flag_drifts()]
        entry: Entry = {"name": log.file, "sha256": log.sha256, "rows": log.rows}
        entries.append(entry if triad else entry | {"gyros": []})
        # K of the run, and of the files at its temperature, where U leaves nothing out
        judged: list[tuple[Value, Value]] = []
        for matrix in matrices:
            if not isinstance(spec, GyroTriadRecipe) and spec.own_axis(matrix.gyros[0]) != axis:
                continue
            for gyro in matrix.gyros:
                quantity = sensitivities[certificate.sensitivity_name(gyro, axis if triad else "")]
                K, of_files = (
                    run_lines.of_runs([run], gyro),
                    _scale_factor(spec, run, matrix, quantity),
                )
                of_run = Value(K.value[0], K.u[0], K.dof[0])
                if quantity.undecided is None:
                    judged.append((of_run, of_files))
            if triad:
                entries[-1] |= _compare_base(spec, run, axis, matrix)
                straight += run_lines.straightened({})
            else:
                compared, line = _compare_line(spec, run_lines, run, matrix, (of_run, of_files))
                entries[-1]["gyros"].append(compared)
                straight.append(line)
            if np.isfinite(run.temp_degc):
                flags += flag_temperatures(log.file, matrix, values(log.frame, TEMPERATURE))
        if judged:
            error = np.array([K.value - frozen.value for K, frozen in judged])
            variance = np.array([K.u**2 + frozen.u**2 for K, frozen in judged])
            dof = (np.inf, max(float(sum(frozen.dof for _, frozen in judged)), 1.0))
            error_over_u = unseen(error, np.zeros((error.size, 1)), variance, dof=dof)
            criteria.append(over_u(f"{log.file}: rms error of K", error_over_u.to_object()))
    body: Entry = {"logs": entries}
    errors = [(log["name"], error) for log in entries for error in log.get("gyros", [log])]
    tables = [_tabulate_errors(errors, triad=triad)]
    of_pair: tuple[str, ...] = ()
    if isinstance(spec, GyroPairRecipe) and len(runs) > 1:
        campaign = fit.fit_campaign(spec, runs)
        of_pair, body["pair"] = campaign.flags, [*_compare_pair(records, campaign, spec.type_b)]
        rows = []
        for ratio in body["pair"]:
            name, difference, u = (ratio[k] for k in ("name", "difference", "standard_uncertainty"))
            numbers = (f"{ratio['frozen']:.9f}", f"{ratio['found']:.9f}")
            expanded = gum.coverage_factor(ratio["dof"]) * u
            rows.append((name, *numbers, f"{difference:+.1e} ± {expanded:.1e}", ratio["unit"]))
            if name == "gamma" or (name == "N" and not within_runs):
                dof = (ratio["dof"], np.inf)
                error_over_u = unseen(np.array([difference]), np.array([[u]]), dof=dof)
                criteria.append(over_u(f"pair: error of {name}", error_over_u.to_object()))
        heads = ("", "frozen", "found", "difference", "unit")
        tables.append(Table("The pair again", heads, tuple(rows)))
    undecided = undecided_limits(spec, within_runs=within_runs)
    of_limits = [error["after"] if triad else error for _, error in errors]
    for criterion in judge_unseen(of_limits, spec.acceptance):
        if criterion.passed and criterion.name in undecided:
            size = f"{criterion.name} {criterion.value:.3g} {criterion.unit}"
            flags.append(f"{size} of these runs decides no limit: {undecided[criterion.name]}")
        else:
            criteria.append(criterion)
    criteria += judge_noise(straight, spec.acceptance)
    every_flag = tuple(dict.fromkeys((*flags, *of_pair)))
    return body, Summary("", tuple(tables), every_flag, tuple(criteria))


def _scale_factor(
    spec: AnyRecipe, run: table_runs.TableRun, matrix: GyroMatrix, quantity: Quantity
) -> Value:
    """Scale factor of the files at the temperature of a run, clamped to the fitted range, with how
    runs and mountings repeat and type B terms.
    """
    if matrix.over_temperature:
        require(run.log.file, run.log.frame.columns, [TEMPERATURE])
    model, degc = matrix.model, float(np.nan_to_num(run.plateaus.temp_degc).mean())
    input_values = {x.column: min(max(degc, x.low), x.high) for x in quantity.inputs}
    point = quantity.point(input_values)
    ((_, u, dof),) = point.type_a()
    K = point.value
    # 100 °/s where a model does not state its own
    fastest = max(map(abs, model.valid.get(forms.RATE, ())), default=0.0) or 100.0
    slopes = {forms.RATE: (fastest, -K / fastest), "time_s": (1.0, K), **point.influences}
    u_B = type_b.combine_terms(spec.type_b, quantity.called, K, quantity.unit, slopes)
    scales = [part.value for part in model.components if part.effect == "scale"]
    tilts = [part.value for part in model.components if part.effect == "angle"]
    repeats = max(scales, default=0.0) / PPM * abs(K)
    # without a stated repeatability the scatter of the runs about the curve stands for it
    if matrix.curves and not scales:
        repeats = point.parts[0][0].residual_rms
    _, by_tilt = point.influences.get(certificate.ANGLE, (90.0, 0.0))
    # an unseen run is another run in another mounting, on the same equipment
    u_frozen = np.linalg.norm([u, repeats, max(tilts, default=0.0) * by_tilt, u_B])
    return Value(*map(np.array, (K, u_frozen, dof)))


def _compare_line(
    spec: AnyRecipe,
    run_lines: Lines,
    run: table_runs.TableRun,
    matrix: GyroMatrix,
    scale_factors: tuple[Value, Value],
) -> tuple[Entry, Line]:
    """JSON object of one gyro of a run about its own axis, and the line of its compensated
    rates.
    """
    (gyro,), (of_run, of_files) = matrix.gyros, scale_factors
    line, temperature = run_lines.published(run, gyro), np.nan_to_num(run.plateaus.temp_degc)
    F = run.plateaus.indication[:, run.gyros.index(gyro)]
    K_before, F0_before = (part.item() for part in matrix.reference)
    before_is = "K and F0 of the mean model"
    if spec.nominal_scale_factor is not None:
        K_before, F0_before, before_is = spec.nominal_scale_factor, 0.0, "nominal scale factor"
    before, after = (F - F0_before) / K_before, matrix.rates(F[:, None], temperature)[:, 0]
    K_of_rows, F0_of_rows = matrix.at(temperature)
    compensated = Line(line.rate_dps, after, line.noise / np.abs(K_of_rows[:, 0, 0]))
    K_frozen, u = float(of_files.value), float(np.hypot(of_run.u, of_files.u))
    entry: Entry = {
        "gyro": gyro,
        "K": line.K,
        "K_standard_uncertainty": float(of_run.u),
        "K_frozen": K_frozen,
        "K_frozen_standard_uncertainty": float(of_files.u),
        "scale_factor_error_ppm": (line.K / K_frozen - 1.0) * PPM,
        "scale_factor_error_standard_uncertainty_ppm": u / abs(K_frozen) * PPM,
        "scale_factor_error_dof": min(float(of_files.dof), MOST_DOF),
        "zero_error_dph": (line.F0 / line.K - float(F0_of_rows.mean()) / K_frozen) * DPH_PER_DPS,
        "rate_gain": compensated.K,
        "before_is": before_is,
    }
    full_scale = float(np.max(np.abs(line.rate_dps)))
    for stage, rate in (("before", before), ("after", after)):
        error = rate - line.rate_dps
        entry[stage] = {
            "scale_factor_error_ppm": (Line(line.rate_dps, rate, line.noise).K - 1.0) * PPM,
            "rate_error_rms_dps": rms(error),
            ALONG: float(np.max(np.abs(error))) / full_scale * PPM,
        }
    for figure in published.figures(line, float(of_run.u), gyro):
        if figure.unit == "ppm":
            kind, standard, _ = FigureName.of(figure.name)
            suffix = {GJB: "_gjb", IEEE: "_ieee"}[standard] if kind == "asymmetry" else ""
            entry[f"{kind}{suffix}_ppm"] = figure.value
    return entry, compensated


def _compare_base(
    spec: AnyRecipe, run: table_runs.TableRun, axis: str, matrix: GyroMatrix
) -> Entry:
    """JSON object of the rates of a run along and across the turned axis; the uncompensated rates
    use each gyro alone, with its scale factor about its main axis.
    """
    temperature, F = np.nan_to_num(run.plateaus.temp_degc), run.plateaus.indication
    S, _ = matrix.reference
    main = np.argmax(np.abs(S), axis=1)
    rates, uncompensated = matrix.rates(F, temperature), F - matrix.at(temperature)[1]
    uncompensated /= S[np.arange(main.size), main]
    turned, true = AXES.index(axis), np.zeros_like(rates)
    # rates about the axes of the base have the earth's rate in them
    true[:, turned] = run.rate_dps + (table_runs.vertical_rate_dps(spec) or 0.0)
    gain = float(np.polyfit(run.rate_dps, rates[:, turned], 1)[0])
    # so far no scale factor drifts: the run is about another axis
    if not abs(gain - 1.0) < 0.1:
        raise FrameError(
            f"{run.log.file}: the rate about {axis} comes out {gain:.4f} times the table's,"
            " expected about 1",
            hint=(
                "it turns about another axis ([axes]), is in another unit or sign, or is of another"
                " unit's gyros"
            ),
        )
    entry: Entry = {
        "axis": axis,
        "rate_gain": gain,
        "before_is": "each gyro by its scale factor about the axis that it senses most",
    }
    full_scale = float(np.max(np.abs(run.rate_dps))) / PPM
    for stage, error, axes in (
        ("before", uncompensated - true[:, main], main),
        ("after", rates - true, np.arange(len(AXES))),
    ):
        largest = np.max(np.abs(error), axis=0) / full_scale
        entry[stage] = {
            ALONG: float(np.max(largest[axes == turned], initial=0.0)),
            ACROSS: float(np.max(largest[axes != turned], initial=0.0)),
        }
    return entry


def _compare_pair(
    records: Mapping[str, Record], unseen_campaign: CampaignFit, terms: Sequence[type_b.TypeB]
) -> Iterator[Entry]:
    """JSON objects of N, ε, γ, α of unseen runs against the frozen values."""
    if forms.ORTHOGONALITY_FILE not in records:
        raise CoefficientError(
            f"the run holds no {forms.ORTHOGONALITY_FILE}", hint="it is not a run of gyro_pair"
        )
    frozen = records[forms.ORTHOGONALITY_FILE].model("pair")
    assert unseen_campaign.pair is not None  # noqa: S101 (a fit of a pair has one)
    for now, c in zip(unseen_campaign.pair.coefficients, frozen.coefficients, strict=True):
        # terms on the ratio itself, or on α
        slopes, names = certificate.by_angle(frozen, c.name), (f"pair.{c.name}", c.name)
        u_B = type_b.combine_terms(terms, names, c.value, c.unit, slopes)
        parts = (
            (now.standard_uncertainty, unseen_campaign.pair.dof_of(now)),
            (c.standard_uncertainty, frozen.dof_of(c)),
            (u_B, np.inf),
        )
        difference = gum.combine(
            [gum.UncertaintyComponent("", c.value, u, "A", dof=dof) for u, dof in parts]
        )
        yield {
            "name": c.name,
            "frozen": c.value,
            "found": now.value,
            "difference": now.value - c.value,
            "standard_uncertainty": difference.standard_uncertainty,
            "dof": min(difference.effective_dof, MOST_DOF),
            "unit": c.unit,
        }


def _tabulate_errors(errors: Sequence[tuple[str, Entry]], *, triad: bool) -> Table:
    """Table of unseen runs before and after compensation: rates along and across the turned axis of
    a triad, else frozen and found K and rates of each gyro.
    """
    rows: list[tuple[str, ...]] = []
    for name, entry in errors:
        before, after, gain = entry["before"], entry["after"], f"{entry['rate_gain']:.6f}"
        along = f"{before[ALONG]:.1f}", f"{after[ALONG]:.1f}"
        if triad:
            across = f"{before[ACROSS]:.1f}", f"{after[ACROSS]:.1f}"
            rows.append((f"{name} about {entry['axis']}", *along, *across, gain))
            continue
        u = entry["scale_factor_error_standard_uncertainty_ppm"]
        expanded = gum.coverage_factor(entry["scale_factor_error_dof"]) * u
        K_error = f"{after['scale_factor_error_ppm']:+.1f} ± {expanded:.2g}"
        scale = f"{entry['K']:.4f}", f"{entry['K_frozen']:.4f}"
        K_errors = f"{before['scale_factor_error_ppm']:+.1f}", K_error
        rows.append((f"{name} {entry['gyro']}", *scale, *K_errors, *along, gain))
    heads: tuple[str, ...] = ("", "K", "frozen", "K error", "after", "rate error", "after", "gain")
    title = (
        "Frozen coefficients on unseen runs: K error in ppm, largest rate error in ppm of full"
        " scale"
    )
    if triad:
        heads = ("", "along", "after", "across", "after", "gain")
        title = (
            "Compensated rates of unseen runs: largest error along and across the turned axis, ppm"
            " of full scale"
        )
    return Table(title, heads, tuple(rows))
