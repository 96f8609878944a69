"""C99 of a chain, from the templates beside: header and source with its numbers, or those of a
loader, which takes the numbers of any device of the same layout from its blob.

In templates and steps @p and @P stand for the prefix in lower and upper case, @real for the type of
a number, @zero for 0 and @max for the largest number.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calibkit.firmware import blob, exact, facts, vectors
from calibkit.firmware.chain import ChainInput
from calibkit.firmware.export import FirmwareRun
from calibkit.firmware.steps import Code, Limit
from calibkit.libraries.templates import read_templates

if TYPE_CHECKING:
    import jinja2

STATUSES = {
    "TEMP_CLAMPED": "temperature outside the fitted range: the correction at its end was used",
    "AIR_CLAMPED": (
        "temperature of the air outside the range of the input: the end of the range was used"
    ),
    "RATE_CLAMPED": "temperature rate outside the fitted range: the end of the range was used",
    "GRADIENT_CLAMPED": (
        "temperature gradient outside the fitted range: the correction at its end was used"
    ),
    "ACCEL_BEYOND": "indication outside the fitted range: corrected as it is",
    "RATE_BEYOND": "indication outside the fitted rates: corrected as it is",
    "STARTING": (
        "the lags have not settled since the reset or since a gap too long to bridge: the header"
        " states by how much the result may be wrong"
    ),
    "INTERVAL": (
        "not one interval after the inputs that were used last: a gap was bridged in a straight"
        " line, or the call came too early and nothing changed"
    ),
    "JUMPED": "the temperature moved faster than it can: not used, the drift is held",
    "HELD": "the air is at rest, or moves on a side that was not fitted: the drift is held",
    "DRIFT_LIMITED": "the summed drift reached its limit: reset or anchor it",
}
"""Status → its meaning."""
CONTRACT = (
    "Results are bit for bit those of calibkit's twin with -ffp-contract=off; else within twice"
    " the error bound."
)


def header(export: FirmwareRun) -> bytes:
    """Header of a source."""
    title = f"{export.prefix}: correction chain as firmware"
    return _fill(
        "header.h.j2",
        export,
        [title, facts.LICENCE, "", *facts.list_facts(export)],
        input_remark=lambda entry: _remark(entry, export.chain.tables),
        loader=None,
        serial=facts.string(export.identity.serial),
        coefficients=next(iter(export.identity.files.items())),
    )


def source(export: FirmwareRun) -> bytes:
    """Source with tables, the chain as functions, and its self-test."""
    structure, tests = export.structure, export.vectors
    title = f"{export.prefix}: correction chain as firmware; C99, no library"
    inputs = [tests.inputs[entry.name] for entry in structure.inputs]
    outputs = [tests.outputs[output.name] for output in structure.outputs]
    return _fill(
        "source.c.j2",
        export,
        [title, facts.LICENCE, "", *facts.list_facts(export), "", CONTRACT],
        tables="@p_",
        initialiser=lambda name, texts: _initialiser(export, name, texts),
        input_rows=list(zip(*inputs, strict=True)),
        output_rows=list(zip(*outputs, strict=True)),
        tests=tests,
        tolerances=vectors.tolerances(export.chain, export.bounds, tests.updates),
    )


def loader_header(export: FirmwareRun) -> bytes:
    """Header of the loader of a layout."""
    return _fill(
        "header.h.j2",
        export,
        _loader_title(export),
        input_remark=lambda entry: _remark(entry, None),
        loader=blob.shape(export.program),
    )


def loader_source(export: FirmwareRun) -> bytes:
    """Source of the loader of a layout; nothing in it belongs to one device."""
    structure, layout = export.structure, blob.shape(export.program)
    ends = {"map": [".middle", ".reciprocal", ".range[0]", ".range[1]"], "number": [""]}
    fields = []
    for name, length in layout.tables:
        places = [f"[{k}]" for k in range(length)]
        fields += [f"{name}{end}" for end in ends.get(structure.tables[name].kind, places)]
    ranges = [entry.table for entry in structure.inputs]
    ranges += [step.table for step in structure.steps if isinstance(step, Limit)]
    ranges += [f"{name}.range" for name in structure.tables if structure.tables[name].kind == "map"]
    return _fill(
        "loader.c.j2",
        export,
        [*_loader_title(export), "", CONTRACT],
        tables="n->t_",
        loader=layout,
        fields=fields,
        ranges=list(dict.fromkeys(ranges)),
        width=blob.width(structure),
        updates_at=blob.updates_at(structure),
    )


def _loader_title(export: FirmwareRun) -> list[str]:
    """Text at the top of both files of a loader."""
    number = export.program.format.name
    return [
        f"{export.prefix}: {facts.LOADER}, correction chain as firmware; C99, no library",
        facts.LICENCE,
        "",
        f"layout        {blob.shape(export.program).digest.hex()}: a blob of any other is refused",
        f"forms         {', '.join(export.structure.forms)}",
        f"number        {number}: {facts.NUMBERS[number]}",
        f"formula       {export.structure.formula}",
        (
            "units         of every input and output below; ranges and error bounds are each unit's"
            " own and stand in the text of its blob"
        ),
    ]


@cache
def _templates() -> "jinja2.Environment":
    """Templates of the C; texts of a device stand in its comments and strings."""
    return read_templates(Path(__file__).parent / "templates", escaped=False)


def _fill(template: str, export: FirmwareRun, title: Sequence[str], **values: Any) -> bytes:  # noqa: ANN401 (what a template prints)
    """A template with the values of a run, under a comment with the facts, over its digest."""
    structure, program = export.structure, export.program
    if "tables" in values:
        lengths = {name: len(numbers) for name, numbers in program.tables.items()}
        code = Code(values["tables"], lengths)
        statements = [entry.c(code) for entry in structure.inputs]
        values["statements"] = statements + [step.c(code) for step in structure.steps]
    names = [entry.name for entry in structure.inputs]
    text = (
        _templates()
        .get_template(template)
        .render(
            {
                "structure": structure,
                "program": program,
                "identity": export.identity,
                "statuses": STATUSES,
                "blob": blob,
                "content": facts.CONTENT,
                "within_comment": facts.within_comment,
                "literals": lambda numbers: list(map(program.format.text, numbers)),
                "formatted": lambda pattern, numbers: [pattern % number for number in numbers],
                "no_number": _joined(
                    [f"(@p_finite(in->{name}) == 0U)" for name in names], "|| ", 8
                ),
                "nan": _joined([f"(in->{name} - in->{name})" for name in names], "+ ", 12),
                "loader": None,
                **values,
            }
        )
    )
    largest = "FLT_MAX" if program.format.bits == 24 else "DBL_MAX"
    for mark, word in {
        "@real": program.format.c_type,
        "@zero": program.format.text(0.0),
        "@max": largest,
        "@p": export.prefix,
        "@P": export.prefix.upper(),
    }.items():
        text = text.replace(mark, word)
    return facts.seal(f"{facts.comment(title)}\n{text}").encode("ascii")


def _joined(parts: Sequence[str], operator: str, indent: int) -> str:
    """Expressions in parentheses, each on its own line; a single one without them."""
    return parts[0][1:-1] if len(parts) == 1 else f"\n{' ' * indent}{operator}".join(parts)


def _remark(entry: ChainInput, tables: Mapping[str, exact.Poly] | None) -> str:
    """Unit and meaning of an input, with its ranges unless they are each device's own."""
    text = f"[{entry.unit}] {entry.meaning}"
    if tables is not None:
        low, high, *full = (float(limit) for limit in tables[entry.table])
        text += f"; {exact.limits_text(low, high, 6)}"
        if full:
            text += f", full scale {exact.limits_text(full[0], full[1], 6)}"
    return facts.within_comment(text)


def _initialiser(export: FirmwareRun, name: str, texts: Sequence[str]) -> str:
    """Numbers of a table in braces: on one line, or in rows where it would be too long."""
    if export.structure.tables[name].kind == "map":
        return f"{{{texts[0]}, {texts[1]}, {{{texts[2]}, {texts[3]}}}}}"
    line = f"{{{', '.join(texts)}}}"
    kind = export.program.format.c_type
    if len(f"static const {kind} @p_{name}[{len(texts)}] = {line};") <= facts.WIDTH:
        return line
    width = 4 if len(texts) <= 16 else export.structure.slopes[0].length - 1
    rows = [", ".join(texts[k : k + width]) for k in range(0, len(texts), width)]
    return "{\n    " + ",\n    ".join(rows) + "\n}"
