"""Is a device still good? Results of two runs over their common range: largest change, U of it,
limit, verdict.

A change d = y(now) - y(then) has u² = Σ (c_i u_i)² over the contributions of both results, each an
error of its own but for what the same equipment does to both (JCGM 100 eq. 10). With U = k u, a
result is still good where [d - U, d + U] (of a limit on values: [y - U, y + U]) is within its
limit, no longer good where it is beyond, and else nobody can tell.
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
from calibkit.certificate.quantities import At, Quantity, ResultLimit
from calibkit.certificate.results import Result
from calibkit.check import copies
from calibkit.errors import UsageError, did_you_mean
from calibkit.history import difference
from calibkit.numeric import gum
from calibkit.records.coefficients import Criterion
from calibkit.records.store import StoredRun
from calibkit.report.run import stated_criteria
from calibkit.results.evaluation import RunResults

Answer = Literal["yes", "no", "cannot tell"]
POINTS = 25
"""Points over the common range of the first input."""
STATED = ("quantity", "standard_uncertainty", "unit", "distribution", "dof")
"""What two runs state of a type B term of the same equipment."""
DRAWS = 4000
"""Draws of the coverage factor of the largest change."""


@dataclass(frozen=True, slots=True)
class ResultChange:
    """A result at one point, then and now: the difference and its uncertainty (None: not known)."""

    point: At
    then: Result
    now: Result
    u: float | None
    expanded: float | None

    @property
    def difference(self) -> float:
        """Now less then."""
        return self.now.value - self.then.value

    def nearness(self, limit: ResultLimit | None) -> float:
        """How near it is to a limit, 1 at the limit: |d| + U over a largest change, |y - middle| +
        U over half the width between two limits, y + U over a single one; |d|/u without a limit.
        """
        if limit is None:
            return abs(self.difference) / self.u if self.u else 0.0
        if limit.change is not None:
            return (abs(self.difference) + (self.expanded or 0.0)) / limit.change
        value, U, (low, high) = self.now.value, self.now.U, limit.bounds(0.0)
        if math.isinf(low):
            return (value + U) / abs(high) if high else math.inf
        if math.isinf(high):
            return abs(low) / abs(value - U) if value - U else math.inf
        return (abs(value - (low + high) / 2.0) + U) / ((high - low) / 2.0)


@dataclass(frozen=True, slots=True)
class ComparedResult:
    """One result over the common range: its changes, the answer, and why."""

    quantity: Quantity
    changes: tuple[ResultChange, ...]
    answer: Answer
    reason: str
    factor: float = math.nan
    """Standard uncertainties that the largest of all changes exceeds with 4.6 % where nothing
    changed.
    """

    @property
    def limit(self) -> ResultLimit | None:
        """What the result is judged by."""
        return self.quantity.limit

    @property
    def worst(self) -> ResultChange | None:
        """Change that decides: nearest to the limit, or largest in its uncertainty."""
        return max(self.changes, key=lambda change: change.nearness(self.limit), default=None)

    @property
    def nearness(self) -> float:
        """How near the result is to its limit, as a share of it; of one without a limit its largest
        change as a share of what chance makes.
        """
        worst = self.worst
        if worst is None or worst.expanded is None:
            return math.inf
        return worst.nearness(self.limit) / (self.factor if self.limit is None else 1.0)


@dataclass(frozen=True, slots=True)
class StillGood:
    """The answer on two runs, result by result, and what else changed between them."""

    before: StoredRun
    after: StoredRun
    compared: tuple[ComparedResult, ...]
    changed: difference.Difference
    """Coefficients, recipe, logs, files and flags that differ."""
    rejected: tuple[Criterion, ...]
    """Limits that the newer run failed itself."""
    flags: tuple[str, ...]
    repeated: bool = False
    """Whether the newer run was fitted to logs of the older one alone: one determination, not two.
    """

    @property
    def answer(self) -> Answer:
        """No where any result has left its limit, else yes where all are known to be within."""
        answers = {compared.answer for compared in self.compared}
        if self.repeated:
            return "cannot tell"
        if "no" in answers or any(criterion.set_by == "recipe" for criterion in self.rejected):
            return "no"
        return "cannot tell" if self.rejected or answers != {"yes"} else "yes"

    @property
    def deciding(self) -> ComparedResult | None:
        """Result that decides: of those with the answer, the one nearest to its limit."""
        with_this_answer = [
            compared for compared in self.compared if compared.answer == self.answer
        ]
        return max(
            with_this_answer or self.compared, key=lambda compared: compared.nearness, default=None
        )


def compare(
    before: StoredRun,
    after: StoredRun,
    *,
    limits: Mapping[str, tuple[float, str]] = MappingProxyType({}),
    profile: Profile | None = None,
    same_equipment: bool = False,
) -> StillGood:
    """Whether what was calibrated is still good, by `limits` on changes in units of the results,
    else by the specifications of a laboratory's profile, else by the limits of the newer recipe.

    With `same_equipment`, type B terms that both runs state alike are one error.
    Raises UsageError for runs of different procedures and for a limit on what is not compared.
    """
    terms, specified = ((), ()) if profile is None else (profile.type_b, profile.specification)
    old, new = RunResults.read(before, terms), RunResults.read(after, terms)
    compared_quantities = [quantity for quantity in new.quantities if quantity.compared]
    result_names = {
        name for quantity in compared_quantities for name in (quantity.key, quantity.name)
    }
    if unknown := [name for name in limits if name not in result_names]:
        raise UsageError(
            f"--limit {unknown[0]}: no result of {after.name} that is compared",
            hint=did_you_mean(
                unknown[0], result_names, f"there are: {', '.join(sorted(result_names))}"
            ),
        )
    changed = difference.compare_runs(before, after, instruments.model_forms)
    earlier = {
        (old_quantity.model, old_quantity.name): old_quantity
        for old_quantity in old.quantities
        if old_quantity.compared
    }
    compared = []
    for quantity in compared_quantities:
        other = earlier.pop((quantity.model, quantity.name), None)
        limited = _limited(quantity, limits, specified)
        compared.append(_compare(limited, other, old, new, same_equipment=same_equipment))
    no_such = f"{after.name} has no such result"
    compared += [ComparedResult(q, (), "cannot tell", no_such) for q in earlier.values()]
    inputs = after.document["inputs"]
    return StillGood(
        before,
        after,
        tuple(compared),
        changed,
        tuple(criterion for criterion in stated_criteria(after.document) if not criterion.passed),
        (*changed.flags, *_flag(changed, compared, specified, same_equipment=same_equipment)),
        len(copies.shared_logs(inputs, before.document["inputs"])) == len(inputs),
    )


def _limited(
    quantity: Quantity,
    limits: Mapping[str, tuple[float, str]],
    specified: Sequence[Specification],
) -> Quantity:
    """Quantity with the limit that a command states on its changes, in its unit or as a share of
    its value, or a profile on its values; RecipeError for a unit of another kind.
    """
    value, unit = limits.get(quantity.key, limits.get(quantity.name, (math.nan, "")))
    if math.isnan(value):
        for specification in specified:
            if _specifies(specification, quantity):
                name = f"specification {specification.name}".strip()
                return replace(
                    quantity,
                    limit=ResultLimit(name, None, specification.lower, specification.upper),
                )
        return quantity
    if unit in units.SHARES:
        low_ends = {i.column: i.low for i in quantity.inputs}
        value *= units.SHARES[unit] * abs(quantity.point(low_ends).value)
    elif unit:
        value *= units.difference_factor(unit, quantity.unit)
    return replace(quantity, limit=ResultLimit("--limit", value))


def _specifies(specification: Specification, quantity: Quantity) -> bool:
    """Whether a specification is on a result over its whole range."""
    name, _, condition = specification.result.partition("@")
    keys = (quantity.key, *(f"{quantity.stage}.{alias}" for alias in quantity.called))
    name_matches = any(fnmatch.fnmatchcase(key, name) for key in (*keys, *quantity.called))
    unit = units.ALIASES.get(specification.unit, specification.unit)
    return name_matches and condition in ("", "*") and unit == quantity.unit


def _flag(
    changed: difference.Difference,
    compared: Sequence[ComparedResult],
    specified: Sequence[Specification],
    *,
    same_equipment: bool,
) -> Iterator[str]:
    """Models of two forms, of which the results alone were compared; type B terms that both runs
    state; specifications that judge nothing here.
    """
    for fact in changed.notes:
        if fact.note.startswith("form "):
            model = fact.what.partition(".")[2]
            yield f"{model}: another model form, compared by its result"
    names = set()
    for result in compared:
        for change in result.changes[:1]:
            earlier_contributions = change.then.contributions
            of_both = [part for part in change.now.contributions if part in earlier_contributions]
            names |= {part.name.en for part in of_both if part.kind == "B"}
    if names and not same_equipment:
        yield (
            f"{', '.join(sorted(names))}: stated by both runs and counted twice; of the same"
            " equipment, --same-equipment counts what differs"
        )
    for specification in specified:
        if not any(_specifies(specification, result.quantity) for result in compared):
            yield (
                f"specification '{specification.name or specification.result}' is not judged:"
                " it names no result over its whole range"
            )


def _compare(
    quantity: Quantity,
    earlier: Quantity | None,
    old: RunResults,
    new: RunResults,
    *,
    same_equipment: bool,
) -> ComparedResult:
    """One result in two runs; its limit is the newer run's, else the older one's."""
    if earlier is None:
        reason = f"{old.run.name} has no such result"
        return ComparedResult(quantity, (), "cannot tell", reason)
    quantity = replace(quantity, limit=quantity.limit or earlier.limit)
    columns = [next((i.column for i in q.inputs), "nothing") for q in (earlier, quantity)]
    changes, reason = tuple[ResultChange, ...](), ""
    if earlier.unit != quantity.unit:
        reason = f"in {earlier.unit} then, in {quantity.unit} now"
    elif columns[0] != columns[1]:
        reason = f"depends on {' and '.join(columns)}: the range of one of the two is not known"
    else:
        changes = tuple(_changes(quantity, earlier, old, new, same_equipment=same_equipment))
        stated = [run for change in changes for run in (change.then, change.now)]
        undecided = next((result.undecided for result in stated if result.undecided), None)
        if not changes:
            reason = "the two calibrated ranges have nothing in common"
        elif any(change.u is None for change in changes):
            reason = "an uncertainty is not known"
        elif undecided is not None:
            reason = undecided.en
    compared = ComparedResult(quantity, changes, "cannot tell", reason)
    if reason:
        return compared
    factor = factor_of_largest(quantity, earlier, changes)
    answer, reason = _judge(replace(compared, factor=factor))
    return replace(compared, factor=factor, answer=answer, reason=reason)


def _judge(compared: ComparedResult) -> tuple[Answer, str]:
    """Answer and its reason."""
    limit, changes = compared.limit, compared.changes
    if limit is None:
        if compared.nearness > 1.0:
            return (
                "no",
                "more than chance gives an unchanged device; you set no limit",
            )
        return (
            "yes",
            "no more than chance gives an unchanged device; you set no limit",
        )
    limited_value, estimates = "value", [(c.now.value, c.now.U) for c in changes]
    if limit.change is not None:
        limited_value, estimates = "change", [(c.difference, c.expanded or 0.0) for c in changes]
    low, high = limit.bounds(0.0)
    if all(low <= value - U and value + U <= high for value, U in estimates):
        return "yes", f"{limited_value} ± U within the limit"
    if any(value + U < low or value - U > high for value, U in estimates):
        return "no", f"{limited_value} beyond the limit by more than U"
    return "cannot tell", "U reaches across the limit"


def _changes(
    quantity: Quantity, earlier: Quantity, old: RunResults, new: RunResults, *, same_equipment: bool
) -> list[ResultChange]:
    """Changes of a result where both hold: over the common range of the first input, at each
    group's first case of the other inputs that both hold at. A point where it is 0 by definition is
    left out.
    """
    grid: Sequence[At] = ({},)
    if quantity.inputs:
        first, other = quantity.inputs[0], earlier.inputs[0]
        low, high = max(first.low, other.low), min(first.high, other.high)
        if not low <= high:
            return []
        values = np.linspace(low, high, POINTS if low < high else 1).tolist()
        grid = tuple({first.column: x} for x in values)
    same_inputs = {i.column for i in quantity.inputs} == {i.column for i in earlier.inputs}
    common_points = list[At]()
    for group in quantity.compared:
        for case in group if same_inputs else (group[0],) * (not group[0]):
            inside = [
                full_point
                for full_point in (quantity.complete({**point, **case}) for point in grid)
                if not quantity.outside(full_point)
                and not earlier.outside(earlier.complete(full_point))
            ]
            if inside:
                common_points += inside
                break
    changes = []
    for full_point in common_points:
        then, now = (
            old.state(earlier, earlier.complete(full_point)),
            new.state(quantity, full_point),
        )
        u = expanded = None
        if then.uncertainty is not None and now.uncertainty is not None:
            of_change = gum.combine(combine_both(then, now, same_equipment=same_equipment))
            u, expanded = of_change.standard_uncertainty, of_change.expanded_uncertainty
        elif then.value == now.value == 0.0 and then.uncertainty is now.uncertainty:
            continue
        changes.append(ResultChange(full_point, then, now, u, expanded))
    return changes


def combine_both(
    result_then: Result, result_now: Result, *, same_equipment: bool
) -> list[gum.UncertaintyComponent]:
    """Contributions to the uncertainty of the difference: of both runs as independent; type B terms
    that they state alike once, by the difference of their sensitivities, where the equipment is
    the same.
    """
    of_then = {part.name.en: part for part in result_then.contributions if part.kind == "B"}
    independent = []
    for part in result_now.contributions:
        other = of_then.get(part.name.en)
        sensitivity = part.sensitivity
        if (
            same_equipment
            and other
            and all(getattr(part, key) == getattr(other, key) for key in STATED)
        ):
            sensitivity -= of_then.pop(part.name.en).sensitivity
        independent.append(replace(part, sensitivity=sensitivity))
    independent += (p for p in result_then.contributions if p.kind == "A" or p.name.en in of_then)
    return [part.component for part in independent]


def factor_of_largest(
    quantity: Quantity, earlier: Quantity, changes: Sequence[ResultChange]
) -> float:
    """Coverage factor of the largest of several changes, by simulation of z = (A e + b)/u.

    Errors e of coefficients and type B terms, which changes at several points share, enter through
    A; model errors, which each point has alone, through b.
    """
    loadings: list[dict[tuple[str, str, int], float]] = []
    model_variance = np.zeros(len(changes))
    for k, change in enumerate(changes):
        loading: dict[tuple[str, str, int], float] = {}
        evaluated_then = earlier.point(earlier.complete(change.point)), change.then
        evaluated_now = quantity.point(change.point), change.now
        # then and now have errors of their own, models of one name included
        for run_age, (point, result) in (("then", evaluated_then), ("now", evaluated_now)):
            for model, weights in point.parts:
                # one standard uncertainty of each independent direction of the coefficients
                coefficient_loadings = gum.square_root(np.array(model.covariance)).T @ weights
                loading |= {
                    (run_age, model.name, j): float(x) for j, x in enumerate(coefficient_loadings)
                }
            for part in result.contributions:
                if part.kind == "B":
                    loading[run_age, part.name.en, -1] = (
                        part.sensitivity * part.standard_uncertainty
                    )
            model_variance[k] += sum(u**2 for _, u, _ in point.more)
        loadings.append(loading)
    keys = list(dict.fromkeys(key for loading in loadings for key in loading))
    A = np.array([[loading.get(key, 0.0) for key in keys] for loading in loadings])
    u = np.sqrt((A**2).sum(axis=1) + model_variance)
    uncertain = u > 0.0
    draw = np.random.default_rng(0).standard_normal
    z = draw((DRAWS, len(keys))) @ (A[uncertain] / u[uncertain, None]).T
    z += draw(z.shape) * np.sqrt(model_variance[uncertain]) / u[uncertain]
    largest = float(np.quantile(np.abs(z).max(axis=1), gum.TWO_SIGMA))
    # few degrees of freedom widen all changes: U over 2 u of the widest
    widest = max((change.expanded or 0.0) / change.u for change in changes if change.u)
    return largest * max(widest / 2.0, 1.0)
