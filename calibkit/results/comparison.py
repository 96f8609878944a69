"""Is a device still good? Results of two runs over their common range: largest change, U of it,
limit, verdict.
"""

import fnmatch
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from calibkit import instruments, units
from calibkit.certificate.profile import Profile, Specification
from calibkit.certificate.quantities import At, Limit, Point, Quantity
from calibkit.certificate.results import Contribution, Result
from calibkit.check import copies
from calibkit.coefficients import Criterion
from calibkit.errors import UsageError, did_you_mean
from calibkit.history import difference
from calibkit.numeric import gum
from calibkit.numeric.change import Joint
from calibkit.report.run import stated_criteria
from calibkit.results.evaluation import RunResults
from calibkit.store import Run

Answer = Literal["yes", "no", "cannot tell"]
POINTS = 25
"""Points over the common range of the first input."""
STATED = ("quantity", "standard_uncertainty", "unit", "distribution", "dof")
"""What two runs state of a type B term of the same equipment."""
DRAWS = 4000
"""Draws of the coverage factor of the largest change."""


@dataclass(frozen=True, slots=True)
class Change:
    """A result at one point, then and now: the difference and its uncertainty (None: not known)."""

    at: At
    then: Result
    now: Result
    u: float | None
    expanded: float | None

    @property
    def difference(self) -> float:
        """Now less then."""
        return self.now.value - self.then.value


@dataclass(frozen=True, slots=True)
class Compared:
    """One result over the common range: its changes, the answer, and why."""

    quantity: Quantity
    changes: tuple[Change, ...]
    limit: Limit | None
    answer: Answer
    reason: str
    factor: float = math.nan
    """Standard uncertainties that the largest of all changes exceeds with 4.6 % where nothing
    changed.
    """

    @property
    def worst(self) -> Change | None:
        """Change that decides: nearest to the limit, or largest in its uncertainty."""
        if not self.changes:
            return None
        limit = self.limit
        if limit is not None and limit.change is None:
            return max(self.changes, key=lambda one: _reach(one.now, limit))
        if limit is not None:
            return max(self.changes, key=lambda one: abs(one.difference) + (one.expanded or 0.0))
        return max(self.changes, key=lambda one: abs(one.difference) / (one.u or math.inf))


@dataclass(frozen=True, slots=True)
class StillGood:
    """The answer on two runs, result by result; the joint test of each exported model; flags."""

    before: Run
    after: Run
    compared: tuple[Compared, ...]
    joints: tuple[tuple[str, int, Joint], ...]
    """Model, number of its coefficients, and their joint test."""
    rejected: tuple[Criterion, ...]
    """Limits that the newer run failed itself."""
    flags: tuple[str, ...]
    repeated: bool = False
    """Whether the newer run was fitted to logs of the older one alone: one determination, not two.
    """

    @property
    def answer(self) -> Answer:
        """No where any result has left its limit, else yes where all are known to be within."""
        answers = {one.answer for one in self.compared}
        if self.repeated:
            return "cannot tell"
        if "no" in answers or any(one.set_by == "recipe" for one in self.rejected):
            return "no"
        return "cannot tell" if self.rejected or answers != {"yes"} else "yes"

    @property
    def deciding(self) -> Compared | None:
        """Result that decides: of those with the answer, the one nearest to its limit."""
        alike = [one for one in self.compared if one.answer == self.answer]
        return max(alike or self.compared, key=nearness, default=None)


def nearness(one: Compared) -> float:
    """How near a result is to its limit, as a share of it; of one without a limit its largest
    change as a share of what chance makes.
    """
    worst = one.worst
    if worst is None or worst.expanded is None or worst.u is None:
        return math.inf
    if one.limit is not None and one.limit.change is not None:
        return (abs(worst.difference) + worst.expanded) / one.limit.change
    if one.limit is not None:
        return _reach(worst.now, one.limit)
    return abs(worst.difference) / (one.factor * worst.u) if worst.u > 0.0 else 0.0


def _reach(found: Result, limit: Limit) -> float:
    """How far a value ± U reaches beyond the middle between its limits, as a share of the half
    width; of one limit, the value + U over it.
    """
    U, (low, high) = found.U, limit.bounds(0.0)
    if not math.isfinite(low) or not math.isfinite(high):
        if math.isinf(low):
            return (found.value + U) / abs(high) if high else math.inf
        return abs(low) / abs(found.value - U) if found.value - U else math.inf
    return (abs(found.value - (low + high) / 2.0) + U) / ((high - low) / 2.0)


