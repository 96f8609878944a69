"""Choice of the exported drift term (or none) by tests on left-out ramps, and drift_rate.json."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibkit.coefficients import Figure, StageResult
from calibkit.instruments.fog_thermal import forms
from calibkit.instruments.fog_thermal.compensate import DriftModel, LogFigures
from calibkit.instruments.fog_thermal.gradient_file import SideChoice
from calibkit.instruments.fog_thermal.numeric import choice, compensation
from calibkit.instruments.fog_thermal.numeric.bank import BankModel
from calibkit.instruments.fog_thermal.numeric.choice import ThermalChoice
from calibkit.instruments.fog_thermal.ramps import PreparedLog
from calibkit.instruments.fog_thermal.recipe import Drift, FogThermalRecipe


@dataclass(frozen=True, slots=True)
class Export:
    """Exported drift term, its share of the raw drift on left-out ramps (None if not tested), and
    flags with the reason.
    """

    model: DriftModel
    name: str
    share_of_raw: float | None
    flags: tuple[str, ...]

    def result(
        self,
        choices: Sequence[SideChoice],
        levels: ThermalChoice,
        logs: Sequence[LogFigures],
        recipe: FogThermalRecipe,
    ) -> StageResult:
        """drift_rate.json: the exported model, and the drift figures of all tests and logs with
        rate gains.
        """
        figures = _left_out_figures(choices, levels)
        for log in logs:
            figures += [
                Figure(f"drift_rms_before.{log.name}", log.before, "deg/h", 0.0),
                Figure(f"drift_rms_after.{log.name}", log.after, "deg/h", 0.0),
                Figure(f"rate_gain_recursive.{log.name}", log.gain_recursive, "1", 0.0),
                Figure(f"one_step_rms_after.{log.name}", log.after_one_step, "deg/h", 0.0),
                Figure(f"rate_gain_one_step.{log.name}", log.gain_one_step, "1", 0.0),
            ]
        flags = [
            *self.flags,
            *(f"not tested: {reason}" for reason in levels.refused),
        ]
        if recipe.drift.compensation == "one_step":
            flags.append(
                "one_step compensation is a first difference: it removes the true rate"
                " (rate gain 0)"
            )
        models = [
            forms.write_rates(polynomial, recipe.drift.interval_s)
            for polynomial in self.model.polynomials
        ]
        if self.model.thermal is not None:
            models.append(forms.write_thermal(self.model.thermal, recipe.drift.interval_s))
        return StageResult(
            "drift_rate", models=tuple(models), figures=tuple(figures), flags=tuple(flags)
        )


def choose_on_levels(logs: Sequence[PreparedLog], spec: Drift) -> ThermalChoice:
    """Test level and lagged models by leaving out each ramp; an empty choice if the recipe asks for
    the published scheme alone.
    """
    if spec.model == "gradient_rate" or (spec.model == "auto" and spec.order != "auto"):
        return ThermalChoice((), (), None, None, "")
    return choice.choose(
        [log.thermal for log in logs],
        [one for one in choice.CANDIDATES if spec.model in ("auto", one.form)],
        figure_blocks=compensation.blocks_per_figure(spec.interval_s),
    )


def decide(
    choices: Sequence[SideChoice], levels: ThermalChoice, recipe: FogThermalRecipe
) -> Export:
    """Export the scheme with the smallest share of the raw drift on left-out ramps; none if none
    helps.
    """
    spec, thermal = recipe.drift, levels.model
    rates = tuple(choice.chosen for choice in choices if choice.chosen is not None)
    share_rates, share_levels = _share_of_rates(choices), None
    if levels.chosen is not None:
        share_levels = levels.chosen.pooled / levels.chosen.pooled_raw
    if spec.model in ("level", "lagged", "bank"):
        rates = ()
    if rates and thermal is not None:
        if share_rates is not None and share_levels is not None and share_rates < share_levels:
            thermal = None
        else:
            rates = ()
    model = DriftModel(
        rates, thermal, spec.interval_s, spec.compensation, recipe.reference_temp_degc
    )
    if thermal is not None and levels.chosen is not None:
        flags = [*thermal.flags, f"exported: {levels.reason}"]
        if thermal.entangled:
            flags.append(
                f"uncertainties of {', '.join(thermal.entangled)} hold together, through the"
                " covariance, not singly"
            )
        return Export(model, levels.chosen.candidate.name, share_levels, tuple(flags))
    reasons = [flag for choice in choices for flag in choice.flags]
    if rates:
        return Export(model, "gradient_rate", share_rates, tuple(reasons))
    if levels.reason:
        reasons.append(levels.reason)
    return Export(model, "none", None, (f"no drift term exported: {'; '.join(reasons)}",))


def _share_of_rates(choices: Sequence[SideChoice]) -> float | None:
    """Share of the raw drift on left-out rates after compensation by the exported orders, over both
    sides.
    """
    tested = [
        r for c in choices if c.chosen is not None for r in c.tested if r.order == c.chosen.order
    ]
    if not tested:
        return None
    left = np.concatenate([result.compensated for result in tested])
    raw = np.concatenate([result.raw for result in tested])
    return float(np.sqrt(np.sum(left**2) / np.sum(raw**2)))


def _left_out_figures(choices: Sequence[SideChoice], levels: ThermalChoice) -> list[Figure]:
    """Figures of the drift rms, raw and compensated: on left-out rates for each order, on left-out
    ramps for each candidate.
    """
    found = []
    for side in choices:
        if side.tested:
            found.append((f"raw_drift_rms.{side.side}", side.tested[0].pooled_raw))
        found += [
            (f"leave_one_rate_out_rms.{side.side}.order_{result.order}", result.pooled)
            for result in side.tested
        ]
    if levels.tested:
        found.append(("raw_drift_rms.ramps", levels.tested[0].pooled_raw))
    found += [(f"leave_one_ramp_out_rms.{one.candidate.name}", one.pooled) for one in levels.tested]
    return [Figure(name, value, "deg/h", 0.0) for name, value in found]


def flag_one_way(logs: Sequence[PreparedLog], model: DriftModel) -> list[str]:
    """Flag that ramps of one direction alone were measured, and what the drift term is in the
    other.
    """
    ways = {ramp.rate > 0.0 for log in logs for ramp in log.ramps}
    if len(ways) != 1 or not model.exported:
        return []
    measured, other = ("heats", "cooling") if ways == {True} else ("cools", "heating")
    if isinstance(model.thermal, BankModel):
        held = "follows from the heat flow in the coil, and its uncertainty grows"
    else:
        held = "is not known: it may come out worse than uncorrected"
    found = f"every ramp {measured}: {other} was not measured; there the drift {held}"
    return [f"{found}. Measure a ramp each way"]
