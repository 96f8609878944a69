"""Key values of a device over the years: one value per result with U, limits, and when the limit
will be reached.

Values of independent determinations have a weighted line y = a + b t (`change.trend`); a limit is
reached between the years in which y + U and y - U of the line cross it (`change.reach`).
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.errors import CalibkitError, UsageError
from calibkit.history.timeline import independent_runs
from calibkit.numeric import change
from calibkit.report.figures import ALERT, DENOISED, MUTED, page, styled
from calibkit.report.table import Table, number_or_none
from calibkit.results.evaluation import RunResults, state_expanded
from calibkit.results.still_good import state_place
from calibkit.units import unit_mark

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from matplotlib.figure import Figure

    from calibkit.certificate.quantities import Quantity
    from calibkit.certificate.results import Result
    from calibkit.numeric.change import Reach, Trend
    from calibkit.records.store import StoredRun

MOST_PANELS = 12
YEAR_DAYS = 365.25
FEWEST_DATES = 3
"""Dates that a slope with an uncertainty needs."""


@dataclass(frozen=True, slots=True)
class FollowedResult:
    """One result at one point over the years: runs with their values, limits now, the line through
    independent determinations, and when it reaches a limit.
    """

    quantity: Quantity
    at: tuple[tuple[str, float, str], ...]
    values: tuple[tuple[StoredRun, Result], ...]
    limits: tuple[float, float] | None
    line: Trend | None
    reach: Reach | None

    @property
    def place(self) -> str:
        """Where it is followed; inputs at rest are left out."""
        return state_place(self.values[-1][1])

    @property
    def forecast(self) -> str:
        """When the limit will be reached, or why that is not known."""
        if self.limits is None:
            return "no limit is set"
        if self.line is None or self.reach is None:
            return f"cannot tell: fewer than {FEWEST_DATES} dates with an uncertainty"
        last, reach = max(_year(run) for run, _ in self.values), self.reach
        if reach.earliest is None:
            return f"not before {_month(reach.until)} (not extrapolated further)"
        if reach.earliest <= last:
            return "cannot tell: the line ± U is at the limit already"
        if reach.expected is None or reach.latest is None:
            return f"not before {_month(reach.earliest)}; cannot tell when"
        span = f"between {_month(reach.earliest)} and {_month(reach.latest)}"
        return f"about {_month(reach.expected)}, {span}"


def _day(run: StoredRun) -> int:
    """Effective date as the number of a day."""
    return dt.date.fromisoformat(run.document["effective_from"]).toordinal()


def _year(run: StoredRun) -> float:
    """Effective date in years."""
    return _day(run) / YEAR_DAYS


def _month(year: float) -> str:
    """Month of a year so counted."""
    return dt.date.fromordinal(round(year * YEAR_DAYS)).isoformat()[:7]


def follow(runs: Sequence[StoredRun]) -> tuple[tuple[FollowedResult, ...], tuple[str, ...]]:
    """Key values of every result that the newest run compares, at one point that all runs hold at:
    the reference temperature, or of a drift, which is zero there, the end that is farthest. Also
    returns why runs are left out.
    """
    runs_results: list[RunResults] = []
    flags = []
    for run in sorted(runs, key=lambda run: (_year(run), run.document["revision"])):
        try:
            runs_results.append(RunResults.read(run))
        except CalibkitError as error:
            flags.append(f"{run.name}: no key values: {error.message}")
    key_values = []
    for quantity in runs_results[-1].quantities if runs_results else ():
        if not quantity.compared:
            continue
        # the same result of every run of the procedure, the newest last
        procedure = runs_results[-1].run.document["procedure"]
        series = []
        for results in runs_results:
            same_quantities = [
                other
                for other in results.quantities
                if (other.model, other.name, other.unit)
                == (quantity.model, quantity.name, quantity.unit)
                and [i.column for i in other.inputs[:1]] == [i.column for i in quantity.inputs[:1]]
            ]
            if same_quantities and results.run.document["procedure"] == procedure:
                series.append((results, same_quantities[0]))
        points = _points([other for _, other in series], runs_results[-1].basis.reference_degc)
        if points:
            key_values.append(_follow(series, points))
    return tuple(key_values), tuple(flags)


def _points(quantities: Sequence[Quantity], reference_degc: float) -> list[dict[str, float]]:
    """Points at which a result of several runs holds in all, the one to follow first."""
    newest = quantities[-1]
    if not newest.inputs:
        return [{}]
    low = max(quantity.inputs[0].low for quantity in quantities)
    high = min(quantity.inputs[0].high for quantity in quantities)
    if not low <= high:
        return []
    ends = sorted((low, high), key=lambda x: -abs(x - reference_degc))
    required_columns = {i.column for i in newest.inputs[1:] if i.rest is None}
    case = newest.compared[0][0] if required_columns <= newest.compared[0][0].keys() else {}
    column, middle = newest.inputs[0].column, float(np.clip(reference_degc, low, high))
    points = [newest.complete({column: x, **case}) for x in (middle, *ends)]
    return [point for point in points if not newest.outside(point)]


def _follow(
    series: Sequence[tuple[RunResults, Quantity]], points: Sequence[Mapping[str, float]]
) -> FollowedResult:
    """One result over the years, at the first of some points at which its U is known."""
    results, quantity = series[-1]
    known_points = [point for point in points if results.state(quantity, point).uncertainty]
    point = (known_points or points)[0]
    values = [
        (results.run, results.state(other, other.complete(point)))
        for results, other in series
        if not other.outside(other.complete(point))
    ]
    newest = values[-1][1] if values else results.state(quantity, point)
    # the line through independent determinations: year, value, u
    independent = independent_runs([run for run, _ in values])
    determinations = [
        (_year(run), result.value, result.uncertainty.standard_uncertainty)
        for run, result in values
        if result.uncertainty is not None and run.document["revision"] in independent
    ]
    years, y, u = np.array(determinations).reshape(-1, 3).T
    limits = None if quantity.limit is None else quantity.limit.bounds(newest.value)
    line, reach = change.trend(years, y, u), None
    if line is not None and limits is not None:
        reach = change.reach(line, float(years.max()), float(np.ptp(years)), *limits)
    return FollowedResult(quantity, newest.at, tuple(values), limits, line, reach)


def tabulate(key_values: Sequence[FollowedResult]) -> Table | None:
    """A row for each key value: the newest, its slope a year, and when the limit will be
    reached; None where there is none.
    """
    rows = []
    for key_value in key_values:
        newest, line = key_value.values[-1][1], key_value.line
        slope = ""
        if line is not None:
            U = line.coverage_factor * line.standard_uncertainty
            slope = state_expanded(line.slope, U, "1")
        last, unit = state_expanded(newest.value, newest.U, "1"), unit_mark(key_value.quantity.unit)
        cells = (key_value.place, len(key_value.values), last, unit, slope, key_value.forecast)
        rows.append((key_value.quantity.words.en, *cells))
    heads = ("key value", "at", "runs", "last ± U", "unit", "a year ± U", "limit reached")
    return Table("key values", heads, tuple(rows)) if rows else None


def documents(key_values: Sequence[FollowedResult]) -> Iterator[dict[str, Any]]:
    """Each key value as a JSON object."""
    for key_value in key_values:
        values = [
            {
                "revision": run.document["revision"],
                "effective_from": run.document["effective_from"],
                "value": result.value,
                "expanded_uncertainty": result.U if result.uncertainty else None,
            }
            for run, result in key_value.values
        ]
        limits = (
            None if key_value.limits is None else [number_or_none(end) for end in key_value.limits]
        )
        yield {
            "quantity": key_value.quantity.key,
            "unit": key_value.quantity.unit,
            "at": {name: value for name, value, _ in key_value.at},
            "values": values,
            "limits": limits,
            "limit_reached": key_value.forecast,
        }


def list_values(key_values: Sequence[FollowedResult]) -> Table:
    """Every determination of every key value, one row each, for CSV."""
    rows = []
    for document in documents(key_values):
        followed = (document["quantity"], document["unit"])
        rows += [(*followed, *value.values()) for value in document["values"]]
    heads = ("quantity", "unit", "revision", "effective_from", "value", "expanded_uncertainty")
    return Table("", heads, tuple(rows))


def draw(serial: str, key_values: Sequence[FollowedResult]) -> Figure:
    """A panel for each key value over the years: values ± U, limits, the line ± U as far as it is
    extrapolated. Raises UsageError where there is none.
    """
    if not key_values:
        raise UsageError(
            f"{serial}: no result with a key value, a figure has nothing to show",
            hint="`calibkit history` states why",
        )
    drawn_values = key_values[:MOST_PANELS]
    columns = min(len(drawn_values), 2)
    rows = -(-len(drawn_values) // columns)
    title, height = f"{serial}: key values over the years, ± U", 0.8 + 2.9 * rows
    with styled():
        figure, axes = page(rows, columns, title=title, height=height)
        for ax, key_value in zip(axes, drawn_values, strict=False):
            for run, result in key_value.values:
                day = _day(run)
                inside = "none" if run.document["verdict"] == "rejected" else DENOISED
                shape: Any = {"fmt": "o", "ms": 4.5, "capsize": 3, "mfc": inside}
                ax.errorbar([day], [result.value], result.U, color=DENOISED, **shape)
            line, reach = key_value.line, key_value.reach
            if line is not None:
                until = reach.until if reach is not None else _year(key_value.values[-1][0])
                years = np.linspace(_year(key_value.values[0][0]), until, 60)
                y, U = line.expand(years)
                ax.plot(years * YEAR_DAYS, y, "--", color=MUTED, lw=1.0)
                ax.fill_between(years * YEAR_DAYS, y - U, y + U, color=MUTED, alpha=0.15, lw=0.0)
            for end in key_value.limits or ():
                if np.isfinite(end):
                    ax.axhline(end, color=ALERT, lw=1.2, ls=":")
            first, last = (_day(key_value.values[k][0]) for k in (0, -1))
            # a margin in months: matplotlib's is a share of the number of the day
            if first == last:
                ax.set_xlim(first - YEAR_DAYS / 2.0, last + YEAR_DAYS / 2.0)
            days = np.linspace(*ax.get_xlim(), 4).astype(int).tolist()
            ax.set_xticks(days, [dt.date.fromordinal(day).isoformat()[:7] for day in days])
            words, unit = key_value.quantity.words.en, unit_mark(key_value.quantity.unit)
            ax.set_title(f"{words}{f' at {key_value.place}' if key_value.at else ''}", fontsize=9)
            ax.set_xlabel(f"limit reached: {key_value.forecast}", fontsize=8)
            ax.set_ylabel(f"[{unit or 1}]")
        for ax in axes[len(drawn_values) :]:
            ax.set_visible(False)
    return figure
