"""A chain in one number format, floating or fixed point: the same steps, with the numbers that the
firmware holds.
"""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from calibkit.firmware import exact, ranges
from calibkit.firmware.chain import (
    Chain,
    Limit,
    Map,
    Play,
    Quotient,
    Select,
    Slope,
    Step,
    Structure,
    Sum,
)
from calibkit.firmware.formats import Format
from calibkit.firmware.ranges import Range

SLACK = {16: 64, 32: 4096}
"""Words at either end that roundings may not reach: 64 of 32768."""
RECIPROCAL_BITS = {16: 14, 32: 30}
"""Of the reciprocal of half in fixed point, which has no leading zeros: the obvious 1/half would
have a handful of bits.
"""


@dataclass(frozen=True, slots=True)
class Program:
    """Steps and numbers of a firmware; everything that decides a result bit for bit.

    In fixed point a stored word w stands for w · 2^−scale; scales hold one entry per value, table,
    partial product ("sum.term.factor"), map's reciprocal ("table.reciprocal") and output
    ("out.name").
    """

    structure: Structure
    format: Format
    tables: Mapping[str, tuple[float, ...]]
    scales: Mapping[str, int]

    @property
    def word(self) -> int:
        """Width of the words that are calculated with: a chain with memory never rounds to 16
        bits.
        """
        return 32 if self.structure.has_memory else self.format.bits

    def map_places(self, step: Map) -> int:
        """Places by which a fixed-point map shifts its product."""
        return (
            self.scales[step.source]
            + self.scales[f"{step.table}.reciprocal"]
            - self.scales[step.name]
        )

    def quotient_places(self, step: Quotient) -> int:
        """Places by which a fixed-point quotient shifts its numerator up."""
        return self.scales[step.name] + self.scales[step.denominator] - self.scales[step.numerator]

    def slope_places(self, step: Slope) -> int:
        """Places by which a fixed-point slope shifts each product."""
        return self.scales[step.table] + self.scales[step.source] - self.scales[step.name]


def quantise(chain: Chain, number: Format) -> Program:
    """Program of a chain in a number format; OutputError where a fixed-point format cannot hold
    it.
    """
    if not number.fixed:
        tables = {
            name: tuple(map(number.nearest, numbers)) for name, numbers in chain.tables.items()
        }
        for entry in chain.structure.inputs:  # floating point needs no full scale
            tables[entry.table] = tables[entry.table][:2]
        return Program(chain.structure, number, tables, {})
    word = Program(chain.structure, number, {}, {}).word
    scales = _choose_fixed_point_scales(chain, word, number.bits)
    return Program(chain.structure, number, _fixed_tables(chain, scales, word), scales)


def _scale(reach: Fraction, word: int) -> int:
    """Largest scale at which a magnitude fits a word."""
    if reach == 0:
        return word - 2
    scale, most = 0, (1 << (word - 1)) - SLACK[word]
    while reach * Fraction(2) ** scale > most:
        scale -= 1
    while reach * Fraction(2) ** (scale + 1) <= most:
        scale += 1
    return scale


def _choose_fixed_point_scales(chain: Chain, word: int, io: int) -> dict[str, int]:
    """Scale of every value, partial product, table, reciprocal and output."""
    known = ranges.find_ranges(chain, usual=False, full=True)
    scales = {e.name: _scale(ranges.magnitude(known[e.name]), io) for e in chain.structure.inputs}
    sloped = {step.source for step in chain.structure.slopes}
    for step in chain.structure.steps:
        reach = ranges.magnitude(known[step.name]) * (2 if step.name in sloped else 1)
        if isinstance(step, Sum):  # no partial sum may overflow either
            parts = [ranges.magnitude(ranges.term(chain, entry, known)[-1]) for entry in step.terms]
            reach = max(reach, sum(parts, Fraction(0)))
        scales[step.name] = scales[step.source] if isinstance(step, Limit) else _scale(reach, word)
    for memory in chain.structure.memories:
        scales[memory.name] = scales[memory.source]
    for step in chain.structure.steps:
        scales |= _inner_scales(chain, step, known, scales, word)
    for output in chain.structure.outputs:
        scales[f"out.{output.name}"] = scales[output.source] - (word - io)
    return scales


def _inner_scales(
    chain: Chain, step: Step, known: Mapping[str, Range], scales: Mapping[str, int], word: int
) -> dict[str, int]:
    """Scales of a step's tables and partial products."""
    found: dict[str, int] = {}
    match step:
        case Map():
            bits = exact.power_of_two(chain.tables[step.table][1])
            found[f"{step.table}.reciprocal"] = RECIPROCAL_BITS[word] - bits
        case Slope():
            weights = _scale(max(map(abs, chain.tables[step.table])), word)
            found[step.table] = min(weights, scales[step.name] - scales[step.source] + 2 * word - 4)
        case Sum():
            for number, entry in enumerate(step.terms):
                parts = ranges.term(chain, entry, known)
                last = scales[step.name]
                for k, name in reversed(list(enumerate(entry.factors, start=1))):
                    found[f"{step.name}.{number}.{k}"] = last
                    last = min(
                        _scale(_reach(chain, entry.table, parts[k - 1], known, entry.over), word),
                        last - scales[name] + 2 * word - 4,
                    )
                if entry.table:
                    found[entry.table] = last
        case _:
            pass
    return found


def _reach(
    chain: Chain, table: str, part: Range, known: Mapping[str, Range], over: str
) -> Fraction:
    """Largest magnitude of a partial product, and of every stage of Horner's scheme."""
    reach = ranges.magnitude(part)
    if table and over:
        u = ranges.magnitude(known[over])
        total = Fraction(0)
        for c in reversed(chain.tables[table]):
            total = total * u + abs(c)
            reach = max(reach, total)
    return reach


def _fixed_tables(chain: Chain, scales: Mapping[str, int], word: int) -> dict[str, tuple[int, ...]]:
    """Tables as words."""
    own = {entry.table: [scales[entry.name]] for entry in chain.structure.inputs}
    if pace := chain.structure.pace:
        own[pace.table] = [0, scales[pace.followed]]
    for step in chain.structure.steps:
        match step:
            case Map():
                reciprocal, u = scales[f"{step.table}.reciprocal"], scales[step.name]
                own[step.table] = [scales[step.source], reciprocal, u, u]
            case Limit() | Play():
                own[step.table] = [scales[step.name]]
            case Slope():
                own[step.table] = [scales[step.table]]
            case Select():
                own |= {case.table: [scales[step.source]] for case in step.cases}
            case Sum():
                own |= {t.table: [scales[t.table]] for t in step.terms if t.table}
            case _:
                pass
    most = (1 << (word - 1)) - 1  # a limit that no word reaches never acts
    return {
        name: tuple(
            min(max(round(x * Fraction(2) ** k), -most), most)
            for x, k in zip(chain.tables[name], itertools.cycle(places), strict=False)
        )
        for name, places in own.items()
    }
