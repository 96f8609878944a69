"""Whether numbers that are taken as seconds are: their spacing tells milliseconds, microseconds and
ticks of a clock crystal from seconds.
"""

import numpy as np

from calibkit.errors import FrameError
from calibkit.numeric.arrays import Array
from calibkit.recipe.toml_text import write_value

_FEWEST_ROWS = 30
"""Rows from which a spacing is judged: a handful of rows may be days apart."""
_ENOUGH_ROWS = 100_000
"""Rows that tell it: of seconds, as many that are questioned are three years."""
_NOTED_S, _REFUSED_S = 900.0, 1e4
"""Spacings from which numbers without a unit are questioned, and refused: no logger waits three
hours between rows.
"""
_CRYSTAL_HZ = 32768.0
"""Frequency of a watch crystal, whose ticks loggers count."""
_ROUND = 1e-4
"""Relative departure from a round number."""


def question_seconds(stamps: Array, source: str, file: str) -> tuple[str, ...]:
    """Note on numbers [n] without a stated unit whose spacing is hardly one of seconds. Raises
    FrameError where it is none, with the unit that it looks like.
    """
    step = _spacing(stamps)
    if step < _NOTED_S:
        return ()
    words, keys = _guess_unit(step)
    finite = stamps[np.isfinite(stamps)]
    span = float(finite[-1] - finite[0])
    rows = f"{finite.size:,} rows over {span:.4g} s, one every {step:.6g} s"
    question = f"column '{source}': {rows}: {words}?"
    written = write_value(source)
    advice = f"under [columns] time_s = {{ from = {written}, {keys} }}"
    if step >= _REFUSED_S:
        raise FrameError(
            f"{file}: {question}", hint=f'state the unit, {advice}; of seconds unit = "s"'
        )
    return (f"{question} State the unit, {advice}",)


def guess_keys(stamps: Array) -> str:
    """Keys of [columns.time_s] that numbers [n] without a unit ask for by their spacing, or ""."""
    step = _spacing(stamps)
    return "" if step < _REFUSED_S else _guess_unit(step)[1]


def _spacing(stamps: Array) -> float:
    """Median step of the first stamps [n]; 0 where there are too few."""
    first = stamps[:_ENOUGH_ROWS]
    finite = first[np.isfinite(first)]
    return 0.0 if finite.size < _FEWEST_ROWS else abs(float(np.median(np.diff(finite))))


def _guess_unit(step: float) -> tuple[str, str]:
    """What a spacing [1] of stamps looks like, in words, and the keys of a column that say so."""
    ticks = step / _CRYSTAL_HZ
    binary = min(_off_round(ticks), _off_round(1.0 / ticks)) < _ROUND
    decimal = _off_round(step / 10.0 ** np.floor(np.log10(step) - 1.0)) < _ROUND
    if binary and not decimal:
        return "ticks of 1/32768 s", f'scale = {1.0 / _CRYSTAL_HZ!r}, unit = "s"'
    if step >= 5e7:
        return "nanoseconds", 'unit = "ns"'
    if step >= 1e5:
        return "microseconds", 'unit = "us"'
    return "milliseconds or microseconds", 'unit = "ms"'


def _off_round(value: float) -> float:
    """Relative distance of a number from the nearest whole number above 0."""
    return abs(value - max(round(value), 1)) / value
