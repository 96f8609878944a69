"""Frozen coefficients compared with unseen runs: errors before and after compensation."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.coefficients import Criterion, Record, over_u
from calibkit.constants import DPH_PER_DPS
from calibkit.errors import CoefficientError, FrameError
from calibkit.fit.unseen import unseen
from calibkit.forms import POLYNOMIAL
from calibkit.frame import Log, require
from calibkit.instruments.gyro_scale import (
    acceptance,
    compensate,
    forms,
    lines,
    pair_fit,
    quantities,
    table_runs,
)
from calibkit.instruments.gyro_scale.campaign import Campaign
from calibkit.instruments.gyro_scale.numeric import gjb_figures
from calibkit.instruments.gyro_scale.numeric.gjb_figures import Line
from calibkit.instruments.gyro_scale.recipe import (
    AnyRecipe,
    GyroPairRecipe,
    GyroTriadRecipe,
    OwnAxisRecipe,
)
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


def validate(
    spec: AnyRecipe, records: Mapping[str, Record], logs: Iterable[Log]
) -> tuple[dict[str, Any], Summary]:
    """Compare scale factors and rates of unseen runs with the frozen coefficients; with both logs
    of a pair, also N and γ.
    """
    known = compensate.read_invertible(spec, records)
    within = lines.hold_within_runs(records.values())
    runs: dict[str, list[table_runs.TableRun]] = {}
    entries: list[dict[str, Any]] = []
    compared: list[tuple[str, dict[str, Any]]] = []
    flags: list[str] = []
    judged: list[Criterion] = []
    published: list[Line] = []
    for log in logs:
        axis = spec.find_axis(log.file)
        run = table_runs.fit_run(spec, log)
        run_lines = lines.Lines.of_runs_about_one_axis([run])
        runs.setdefault(axis if isinstance(spec, GyroPairRecipe) else log.file, []).append(run)
        flags += [*run.flags, *run_lines.flag_drifts()]
        if isinstance(spec, GyroTriadRecipe):
            turned, vertical = [*known], table_runs.vertical_rate_dps(spec) or 0.0
            found = [_compare_base(run, axis, matrix, vertical) for matrix in known]
            published += run_lines.straightened({})
        else:
            turned = [matrix for matrix in known if spec.own_axis(matrix.gyros[0]) == axis]
            found = []
            for matrix in turned:
                entry_of_gyro, compensated = _compare_line(spec, run_lines, run, matrix)
                found.append(entry_of_gyro)
                published.append(compensated)
        for matrix in turned if np.isfinite(run.temp_degc) else ():
            flags += compensate.flag_temperatures(log.file, matrix, run.plateaus.temp_degc)
        entry = {"name": log.file, "sha256": log.sha256, "rows": log.rows}
        entries.append(
            entry | found[0] if isinstance(spec, GyroTriadRecipe) else entry | {"gyros": found}
        )
        compared += [(log.file, one) for one in found]
        if not within:
            judged.append(_judge_uncertainty(run_lines, run, axis, turned, spec.type_b))
    body: dict[str, Any] = {"logs": entries}
    errors, limits = [one for _, one in compared], acceptance.UNSEEN_LINE_LIMITS
    if isinstance(spec, GyroTriadRecipe):
        errors, limits = [one["after"] for one in errors], acceptance.UNSEEN_BASE_LIMITS
        shown = [_tabulate_base_errors(compared)]
    else:
        shown = [_tabulate_line_errors(compared)]
    criteria, undecided = _decide(
        acceptance.judge_unseen(errors, limits, spec.acceptance), within=within
    )
    flags += undecided
    if isinstance(spec, GyroPairRecipe) and len(runs) > 1:
        again = pair_fit.fit_pair(spec, {axis: tuple(group) for axis, group in runs.items()})
        body["pair"] = _compare_pair(records, again, spec.type_b)
        shown.append(_tabulate_pair_again(body["pair"]))
        flags += again.flags
        judged += _judge_pair(body["pair"], within=within)
    criteria = (*judged, *criteria, *acceptance.judge_noise(published, spec.acceptance))
    return body, Summary("", tuple(shown), tuple(dict.fromkeys(flags)), criteria)


def _decide(
    criteria: Sequence[Criterion], *, within: bool
) -> tuple[tuple[Criterion, ...], list[str]]:
    """Criteria that decide, and flags for those that do not: where scale factors hold within their
    runs, a run beyond a limit of theirs rejects, and one within it accepts nothing.
    """
    undecided = [one for one in criteria if within and one.passed and one.name in OF_SCALE]
    flags = [
        f"{one.name} {one.value:.3g} {one.unit} of these runs decides no limit: {lines.WITHIN}"
        for one in undecided
    ]
    return tuple(one for one in criteria if one not in undecided), flags


def _judge_pair(compared: Sequence[Mapping[str, Any]], *, within: bool) -> Iterator[Criterion]:
    """Criteria that γ of unseen runs, and N where runs tell how scale factors repeat, differ as
    their uncertainties state.
    """
    for one in compared:
        if one["name"] == "gamma" or (one["name"] == "N" and not within):
            error, u = np.array([one["difference"]]), np.array([[one["standard_uncertainty"]]])
            over = unseen(error, u, dof=(one["dof"], np.inf)).to_object()
            yield over_u(f"pair: error of {one['name']}", over)


def _judge_uncertainty(
    run_lines: lines.Lines,
    run: table_runs.TableRun,
    axis: str,
    matrices: Sequence[forms.GyroMatrix],
    terms: Sequence[type_b.TypeB],
) -> Criterion:
    """Criterion that the sensitivities found on an unseen run differ from the frozen ones as their
    uncertainties, type B terms and the repeatability of runs state.
    """
    mean = np.array([_temperatures(run).mean()])
    rows = []
    for matrix in matrices:
        column = forms.AXES.index(axis) if len(matrix.outputs) > 1 else 0
        frozen = matrix.at(mean)[0][0, :, column]
        for row, gyro in enumerate(matrix.gyros):
            K = run_lines.of_runs([run], gyro)
            u, dof = _uncertainty_of_sensitivity(
                matrix, row * len(matrix.outputs) + column, mean, terms
            )
            rows.append((K.value[0] - frozen[row], float(np.hypot(K.u[0], u)), dof))
    error, u, dofs = np.array(rows).T
    judged = unseen(
        error, np.zeros((error.size, 1)), u**2, dof=(np.inf, max(float(dofs.sum()), 1.0))
    )
    return over_u(f"{run.log.file}: rms error of K", judged.to_object())


def _uncertainty_of_sensitivity(
    matrix: forms.GyroMatrix, entry: int, temperature: Array, terms: Sequence[type_b.TypeB]
) -> tuple[float, float]:
    """Standard uncertainty [1/deg] of a sensitivity of another run at a temperature [1, °C], with
    how runs repeat and type B terms, and degrees of freedom of the coefficient; clamped to the
    fitted range.
    """
    model = matrix.model
    coefficient = model.coefficients[entry]
    at = temperature[0] + np.array([-0.5, 0.5])
    slope = float(np.diff(matrix.at(at)[0].reshape(2, -1)[:, entry])[0])
    fastest = max(map(abs, model.valid.get(forms.RATE, ())), default=0.0) or FULL_SCALE
    known = {
        forms.RATE: (fastest, -coefficient.value / fastest),
        "time_s": (1.0, coefficient.value),
        forms.TEMPERATURE: (float(temperature[0]), slope),
    }
    names = (f"{model.name}.{coefficient.name}", coefficient.name)
    other = type_b.combine_terms(terms, names, coefficient.value, coefficient.unit, known)
    u, dof = coefficient.standard_uncertainty, model.dof_of(coefficient)
    repeats = [
        part.value / gjb_figures.PPM * abs(coefficient.value)
        for part in model.components
        if (part.effect, part.unit) == ("scale", "ppm")
    ]
    if matrix.curves:
        curve = matrix.curves[entry]
        inside = np.clip(temperature, *curve.valid[forms.TEMPERATURE])
        u = float(POLYNOMIAL.standard_uncertainty(curve, {forms.TEMPERATURE: inside})[0])
        dof = min(map(curve.dof_of, curve.coefficients))
        repeats = repeats or [curve.residual_rms]
    return float(np.linalg.norm([u, max(repeats, default=0.0), other])), float(dof)


def _temperatures(run: table_runs.TableRun) -> Array:
    """Temperatures [p, °C] of the held rates, 0 where they were not logged."""
    return np.nan_to_num(run.plateaus.temp_degc)


def _compare_line(
    spec: OwnAxisRecipe, run_lines: lines.Lines, run: table_runs.TableRun, matrix: forms.GyroMatrix
) -> tuple[dict[str, Any], Line]:
    """JSON object of one gyro of a run about its own axis, and the line of its compensated
    rates.
    """
    (gyro,) = matrix.gyros
    line, temperature = run_lines.published(run, gyro), _temperatures(run)
    if matrix.over_temperature and not np.isfinite(run.temp_degc):
        require(run.log.file, run.log.frame.columns, [forms.TEMPERATURE])
    mean = np.array([temperature.mean()])
    K = float(matrix.at(mean)[0].item())
    u_frozen, dof = _uncertainty_of_sensitivity(matrix, 0, mean, spec.type_b)
    found = run_lines.of_runs([run], gyro)
    u_found, indication = float(found.u[0]), run.scale(gyro).indication
    after = matrix.rates(indication[:, None], temperature)[:, 0]
    K_of_rows = matrix.at(temperature)[0][:, 0, 0]
    compensated = Line(line.rate_dps, after, line.noise / np.abs(K_of_rows))
    nominal = spec.nominal_scale_factor
    K_before, F0_before = (
        (part.item() for part in matrix.reference) if nominal is None else (nominal, 0.0)
    )
    before = (indication - F0_before) / K_before
    shown = {}
    for figure in gjb_figures.figures(line, u_found):
        if figure.unit == "ppm":
            standard = {gjb_figures.GJB: "_gjb", gjb_figures.IEEE: "_ieee"}[figure.standard]
            name = figure.name + standard * (figure.name == "asymmetry")
            shown[f"{name}_ppm"] = figure.value
    compared = {
        "gyro": gyro,
        "K": line.K,
        "K_standard_uncertainty": u_found,
        "K_frozen": K,
        "K_frozen_standard_uncertainty": u_frozen,
        "scale_factor_error_ppm": (line.K / K - 1.0) * gjb_figures.PPM,
        "scale_factor_error_standard_uncertainty_ppm": (
            float(np.hypot(u_found, u_frozen) / abs(K)) * gjb_figures.PPM
        ),
        "scale_factor_error_dof": min(dof, MOST_DOF),
        "zero_error_dph": (
            (line.F0 / line.K - float(matrix.at(temperature)[1].mean()) / K) * DPH_PER_DPS
        ),
        "rate_gain": compensated.K,
        "before_is": (
            "nominal scale factor" if nominal is not None else "K and F0 of the mean model"
        ),
        "before": _line_errors(before, line),
        "after": _line_errors(after, line),
    }
    return compared | shown, compensated


def _line_errors(rate: Array, line: Line) -> dict[str, float]:
    """Errors of rates [p] against the table's: slope error, rms and largest error relative to full
    scale.
    """
    error = rate - line.rate_dps
    full = float(np.max(np.abs(line.rate_dps)))
    return {
        "scale_factor_error_ppm": (Line(line.rate_dps, rate, line.noise).K - 1.0) * gjb_figures.PPM,
        "rate_error_rms_dps": rms(error),
        "rate_error_max_ppm_of_full_scale": float(np.max(np.abs(error))) / full * gjb_figures.PPM,
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
    full = float(np.max(np.abs(rate_dps))) / gjb_figures.PPM
    return {
        f"{kind}_max_ppm_of_full_scale": float(np.max(np.abs(error[:, chosen]), initial=0.0)) / full
        for kind, chosen in (("rate_error", along), ("cross_axis", ~along))
    }


def _compare_pair(
    records: Mapping[str, Record], again: Campaign, terms: Sequence[type_b.TypeB]
) -> list[dict[str, Any]]:
    """JSON objects of N, ε, γ, α of unseen runs against the frozen values."""
    if forms.ORTHOGONALITY_FILE not in records:
        raise CoefficientError(
            f"the run holds no {forms.ORTHOGONALITY_FILE}", hint="it is not a run of gyro_pair"
        )
    frozen = records[forms.ORTHOGONALITY_FILE].model("pair")
    found, compared = again.pair, []
    assert found is not None  # noqa: S101 (a fit of a pair has one)
    for c, value, u, dof in zip(
        *(frozen.coefficients, found.values, found.standard_uncertainty.tolist(), found.dof),
        strict=True,
    ):
        # terms on the ratio itself, or on α
        slopes = quantities.by_angle(frozen, c.name)
        names = (f"pair.{c.name}", c.name)
        type_b_u = type_b.combine_terms(terms, names, c.value, c.unit, slopes)
        of_both = [
            gum.Component("found", value, u, "A", dof=dof),
            gum.Component("frozen", c.value, c.standard_uncertainty, "A", dof=frozen.dof_of(c)),
            gum.Component("type B", c.value, type_b_u, "B"),
        ]
        both = gum.combine(of_both)
        compared.append(
            {
                "name": c.name,
                "frozen": c.value,
                "found": value,
                "difference": value - c.value,
                "standard_uncertainty": both.standard_uncertainty,
                "dof": min(both.effective_dof, MOST_DOF),
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