def compare(
    before: Run,
    after: Run,
    *,
    limits: Mapping[str, tuple[float, str]] = MappingProxyType({}),
    profile: Profile | None = None,
    same: bool = False,
) -> StillGood:
    """Whether what was calibrated is still good, by `limits` on changes in units of the results,
    else by the specifications of a laboratory's profile, else by the limits of the newer recipe.

    With `same`, type B terms that both runs state alike are one error of the same equipment.
    Raises UsageError for runs of different procedures and for a limit on what is not compared.
    """
    terms, specified = ((), ()) if profile is None else (profile.type_b, profile.specification)
    old, new = RunResults.read(before, terms), RunResults.read(after, terms)
    known = {name for one in new.quantities if one.compared for name in (one.key, one.name)}
    if unknown := [name for name in limits if name not in known]:
        raise UsageError(
            f"--limit {unknown[0]}: no result of {new.run.name} that is compared",
            hint=did_you_mean(unknown[0], known, f"there are: {', '.join(sorted(known))}"),
        )
    found = difference.compare_runs(before, after, instruments.model_forms)
    compared = tuple(_compare_all(old, new, limits, specified, same=same))
    inputs = after.document["inputs"]
    # models that a compared result is made of
    used = {
        model.name
        for one in compared
        for change in one.changes[:1]
        for model, _ in one.quantity.point(change.at).parts
    }
    joints = [(one.name, len(one.changes), one.joint) for one in found.models if one.name in used]
    return StillGood(
        before,
        after,
        compared,
        tuple((name, count, joint) for name, count, joint in joints if joint is not None),
        tuple(criterion for criterion in stated_criteria(after.document) if not criterion.passed),
        (*found.flags, *_flag(found, compared, specified, same=same)),
        len(copies.shared_logs(inputs, before.document["inputs"])) == len(inputs),
    )


def _compare_all(
    old: RunResults,
    new: RunResults,
    limits: Mapping[str, tuple[float, str]],
    specified: Sequence[Specification],
    *,
    same: bool,
) -> Iterator[Compared]:
    """Every result that either run compares."""
    pairs = {(one.model, one.name): one for one in old.quantities if one.compared}
    for quantity in (one for one in new.quantities if one.compared):
        earlier = pairs.pop((quantity.model, quantity.name), None)
        yield _compare(_limited(quantity, limits, specified), earlier, old, new, same=same)
    for quantity in pairs.values():
        reason = f"{new.run.name} has no such result"
        yield Compared(quantity, (), quantity.limit, "cannot tell", reason)


def _limited(
    quantity: Quantity,
    limits: Mapping[str, tuple[float, str]],
    specified: Sequence[Specification],
) -> Quantity:
    """Quantity with the limit that a command states on its changes, in its unit or as a share of
    its value, or a profile on its values; RecipeError for a unit of another kind.
    """
    value, unit = limits.get(quantity.key, limits.get(quantity.name, (math.nan, "")))
    for one in specified if math.isnan(value) else ():
        if _specifies(one, quantity):
            limit = Limit(f"specification {one.name}".strip(), None, one.lower, one.upper)
            return replace(quantity, limit=limit)
    if math.isnan(value):
        return quantity
    if unit in units.SHARES:
        somewhere = {one.column: one.low for one in quantity.inputs}
        value *= units.SHARES[unit] * abs(quantity.point(somewhere).value)
    elif unit:
        value *= units.difference_factor(unit, quantity.unit)
    return replace(quantity, limit=Limit("--limit", value))


def _specifies(one: Specification, quantity: Quantity) -> bool:
    """Whether a specification is on a result over its whole range."""
    name, _, condition = one.result.partition("@")
    keys = (quantity.key, *(f"{quantity.stage}.{called}" for called in quantity.called))
    named = any(fnmatch.fnmatchcase(key, name) for key in (*keys, *quantity.called))
    unit = units.ALIASES.get(one.unit, one.unit)
    return named and condition in ("", "*") and unit == quantity.unit


