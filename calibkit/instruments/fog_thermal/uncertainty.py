"""Uncertainty of the compensated rate along a log by component, and its coverage of the residuals
on logs that were not fitted.

    u² = xᵀ C x + e² + Δ²/3 + h²/3 + Σ type B           (`numeric.thermal.uncertainty`)
    |mean of 100 s| ≤ √(U² + (2 u_noise)²) for 95 % of the means

Absolutely, the rate at rest of the fit and the turn-on bias of one more log enter too
(`RestLevel`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from calibkit import thermal_forms
from calibkit.arrays import Array
from calibkit.coefficients import Figure
from calibkit.errors import UsageError
from calibkit.instruments.fog_thermal.compensate import DriftModel
from calibkit.instruments.fog_thermal.numeric import bank
from calibkit.instruments.fog_thermal.numeric.published import DriftBlocks
from calibkit.instruments.fog_thermal.ramps import PreparedLog
from calibkit.numeric import gum
from calibkit.numeric.thermal import uncertainty
from calibkit.numeric.thermal.evaluate import Evaluation
from calibkit.numeric.thermal.left_out import blocks_per_figure
from calibkit.recipe import TypeB, type_b
from calibkit.report import budget

TURN_ON = "turn_on_bias."
"""Figures of the turn-on biases begin with this, and a log's name follows."""
RESULT = "gyro_dph"
"""Name of the compensated rate in type B terms."""
THERMOMETERS = ("temp_case_degc", "temp_env_degc")
POINTS = 5
"""Number of temperatures at which the uncertainty at rest is stated."""


def along_blocks(
    model: DriftModel,
    blocks: DriftBlocks,
    terms: Sequence[TypeB],
    *,
    long_at_rest: bool = False,
) -> uncertainty.Along:
    """Uncertainty of the drift along block means: type A, model error, clamping, hysteresis, and
    type B terms; raises UsageError without a model on levels.

    A type B term of temp_case_degc or temp_env_degc is propagated by the derivative of the drift
    for a constant error of that thermometer. A term of the compensated rate (gyro_dph) enters
    directly, one with a sensitivity multiplied by it.
    """
    thermal, reference = model.thermal, model.reference_temp_degc
    if thermal is None:
        exported = (
            "gradient_rate, whose error on other rates is not known"
            if model.polynomials
            else "no drift term"
        )
        raise UsageError(
            f"output.rate_uncertainty: the run exports {exported}: no uncertainty of the"
            " compensated rate can be stated",
            hint="set it to false, or fit with drift.model = 'auto'",
        )
    time, case, env = blocks.time, blocks.case, blocks.case - blocks.gradient

    def warmer_by(of_case: float, of_env: float) -> Evaluation:
        temperatures = case + of_case, env + of_env
        return bank.evaluate(thermal, time, *temperatures, reference, long_at_rest=long_at_rest)

    thermometers = {
        "temp_case_degc": lambda step: warmer_by(step, 0.0).drift,
        "temp_env_degc": lambda step: warmer_by(0.0, step).drift,
    }
    effects = type_b.effects_along(terms, RESULT, time.size, thermometers)
    return uncertainty.combine_along(thermal, warmer_by(0.0, 0.0), effects)


