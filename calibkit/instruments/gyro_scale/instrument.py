"""Gyros on a rate table: runs of single gyros, a pair about two axes, any number of gyros about
three axes. The story of a fit: logs → held rates → equation → coefficient files, how these move
with errors of the inputs, tables, the first screen, verdicts.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibkit.certificate.fit_tables import tabulate_fit
from calibkit.check import copies
from calibkit.errors import RecipeError
from calibkit.instruments import Fitted, Progress
from calibkit.instruments.gyro_scale import (
    coefficient_files,
    flags,
    forms,
    table_runs,
)
from calibkit.instruments.gyro_scale.certificate import MAGNITUDES, blocks, results
from calibkit.instruments.gyro_scale.coefficient_files import CampaignFit, Runs
from calibkit.instruments.gyro_scale.corrections import correct, validate
from calibkit.instruments.gyro_scale.fit import fit_campaign
from calibkit.instruments.gyro_scale.forms import FORMS
from calibkit.instruments.gyro_scale.published import GJB, FigureName
from calibkit.instruments.gyro_scale.recipe import AnyRecipe
from calibkit.instruments.gyro_scale.table_runs import TableRun, faults, read
from calibkit.logs import log_files
from calibkit.records.coefficients import Coefficient, Figure, Input, StageResult
from calibkit.records.sensitivities import InputError, Sensitivity, differentiate, of_thermometer
from calibkit.report.overview import KeyValue, Overview
from calibkit.report.run import list_components
from calibkit.report.summary import Summary
from calibkit.units import unit_mark

MOVED = {
    forms.RATE: ("rate_dps", "angle_rate_dps"),
    "time_s": ("indication", "angle_rate_dps"),
    forms.TEMPERATURE: ("temp_degc",),
}
"""Input → means over held rates that it moves; of a clock counts and turns per second."""
SHARE, RATE_STEP_DPS, LATITUDE_STEP_DEG = 1e-5, 1e-6, 1e-3
"""Errors of table rate and clock, of the zero of the table's rate and of the latitude, about as
large as such errors are: steps of the differences by which results follow them.
"""

__all__ = ["FORMS", "blocks", "correct", "faults", "fit", "read", "results", "validate"]


def fit(
    spec: AnyRecipe, data: Path, files: Sequence[str], progress: Progress
) -> Fitted[CampaignFit]:
    """Fit gyros to the logs of a data folder; every coefficient file carries all flags."""
    axes = {file: spec.find_axis(file) for file in files}
    for axis in spec.logs_of_axes:
        if axis not in axes.values():
            raise RecipeError(
                f"no log about table axis {axis} among {', '.join(files)}",
                hint="each table axis needs a log: see [pair] or [axes], and [logs] files, exclude",
            )
    logs = log_files.read_ahead(
        progress(files, "reading and averaging"), lambda file: table_runs.read(spec, data, file)
    )
    # runs about each table axis, in the order of the files
    runs: dict[str, tuple[TableRun, ...]] = dict.fromkeys(spec.logs_of_axes, ())
    for log in copies.refuse_copies(logs):
        runs[axes[log.file]] += (table_runs.fit_run(spec, log),)
    campaign = fit_campaign(spec, runs)
    stages = coefficient_files.list_results(campaign, spec)

    influences = _find_sensitivities(spec, runs, campaign, stages)
    # the first screen shows the first table of the last file: lines of one gyro, what is between
    # several
    of_files = [tabulate_fit([result], spec, influences, blocks) for result in stages]
    tables = [table for of_file in of_files for table in of_file]
    shared = list_components("Errors that held rates share", stages[0].models)
    tables += [shared] if shared.rows else []
    first = replace(_summarize(campaign, stages[0]), table=of_files[-1][0])
    straight = campaign.run_lines.straightened(
        {channel.gyro: channel.response for channel in campaign.own_channels}
    )
    figures = [figure for result in stages for figure in result.figures]
    undecided = flags.undecided_limits(spec, within_runs=campaign.within_runs)
    criteria = tuple(
        criterion
        for criterion in flags.judge_figures(figures, spec.acceptance)
        if not (criterion.passed and criterion.name in undecided)
    )
    criteria += flags.judge_noise(straight, spec.acceptance)
    criteria += flags.judge_contradictions(campaign.flags)
    single = not (campaign.pair or campaign.sets)
    return Fitted(
        stages,
        tuple(Input.of(run.log) for group in runs.values() for run in group),
        Summary(spec.title, tuple(tables), campaign.flags, criteria, overview=first),
        campaign,
        sensitivities=influences,
        lacks=tuple(flags.list_undetermined(campaign)) if single else (),
    )


def _find_sensitivities(
    spec: AnyRecipe, runs: Runs, campaign: CampaignFit, stages: Sequence[StageResult]
) -> tuple[Sensitivity, ...]:
    """How the results move with errors of the table's rate, the time base, the thermometer and the
    latitude.
    """
    errors = [
        InputError(forms.RATE, "scale", SHARE),
        InputError(forms.RATE, "offset", RATE_STEP_DPS),
        InputError("time_s", "scale", SHARE),
    ]
    temperatures = [run.temp_degc for group in runs.values() for run in group]
    low, high = min(temperatures), max(temperatures)
    if low <= high:  # logged in every run
        errors += of_thermometer(forms.TEMPERATURE, low, high)
    if spec.site.latitude_deg is not None:
        errors.append(InputError("latitude_deg", "offset", LATITUDE_STEP_DEG))

    def refit(error: InputError) -> Sequence[StageResult]:
        moved_spec, shifted = spec, dict(runs)
        if error.input == "latitude_deg":
            latitude = error.shift(spec.site.latitude_deg)
            site = spec.site.model_copy(update={"latitude_deg": latitude})
            moved_spec = spec.model_copy(update={"site": site})
        else:
            for axis, group in runs.items():
                of_axis = []
                for run in group:
                    plateaus = run.plateaus
                    means = {
                        name: error.shift(getattr(plateaus, name)) for name in MOVED[error.input]
                    }
                    of_axis.append(replace(run, plateaus=replace(plateaus, **means)))
                shifted[axis] = tuple(of_axis)
        return coefficient_files.list_results(
            fit_campaign(moved_spec, shifted, campaign), moved_spec
        )

    return differentiate(errors, stages, refit)


def _summarize(campaign: CampaignFit, scales: StageResult) -> Overview:
    """Sentence, facts and values of a fit; `scales` is what gyro_scale.json will hold."""
    largest: list[KeyValue] = []
    for kind, (name, _, _) in flags.LIMITS.items():
        figures = [f for f in scales.figures if FigureName.of(f.name)[:2] == (kind, GJB)]
        if figures:
            worst = max(figures, key=lambda figure: abs(figure.value))
            key_value = _key_value(f"largest {name} ({GJB})", worst)
            if kind in MAGNITUDES:  # whose interval is not ± U: see the tables
                key_value = replace(key_value, expanded_uncertainty=0.0)
            largest.append(key_value)
    if campaign.pair is not None:
        of_pair = {result.name: result for result in campaign.pair_figures}
        alpha, ratio = _key_value("α", of_pair["alpha_deg"]), _key_value("N", of_pair["N"])
        error = _key_value("orthogonality error 90° − α", of_pair["orthogonality_error_deg"])
        sentence = f"Angle between the input axes α = {alpha}: {error.name} = {error}."
        ratios = f"N = K_B/K_A = {ratio}; γ = {_key_value('γ', of_pair['gamma'])}."
        return Overview(sentence, (ratios, *_in_words(largest)), (error, ratio, *largest)[:4])
    scale_factors, place = [], ""
    for channel in campaign.own_channels:
        K: Figure | Coefficient
        if channel.mean is not None:
            K, gyro = channel.mean.coefficients[0], channel.name
            degc = float(np.mean([run.temp_degc for run in channel.repeated]))
        else:
            K = campaign.reference.figures[f"scale_factor.{channel.gyro}"]
            gyro = f"{channel.gyro} along its input axis"
            degc = campaign.reference.temp_degc
        place = f" at {degc:.1f} °C" if np.isfinite(degc) else ""
        scale_factors.append(_key_value(f"scale factor of {gyro}{place}", K, "counts/°"))
    facts = (*_in_words(scale_factors), *_in_words(largest))
    errors = [
        figure
        for name, figure in (campaign.reference.figures.items() if campaign.sets else ())
        if name.startswith("orthogonality_error")
    ]
    if not errors:
        return Overview(facts[0], facts[1:], (*scale_factors, *largest)[:4])
    worst = max(errors, key=lambda figure: abs(figure.value))
    of_both = worst.name.partition(".")[2].replace("_", " and ")
    error = _key_value(f"90° − angle between the input axes of {of_both}", worst)
    sentence = f"Largest departure from right angles{place}: {error.name} is {error}."
    return Overview(sentence, facts, (error, *scale_factors)[:4])


def _key_value(name: str, result: Figure | Coefficient, unit: str = "") -> KeyValue:
    """A figure or coefficient as the first screen states it."""
    unit = unit or unit_mark(result.unit) or "1"
    u, dof = result.standard_uncertainty, result.effective_dof
    return KeyValue.of(name, result.value, unit, u, dof)


def _in_words(values: Sequence[KeyValue]) -> tuple[str, ...]:
    """Values as one line."""
    text = "; ".join(f"{value.name} = {value}" for value in values)
    return (f"{text[0].upper()}{text[1:]}.",) if text else ()
