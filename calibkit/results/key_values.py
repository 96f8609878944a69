"""Key values of a device over the years: one value per result with U, limits, and when the limit
will be reached.
"""

from __future__ import annotations

import datetime as dt
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from calibkit.certificate.results import print_expanded
from calibkit.certificate.words import unit_mark
from calibkit.errors import CalibkitError
from calibkit.history.timeline import YEAR_DAYS, independent_runs
from calibkit.numeric import change
from calibkit.report.figures import ALERT, DENOISED, MUTED, page, styled
from calibkit.report.table import Table, number_or_none
from calibkit.results.evaluation import RunResults
from calibkit.results.still_good import state_place

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.certificate.quantities import Quantity
    from calibkit.certificate.results import Result
    from calibkit.numeric.change import Reach, Trend
    from calibkit.store import StoredRun

MOST_PANELS = 12
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
        between = f"between {_month(reach.earliest)} and {_month(reach.latest)}"
        return f"about {_month(reach.expected)}, {between}"


def _year(run: StoredRun) -> float:
    """Effective date as a year, counted as by `timeline`."""
    return dt.date.fromisoformat(run.document["effective_from"]).toordinal() / YEAR_DAYS


def _month(year: float) -> str:
    """Month of a year so counted."""
    return dt.date.fromordinal(round(year * YEAR_DAYS)).isoformat()[:7]


def follow(runs: Sequence[StoredRun]) -> tuple[tuple[FollowedResult, ...], tuple[str, ...]]:
    """Key values of every result that the newest run compares, at one point that all runs hold at:
    the reference temperature, or of a drift, which is zero there, the end that is farthest. Also
    returns why runs are left out.
    """
    every: list[RunResults] = []
    flags = []
    for run in sorted(runs, key=lambda run: (_year(run), run.document["revision"])):
        try:
            every.append(RunResults.read(run))
        except CalibkitError as error:
            flags.append(f"{run.name}: no key values: {error.message}")
    key_values = []
    for quantity in every[-1].quantities if every else ():
        if not quantity.compared:
            continue
        # the same result of every run of the procedure, the newest last
        procedure = every[-1].run.document["procedure"]
        same = []
        for results in every:
            alike = [other for other in results.quantities if _is_same(other, quantity)]
            if alike and results.run.document["procedure"] == procedure:
                same.append((results, alike[0]))
        points = _points([other for _, other in same], every[-1].stated.reference_degc)
        if points:
            key_values.append(_follow(same, points))
    return tuple(key_values), tuple(flags)


def _is_same(a: Quantity, b: Quantity) -> bool:
    """Whether two runs have a result in common."""
    columns = [[each.column for each in quantity.inputs[:1]] for quantity in (a, b)]
    return (a.model, a.name, a.unit) == (b.model, b.name, b.unit) and columns[0] == columns[1]


def _points(same: Sequence[Quantity], reference_degc: float) -> list[dict[str, float]]:
    """Points at which a result of several runs holds in all, the one to follow first."""
    newest = same[-1]
    if not newest.inputs:
        return [{}]
    low = max(quantity.inputs[0].low for quantity in same)
    high = min(quantity.inputs[0].high for quantity in same)
    if not low <= high:
        return []
    ends = sorted((low, high), key=lambda x: -abs(x - reference_degc))
    needed = {each.column for each in newest.inputs[1:] if each.rest is None}
    case = newest.compared[0][0] if needed <= newest.compared[0][0].keys() else {}
    column, middle = newest.inputs[0].column, float(np.clip(reference_degc, low, high))
    points = [newest.complete({column: x, **case}) for x in (middle, *ends)]
    return [at for at in points if not newest.outside(at)]


def _follow(
    same: Sequence[tuple[RunResults, Quantity]], points: Sequence[Mapping[str, float]]
) -> FollowedResult:
    """One result over the years, at the first of some points at which its U is known."""
    results, quantity = same[-1]
    at = next((at for at in points if results.state(quantity, at).uncertainty), points[0])
    values = [
        (results.run, results.state(other, other.complete(at)))
        for results, other in same
        if not other.outside(other.complete(at))
    ]
    newest = values[-1][1] if values else results.state(quantity, at)
    # the line through independent determinations: year, value, u
    independent = independent_runs([run for run, _ in values])
    known = [
        (_year(run), result.value, result.uncertainty.standard_uncertainty)
        for run, result in values
        if result.uncertainty is not None and run.document["revision"] in independent
    ]
    years, y, u = np.array(known).reshape(-1, 3).T
    limits = None if quantity.limit is None else quantity.limit.bounds(newest.value)
    line, reach = change.trend(years, y, u), None
    if line is not None and limits is not None:
        reach = change.reach(line, float(years.max()), float(np.ptp(years)), *limits)
    return FollowedResult(quantity, newest.at, tuple(values), limits, line, reach)


