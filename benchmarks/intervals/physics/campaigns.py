"""A campaign with its truth, and what a fit of its logs states."""

from __future__ import annotations

import fnmatch
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from unittest import mock

import numpy as np
from scipy.stats import t as student

import calibkit
from calibkit.report import figures, svg
from calibkit.results import evaluation
from intervals import exact
from intervals.rows import Outcome

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import pandas as pd
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

DATE = "2026-11-21"
PROBABILITY_95 = 0.97725
"""One-sided, so that U is 2 u where the degrees of freedom are infinite."""
U_OVER_95 = 2.0 / exact.NORMAL_95
"""U of a result over its 95 % half-width."""


@dataclass(frozen=True)
class Truth:
    """A result of a run and its true value."""

    quantity: str
    """Row of the table that it belongs to."""
    key: str
    """Patterns, with | between them, of ``model.name`` of a coefficient or of a figure; where
    `at` is given, end of the name of a quantity of ``calibkit evaluate``.
    """
    value: float
    at: Mapping[str, float] | None = None
    """Inputs of the quantity."""


@dataclass(frozen=True)
class Difference:
    """Results of a model at two points of its one input, the second less the first."""

    quantity: str
    model: str
    column: str
    points: tuple[float, float]
    value: float


@dataclass(frozen=True)
class Applied:
    """A log that the run compensates, and the true values of one of the columns."""

    quantity: str
    log: pd.DataFrame
    column: str
    truth: Array
    """True values [n], in the unit of the column."""
    expanded: str | float
    """Column of the standard uncertainty, or largest error that is allowed where there is none."""
    settings: Mapping[str, Any]
    """Of the place of use, as keys of the recipe."""


@dataclass(frozen=True)
class Campaign:
    """Logs of a device, the recipe that fits them, and what is true of it."""

    recipe: Mapping[str, Any]
    logs: Mapping[str, pd.DataFrame]
    truth: Sequence[Truth]
    applied: Applied | None = None
    differences: Sequence[Difference] = ()


@dataclass(frozen=True)
class Fault:
    """Something that is wrong with a campaign, and how a flag may name it."""

    procedure: str
    name: str
    size: float
    unit: str
    campaign: Callable[[np.random.Generator, float], Campaign]
    """Campaign with a fault of some size; the same generator gives the same campaign otherwise."""
    causes: str
    """Regular expression of flags and refusals that name the cause."""
    sound: float = 0.0
    """Size in the same campaign without the fault."""
    by_design: str = "^$"
    """Regular expression of flags that the design of the campaign earns without any fault."""

    @property
    def label(self) -> str:
        """Name with size."""
        return f"{self.name}, {self.size:g} {self.unit}".rstrip()


@dataclass(frozen=True)
class Fitted:
    """What a fit states of a campaign."""

    error: Mapping[str, Array]
    """Quantity → errors of its members, NaN of one that the run does not state."""
    half_width: Mapping[str, Array]
    """Quantity → U (95 %) of its members."""
    flags: tuple[str, ...] = ()
    """Findings that warn, and the message of a refusal."""
    notes: tuple[str, ...] = ()
    """Remarks that do not warn."""
    refused: bool = False
    rejected: bool = False


