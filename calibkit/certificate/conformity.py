"""Statements of conformity: a result, its limits, the decision rule, and what follows (JCGM 106,
ILAC G8).
"""

import difflib
import fnmatch
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from calibkit.certificate.profile import Rule, Specification
from calibkit.certificate.results import Result
from calibkit.certificate.words import Words
from calibkit.errors import RecipeError
from calibkit.units import ALIASES

Verdict = Literal["pass", "conditional pass", "conditional fail", "fail", "no statement possible"]
VERDICTS: dict[Verdict, Words] = {
    "pass": Words("pass"),
    "conditional pass": Words("conditional pass"),
    "conditional fail": Words("conditional fail"),
    "fail": Words("fail"),
    "no statement possible": Words("no statement possible"),
}
RULES: dict[Rule, Words] = {
    "guarded": Words(
        "guarded acceptance: pass when the value lies inside the tolerance by at least U (guard"
        " band w = U), else fail"
    ),
    "simple": Words(
        "simple acceptance: pass when the value lies inside the tolerance; U is not taken off"
    ),
    "four_way": Words(
        "four-way: pass inside by at least U, conditional pass inside, conditional fail outside by"
        " less than U, fail beyond"
    ),
}


RULE_NAMES: dict[Rule, Words] = {
    "guarded": Words("guarded"),
    "simple": Words("simple"),
    "four_way": Words("four-way"),
}
RISKS: dict[Rule, Words] = {
    "guarded": Words("Risk: a value beyond the limit passes with a probability of at most 2.5 %."),
    "simple": Words("Risk: near the limit a decision is wrong with a probability of up to 50 %."),
    "four_way": Words(
        "Risk: pass and fail are wrong with a probability of at most 2.5 %, the conditional ones of"
        " up to 50 %."
    ),
}
"""Probability of a wrong decision, of a normal distribution about the value (JCGM 106, ILAC G8)."""


@dataclass(frozen=True, slots=True)
class ConformityStatement:
    """One statement: the result, the limits in its unit, the rule, the acceptance limits and the
    verdict.
    """

    result: Result
    specification: Specification
    rule: Rule
    acceptance: tuple[float | None, float | None]
    verdict: Verdict
    reason: Words


def judge_results(
    specifications: Sequence[Specification], results: Sequence[Result], default: Rule
) -> tuple[ConformityStatement, ...]:
    """Statement for every result that a specification names; RecipeError where it names none or in
    another unit.
    """
    statements = []
    for k, specification in enumerate(specifications):
        named_results = [r for r in results if fnmatch.fnmatchcase(r.key, specification.result)]
        if not named_results:
            close = difflib.get_close_matches(
                specification.result, [r.key for r in results], n=1, cutoff=0.3
            )
            guess = (
                f"did you mean '{close[0]}'?" if close else "see the keys in docs/certificate.md"
            )
            raise RecipeError(
                f"[[specification]] result = '{specification.result}' is no result of this run",
                hint=guess,
                at=("specification", k, "result"),
            )
        results_to_judge = [r for r in named_results if not r.by_definition]
        if not results_to_judge:
            raise RecipeError(
                f"[[specification]] result = '{specification.result}' is"
                f" {named_results[0].value:g} by definition",
                hint="there is nothing to judge; name values at other temperatures",
                at=("specification", k, "result"),
            )
        for result in results_to_judge:
            if ALIASES.get(specification.unit, specification.unit) != result.unit:
                raise RecipeError(
                    f"[[specification]] '{specification.result}' is in '{specification.unit}',"
                    f" {result.key} in '{result.unit}'",
                    hint="state the limits in the unit of the result",
                    at=("specification", k, "unit"),
                )
            statements.append(_statement(result, specification, specification.rule or default))
    return tuple(statements)


def _statement(result: Result, specification: Specification, rule: Rule) -> ConformityStatement:
    """Judge one result, on unrounded numbers."""
    lower, upper = specification.lower, specification.upper
    u_below, u_above = _expansion(result)
    acceptance = (lower, upper)
    if rule != "simple" and math.isfinite(u_above):
        acceptance = (
            None if lower is None else lower + u_below,
            None if upper is None else upper - u_above,
        )
    verdict, reason = _judge(result, lower, upper, rule)
    return ConformityStatement(result, specification, rule, acceptance, verdict, reason)


def _expansion(result: Result) -> tuple[float, float]:
    """How far the result may lie below and above its value: ± U, or the ends of its interval;
    infinite where unknown.
    """
    if result.interval is not None:
        return result.value - result.interval[0], result.interval[1] - result.value
    if result.uncertainty is None:
        return math.inf, math.inf
    return result.uncertainty.expanded_uncertainty, result.uncertainty.expanded_uncertainty


def _judge(
    result: Result, lower: float | None, upper: float | None, rule: Rule
) -> tuple[Verdict, Words]:
    """Verdict and why, or that none is possible: no uncertainty, or one larger than the
    tolerance, which is half the width between two limits; of one limit on a quantity that cannot be
    negative, the limit; else unbounded.
    """
    u_below, u_above = _expansion(result)
    obstacle = result.undecided
    if obstacle is None and not math.isfinite(u_above):
        obstacle = Words("no uncertainty was determined")
    if obstacle is not None:
        return "no statement possible", obstacle
    low, high = (-math.inf if lower is None else lower), (math.inf if upper is None else upper)
    tolerance = (high - low) / 2.0
    if lower is None and result.interval is not None and result.interval[0] >= 0.0:
        tolerance = high
    if max(u_below, u_above) > tolerance:
        return "no statement possible", Words("U exceeds the tolerance")
    bottom, top = result.value - u_below, result.value + u_above
    inside = min(result.value - low, high - result.value) >= 0.0
    accepted = inside if rule == "simple" else min(bottom - low, high - top) >= 0.0
    if accepted:
        return "pass", Words("")
    if rule != "four_way":
        guard_band_reason = Words("inside the tolerance, but by less than U")
        return "fail", guard_band_reason if inside else Words("")
    if inside:
        return "conditional pass", Words("")
    return ("conditional fail" if max(low - top, bottom - high) <= 0.0 else "fail"), Words("")
