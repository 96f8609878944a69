"""All revisions of one serial: which is in force when, whether each supersedes the one before, how
its numbers moved.
"""

import datetime as dt
import fnmatch
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from calibkit import store
from calibkit.check import copies
from calibkit.coefficients import Coefficient, Record
from calibkit.errors import CoefficientError, UsageError
from calibkit.forms import Form, FormsOf
from calibkit.history import difference
from calibkit.history.difference import Change
from calibkit.numeric import change
from calibkit.numeric.change import Trend
from calibkit.store import StoredRun

YEAR_DAYS = 365.25


@dataclass(frozen=True, slots=True)
class _Refused:
    """A revision that cannot be trusted, and why."""

    revision: int
    reason: str


@dataclass(frozen=True, slots=True)
class _InForce:
    """From when and, where another takes over, up to which date (exclusive) a revision is in force;
    empty: never.
    """

    since: str
    until: str


@dataclass(frozen=True, slots=True)
class Determination:
    """One determination of a number."""

    revision: int
    effective_from: str
    value: float
    standard_uncertainty: float
    effective_dof: float | None
    """Degrees of freedom of the standard uncertainty; None where they are not stated."""
    verdict: str


@dataclass(frozen=True, slots=True)
class FollowedNumber:
    """A coefficient or figure that revisions share; `meaning` holds the chosen parameters that say
    what it is.
    """

    stage: str
    model: str
    form: str
    meaning: str
    name: str
    unit: str

    @property
    def label(self) -> str:
        """stage.model.name."""
        return ".".join(filter(None, (self.stage, self.model, self.name)))


@dataclass(frozen=True, slots=True)
class NumberSeries:
    """One quantity over the revisions that determined it, in the order of their dates: first to
    last, neighbours, years.
    """

    quantity: FollowedNumber
    points: tuple[Determination, ...]
    overall: Change
    largest_step: float
    """Largest change between neighbours in time, in standard uncertainties of that difference."""
    trend: Trend | None


@dataclass(frozen=True, slots=True)
class Timeline:
    """Every revision of a serial, the faults of its chain, and its numbers over time."""

    serial: str
    runs: tuple[StoredRun, ...]
    in_force: Mapping[int, _InForce]
    refused: tuple[_Refused, ...]
    breaks: tuple[str, ...]
    flags: tuple[str, ...]
    series: tuple[NumberSeries, ...]

    @property
    def sound(self) -> bool:
        """Whether every revision could be read and supersedes the one before."""
        return not self.refused and not self.breaks

    @classmethod
    def read(cls, serial: str, runs_folder: Path, forms_of: FormsOf, pattern: str = "") -> Self:
        """Timeline of a serial under a folder of runs; UsageError where there is none, or no number
        matches the pattern.

        Without a pattern the coefficients of models are followed; with one, every coefficient and
        figure whose stage.model.name matches it.
        """
        numbers = store.revisions(runs_folder / store.check_serial(serial))
        if not numbers:
            raise UsageError(
                f"serial '{serial}': no run under {runs_folder}",
                hint="give --runs, or fit it first",
            )
        runs, refused = [], []
        for number in numbers:
            try:
                runs.append(store.load_revision(runs_folder, serial, number))
            except CoefficientError as error:
                refused.append(_Refused(number, str(error)))
        series = tuple(
            entry
            for entry in _series(runs, forms_of)
            if (
                fnmatch.fnmatchcase(entry.quantity.label, pattern)
                if pattern
                else bool(entry.quantity.form)
            )
        )
        if runs and not series and pattern:
            raise UsageError(
                f"--only {pattern}: no coefficient or figure of {serial} matches",
                hint="try --only '*'",
            )
        return cls(
            serial,
            tuple(runs),
            _dates_in_force(runs),
            tuple(refused),
            tuple(_chain_faults(runs, numbers)),
            _flags(runs),
            series,
        )


def _chain_faults(runs: Sequence[StoredRun], numbers: Sequence[int]) -> Iterator[str]:
    """One line per fault of the chain: a revision that is missing, a file that does not supersede
    the one before it.
    """
    for number in sorted(set(range(1, numbers[-1] + 1)) - set(numbers)):
        yield f"r{number:03d} is missing"
    readable = {run.document["revision"]: run for run in runs}
    for run in runs:
        number = run.document["revision"]
        if number > 1 and number - 1 not in readable:
            yield (
                f"r{number:03d}: what it supersedes cannot be checked, r{number - 1:03d} is not"
                " here or not readable"
            )
            continue
        before = readable[number - 1].stage_digests() if number > 1 else {}
        for record in run.records.values():
            expected = before.get(record.stage, "")
            if record.supersedes != expected:
                yield _state_break(number, record, expected)


def _state_break(number: int, record: Record, expected: str) -> str:
    """One file that does not supersede the one before it."""
    superseded = f"{record.supersedes[:12]}…" if record.supersedes else "nothing"
    required = (
        f"{expected[:12]}… of r{number - 1:03d}"
        if expected
        else f"nothing: r{number - 1:03d} has no such stage"
    )
    return f"r{number:03d}: {record.stage} supersedes {superseded}, expected {required}"