def fit(campaign: Campaign) -> Fitted:
    """Fit the logs of a campaign and compare each result with its truth."""
    try:
        # Nobody looks at the reports, and drawing them takes longer than the fit.
        with (
            mock.patch.object(figures, "settle", return_value=None),
            mock.patch.object(svg, "inline", lambda drawn: (["<svg></svg>"] * len(drawn), False)),
        ):
            run = calibkit.fit(campaign.recipe, logs=campaign.logs, runs=None, date=DATE)
    except calibkit.CalibkitError as error:
        return Fitted({}, {}, (str(error),), refused=True)
    numbers = run.numbers()
    numbers = numbers[numbers["kind"].isin(("coefficient", "figure"))]
    names = numbers["model"].where(numbers["kind"] == "coefficient", "") + "." + numbers["name"]
    stated = dict(
        zip(
            names.str.lstrip("."),
            numbers[["value", "standard_uncertainty", "dof"]].astype(float).to_numpy(),
            strict=True,
        )
    )
    results = evaluation.RunResults.read(run)
    error: dict[str, Any] = defaultdict(list)
    half_width: dict[str, Any] = defaultdict(list)
    for truth in campaign.truth:
        if truth.at is None:
            value, expanded = _read_number(stated, truth.key)
        else:
            value, expanded = _evaluate(results, truth.key, truth.at)
        error[truth.quantity].append(value - truth.value)
        half_width[truth.quantity].append(expanded)
    for difference in campaign.differences:
        value, expanded = _subtract(run, difference)
        error[difference.quantity].append(value - difference.value)
        half_width[difference.quantity].append(expanded)
    applied = campaign.applied
    if applied is not None:
        error[applied.quantity], half_width[applied.quantity] = _apply(run, applied)
    return Fitted(
        {name: np.array(values) for name, values in error.items()},
        {name: np.array(values) for name, values in half_width.items()},
        tuple(run.flags),
        tuple(run.document["flags"]),
        rejected=run.document["verdict"] == "rejected",
    )


def compare(fitted: Fitted, known: Mapping[str, Array], few: Sequence[str]) -> Outcome:
    """Outcome of a campaign beside the half-widths of intervals whose standard deviations are
    known; `few` are texts of which a flag has one where groups are too few.
    """
    if fitted.refused:
        return Outcome({}, {}, refused=fitted.flags[0])
    inside = {
        name: (np.abs(error) <= fitted.half_width[name]).astype(np.float64)
        for name, error in fitted.error.items()
    }
    width = {name: half / (U_OVER_95 * known[name]) for name, half in fitted.half_width.items()}
    warned = any(text in flag for flag in fitted.notes for text in few)
    return Outcome(inside, width, warned=warned, rejected=fitted.rejected)


def _subtract(run: calibkit.Run, difference: Difference) -> tuple[float, float]:
    """Value and U of a difference; the constant of the model drops out of it."""
    stated = run.model(difference.model).evaluate(**{difference.column: list(difference.points)})
    signs = np.array([-1.0, 1.0])
    u = float(np.sqrt(signs @ stated.covariance @ signs))
    numbers = run.numbers()
    slopes = numbers[(numbers["model"] == difference.model) & (numbers["name"] != "p0")]
    dof = float(slopes["dof"].astype(float).min())
    return float(signs @ stated.value), student.ppf(PROBABILITY_95, dof) * u


def _apply(run: calibkit.Run, applied: Applied) -> tuple[Array, Array]:
    """Errors and U [n] of a compensated log; angles are compared on the circle."""
    frame = run.apply(applied.log, **applied.settings)
    error = frame[applied.column].to_numpy() - applied.truth
    if applied.column.endswith("_deg"):
        error = (error + 180.0) % 360.0 - 180.0
    if isinstance(applied.expanded, str):
        return error, 2.0 * frame[applied.expanded].to_numpy()
    return error, np.full(error.shape, applied.expanded)


def _read_number(stated: Mapping[str, Array], key: str) -> tuple[float, float]:
    """Value and U of a coefficient or figure; NaN where the run does not state it."""
    for name in (name for pattern in key.split("|") for name in fnmatch.filter(stated, pattern)):
        value, u, dof = stated[name]
        # A run that states no degrees of freedom means infinitely many.
        factor = student.ppf(PROBABILITY_95, dof) if np.isfinite(dof) else 2.0
        return float(value), float(factor * u)
    return np.nan, np.nan


def _evaluate(
    results: evaluation.RunResults, key: str, at: Mapping[str, float]
) -> tuple[float, float]:
    """Value and U of a quantity at a point; NaN where the run has none or does not know U there."""
    for quantity in results.quantities:
        if fnmatch.fnmatchcase(quantity.key, f"*{key}"):
            inputs = {part.column: at[part.column] for part in quantity.inputs}
            (value,) = evaluation.evaluate(results, [quantity], [inputs])
            expanded = value.result.uncertainty
            return float(value.result.value), (
                np.nan if expanded is None else float(expanded.expanded_uncertainty)
            )
    return np.nan, np.nan
