"""Gyros on a rate table: runs of single gyros, a pair about two axes, any number of gyros about
three axes.
"""

from __future__ import annotations

from dataclasses import replace
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
    over_runs,
    overview,
    pair_fit,
    sensitivities,
    table_runs,
    triad_fit,
)
from calibkit.instruments.gyro_scale.compensate import correct
from calibkit.instruments.gyro_scale.forms import FORMS
from calibkit.instruments.gyro_scale.recipe import GyroPairRecipe, GyroTriadRecipe
from calibkit.instruments.gyro_scale.table_runs import faults, read
from calibkit.instruments.gyro_scale.unseen import validate
from calibkit.report.run import list_components
from calibkit.report.summary import Summary

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from calibkit.coefficients import StageResult
    from calibkit.instruments import Progress
    from calibkit.instruments.gyro_scale.campaign import Campaign
    from calibkit.instruments.gyro_scale.recipe import AnyRecipe
    from calibkit.instruments.gyro_scale.table_runs import TableRun
    from calibkit.report.table import Table

    Runs = Mapping[str, tuple[TableRun, ...]]
    """Table axis → its runs."""

__all__ = ["FORMS", "correct", "faults", "fit", "read", "validate"]


def fit(spec: AnyRecipe, data: Path, files: Sequence[str], progress: Progress) -> Fitted[Campaign]:
    """Fit gyros to the logs of a data folder; every coefficient file carries all flags."""
    runs = _read_runs(spec, data, files, progress)
    campaign = fit_campaign(spec, runs)
    results = coefficient_files.list_results(campaign, spec)

    def refit(spec: AnyRecipe, runs: Runs) -> tuple[StageResult, ...]:
        return coefficient_files.list_results(fit_campaign(spec, runs, campaign), spec)

    influences = sensitivities.find(spec, runs, results, refit)
    # the first screen shows the first table of the last file: lines of one gyro, what is between
    # several
    of_files = [tabulate_fit([one], spec, influences, certificate.blocks) for one in results]
    tables: list[Table] = [table for of_file in of_files for table in of_file]
    shared = list_components("Errors that held rates share", results[0].models)
    tables += [shared] if shared.rows else []
    first = replace(overview.summarize(campaign, results[0]), table=of_files[-1][0])
    straight = campaign.run_lines.straightened(
        {channel.gyro: channel.response for channel in campaign.own}
    )
    criteria = acceptance.judge(results, straight, spec.acceptance)
    single = not (campaign.pair or campaign.sets)
    return Fitted(
        results,
        tuple(Input.of(run.log) for group in runs.values() for run in group),
        Summary(spec.title, tuple(tables), campaign.flags, criteria, overview=first),
        campaign,
        sensitivities=influences,
        lacks=over_runs.list_undetermined(campaign) if single else (),
    )


def fit_campaign(spec: AnyRecipe, runs: Runs, near: Campaign | None = None) -> Campaign:
    """Fit a procedure's equation to its runs; `near` is a fit of nearly the same runs, whose sizes
    of errors and choices are kept, and which has the flags.
    """
    if isinstance(spec, GyroPairRecipe):
        return pair_fit.fit_pair(spec, runs, near)
    if isinstance(spec, GyroTriadRecipe):
        return triad_fit.fit_axes(spec, runs, near)
    return over_runs.fit_runs(spec, runs, near)


def _read_runs(spec: AnyRecipe, data: Path, files: Sequence[str], progress: Progress) -> Runs:
    """Runs about each table axis, in the order of the files."""
    axes = {file: spec.find_axis(file) for file in files}
    for axis in spec.logs_of_axes:
        if axis not in axes.values():
            raise RecipeError(
                f"no log about table axis {axis} among {', '.join(files)}",
                hint="each table axis needs a log: see [pair] or [axes], and [logs] files, exclude",
            )
    logs = copies.refuse_copies(
        ingest.read_ahead(
            progress(files, "reading and averaging"), lambda file: table_runs.read(spec, data, file)
        )
    )
    found: dict[str, tuple[TableRun, ...]] = dict.fromkeys(spec.logs_of_axes, ())
    for log in logs:
        found[axes[log.file]] += (table_runs.fit_run(spec, log),)
    return found
