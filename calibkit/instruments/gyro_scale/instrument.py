"""Gyros on a rate table: runs of single gyros, a pair about two axes, any number of gyros about
three axes.
"""

from __future__ import annotations

from dataclasses import replace
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

from calibkit.certificate.fit_tables import tabulate_fit
from calibkit.check import copies
from calibkit.coefficients import Input
from calibkit.errors import RecipeError
from calibkit.ingest import logs as ingest
from calibkit.instruments import Fitted
from calibkit.instruments.gyro_scale import (
    acceptance,
    certificate,
    coefficient_files,
    curves,
    over_runs,
    overview,
    pair_fit,
    sensitivities,
    table_runs,
    triad_fit,
)
from calibkit.instruments.gyro_scale.lines import Lines
from calibkit.report.run import list_components
from calibkit.report.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from calibkit.coefficients import Criterion, StageResult
    from calibkit.instruments import Progress
    from calibkit.instruments.gyro_scale.numeric.gjb_figures import Line
    from calibkit.instruments.gyro_scale.recipe import (
        AnyRecipe,
        GyroPairRecipe,
        GyroTriadRecipe,
        RateTableRecipe,
    )
    from calibkit.instruments.gyro_scale.table_runs import TableRun
    from calibkit.report.overview import Overview
    from calibkit.report.table import Table


def _read_runs(
    spec: AnyRecipe, data: Path, files: Sequence[str], progress: Progress
) -> dict[str, tuple[TableRun, ...]]:
    """Table axis → its runs, in the order of the files."""
    axes = {file: spec.find_axis(file) for file in files}
    logs = copies.refuse_copies(
        ingest.read_ahead(
            progress(files, "reading and averaging"), lambda file: table_runs.read(spec, data, file)
        )
    )
    found: dict[str, tuple[TableRun, ...]] = {}
    for log in logs:
        axis = axes[log.file]
        found[axis] = (*found.get(axis, ()), table_runs.fit_run(spec, log))
    return {axis: found[axis] for axis in sorted(found)}


def _fitted(
    spec: AnyRecipe,
    runs: sensitivities.Runs,
    published: Iterable[Line],
    results: tuple[StageResult, ...],
    criteria: tuple[Criterion, ...],
    drawing: curves.GyroReport,
    first: Overview,
    refit: sensitivities.Refit,
) -> Fitted[curves.GyroReport]:
    """Result of a fit; every coefficient file carries all flags. The first screen shows the first
    table of the last file: lines of one gyro, what is between several.
    """
    every = [run for group in runs.values() for run in group]
    inputs = tuple(Input.of(run.log) for run in every)
    criteria = (*criteria, *acceptance.judge_noise(published, spec.acceptance))
    influences = sensitivities.find(spec, runs, results, refit)
    tables: list[Table] = []
    for result in results:
        of_file = tabulate_fit([result], spec, influences, certificate.blocks)
        first = replace(first, table=of_file[0])
        tables += of_file
    shared = list_components("Errors that held rates share", results[0].models)
    tables += [shared] if shared.rows else []
    summary = Summary(spec.title, tuple(tables), results[0].flags, criteria, overview=first)
    return Fitted(results, inputs, summary, drawing, sensitivities=influences)


def fit_rate_table(
    spec: RateTableRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[curves.GyroReport]:
    """Fit each gyro in each run, then its scale factor over the runs and over temperature."""
    runs = _read_runs(spec, data, files, progress)
    about = runs[""]
    run_lines = Lines.of_runs_about_one_axis(about)
    gyros = [over_runs.fit_over_runs(spec, gyro, about, run_lines) for gyro in spec.gyros]
    flags = over_runs.flag_runs(gyros, run_lines, spec)
    results = coefficient_files.list_rate_table_results(gyros, run_lines, flags, spec)

    def refit(spec: RateTableRecipe, runs: sensitivities.Runs) -> tuple[StageResult, ...]:
        moved = Lines.of_runs_about_one_axis(runs[""], run_lines)
        over = [over_runs.fit_over_runs(spec, one.gyro, runs[""], moved, near=one) for one in gyros]
        return coefficient_files.list_rate_table_results(over, moved, (), spec)

    (scales,) = results
    found = _fitted(
        spec,
        runs,
        run_lines.straightened({one.gyro: one.response for one in gyros}),
        results,
        acceptance.judge_figures(scales.figures, acceptance.RUN_LIMITS, spec.acceptance),
        curves.GyroReport.of_runs(gyros, run_lines),
        overview.summarize_rate_table(gyros, scales),
        refit,
    )
    return replace(found, lacks=over_runs.list_undetermined(gyros))


def fit_pair(
    spec: GyroPairRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[curves.GyroReport]:
    """Fit the scale factors about both axes and the orthogonality of the pair."""
    needed = {"a": spec.pair.axis_a, "b": spec.pair.axis_b}
    for axis, name in needed.items():
        if not any(file == name or fnmatchcase(file, name) for file in files):
            raise RecipeError(
                f"pair.axis_{axis} = '{name}': no such log among {', '.join(files)}",
                hint="a pair needs the log of each table axis; see [logs] files, exclude",
            )
    runs = _read_runs(spec, data, sorted(files, key=spec.find_axis), progress)
    fitted = pair_fit.fit_pair(runs, spec)
    results = coefficient_files.list_pair_results(fitted, spec)
    scales = results[0]
    criteria = acceptance.judge_pair(fitted, scales.figures, spec.acceptance)
    first = overview.summarize_pair(fitted, scales)
    return _fitted(
        spec,
        runs,
        fitted.run_lines.straightened(fitted.responses),
        results,
        criteria,
        curves.GyroReport.of_pair(fitted),
        first,
        lambda spec, runs: coefficient_files.list_pair_results(
            pair_fit.fit_pair(runs, spec, fitted), spec
        ),
    )


def fit_triad(
    spec: GyroTriadRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[curves.GyroReport]:
    """Fit the sensitivities of every gyro about three axes, the angles between them, and both over
    temperature.
    """
    runs = _read_runs(spec, data, files, progress)
    fitted = triad_fit.fit_axes(spec, runs)
    results = coefficient_files.list_triad_results(fitted, spec)
    scales = results[0]
    criteria = acceptance.judge_triad(fitted, scales.figures, spec.acceptance)
    first = overview.summarize_triad(fitted, scales)
    return _fitted(
        spec,
        runs,
        fitted.run_lines.straightened({}),
        results,
        criteria,
        curves.GyroReport.of_triad(fitted),
        first,
        lambda spec, runs: coefficient_files.list_triad_results(
            triad_fit.fit_axes(spec, runs, fitted), spec
        ),
    )