def _flag(
    found: difference.Difference,
    compared: Sequence[Compared],
    specified: Sequence[Specification],
    *,
    same: bool,
) -> Iterator[str]:
    """Models of two forms, of which the results alone were compared; type B terms that both runs
    state; specifications that judge nothing here.
    """
    for model in found.models:
        if any(" became " in note and note.startswith("form") for note in model.notes):
            yield f"{model.name}: another model form, compared by its result"
    names = {
        now.name.en
        for one in compared
        for at in one.changes[:1]
        for now in contributions(at.now)
        if now.kind == "B" and any(map(now.__eq__, contributions(at.then)))
    }
    if names and not same:
        yield (
            f"{', '.join(sorted(names))}: stated by both runs and counted twice; of the same"
            " equipment, --same-equipment counts what differs"
        )
    for one in specified:
        if not any(_specifies(one, each.quantity) for each in compared):
            yield (
                f"specification '{one.name or one.result}' is not judged: it names no result over"
                " its whole range"
            )


def _compare(
    quantity: Quantity, earlier: Quantity | None, old: RunResults, new: RunResults, *, same: bool
) -> Compared:
    """One result in two runs."""

    def unknown(reason: str, changes: tuple[Change, ...] = ()) -> Compared:
        return Compared(quantity, changes, quantity.limit, "cannot tell", reason)

    if earlier is None:
        return unknown(f"{old.run.name} has no such result")
    if earlier.unit != quantity.unit:
        return unknown(f"in {earlier.unit} then, in {quantity.unit} now")
    if [one.column for one in earlier.inputs[:1]] != [one.column for one in quantity.inputs[:1]]:
        depends = " and ".join(
            "nothing" if not one.inputs else one.inputs[0].column for one in (earlier, quantity)
        )
        return unknown(f"depends on {depends}: the range of one of the two is not known")
    changes = tuple(_changes(quantity, earlier, old, new, same=same))
    if not changes:
        return unknown("the two calibrated ranges have nothing in common")
    undecided = earlier.undecided or quantity.undecided
    reason = "" if undecided is None else undecided.en
    if any(one.u is None for one in changes):
        reason = "an uncertainty is not known"
    if reason:
        return unknown(reason, changes)
    limit = quantity.limit or earlier.limit
    factor = factor_of_largest(quantity, earlier, changes)
    made = Compared(quantity, changes, limit, "cannot tell", "", factor)
    answer, reason = _judge(made)
    return replace(made, answer=answer, reason=reason)


def _places(quantity: Quantity, earlier: Quantity) -> Iterator[At]:
    """Points at which both hold: over the common range of the first input, at each group's first
    case of the other inputs that both hold at.
    """
    grid: Sequence[At] = ({},)
    if quantity.inputs:
        one, other = quantity.inputs[0], earlier.inputs[0]
        ends = max(one.low, other.low), min(one.high, other.high)
        if not ends[0] <= ends[1]:
            return
        values = np.linspace(*ends, POINTS if ends[0] < ends[1] else 1).tolist()
        grid = tuple({one.column: x} for x in values)
    alike = {i.column for i in quantity.inputs} == {i.column for i in earlier.inputs}
    for group in quantity.compared:
        for case in group if alike else (group[0],) * (not group[0]):
            held = [
                at
                for at in (quantity.complete({**point, **case}) for point in grid)
                if not quantity.outside(at) and not earlier.outside(earlier.complete(at))
            ]
            if held:
                yield from held
                break


def _changes(
    quantity: Quantity, earlier: Quantity, old: RunResults, new: RunResults, *, same: bool
) -> Iterator[Change]:
    """The changes of a result; a point where it is 0 by definition is left out."""
    for at in _places(quantity, earlier):
        then, now = old.state(earlier, earlier.complete(at)), new.state(quantity, at)
        if then.value == now.value == 0.0 and then.uncertainty is now.uncertainty is None:
            continue
        if then.uncertainty is None or now.uncertainty is None:
            yield Change(at, then, now, None, None)
            continue
        expanded = gum.combine(list(combine_both(then, now, same=same)))
        yield Change(at, then, now, expanded.standard_uncertainty, expanded.expanded_uncertainty)


