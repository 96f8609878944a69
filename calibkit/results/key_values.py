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
from calibkit.report.table import Table
from calibkit.results.evaluation import RunResults
from calibkit.results.still_good import state_place

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from calibkit.certificate.quantities import Quantity
    from calibkit.certificate.results import Result
    from calibkit.numeric.change import Reach, Trend
    from calibkit.store import Run

MOST_PANELS = 12
FEWEST_DATES = 3
"""Dates that a slope with an uncertainty needs."""


@dataclass(frozen=True, slots=True)
class _KeyValue:
    """One result at one point over the years: runs with their values, limits now, the line through
    independent determinations, and when it reaches a limit.
    """

    quantity: Quantity
    at: tuple[tuple[str, float, str], ...]
    values: tuple[tuple[Run, Result], ...]
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
        last = max(map(_year, (run for run, _ in self.values)))
        found = self.reach
        if found.earliest is not None and found.earliest <= last:
            return "cannot tell: the line ± U is at the limit already"
        if found.earliest is None:
            return f"not before {_month(found.until)} (not extrapolated further)"
        if found.expected is None or found.latest is None:
            return f"not before {_month(found.earliest)}; cannot tell when"
        return (
            f"about {_month(found.expected)}, between {_month(found.earliest)} and"
            f" {_month(found.latest)}"
        )


def _year(run: Run) -> float:
    """Effective date as a year, counted as by `timeline`."""
    return dt.date.fromisoformat(run.document["effective_from"]).toordinal() / YEAR_DAYS


def _month(year: float) -> str:
    """Month of a year so counted."""
    return dt.date.fromordinal(round(year * YEAR_DAYS)).isoformat()[:7]


def follow(runs: Sequence[Run]) -> tuple[tuple[_KeyValue, ...], tuple[str, ...]]:
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
    if not every:
        return (), tuple(flags)
    procedure = every[-1].run.document["procedure"]
    alike = [found for found in every if found.run.document["procedure"] == procedure]
    return tuple(
        _follow(alike, quantity)
        for quantity in alike[-1].quantities
        if quantity.compared and _points(alike, quantity)
    ), tuple(flags)


def _alike(found: RunResults, quantity: Quantity) -> Quantity | None:
    """The same result in another run."""
    inputs = [one.column for one in quantity.inputs[:1]]
    return next(
        (
            one
            for one in found.quantities
            if (one.model, one.name, one.unit) == (quantity.model, quantity.name, quantity.unit)
            and [i.column for i in one.inputs[:1]] == inputs
        ),
        None,
    )


def _points(every: Sequence[RunResults], quantity: Quantity) -> list[dict[str, float]]:
    """Points at which all runs that have the result hold, the one to follow first."""
    if not quantity.inputs:
        return [{}]
    inputs = [one.inputs[0] for found in every if (one := _alike(found, quantity)) is not None]
    low, high = max(one.low for one in inputs), min(one.high for one in inputs)
    reference = every[-1].stated.reference_degc
    if not low <= high:
        return []
    ends = sorted((low, high), key=lambda x: -abs(x - reference))
    column = quantity.inputs[0].column
    points = [{column: float(np.clip(reference, low, high))}, *({column: x} for x in ends)]
    needed = {one.column for one in quantity.inputs[1:] if one.rest is None}
    case = quantity.compared[0][0] if needed <= quantity.compared[0][0].keys() else {}
    return [
        at
        for point in points
        for at in [quantity.complete({**point, **case})]
        if not quantity.outside(at)
    ]


def _follow(every: Sequence[RunResults], quantity: Quantity) -> _KeyValue:
    """One result over the years."""
    points = _points(every, quantity)
    own = every[-1]
    at = next((at for at in points if own.state(quantity, at).uncertainty), points[0])
    values = tuple(
        (found.run, found.state(one, one.complete(at)))
        for found in every
        if (one := _alike(found, quantity)) is not None and not one.outside(one.complete(at))
    )
    newest = values[-1][1] if values else own.state(quantity, at)
    independent = independent_runs([run for run, _ in values])
    used = [
        (run, result)
        for run, result in values
        if result.uncertainty is not None and run.document["revision"] in independent
    ]
    limits = None if quantity.limit is None else quantity.limit.bounds(newest.value)
    line = change.trend(
        np.array([_year(run) for run, _ in used]),
        np.array([result.value for _, result in used]),
        np.array(
            [r.uncertainty.standard_uncertainty for _, r in used if r.uncertainty is not None]
        ),
    )
    reach = None
    if line is not None and limits is not None:
        years = [_year(run) for run, _ in used]
        reach = change.reach(line, max(years), max(years) - min(years), *limits)
    return _KeyValue(quantity, newest.at, values, limits, line, reach)


