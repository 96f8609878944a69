"""A thermal drift model and a log → what the compensated rate is uncertain by, component by
component, and whether it holds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import UsageError
from calibkit.instruments.fog_thermal.numeric import evaluate, uncertainty
from calibkit.instruments.fog_thermal.numeric import noise as thermal_noise
from calibkit.numeric import gum
from calibkit.recipe.type_b import RELATIVE
from calibkit.report.summary import number
from calibkit.report.table import Table, number_or_none

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibkit.arrays import Array
    from calibkit.instruments.fog_thermal.compensate import DriftModel
    from calibkit.instruments.fog_thermal.numeric.gradient import Blocks
    from calibkit.instruments.fog_thermal.numeric.terms import ThermalModel
    from calibkit.instruments.fog_thermal.ramps import PreparedLog
    from calibkit.recipe import TypeB


RESULT = "gyro_dph"
"""Name under which type B terms speak of the compensated rate."""
SHIFT_DEGC = 0.05
"""Change of a thermometer by which the drift is differentiated: the drift is smooth over degrees.
"""
POINTS = 5
"""Temperatures at which the uncertainty at rest is stated."""
FIGURE_S = 100.0


@dataclass(frozen=True, slots=True)
class RateUncertainty:
    """Drift [n, °/h] along a log, contributions [m, n, °/h] to its uncertainty with names and
    kinds, and their combination.
    """

    drift: Array
    names: tuple[str, ...]
    kinds: tuple[str, ...]
    contributions: Array
    standard: Array
    effective_dof: Array
    expanded: Array


@dataclass(frozen=True, slots=True)
class Stated:
    """The combined uncertainty at one instant: where that is, the drift there [°/h], and every
    component.
    """

    where: str
    temp_case_degc: float
    drift: float
    components: tuple[tuple[str, str, float], ...]
    standard_uncertainty: float
    effective_dof: float
    coverage_factor: float
    expanded_uncertainty: float


def along(
    thermal: ThermalModel,
    time: Array,
    case: Array,
    env: Array,
    terms: Sequence[TypeB],
    reference_degc: float,
) -> RateUncertainty:
    """Uncertainty of what is taken off the indication along a log: type A, model error, clamping,
    and the type B terms.

    A type B term of temp_case_degc or temp_env_degc acts through the drift's change where that
    thermometer is off all along the log; one of the compensated rate (gyro_dph) acts itself; one
    with a sensitivity to it by that.
    """
    found = evaluate.evaluate(thermal, time, case, env, reference_degc)
    own = uncertainty.contributions(thermal, found)
    shifts = {"temp_case_degc": (1.0, 0.0), "temp_env_degc": (0.0, 1.0)}
    names, kinds, values, dof = list(own.names), list(own.kinds), [*own.values], own.dof.tolist()
    for term in terms:
        if term.quantity in shifts and term.sensitivity is None and term.unit not in RELATIVE:
            of_case, of_env = (SHIFT_DEGC * way for way in shifts[term.quantity])
            warmer, colder = (
                evaluate.evaluate(
                    thermal, time, case + way * of_case, env + way * of_env, reference_degc
                ).drift
                for way in (1.0, -1.0)
            )
            part = (warmer - colder) / (2.0 * SHIFT_DEGC) * term.u_of(0.0)
        elif term.quantity == RESULT and term.sensitivity is None and term.unit not in RELATIVE:
            part = np.full(time.size, term.u_of(0.0))
        elif term.result == RESULT and term.sensitivity is not None:
            part = np.full(time.size, term.u * term.sensitivity)
        else:
            continue
        names.append(term.name)
        kinds.append("B")
        values.append(np.asarray(np.abs(part), dtype=np.float64))
        dof.append(float("inf") if term.dof is None else term.dof)
    standard, effective, expanded = gum.expand_along(np.stack(values), np.array(dof))
    return RateUncertainty(
        found.drift, tuple(names), tuple(kinds), np.stack(values), standard, effective, expanded
    )


def of_blocks(model: DriftModel, blocks: Blocks, terms: Sequence[TypeB]) -> RateUncertainty:
    """Uncertainty along block means; raises UsageError where the run exports no model on levels, of
    which it can be stated.
    """
    if model.thermal is None:
        found = (
            "gradient_rate, whose error on other rates is not known"
            if model.polynomials
            else "no drift term"
        )
        raise UsageError(
            f"output.rate_uncertainty: the run exports {found}: no uncertainty of the compensated"
            " rate can be stated",
            hint="set it to false, or fit with drift.model = 'auto'",
        )
    env = blocks.case - blocks.gradient
    return along(model.thermal, blocks.time, blocks.case, env, terms, model.reference_temp_degc)


def _at(where: str, temperature: float, found: RateUncertainty, row: int) -> Stated:
    """Statement at one row of a log."""
    parts = zip(found.names, found.kinds, found.contributions[:, row].tolist(), strict=True)
    standard, expanded = float(found.standard[row]), float(found.expanded[row])
    factor = expanded / standard if standard > 0.0 else gum.coverage_factor(float("inf"))
    return Stated(
        where,
        temperature,
        float(found.drift[row]),
        tuple(parts),
        standard,
        float(found.effective_dof[row]),
        factor,
        expanded,
    )


def stated(
    model: DriftModel, logs: Sequence[PreparedLog], terms: Sequence[TypeB]
) -> tuple[Stated, ...]:
    """Uncertainty at rest over the fitted temperatures, and where it is largest along each log;
    needs a model on levels.
    """
    if model.thermal is None:
        return ()
    low, high = model.thermal.valid.temperature
    reference = min(max(model.reference_temp_degc, low), high)
    found = []
    for temperature in sorted({*np.linspace(low, high, POINTS).tolist(), reference}):
        still = np.full(2, temperature)
        at_rest = along(
            model.thermal, np.array([0.0, 1.0]), still, still, terms, model.reference_temp_degc
        )
        found.append(_at("at rest", temperature, at_rest, 1))
    for log in logs:
        moving = of_blocks(model, log.raw, terms)
        row = int(np.argmax(moving.standard))
        found.append(_at(log.name, float(log.raw.case[row]), moving, row))
    return tuple(found)


def table(statements: Sequence[Stated]) -> Table:
    """Table of the statements."""
    rows = []
    for entry in statements:
        parts = {name: value for name, _, value in entry.components}
        type_b = float(
            np.sqrt(sum(value**2 for name, kind, value in entry.components if kind == "B"))
        )
        dof = "∞" if entry.effective_dof > 1e4 else f"{np.floor(entry.effective_dof):.0f}"
        cells = (
            parts["coefficients"],
            parts["model error on ramps left out"],
            type_b,
            entry.standard_uncertainty,
        )
        rows.append(
            (
                entry.where,
                f"{entry.temp_case_degc:.0f}",
                f"{entry.drift:+.3f}",
                *(number(value, 2) for value in cells),
                dof,
                f"{entry.coverage_factor:.2f}",
                number(entry.expanded_uncertainty, 2),
            )
        )
    return Table(
        "Uncertainty of the drift taken off, and so of the compensated rate [°/h]: at rest, and"
        " where it is largest in each log",
        ("where", "°C", "drift", "coefficients", "model error", "type B", "u", "ν_eff", "k", "U"),
        tuple(rows),
    )


def unused(terms: Sequence[TypeB]) -> tuple[str, ...]:
    """Flags that name the type B terms which say nothing of the compensated rate."""
    temperatures = ("temp_case_degc", "temp_env_degc", RESULT)
    idle = [
        term.name
        for term in terms
        if term.result != RESULT
        and (
            term.quantity not in temperatures
            or term.unit in RELATIVE
            or term.sensitivity is not None
        )
    ]
    return (
        (f"type B terms that do not enter the compensated rate: {', '.join(idle)}",) if idle else ()
    )


def document(statements: Sequence[Stated]) -> list[dict[str, Any]]:
    """JSON objects of the statements; infinite degrees of freedom are null."""
    return [
        {
            "result": "drift taken off the indication",
            "unit": "deg/h",
            "where": entry.where,
            "temp_case_degc": entry.temp_case_degc,
            "value": entry.drift,
            "components": [
                {"name": name, "kind": kind, "standard_uncertainty": value}
                for name, kind, value in entry.components
            ],
            "standard_uncertainty": entry.standard_uncertainty,
            "effective_dof": number_or_none(entry.effective_dof),
            "coverage_factor": entry.coverage_factor,
            "expanded_uncertainty": entry.expanded_uncertainty,
            "probability": gum.TWO_SIGMA,
        }
        for entry in statements
    ]


def coverage(model: DriftModel, blocks: Blocks, terms: Sequence[TypeB]) -> dict[str, Any]:
    """JSON object: standard uncertainties along a log, and the share of its 100 s means that are as
    near as U says.

    A mean may be off the log's own mean by the uncertainty of the drift and by noise: white noise
    of the blocks and flicker noise about its mean, at the levels that the fit found.
    """
    if model.thermal is None:
        return {"not_available": "the run exports no model on levels"}
    found = of_blocks(model, blocks, terms)
    group = max(1, round(FIGURE_S / model.interval_s))
    count = found.drift.size // group
    entry: dict[str, Any] = {
        "unit": "deg/h",
        "standard_uncertainty_mean": float(found.standard.mean()),
        "standard_uncertainty_largest": float(found.standard.max()),
        "expanded_uncertainty_largest": float(found.expanded.max()),
        "probability": gum.TWO_SIGMA,
    }
    if count < 2:
        return entry
    rows = slice(0, count * group)

    def grouped(values: Array) -> Array:
        return np.asarray(values[rows].reshape(count, group).mean(axis=1), dtype=np.float64)

    left = grouped(blocks.indication - found.drift)
    noise = model.thermal.noise
    flicker = noise.flicker**2 * np.diag(
        uncertainty.about_its_mean(thermal_noise.flicker_kernel(count))
    )
    limit = np.sqrt(grouped(found.expanded) ** 2 + 4.0 * (noise.white_variance / group + flicker))
    share = float(np.mean(np.abs(left - left.mean()) <= limit))
    return entry | {"means_of_100_s": count, "share_within_expanded_uncertainty": share}
