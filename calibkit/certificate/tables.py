"""Tables of results → rows of text: value, U with two significant digits, coverage factor."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from decimal import ROUND_HALF_UP, Decimal
from typing import Any

from calibkit.certificate.names import name_result, show_symbol
from calibkit.certificate.results import (
    GridTable,
    ListTable,
    Result,
    Uncertainty,
    round_descriptor,
    round_result,
)
from calibkit.certificate.words import Lang, Words
from calibkit.numeric import gum
from calibkit.units import POWERS, unit_mark, with_unit

WIDEST = 130
"""Characters that stand side by side in a table."""
COLUMN_GAP = 3
LONGEST = 12
"""Rows of a list of coefficients above which it is set in two or three parts side by side."""
MANY = 10_000.0
"""Degrees of freedom that are printed as infinite."""
ABSENT = "—"
ENDS = 0.01
"""Distance of an end of an interval from its value, relative to U, below which it tells nothing."""
FEWEST, MOST_DIGITS = 4, 17
"""Significant digits of a number without an uncertainty, and those that hold any float64."""
VALUE, U, K, UNIT = Words("value"), Words.literal("U"), Words.literal("k"), Words("unit")

OUTSIDE = Words("Results marked * are outside the scope of the accreditation.")
UNIT_OF_BOTH = Words("unit of value and U")


def format_number(text: str, exponent: int = 0) -> str:
    """A decimal number with a true minus sign, and a power of ten behind it."""
    power = "" if exponent == 0 else " × 10" + str(exponent).replace("-", "⁻").translate(POWERS)
    return text.replace("-", "−") + power


DISTRIBUTIONS = {
    "normal": Words("normal"),
    "rectangular": Words("rectangular"),
    "triangular": Words("triangular"),
    "arcsine": Words("arcsine"),
    "t": Words.literal("t"),
}


def format_result(result: Result | None) -> tuple[str, str]:
    """Value and U, or the coverage interval of a magnitude, as printed."""
    if result is None:
        return ABSENT, ""
    if result.outside_scope:
        marked = format_result(replace(result, outside_scope=False))
        return f"{marked[0]}*", marked[1]
    if result.uncertainty is None:
        printed = round_descriptor(result.value)
        number = format_number(printed.value, printed.exponent)
        return number, "ref." if result.by_definition else ""
    expanded = result.uncertainty.expanded_uncertainty
    if result.interval is not None:  # the end that is nearer tells how well the value is known
        reach = (abs(result.value - end) for end in result.interval)
        expanded = min(
            (distance for distance in reach if distance > ENDS * expanded), default=expanded
        )
    printed = round_result(result.value, expanded)
    if result.interval is None:
        return format_number(printed.value, printed.exponent), format_number(
            printed.uncertainty, printed.exponent
        )
    place = Decimal(1).scaleb(int(Decimal(printed.value).as_tuple().exponent))
    ends = "…".join(
        f"{Decimal(repr(float(end))).scaleb(-printed.exponent).quantize(place, ROUND_HALF_UP):f}"
        for end in result.interval
    )
    return (
        format_number(printed.value, printed.exponent),
        format_number(f"[{ends}]", printed.exponent),
    )


def format_coverage(factor: float | None) -> str:
    """Coverage factor to two decimal places, 2 as it is; empty for none."""
    return "" if factor is None else f"{factor:.2f}".removesuffix(".00")


def format_stated(result: Result | None) -> tuple[str, str, str]:
    """Value, U (or the coverage interval of a magnitude) and coverage factor, as printed."""
    uncertainty = None if result is None or result.interval is not None else result.uncertainty
    factor = None if uncertainty is None else uncertainty.coverage_factor
    return (*format_result(result), format_coverage(factor))


def format_plain(value: float | None, digits: int = 4) -> str:
    """A number without an uncertainty, in a few significant digits; a dash for none, ∞ for
    infinity.
    """
    if value is None:
        return ABSENT
    if math.isinf(value):
        return "∞" if value > 0.0 else "−∞"
    mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
    return format_number(mantissa, int(exponent or 0))


def format_exact(value: float) -> str:
    """A number that somebody stated, with every digit that was stated (its shortest form)."""
    if math.isinf(value):
        return format_plain(value)
    mantissa, _, exponent = repr(float(value)).partition("e")
    return format_number(mantissa.removesuffix(".0"), int(exponent or 0))


def format_limits(lower: str | None, upper: str | None) -> str:
    """Limits as an interval, or as one bound."""
    if lower is None:
        return f"≤ {upper or ABSENT}"
    return f"≥ {lower}" if upper is None else f"{lower} … {upper}"


def format_beside(value: float, limit: float, *, is_stated: bool) -> tuple[str, str]:
    """A number beside a limit that it was judged by, in as few digits as show on which side it
    lies: the limit as it was stated, and the number to its place at least; a computed limit in as
    many digits as the number.
    """
    if not (math.isfinite(value) and math.isfinite(limit)):
        return format_plain(value), format_plain(limit)
    side, first = (value > limit, value < limit), FEWEST
    if is_stated:
        last_place = int(Decimal(repr(limit)).normalize().as_tuple().exponent)
        first = max(FEWEST, Decimal(repr(value)).adjusted() - last_place + 1)
    for digits in range(first, MOST_DIGITS):
        rounded_limit = limit if is_stated else float(f"{limit:.{digits}g}")
        rounded_value = float(f"{value:.{digits}g}")
        if (rounded_value > rounded_limit, rounded_value < rounded_limit) == side:
            shown_limit = format_exact(limit) if is_stated else format_plain(limit, digits)
            return format_plain(value, digits), shown_limit
    return format_exact(value), format_exact(limit)


def format_acceptance(
    limit: float | None, stated_limit: float | None, result: Result
) -> str | None:
    """An acceptance limit: as stated where nothing was taken off, else to one place more than U."""
    if limit is None or limit == stated_limit or result.uncertainty is None:
        return None if limit is None else format_exact(limit)
    printed = round_result(limit, result.uncertainty.expanded_uncertainty, digits=3)
    return format_number(printed.value, printed.exponent)


def _significant(value: float) -> str:
    """A standard uncertainty with two significant digits, a trailing zero kept."""
    if not value:
        return "0"
    printed = round_result(value, value)
    return format_number(printed.uncertainty, printed.exponent)


def lay_out_list(table: ListTable, lang: Lang) -> dict[str, Any]:
    """A list as rows of symbol and name (where any result has one), value, U, unit."""
    has_names = any(result.name.en for result in table.results)
    has_symbols = not has_names or any(result.symbol for result in table.results)
    rows = []
    for result in table.results:
        name = result.name.of(lang) + (f" ({result.standard})" if result.standard else "")
        symbol = show_symbol(result.symbol)
        head = [*[symbol] * has_symbols, *[name] * has_names]
        rows.append([*head, *format_stated(result), unit_mark(result.unit) or "1"])
    parts = 1 if has_names else min(3, -(-len(rows) // LONGEST))
    unit = UNIT_OF_BOTH if parts == 1 else UNIT
    left = has_symbols + has_names
    heads = [*[Words("")] * left, VALUE, U, K, unit] * parts
    align = ("l" * left + "rrrl") * parts
    notes = (table.note, *_list_notes(table.results))
    return text_table(heads, align, _side_by_side(rows, parts), lang, table.title, notes)


def _side_by_side(rows: list[list[str]], parts: int) -> list[list[str]]:
    """A long list of rows as parts that stand side by side."""
    height = -(-len(rows) // parts) if rows else 0
    filled = rows + [[""] * len(rows[0])] * (height * parts - len(rows)) if rows else []
    return [
        [cell for part in range(parts) for cell in filled[part * height + k]] for k in range(height)
    ]


def lay_out_grid(table: GridTable, lang: Lang) -> list[dict[str, Any]]:
    """A grid as tables of as many quantities side by side as fit, each with value and U."""
    ends, total = [0], len(table.heads)
    while ends[-1] < total:
        ends.append(_end_of_part(table, ends[-1], lang))
    part_width = -(-total // max(len(ends) - 1, 1))  # as many in the last part as in the others
    starts = range(0, total, part_width)
    return [
        _part(table, slice(start, start + part_width), lang, last=start == starts[-1])
        for start in starts
    ]


def _end_of_part(table: GridTable, start: int, lang: Lang) -> int:
    """End of the columns from `start` that fit side by side: one at least."""
    free = (
        WIDEST
        - max((len(_label(label, lang)) for label in table.labels), default=0)
        - (14 if table.by_row else 0)
    )
    for k in range(start, len(table.heads)):
        column_cells = [format_stated(row[k]) for row in table.cells]
        width = sum(max((len(cells[i]) for cells in column_cells), default=0) for i in range(3))
        free -= max(width + 3 * COLUMN_GAP, len(table.heads[k].of(lang)) + 8)
        if free < 0 and k > start:
            return k
    return len(table.heads)


def _part(table: GridTable, column_slice: slice, lang: Lang, *, last: bool) -> dict[str, Any]:
    """Some columns of a grid; notes stand under the last of them."""
    part = [row[column_slice] for row in table.cells]
    widths = [  # with U and k where any result of the column has one
        3 if any(r is not None and r.uncertainty is not None for r in column) else 1
        for column in zip(*part, strict=True)
    ]
    groups: list[list[Any]] = [["", 1]]
    heads, align = [table.row_head], "l"
    for k, (head, width) in enumerate(zip(table.heads[column_slice], widths, strict=True)):
        unit = "" if table.by_row else f" [{unit_mark(table.units[column_slice][k]) or 1}]"
        groups.append([head.of(lang), width])
        heads += (VALUE + Words.literal(unit), U + Words.literal(unit), K)[:width]
        align += "r" * width
    rows = [
        [_label(label, lang)]
        + [text for r, width in zip(row, widths, strict=True) for text in format_stated(r)[:width]]
        for label, row in zip(table.labels, part, strict=True)
    ]
    if table.by_row:
        groups.append(["", 1])
        heads.append(UNIT_OF_BOTH)
        align += "l"
        for row, unit in zip(rows, table.units, strict=True):
            row.append(unit_mark(unit) or "1")
    results = [r for row in table.cells for r in row if r is not None]
    notes = (table.note, *_list_notes(results)) if last else ()
    return text_table(heads, align, rows, lang, table.title, notes, groups)


def _label(label: str | Words, lang: Lang) -> str:
    """Label of a row; the hyphen of a number is a minus."""
    if not isinstance(label, str):
        return label.of(lang)
    label = show_symbol(label)
    try:
        float(label)
    except ValueError:
        return label
    return label.replace("-", "−")


def text_table(
    heads: Sequence[Words],
    align: str,
    rows: list[list[str]],
    lang: Lang,
    title: Words | None = None,
    notes: Iterable[Words | None] = (),
    groups: Sequence[list[Any]] = (),
) -> dict[str, Any]:
    """JSON object of a table; `align` has one letter per column, l or r, `groups` a title and a
    number of columns each.
    """
    return {
        "title": "" if title is None else title.of(lang),
        "groups": list(groups),
        "heads": [head.of(lang) for head in heads],
        "align": [{"l": "left", "r": "right"}[letter] for letter in align],
        "rows": rows,
        "notes": [note.of(lang) for note in notes if note is not None],
    }


def _list_notes(results: Sequence[Result]) -> list[Words | None]:
    """What U is in a table, and what a mark of results outside the scope stands for."""
    is_outside = any(result.outside_scope for result in results)
    return [_factor_words(results), OUTSIDE if is_outside else None]


def _factor_words(results: Sequence[Result]) -> Words | None:
    """What U is in a table, and the degrees of freedom where they are few."""
    brackets = Words(
        "Brackets hold the coverage interval of a quantity that cannot be negative: Monte Carlo, of"
        " a deviation chi-square."
    )
    bracketed = any(r.interval is not None for r in results)
    dofs = [
        r.uncertainty.effective_dof
        for r in results
        if r.uncertainty is not None and r.interval is None
    ]
    if not dofs:
        return brackets if bracketed else None
    few_dofs = [math.floor(dof) for dof in dofs if dof < gum.FEW_DOF]
    student = Words("")
    if few_dofs:
        span = " … ".join(f"{dof}" for dof in sorted({min(few_dofs), max(few_dofs)}))
        student = Words("; k of Student with ν_eff = {span}", span=span)
    words = Words("U = k·u, coverage probability about 95 %{student}.", student=student)
    return words + Words(" {sentence}", sentence=brackets) if bracketed else words


def lay_out_budget(result: Result, uncertainty: Uncertainty, lang: Lang) -> dict[str, Any]:
    """Budget of one result: a row per contribution, and the sum."""
    unit = unit_mark(result.unit)
    rows = [
        [
            part.name.of(lang),
            part.kind,
            DISTRIBUTIONS[part.distribution].of(lang),
            with_unit(
                _significant(part.standard_uncertainty),
                unit_mark(part.unit) if part.quantity else unit,
            ),
            format_plain(part.sensitivity, 3),
            _significant(part.contribution),
            _dof(part.dof),
        ]
        for part in uncertainty.contributions
    ]
    value, expanded = format_result(result)
    return {
        "title": name_result(result).of(lang),
        "value": with_unit(value, unit),
        "rows": rows,
        "sum": [
            with_unit(f"u_c = {_significant(uncertainty.standard_uncertainty)}", unit),
            f"ν_eff = {_dof(uncertainty.effective_dof)}",
            f"k = {format_coverage(uncertainty.coverage_factor)}",
            with_unit(f"U = {expanded}", unit),
        ],
    }


def _dof(dof: float) -> str:
    """Degrees of freedom, rounded down; from ten thousand on they are many."""
    return "∞" if dof >= MANY else f"{math.floor(dof + 1e-9)}"
