"""Range of every value of a chain, in exact interval arithmetic: errors scale with it."""

from collections.abc import Mapping, Sequence
from fractions import Fraction

from calibkit.firmware.chain import (
    Chain,
    ChainTerm,
    Limit,
    Map,
    Memory,
    Play,
    Quotient,
    Select,
    Slope,
    Step,
    Sum,
)

Range = tuple[Fraction, Fraction]
ONE = (Fraction(1), Fraction(1))


def _times(a: Range, b: Range) -> Range:
    """Range of a product."""
    corners = [x * y for x in a for y in b]
    return min(corners), max(corners)


def magnitude(a: Range) -> Fraction:
    """Largest magnitude."""
    return max(abs(a[0]), abs(a[1]))


def _polynomial(c: Sequence[Fraction], variable_range: Range) -> Range:
    """Range of a polynomial around its constant: an upper bound, not the narrowest."""
    reach = magnitude(variable_range)
    spread = sum((abs(x) * reach**k for k, x in enumerate(c[1:], start=1)), Fraction(0))
    return c[0] - spread, c[0] + spread


def total(parts: Sequence[Range]) -> Range:
    """Range of a sum."""
    low, high = (sum((part[end] for part in parts), Fraction(0)) for end in (0, 1))
    return low, high


def term(chain: Chain, entry: ChainTerm, value_ranges: Mapping[str, Range]) -> list[Range]:
    """Ranges of a term: of its polynomial, then of each product with one more factor."""
    c = chain.tables[entry.table] if entry.table else ()
    first = _polynomial(c, value_ranges[entry.over] if entry.over else ONE) if c else ONE
    first = first if entry.sign > 0 else (-first[1], -first[0])
    term_ranges = [first]
    for name in entry.factors:
        term_ranges.append(_times(term_ranges[-1], value_ranges[name]))
    return term_ranges


def find_ranges(chain: Chain, *, usual: bool, full: bool = False) -> dict[str, Range]:
    """Range of every input and step, of indications the fitted one or the full scale; remembered
    values have the chain's limits, or the tighter ones of usual use.
    """
    bounds = {**chain.limits, **(chain.usual if usual else {})}
    value_ranges: dict[str, Range] = {}
    for entry in chain.structure.inputs:
        low, high = chain.tables[entry.table][-2:] if full else chain.tables[entry.table][:2]
        value_ranges[entry.name] = (low, high)
    for step in chain.structure.steps:
        if step.name in bounds:
            value_ranges[step.name] = (-bounds[step.name], bounds[step.name])
        else:
            value_ranges[step.name] = _step(chain, step, value_ranges, bounds)
    return value_ranges


def _step(  # noqa: PLR0911 (one return per kind of step)
    chain: Chain, step: Step, value_ranges: Mapping[str, Range], bounds: Mapping[str, Fraction]
) -> Range:
    """Range of one step."""
    match step:
        case Map():
            return chain.tables[step.table][2], chain.tables[step.table][3]
        case Limit():
            (low, high), (lower, upper) = value_ranges[step.source], chain.tables[step.table]
            return min(max(low, lower), upper), max(min(high, upper), lower)
        case Memory():  # what it remembers is mapped or limited, or has bounds of its own
            return value_ranges[step.source]
        case Play():
            return total(
                [
                    value_ranges[step.source],
                    (chain.tables[step.table][0], chain.tables[step.table][1]),
                ]
            )
        case Sum():
            return total([term(chain, entry, value_ranges)[-1] for entry in step.terms])
        case Quotient():
            low, high = value_ranges[step.denominator]
            return _times(value_ranges[step.numerator], (1 / high, 1 / low))
        case Slope():
            reach = heaviest(chain, step) * difference(step, value_ranges, bounds)
            return -reach, reach
        case Select():  # 0 where no case holds
            ends = [end for case in step.cases for end in value_ranges[case.value]]
            return min(Fraction(0), *ends), max(Fraction(0), *ends)


def difference(
    step: Slope, value_ranges: Mapping[str, Range], bounds: Mapping[str, Fraction]
) -> Fraction:
    """Largest difference between two values that a slope keeps."""
    low, high = value_ranges[step.source]
    return min(high - low, bounds.get(f"{step.name}.difference", high - low))


def heaviest(chain: Chain, step: Slope) -> Fraction:
    """Largest sum of magnitudes of the weights for one number of values."""
    weights, width = chain.tables[step.table], step.length - 1
    return max(
        sum(map(abs, weights[k : k + width]), Fraction(0)) for k in range(0, len(weights), width)
    )