def _dates_in_force(runs: Sequence[StoredRun]) -> dict[int, _InForce]:
    """Revision → dates between which it is in force."""
    winners = store.in_force([run.document for run in runs])
    until = dict(itertools.pairwise([*sorted(winners), ""]))
    periods = {revision: _InForce(date, until[date]) for date, revision in winners.items()}
    return {
        run.document["revision"]: periods.get(run.document["revision"], _InForce("", ""))
        for run in runs
    }


def _flags(runs: Sequence[StoredRun]) -> tuple[str, ...]:
    """What a reader of a timeline must know."""
    flags = [
        f"{run.name} was rejected: it is never in force by date"
        for run in runs
        if run.document["verdict"] == "rejected"
    ]
    for older, newer in itertools.pairwise(runs):
        dates = older.document["effective_from"], newer.document["effective_from"]
        if dates[1] < dates[0]:
            flags.append(
                f"{newer.name} holds from {dates[1]}, before {older.name} which it supersedes holds"
                f" ({dates[0]}): by date {older.name} stays in force from {dates[0]}"
            )
    flags += [
        f"{newer.name} was fitted to logs of {older.name} as well: one determination, not two;"
        " slopes take the newer"
        for k, newer in enumerate(runs)
        for older in runs[:k]
        if copies.shared_logs(older.document["inputs"], newer.document["inputs"])
    ]
    procedures = dict.fromkeys(run.document["procedure"] for run in runs)
    if len(procedures) > 1:
        flags.append(f"revisions of different procedures: {', '.join(procedures)}")
    return tuple(flags)


def independent_runs(runs: Sequence[StoredRun]) -> set[int]:
    """Revisions that were not rejected and share no log with a newer one of them."""
    newer_inputs: list[Mapping[str, object]] = []
    independent = set()
    for run in sorted(runs, key=lambda run: -int(run.document["revision"])):
        usable = run.document["verdict"] != "rejected"
        if usable and not copies.shared_logs(run.document["inputs"], newer_inputs):
            independent.add(int(run.document["revision"]))
            newer_inputs += run.document["inputs"]
    return independent


def _series(runs: Sequence[StoredRun], forms_of: FormsOf) -> Iterator[NumberSeries]:
    """Quantities with an uncertainty that two runs or more determined, alike in form, unit and
    meaning.
    """
    points: dict[FollowedNumber, list[Determination]] = {}
    for run in sorted(
        runs, key=lambda run: (run.document["effective_from"], run.document["revision"])
    ):
        revision_and_date = (run.document["revision"], run.document["effective_from"])
        for quantity, number in _numbers(run, forms_of(run.document["procedure"])):
            if number.standard_uncertainty > 0.0:
                verdict = run.document["verdict"]
                u, dof = number.standard_uncertainty, number.effective_dof
                point = Determination(*revision_and_date, number.value, u, dof, verdict)
                points.setdefault(quantity, []).append(point)
    independent = independent_runs(runs)
    for quantity, determinations in points.items():
        if len(determinations) > 1:
            yield _one_series(quantity, tuple(determinations), independent)


def _numbers(
    run: StoredRun, forms: Mapping[str, Form]
) -> Iterator[tuple[FollowedNumber, Coefficient]]:
    """Every coefficient and figure of a run that belongs to the instrument and not to one log."""
    for record in run.records.values():
        for model in record.models:
            form = forms.get(model.form)
            if form is not None and form.per_log:
                continue
            names = form.meaning if form is not None else ()
            meaning = ", ".join(
                f"{p.name} {p.value:g} {p.unit}" for p in model.parameters if p.name in names
            )
            for c in difference.with_dof(model):
                yield (
                    FollowedNumber(record.stage, model.name, model.form, meaning, c.name, c.unit),
                    c,
                )
        for figure in record.figures:
            yield FollowedNumber(record.stage, "", "", "", figure.name, figure.unit), figure


def _one_series(
    quantity: FollowedNumber, points: tuple[Determination, ...], independent: set[int]
) -> NumberSeries:
    """A series with its change from first to last, its largest step and its straight line over
    years.
    """
    steps = [_change(quantity, a, b).in_u for a, b in itertools.pairwise(points)]
    independent_points = [point for point in points if point.revision in independent]
    years = np.array(
        [
            dt.date.fromisoformat(point.effective_from).toordinal() / YEAR_DAYS
            for point in independent_points
        ]
    )
    values = np.array([point.value for point in independent_points])
    return NumberSeries(
        quantity,
        points,
        _change(quantity, points[0], points[-1]),
        max(map(abs, steps)),
        change.trend(
            years, values, np.array([point.standard_uncertainty for point in independent_points])
        ),
    )


def _change(quantity: FollowedNumber, a: Determination, b: Determination) -> Change:
    """Change from one determination to another."""
    old, new = (
        Coefficient(
            quantity.name,
            point.value,
            quantity.unit,
            point.standard_uncertainty,
            point.effective_dof,
        )
        for point in (a, b)
    )
    return difference.compare_numbers((old,), (new,))[0]