def state_along_logs(
    model: DriftModel, logs: Sequence[PreparedLog], terms: Sequence[TypeB]
) -> list[dict[str, Any]]:
    """Uncertainty of the drift as JSON objects: at rest over the fitted temperatures, and where it
    is largest in each log; empty without a model on levels.
    """
    if model.thermal is None:
        return []
    entries = []

    def state(place: str, degc: float, drift_uncertainty: uncertainty.Along, row: int) -> None:
        drift = float(drift_uncertainty.drift[row])
        parts = [
            gum.UncertaintyComponent(name, drift, float(values[row]), kind, dof=dof)
            for name, kind, values, dof in drift_uncertainty.contributions
        ]
        entry = budget.combine("drift taken off the indication", "deg/h", parts)
        entries.append(entry | {"where": place, "temp_case_degc": degc})

    no_change = np.zeros(2)
    fitted = np.linspace(*model.thermal.valid.temperature, POINTS).tolist()
    for degc in sorted({*fitted, model.thermal.nearest_fitted(model.reference_temp_degc)}):
        resting = DriftBlocks(
            np.array([0.0, 1.0]), np.full(2, degc), no_change, no_change, no_change
        )
        state("at rest", degc, along_blocks(model, resting, terms, long_at_rest=True), 1)
    for log in logs:
        moving = along_blocks(model, log.raw, terms)
        row = int(np.argmax(moving.standard))
        state(log.name, float(log.raw.case[row]), moving, row)
    return entries


@dataclass(frozen=True, slots=True)
class RestLevel:
    """Rate at rest at the reference temperature that a run states, and its standard uncertainty
    [°/h]; turn-on biases of the fitted logs [logs, °/h].
    """

    rate: float
    standard_uncertainty: float
    turn_on: Array

    @staticmethod
    def find(figures: Sequence[Figure]) -> "RestLevel | None":
        """Level of the figures of drift_rate.json; None where no rate at rest is stated."""
        by_name = {figure.name: figure for figure in figures}
        rate = by_name.get("mean_rate_at_reference")
        turn_on = [entry.value for name, entry in by_name.items() if name.startswith(TURN_ON)]
        if rate is None or len(turn_on) < 2:
            return None
        return RestLevel(rate.value, rate.standard_uncertainty, np.array(turn_on))

    @property
    def expanded(self) -> float:
        """Expanded uncertainty [°/h] of the rate at rest of one more log, its turn-on included."""
        dof = self.turn_on.size - 1
        one_more = gum.coverage_factor(float(dof)) * float(np.std(self.turn_on, ddof=1))
        return float(np.hypot(one_more, 2.0 * self.standard_uncertainty))

    def compare(self, left: Array, limit: Array) -> dict[str, float]:
        """JSON object: share of compensated means [m, °/h] that are as near to the rate at rest as
        their limits [m, °/h] and this level say, and the log's offset.
        """
        absolute = np.hypot(limit, self.expanded)
        return {
            "share_within_absolutely": float(np.mean(np.abs(left - self.rate) <= absolute)),
            "offset": float(left.mean()) - self.rate,
            "offset_expanded_uncertainty": float(absolute.mean()),
        }


def check_coverage(
    model: DriftModel, blocks: DriftBlocks, terms: Sequence[TypeB], level: RestLevel | None
) -> dict[str, Any]:
    """JSON object: uncertainties along a log, and the share of its 100 s means within U, about the
    log's mean and absolutely.

    The limit for a mean combines the expanded uncertainty of the drift, about the log's mean that
    of the drift less its mean, with noise: white noise of the blocks and flicker noise, at the
    levels of the fit. Absolutely, a log is held against the rate at rest of the run, and the
    turn-on bias of one more log is in the limit.
    """
    if model.thermal is None:
        return {"not_available": "the run exports no model on levels"}
    drift_uncertainty = along_blocks(model, blocks, terms)
    group = blocks_per_figure(model.interval_s)
    entry: dict[str, Any] = {
        "unit": "deg/h",
        "standard_uncertainty_mean": float(drift_uncertainty.standard.mean()),
        "standard_uncertainty_largest": float(drift_uncertainty.standard.max()),
        "expanded_uncertainty_largest": float(drift_uncertainty.expanded.max()),
        "probability": gum.TWO_SIGMA,
    }
    left, noise = blocks.indication - drift_uncertainty.drift, model.thermal.noise
    compared, means, limit = thermal_forms.compare_means(left, drift_uncertainty, noise, group)
    if compared and level is not None:
        entry |= level.compare(means, limit)
    return entry | compared
