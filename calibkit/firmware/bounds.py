"""Worst-case difference between what a firmware computes and the exact chain, over the whole range
of its inputs.

First-order running error analysis with the program's own rounding of every number (Higham 2002,
Accuracy and Stability of Numerical Algorithms, chapter 3). A polynomial of degree n comes out
within 2⁻²⁴ (S (1 + 2n) + 3 D), S = Σ|c_k|, D = Σ k|c_k|, in single precision; here each rounding is
counted where it stands, which is tighter. Contraction to fused multiply-add only leaves roundings
out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Self

from calibkit.firmware import exact, ranges
from calibkit.firmware.chain import Chain, Program
from calibkit.firmware.rounding import Rounding
from calibkit.firmware.steps import Memory

ALLOWANCE = 1.01
"""For products of errors, which first order leaves out, and for the roundings of this analysis
itself.
"""


def find_bounds(chain: Chain, program: Program, *, full: bool = False) -> dict[str, float]:
    """Bound of each output in its unit, two digits rounded up, for indications in their fitted
    range or up to the full scale; of a chain that sums, the largest error that one update may add.
    """
    analysis = _Analysis.prepare(chain, program, full=full)
    driven, at_rest = analysis.driven, dict.fromkeys(analysis.driven, 0.0)
    start = analysis.walk(at_rest)[1]
    # errors of remembered values go on linearly: an error of 1 in each gives a column of the matrix
    columns = [analysis.walk(at_rest | {name: 1.0})[1] for name in driven]
    sources = [memory.source for memory in driven.values()]
    growth = [[column[source] - start[source] for column in columns] for source in sources]
    # a filter forgets: however long it runs, its error stays below a fixed point
    settled_errors = _settled(growth, [start[source] for source in sources])
    errors, _ = analysis.walk(dict(zip(driven, settled_errors, strict=True)))
    return {
        output.name: exact.round_to(errors[output.source] * ALLOWANCE, 2, up=True)
        for output in chain.structure.outputs
    }


def find_gains(chain: Chain, program: Program) -> dict[str, dict[str, float]]:
    """Output → remembered value → largest derivative of the output by it, for values that a reset
    takes for 0.
    """
    analysis = _Analysis.prepare(chain, program, full=False)
    at_rest = dict.fromkeys(analysis.driven, 0.0)
    outputs = chain.structure.outputs
    errors, _ = analysis.walk(at_rest)
    gains: dict[str, dict[str, float]] = {output.name: {} for output in outputs}
    for name, memory in analysis.driven.items():
        if memory.source in chain.ramped:
            shifted_errors, _ = analysis.walk(at_rest | {name: 1.0})
            for output in outputs:
                gain = shifted_errors[output.source] - errors[output.source]
                gains[output.name][memory.source] = gain
    return gains


def _settled(growth: Sequence[Sequence[float]], fed: Sequence[float]) -> list[float]:
    """Errors e = growth · e + fed of remembered values after any number of updates."""
    size = range(len(fed))
    matrix = [[Fraction(int(i == j)) - Fraction(growth[i][j]) for j in size] for i in size]
    # e = (1 − growth)⁻¹ fed, the sum of what all updates before have left
    return [float(x) for x in exact.solve(matrix, [Fraction(x) for x in fed])]


@dataclass(frozen=True, slots=True)
class _Analysis:
    """Errors of every value, given those of the remembered ones."""

    chain: Chain
    rounding: Rounding
    driven: Mapping[str, Memory]
    """Remembered values that filter what drives them, by name."""

    @classmethod
    def prepare(cls, chain: Chain, program: Program, *, full: bool) -> Self:
        """Ranges and rounded numbers of a program."""
        intervals = chain.find_ranges(usual=True, full=full)
        reaches = {
            name: float(ranges.magnitude(intervals.values[name])) for name in intervals.values
        }
        stored = {
            name: [
                float(abs(number - Fraction(rounded)))
                for number, rounded in zip(chain.tables[name], numbers, strict=False)
            ]  # the full scale of an indication is no number of the program
            for name, numbers in program.tables.items()
        }
        driven = {m.name: m for m in chain.structure.memories if m.source in chain.gains}
        return cls(chain, Rounding(program.format.bits, intervals, reaches, stored), driven)

    def walk(self, remembered: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
        """Errors by value; and of filtered values those by rounding alone, without the error of
        the map that drives them.
        """
        structure, gains = self.chain.structure, self.chain.gains
        errors, inner = {entry.name: 0.0 for entry in structure.inputs}, dict[str, float]()
        # the mapped value that the filters follow, and what is remembered of it
        followed = next((m for m in structure.memories if m.start == "same"), None)
        for step in structure.steps:
            if step.name in remembered:
                errors[step.name] = remembered[step.name]
            elif followed is not None and step.name in gains:
                mapped = (followed.name, followed.source)
                # an error of the map moves all filters alike: it is bounded once by the gain, not
                # in each
                quiet = {**errors, **inner, **dict.fromkeys(mapped, 0.0)}
                inner[step.name] = step.error(quiet, self.rounding)
                driving = max(errors[name] for name in mapped)
                errors[step.name] = inner[step.name] + float(gains[step.name]) * driving
            else:
                errors[step.name] = step.error(errors, self.rounding)
        return errors, inner
