"""Where the quantities of an export came from in calibration: column, unit, scale and sign, as the
run's recipe maps them.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from calibkit import units
from calibkit.errors import OutputError, RecipeError
from calibkit.firmware.chain import Chain
from calibkit.recipe import Recipe
from calibkit.recipe.tables import ColumnMapping
from calibkit.records.coefficients import Record

UNSAFE = re.compile(r"[^ !-~]|[\\*?@{}']")
"""Characters that could end a C comment, join its lines, or be taken for a mark of the generator;
"'" encloses the name.
"""


def _quoted(name: str) -> str:
    """A column's name as it is safe in a C comment: printable ASCII, anything else by its number,
    in hexadecimal.
    """
    return f"'{UNSAFE.sub(lambda unsafe: _escaped(ord(unsafe.group())), name)}'"


def _escaped(code: int) -> str:
    """Escape of a character."""
    return next(
        f"\\{letter}{code:0{width}x}"
        for letter, width in (("x", 2), ("u", 4), ("U", 8))
        if code < 16**width
    )


def describe_sources(spec: Recipe, chain: Chain, conventions: Sequence[str]) -> tuple[str, ...]:
    """One line per quantity that a chain takes or corrects: its unit, and how the recipe made it
    from a column of the logs.
    """
    input_units = {entry.name: entry.unit for entry in chain.structure.inputs}
    corrected = [entry.column for entry in chain.corrections if entry.column not in input_units]
    return (
        *(
            f"input         {name} [{unit}] ="
            f" {chain.derived.get(name) or _right_hand_side(spec, name)}"
            for name, unit in input_units.items()
        ),
        *(
            f"indication    {name} [{units.column_unit(name)}] = {_right_hand_side(spec, name)}"
            for name in corrected
        ),
        *(f"convention    {convention}" for convention in conventions),
        (
            "sign          feed and correct what the right-hand sides give, not the columns as they"
            " were logged"
        ),
    )


def _right_hand_side(spec: Recipe, name: str) -> str:
    """Right-hand side of a canonical quantity, and the certificates that correct it."""
    column, logger = spec.columns.get(name), ""
    if spec.chamber is not None and name in spec.chamber.provides:
        column, logger = spec.chamber.columns.get(name), " of the chamber's logger"
    source = _quoted(column.source if column else name)
    certificates = "".join(
        f", + correction of certificate {_quoted(entry.certificate)}"
        for entry in spec.correction
        if entry.column == name
    )
    return f"{_converted(spec, name, column, f'column {source}{logger}')}{certificates}"


def _converted(spec: Recipe, name: str, column: ColumnMapping | None, source: str) -> str:
    """The sum sign · (scale · column + offset), as one factor and one constant where the recipe
    states the unit.
    """
    target = units.column_unit(name)
    sign, scale, offset = (column.sign, column.scale, column.offset) if column else (1, 1.0, 0.0)
    recipe_text = ", ".join(
        [
            f"sign = {sign:+d}",
            *([f"scale = {scale:.12g}"] if scale != 1.0 else []),
            *([f"offset = {offset:.12g}"] if offset else []),
        ]
    )
    log_unit = (column.unit or units.unit_in_header(column.source)) if column else ""
    inner = f"{scale:.12g} * {source}" if scale != 1.0 else source
    inner = f"({inner} {'-' if offset < 0 else '+'} {abs(offset):.12g})" if offset else inner
    if column and (column.accumulated or log_unit == "1/sample"):
        kind = ", its counts since the row before" if column.accumulated else ", counts per sample"
        per = (
            f"{column.interval_s:.12g} s"
            if column.interval_s is not None
            else "s since the row before"
        )
        return f"{'-' if sign < 0 else ''}{inner}{kind}, / ({per}) (recipe: {recipe_text})"
    factor_text = "-1 * " if sign < 0 else ""
    if not log_unit:
        unstated = f"in {target}, or in the unit that its header states"
        return f"{factor_text}{inner}, {unstated} (recipe: {recipe_text})"
    try:
        ends = units.convert(
            np.array([offset, scale + offset]),
            log_unit,
            target,
            gravity_mps2=spec.site.gravity_mps2,
        )
    except RecipeError:  # local g, which the recipe knows by latitude alone
        return f"{factor_text}{inner}, converted from {log_unit} (recipe: {recipe_text})"
    constant, factor = sign * float(ends[0]), sign * float(ends[1] - ends[0])
    added = f" {'-' if constant < 0 else '+'} {abs(constant):.10g}" if constant else ""
    return f"{factor:.10g} * {source} [{log_unit}]{added} (recipe: {recipe_text})"


def required_record(records: Mapping[str, Record], name: str, spec: Recipe) -> Record:
    """A coefficient file of the run, or OutputError."""
    if name not in records:
        raise OutputError(f"the run holds no {name}", hint=f"it is not a run of {spec.procedure}")
    return records[name]