def _judge(made: Compared) -> tuple[Answer, str]:
    """Answer and its reason."""
    limit, worst = made.limit, made.worst
    if limit is None:
        u = worst.u if worst is not None and worst.u else 0.0
        if worst is not None and abs(worst.difference) > made.factor * u:
            return "no", "no limit is set, and it changed by more than its U"
        return "yes", "no limit is set, and it did not change beyond its U"
    low, high = limit.bounds(0.0)
    if limit.change is not None:
        what = "change"
        found = [(one.difference, one.expanded or 0.0) for one in made.changes]
    else:
        what = "value"
        found = [(one.now.value, one.now.U) for one in made.changes if one.now.uncertainty]
    if all(low <= value - U and value + U <= high for value, U in found):
        return "yes", f"{what} ± U within the limit"
    if any(value + U < low or value - U > high for value, U in found):
        return "no", f"{what} beyond the limit by more than U"
    return "cannot tell", "U reaches across the limit"


def contributions(found: Result) -> tuple[Contribution, ...]:
    """Contributions to the uncertainty of a result."""
    return () if found.uncertainty is None else found.uncertainty.contributions


def combine_both(then: Result, now: Result, *, same: bool) -> Iterator[gum.Component]:
    """Contributions to the uncertainty of the difference: of both runs as independent; type B terms
    that they state alike once, by the difference of their sensitivities, where the equipment is
    the same.
    """
    shared = {one.name.en: one for one in contributions(then) if one.kind == "B"}
    for part in contributions(now):
        other = shared.get(part.name.en)
        alike = (
            same
            and other is not None
            and all(getattr(part, fact) == getattr(other, fact) for fact in STATED)
        )
        taken = shared.pop(part.name.en).sensitivity if alike else 0.0
        yield _component(part, part.sensitivity - taken)
    for part in contributions(then):
        if part.kind == "A" or part.name.en in shared:
            yield _component(part, part.sensitivity)


def _component(part: Contribution, sensitivity: float) -> gum.Component:
    """A contribution as an independent input."""
    return gum.Component(
        part.name.en,
        0.0,
        part.standard_uncertainty,
        "A" if part.kind == "A" else "B",
        sensitivity,
        part.dof,
    )


def factor_of_largest(quantity: Quantity, earlier: Quantity, changes: Sequence[Change]) -> float:
    """Coverage factor of the largest of several changes, by simulation: what errors of the
    coefficients and type B terms have in common from point to point counts once, model errors are
    taken as independent.
    """
    loadings = [
        _load(earlier.point(earlier.complete(one.at)), one.then, "then")
        | _load(quantity.point(one.at), one.now, "now")
        for one in changes
    ]
    keys = list(dict.fromkeys(key for row in loadings for key in row))
    matrix = np.array([[row.get(key, 0.0) for key in keys] for row in loadings])
    own = np.array([sum(u**2 for u in _further(quantity, earlier, one)) for one in changes])
    size = np.sqrt((matrix**2).sum(axis=1) + own)
    held = size > 0.0
    draw = np.random.default_rng(0).standard_normal
    z = draw((DRAWS, len(keys))) @ (matrix[held] / size[held, None]).T
    z += draw(z.shape) * np.sqrt(own[held]) / size[held]
    widest = max((one.expanded or 0.0) / one.u for one in changes if one.u)
    largest = np.abs(z).max(axis=1)
    return float(np.quantile(largest, gum.TWO_SIGMA)) * max(widest / 2.0, 1.0)


def _load(point: Point, found: Result, when: str) -> dict[tuple[str, str, int], float]:
    """Change of a result by one standard uncertainty of each independent direction of its
    coefficients, and of each type B term.
    """
    made: dict[tuple[str, str, int], float] = {}
    for model, weights in point.parts:
        along = gum.square_root(np.array(model.covariance)).T @ weights
        made |= {(when, model.name, k): float(x) for k, x in enumerate(along)}
    for part in contributions(found):
        if part.kind == "B":
            made[when, part.name.en, -1] = part.sensitivity * part.standard_uncertainty
    return made


def _further(quantity: Quantity, earlier: Quantity, one: Change) -> Iterator[float]:
    """Uncertainties of both results that belong to no coefficient."""
    points = quantity.point(one.at), earlier.point(earlier.complete(one.at))
    yield from (u for point in points for _, u, _ in point.more)
