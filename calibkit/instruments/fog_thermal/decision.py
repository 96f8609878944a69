"""Models tested on withheld ramps → the one drift term that is exported, or none, and
drift_rate.json.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.coefficients import Figure, StageResult
from calibkit.instruments.fog_thermal import forms, gradient_file
from calibkit.instruments.fog_thermal.compensate import DriftModel, LogFigures
from calibkit.instruments.fog_thermal.gradient_file import SideChoice
from calibkit.instruments.fog_thermal.numeric import choice, compensation
from calibkit.instruments.fog_thermal.numeric.choice import ThermalChoice
from calibkit.instruments.fog_thermal.ramps import PreparedLog
from calibkit.instruments.fog_thermal.recipe import Drift, FogThermalRecipe


@dataclass(frozen=True, slots=True)
class Export:
    """The exported drift term, what withheld ramps were left with (share of raw; none where
    untested), and why.
    """

    model: DriftModel
    name: str
    share_of_raw: float | None
    flags: tuple[str, ...]


def choose_on_levels(logs: Sequence[PreparedLog], spec: Drift) -> ThermalChoice | None:
    """Test the models on levels by leaving out each ramp; none where the recipe asks for the
    published scheme alone.
    """
    if spec.model == "gradient_rate" or (spec.model == "auto" and spec.order != "auto"):
        return None
    return choice.choose(
        [log.thermal for log in logs],
        [one for one in choice.CANDIDATES if spec.model in ("auto", one.form)],
        figure_blocks=compensation.blocks_per_figure(spec.interval_s),
    )


def decide(
    choices: Sequence[SideChoice], levels: ThermalChoice | None, recipe: FogThermalRecipe
) -> Export:
    """Export the scheme that leaves withheld ramps the smallest share of their raw drift; none
    where none helps.
    """
    spec = recipe.drift
    rates = tuple(choice.chosen for choice in choices if choice.chosen is not None)
    thermal = levels.model if levels is not None else None
    if spec.model in ("level", "lagged"):
        rates = ()
    share_rates, share_levels = _share_of_rates(choices), _share_of_levels(levels)
    if rates and thermal is not None:
        if share_rates is not None and share_levels is not None and share_rates < share_levels:
            thermal = None
        else:
            rates = ()
    model = DriftModel(
        rates, thermal, spec.interval_s, spec.compensation, recipe.reference_temp_degc
    )
    if thermal is not None and levels is not None and levels.chosen is not None:
        flags = [*thermal.flags, f"exported: {levels.reason}"]
        if thermal.entangled:
            flags.append(
                f"uncertainties of {', '.join(thermal.entangled)} hold together, through the"
                " covariance, not singly"
            )
        return Export(model, levels.chosen.candidate.name, share_levels, tuple(flags))
    if rates:
        pinned = tuple(flag for choice in choices for flag in choice.flags)
        return Export(model, "gradient_rate", share_rates, pinned)
    reasons = [flag for choice in choices for flag in choice.flags]
    reasons += [levels.reason] if levels is not None else []
    return Export(model, "none", None, (f"no drift term exported: {'; '.join(reasons)}",))


def _share_of_rates(choices: Sequence[SideChoice]) -> float | None:
    """Share of the raw drift that the exported orders leave on left-out rates, over both sides."""
    tested = [
        r for c in choices if c.chosen is not None for r in c.tested if r.order == c.chosen.order
    ]
    if not tested:
        return None
    left = np.concatenate([result.compensated for result in tested])
    raw = np.concatenate([result.raw for result in tested])
    return float(np.sqrt(np.sum(left**2) / np.sum(raw**2)))


def _share_of_levels(levels: ThermalChoice | None) -> float | None:
    """Share of the raw drift that the chosen model on levels leaves on left-out ramps."""
    return (
        None
        if levels is None or levels.chosen is None
        else levels.chosen.pooled / levels.chosen.pooled_raw
    )


def result(
    export: Export,
    choices: Sequence[SideChoice],
    levels: ThermalChoice | None,
    logs: Sequence[LogFigures],
    recipe: FogThermalRecipe,
) -> StageResult:
    """drift_rate.json: the exported model and every drift figure with its rate gain beside it."""
    figures = gradient_file.left_out_figures(choices)
    tested = levels.tested if levels is not None else ()
    if tested:
        figures.append(Figure("raw_drift_rms.ramps", tested[0].pooled_raw, "deg/h", 0.0))
    figures += [
        Figure(f"leave_one_ramp_out_rms.{one.candidate.name}", one.pooled, "deg/h", 0.0)
        for one in tested
    ]
    for log in logs:
        figures += [
            Figure(f"drift_rms_before.{log.name}", log.before, "deg/h", 0.0),
            Figure(f"drift_rms_after.{log.name}", log.after, "deg/h", 0.0),
            Figure(f"rate_gain_recursive.{log.name}", log.gain_recursive, "1", 0.0),
            Figure(f"one_step_rms_after.{log.name}", log.after_one_step, "deg/h", 0.0),
            Figure(f"rate_gain_one_step.{log.name}", log.gain_one_step, "1", 0.0),
        ]
    flags = [
        *export.flags,
        *(f"not tested: {reason}" for reason in (levels.refused if levels is not None else ())),
    ]
    if recipe.drift.compensation == "one_step":
        flags.append(
            "one_step compensation is a first difference: it removes the true rate (rate gain 0)"
        )
    models = [
        forms.write_rates(polynomial, recipe.drift.interval_s)
        for polynomial in export.model.polynomials
    ]
    if export.model.thermal is not None:
        models.append(forms.write_thermal(export.model.thermal, recipe.drift.interval_s))
    return StageResult(
        "drift_rate", models=tuple(models), figures=tuple(figures), flags=tuple(flags)
    )