def tabulate(found: Sequence[_KeyValue]) -> Table | None:
    """A row for each key value: the newest, its slope a year, and when the limit will be
    reached; None where there is none.
    """
    rows = []
    for one in found:
        newest, unit = one.values[-1][1], unit_mark(one.quantity.unit)
        line = one.line
        slope = ""
        if line is not None:
            slope = _state(line.slope, line.coverage_factor * line.standard_uncertainty)
        last = _state(newest.value, newest.U)
        cells = (one.place, len(one.values), last, unit, slope, one.forecast)
        rows.append((one.quantity.words.en, *cells))
    heads = ("key value", "at", "runs", "last ± U", "unit", "a year ± U", "limit reached")
    return Table("key values", heads, tuple(rows)) if rows else None


def _state(value: float, U: float) -> str:
    """A value ± U as it is printed."""
    if not U > 0.0:
        return f"{value:.6g}"
    return " ± ".join(print_expanded(value, U))


def documents(found: Sequence[_KeyValue]) -> Iterator[dict[str, Any]]:
    """Each key value as a JSON object."""
    for one in found:
        yield {
            "quantity": one.quantity.key,
            "unit": one.quantity.unit,
            "at": {name: value for name, value, _ in one.at},
            "values": [
                {
                    "revision": run.document["revision"],
                    "effective_from": run.document["effective_from"],
                    "value": result.value,
                    "expanded_uncertainty": None
                    if result.uncertainty is None
                    else result.uncertainty.expanded_uncertainty,
                }
                for run, result in one.values
            ],
            "limits": None
            if one.limits is None
            else [end if np.isfinite(end) else None for end in one.limits],
            "limit_reached": one.forecast,
        }


def draw(serial: str, found: Sequence[_KeyValue]) -> Figure:
    """A panel for each key value over the years: values ± U, limits, the line ± U as far as it is
    extrapolated.
    """
    shown = found[:MOST_PANELS]
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)
    with styled():
        figure, axes = page(
            rows,
            columns,
            title=f"{serial}: key values over the years, ± U",
            height=0.8 + 2.9 * rows,
        )
        for ax, one in zip(axes, shown, strict=False):
            _panel(ax, one)
        for ax in axes[len(shown) :]:
            ax.set_visible(False)
    return figure


def _panel(ax: Axes, one: _KeyValue) -> None:
    """One key value."""
    for run, result in one.values:
        day = dt.date.fromisoformat(run.document["effective_from"]).toordinal()
        hollow = run.document["verdict"] == "rejected"
        ax.errorbar([day], [result.value], result.U, fmt="o", ms=4.5, capsize=3, color=DENOISED,
                    mfc="none" if hollow else DENOISED)  # fmt: skip
    if one.line is not None:
        until = one.reach.until if one.reach is not None else _year(one.values[-1][0])
        years = np.linspace(_year(one.values[0][0]), until, 60)
        y, U = np.array([one.line.expand(year) for year in years.tolist()]).T
        ax.plot(years * YEAR_DAYS, y, "--", color=MUTED, lw=1.0)
        ax.fill_between(years * YEAR_DAYS, y - U, y + U, color=MUTED, alpha=0.15, lw=0.0)
    for end in one.limits or ():
        if np.isfinite(end):
            ax.axhline(end, color=ALERT, lw=1.2, ls=":")
    low, high = ax.get_xlim()
    days = np.linspace(low, high, 4).astype(int).tolist()
    ax.set_xticks(days, [dt.date.fromordinal(day).isoformat()[:7] for day in days])
    ax.set_title(f"{one.quantity.words.en}{f' at {one.place}' if one.at else ''}", fontsize=9)
    ax.set_xlabel(f"limit reached: {one.forecast}", fontsize=8)
    ax.set_ylabel(f"[{unit_mark(one.quantity.unit) or 1}]")