def tabulate(key_values: Sequence[FollowedResult]) -> Table | None:
    """A row for each key value: the newest, its slope a year, and when the limit will be
    reached; None where there is none.
    """

    def printed(value: float, U: float) -> str:
        return " ± ".join(print_expanded(value, U)) if U > 0.0 else f"{value:.6g}"

    rows = []
    for each in key_values:
        newest, line = each.values[-1][1], each.line
        slope = ""
        if line is not None:
            slope = printed(line.slope, line.coverage_factor * line.standard_uncertainty)
        last, unit = printed(newest.value, newest.U), unit_mark(each.quantity.unit)
        cells = (each.place, len(each.values), last, unit, slope, each.forecast)
        rows.append((each.quantity.words.en, *cells))
    heads = ("key value", "at", "runs", "last ± U", "unit", "a year ± U", "limit reached")
    return Table("key values", heads, tuple(rows)) if rows else None


def documents(key_values: Sequence[FollowedResult]) -> Iterator[dict[str, Any]]:
    """Each key value as a JSON object."""
    for each in key_values:
        values = [
            {
                "revision": run.document["revision"],
                "effective_from": run.document["effective_from"],
                "value": result.value,
                "expanded_uncertainty": result.U if result.uncertainty else None,
            }
            for run, result in each.values
        ]
        limits = None if each.limits is None else [number_or_none(end) for end in each.limits]
        yield {
            "quantity": each.quantity.key,
            "unit": each.quantity.unit,
            "at": {name: value for name, value, _ in each.at},
            "values": values,
            "limits": limits,
            "limit_reached": each.forecast,
        }


def draw(serial: str, key_values: Sequence[FollowedResult]) -> Figure:
    """A panel for each key value over the years: values ± U, limits, the line ± U as far as it is
    extrapolated.
    """
    shown = key_values[:MOST_PANELS]
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)
    title, height = f"{serial}: key values over the years, ± U", 0.8 + 2.9 * rows
    with styled():
        figure, axes = page(rows, columns, title=title, height=height)
        for ax, each in zip(axes, shown, strict=False):
            _panel(ax, each)
        for ax in axes[len(shown) :]:
            ax.set_visible(False)
    return figure


def _panel(ax: Axes, key_value: FollowedResult) -> None:
    """One key value."""
    for run, result in key_value.values:
        day = dt.date.fromisoformat(run.document["effective_from"]).toordinal()
        hollow = run.document["verdict"] == "rejected"
        ax.errorbar([day], [result.value], result.U, fmt="o", ms=4.5, capsize=3, color=DENOISED,
                    mfc="none" if hollow else DENOISED)  # fmt: skip
    line, reach = key_value.line, key_value.reach
    if line is not None:
        until = reach.until if reach is not None else _year(key_value.values[-1][0])
        years = np.linspace(_year(key_value.values[0][0]), until, 60)
        y, U = np.array([line.expand(year) for year in years.tolist()]).T
        ax.plot(years * YEAR_DAYS, y, "--", color=MUTED, lw=1.0)
        ax.fill_between(years * YEAR_DAYS, y - U, y + U, color=MUTED, alpha=0.15, lw=0.0)
    for end in key_value.limits or ():
        if np.isfinite(end):
            ax.axhline(end, color=ALERT, lw=1.2, ls=":")
    days = np.linspace(*ax.get_xlim(), 4).astype(int).tolist()
    ax.set_xticks(days, [dt.date.fromordinal(day).isoformat()[:7] for day in days])
    words, unit = key_value.quantity.words.en, unit_mark(key_value.quantity.unit)
    ax.set_title(f"{words}{f' at {key_value.place}' if key_value.at else ''}", fontsize=9)
    ax.set_xlabel(f"limit reached: {key_value.forecast}", fontsize=8)
    ax.set_ylabel(f"[{unit or 1}]")
