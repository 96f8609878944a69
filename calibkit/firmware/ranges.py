"""Range of every value of a chain, in exact interval arithmetic: what fixed-point words must hold,
what errors scale with.
"""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from calibkit.firmware.chain import Limit, Map, Memory, Quotient, Slope, Sum

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from calibkit.firmware.chain import Chain, Step, Term

Range = tuple[Fraction, Fraction]
ONE = (Fraction(1), Fraction(1))


def times(a: Range, b: Range) -> Range:
    """Range of a product."""
    corners = [x * y for x in a for y in b]
    return min(corners), max(corners)


def magnitude(a: Range) -> Fraction:
    """Largest magnitude."""
    return max(abs(a[0]), abs(a[1]))


def polynomial(c: Sequence[Fraction], over: Range) -> Range:
    """Range of a polynomial around its constant; not sharp, never too small."""
    reach = magnitude(over)
    spread = sum((abs(x) * reach**k for k, x in enumerate(c[1:], start=1)), Fraction(0))
    return c[0] - spread, c[0] + spread


def term(chain: Chain, entry: Term, known: Mapping[str, Range]) -> list[Range]:
    """Ranges of a term: of its polynomial, then of each product with one more factor."""
    c = chain.tables[entry.table] if entry.table else ()
    first = polynomial(c, known[entry.over] if entry.over else ONE) if c else ONE
    first = first if entry.sign > 0 else (-first[1], -first[0])
    found = [first]
    for name in entry.factors:
        found.append(times(found[-1], known[name]))
    return found


def of(chain: Chain, *, usual: bool) -> dict[str, Range]:
    """Range of every input and step; remembered values have the chain's limits, or the tighter ones
    of usual use.
    """
    bounds = {**chain.limits, **(chain.usual if usual else {})}
    known: dict[str, Range] = {}
    for entry in chain.structure.inputs:
        low, high = chain.tables[entry.table]
        known[entry.name] = (low, high)
    for step in chain.structure.steps:
        if step.name in bounds:
            known[step.name] = (-bounds[step.name], bounds[step.name])
        else:
            known[step.name] = _step(chain, step, known, bounds)
    return known


def _step(  # noqa: PLR0911 (one return a kind of step)
    chain: Chain, step: Step, known: Mapping[str, Range], bounds: Mapping[str, Fraction]
) -> Range:
    """Range of one step."""
    if isinstance(step, Map):
        return chain.tables[step.table][2], chain.tables[step.table][3]
    if isinstance(step, Limit):
        return chain.tables[step.table][0], chain.tables[step.table][1]
    if isinstance(step, Memory):  # what it remembers is mapped or limited, or has bounds of its own
        return known[step.source]
    if isinstance(step, Sum):
        parts = [term(chain, entry, known)[-1] for entry in step.terms]
        return sum((low for low, _ in parts), Fraction(0)), sum(
            (high for _, high in parts), Fraction(0)
        )
    if isinstance(step, Quotient):
        low, high = known[step.denominator]
        return times(known[step.numerator], (1 / high, 1 / low))
    if isinstance(step, Slope):
        reach = heaviest(chain, step) * difference(step, known, bounds)
        return -reach, reach
    parts = [known[case.value] for case in step.cases]
    return min(Fraction(0), *(low for low, _ in parts)), max(
        Fraction(0), *(high for _, high in parts)
    )


def difference(step: Slope, known: Mapping[str, Range], bounds: Mapping[str, Fraction]) -> Fraction:
    """Largest difference between two values that a slope keeps."""
    low, high = known[step.source]
    return min(high - low, bounds.get(f"{step.name}.difference", high - low))


def rows(step: Slope, table: Sequence[Fraction]) -> list[Sequence[Fraction]]:
    """Weights of a slope for each number of values."""
    width = step.length - 1
    return [table[k : k + width] for k in range(0, len(table), width)]


def heaviest(chain: Chain, step: Slope) -> Fraction:
    """Largest sum of magnitudes of the weights of one row."""
    return max(sum(map(abs, row), Fraction(0)) for row in rows(step, chain.tables[step.table]))
