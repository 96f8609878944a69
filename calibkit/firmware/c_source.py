"""The source: tables, helpers, the chain as one function, the self-test, and the steps again for
`calibkit verify`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibkit.firmware import c_helpers, c_steps, c_text, layout, vectors
from calibkit.firmware.chain import Limit, Map, Select, Slope, Sum

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibkit.firmware.chain import Step, Structure
    from calibkit.firmware.export import Export

CONTRACT = {
    False: (
        "Results are bit for bit those of calibkit's twin with -ffp-contract=off; else within twice"
        " the error bound."
    ),
    True: "Results are bit for bit those of calibkit's twin.",
}

FLOAT_GUARD = """#include <float.h>

#if defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0)
#error -ffast-math and -ffinite-math-only delete the guard against NaN
#endif
"""
"""Refuses compilers that take every number for finite."""

COUNTED = (
    "        if (state->updates < UINT32_MAX) {",
    "            state->updates++;",
    "        }",
)
"""Counts the updates, and never starts anew."""


def render(export: Export) -> str:
    """Text of the source."""
    fixed = export.program.format.fixed
    body = "\n".join([functions(export), _selftest(export)])
    title = f"{export.prefix}: correction chain as firmware; C99, no library"
    parts = [
        c_text.comment([title, "", *c_text.facts(export), "", CONTRACT[fixed]]),
        f'#include "{export.prefix}.h"\n',
        "" if fixed else FLOAT_GUARD,
        windows(export),
        _tables(export),
        *(helper.lstrip("\n") for helper in c_helpers.wanted(body, fixed=fixed)),
        body,
        _listing(export),
    ]
    text = "\n".join(part for part in parts if part)
    return c_text.sealed(c_text.named(typed(text, export), export.prefix))


def typed(text: str, export: Export) -> str:
    """Helpers in the types of the number format."""
    program = export.program
    wide = 64 if program.word == 32 else 32
    words = {
        "@real": program.format.c_type,
        "@zero": "0" if program.format.fixed else program.format.text(0.0),
        "@max": "FLT_MAX" if program.format.bits == 24 else "DBL_MAX",
        "@wide": f"int{wide}_t",
        "@uwide": f"uint{wide}_t",
        "@top": str(wide - 1),
        "@word": f"int{program.word}_t",
        "@reciprocal": "30" if program.word == 32 else "14",
    }
    for mark, word in words.items():
        text = text.replace(mark, word)
    return text


def windows(export: Export) -> str:
    """Lengths of the histories."""
    slopes = export.chain.structure.slopes
    if not slopes:
        return ""
    return f"#define @P_WINDOW {slopes[0].length}U\n#define @P_WINDOW_LEAST {slopes[0].least}U\n"


def _tables(export: Export) -> str:
    """Every number of the chain."""
    program, lines = export.program, []
    word = f"int{program.word}_t" if program.format.fixed else program.format.c_type
    if any(isinstance(step, Map) for step in program.structure.steps):
        fields = "".join(f"    {word} {name};\n" for name in ("middle", "reciprocal", "range[2]"))
        places = "    uint32_t places;\n" if program.format.fixed else ""
        lines.append(f"typedef struct {{\n{fields}{places}}} @p_map;\n")
    lines += [
        _array(export, entry.table, word, f"least and greatest {entry.name} [{entry.unit}]")
        for entry in program.structure.inputs
    ]
    for step in program.structure.steps:
        lines += list(_step_tables(export, step, word))
    return "\n".join(lines) + "\n"


def _step_tables(export: Export, step: Step, word: str) -> Iterator[str]:
    """Tables of one step."""
    program = export.program
    if isinstance(step, Map):
        middle, reciprocal, low, high = (program.format.text(x) for x in program.tables[step.table])
        numbers = [middle, reciprocal, f"{{{low}, {high}}}"]
        if program.format.fixed:
            scales = program.scales
            places = scales[step.source] + scales[f"{step.table}.reciprocal"] - scales[step.name]
            numbers.append(f"{places}U")
        yield f"static const @p_map @p_{step.table} = {{{', '.join(numbers)}}};"
    elif isinstance(step, Limit):
        yield _array(export, step.table, word, f"least and greatest {step.name}")
    elif isinstance(step, Slope):
        yield _array(export, step.table, word, "a row for each number of values")
    elif isinstance(step, Select):
        yield from (_scalar(export, case.table, word) for case in step.cases)
    elif isinstance(step, Sum):
        for entry in step.terms:
            if entry.table and entry.over:
                yield _array(export, entry.table, word, "")
            elif entry.table:
                yield _scalar(export, entry.table, word)


def _array(export: Export, name: str, word: str, remark: str) -> str:
    """A table."""
    numbers = [export.program.format.text(x) for x in export.program.tables[name]]
    text = f"static const {word} @p_{name}[{len(numbers)}] = {{{', '.join(numbers)}}};"
    if len(text) > c_text.WIDTH:
        width = 4 if len(numbers) <= 16 else export.chain.structure.slopes[0].length - 1
        rows = (", ".join(numbers[k : k + width]) for k in range(0, len(numbers), width))
        text = (
            f"static const {word} @p_{name}[{len(numbers)}] = {{\n    "
            + ",\n    ".join(rows)
            + "\n};"
        )
    return f"{text} /* {remark} */" if remark else text


def _scalar(export: Export, name: str, word: str) -> str:
    """A single number."""
    return (
        f"static const {word} @p_{name} ="
        f" {export.program.format.text(export.program.tables[name][0])};"
    )


def functions(export: Export) -> str:
    """The chain, and what handles its state."""
    structure = export.chain.structure
    return (
        _correct(export)
        if structure.interval_s is None
        else "\n".join([_reset(export), _update(export)])
    )


def _chain(export: Export) -> list[str]:
    """Inputs and steps as statements."""
    body = c_steps.Body(export.program)
    lines = [body.input(entry) for entry in export.chain.structure.inputs]
    for step in export.chain.structure.steps:
        lines += body.statements(step)
    return "\n".join(lines).split("\n")


def _invalid(export: Export) -> str:
    """Condition that an input is no number."""
    if export.program.format.fixed:
        checks = [f"(in->{entry.name} == @P_NO_NUMBER)" for entry in export.chain.structure.inputs]
    else:
        checks = [f"(@p_finite(in->{entry.name}) == 0U)" for entry in export.chain.structure.inputs]
    return checks[0][1:-1] if len(checks) == 1 else "\n        || ".join(checks)


def _sides(export: Export) -> list[str]:
    """Statuses of sides of which one is selected."""
    return [f"uint32_t status_{group} = @P_OK;" for group in c_steps.groups(export.program)]


def _results(export: Export) -> list[str]:
    """Outputs from their values."""
    program, lines = export.program, []
    for output in export.chain.structure.outputs:
        value = output.source
        if program.format.bits == 16:
            value = f"@p_narrow({value})" if program.word == 32 else f"(int16_t){value}"
        lines.append(f"out->{output.name} = {value};")
    return lines


def _correct(export: Export) -> str:
    """Function of a chain without memory."""
    structure = export.chain.structure
    none = "@P_NO_NUMBER"
    before: list[str] = []
    if not export.program.format.fixed:
        none = "none"
        spoiled = [f"(in->{entry.name} - in->{entry.name})" for entry in structure.inputs]
        text = spoiled[0][1:-1] if len(spoiled) == 1 else "\n            + ".join(spoiled)
        before = [f"const {export.program.format.c_type} none = {text}; /* a NaN */", ""]
    lines = [
        "uint32_t @p_correct(const @p_in *in, @p_out *out)",
        "{",
        "    uint32_t status = @P_OK;",
        "",
        f"    if ({_invalid(export)}) {{",
        *(f"        {line}".rstrip() for line in before),
        *(f"        out->{output.name} = {none};" for output in structure.outputs),
        "        status = @P_INVALID;",
        "    } else {",
        *(f"        {line}" for line in (*_sides(export), *_chain(export))),
        "",
        *(f"        {line}" for line in _results(export)),
        "    }",
        "    return status;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _reset(export: Export) -> str:
    """Functions that set the state."""
    structure, zero = export.chain.structure, c_steps.Body(export.program).zero
    last = "0" if export.program.format.fixed else zero
    lines = ["void @p_reset(@p_state *state)", "{"]
    if structure.slopes:
        lines += ["    uint32_t i;", "", "    for (i = 0U; i < @P_WINDOW; i++) {"]
        lines += [f"        state->{slope.name}_history[i] = {zero};" for slope in structure.slopes]
        lines.append("    }")
    lines += [f"    state->{memory.source} = {zero};" for memory in structure.memories]
    lines += [f"    state->last.{output.name} = {last};" for output in structure.outputs]
    lines += ["    state->updates = 0U;"] if structure.counting else []
    lines += ["}", ""]
    if structure.summing:
        places = export.program.word - export.program.format.bits
        value = "drift_dph"
        if export.program.format.fixed and places:
            value = f"(int32_t)drift_dph * {1 << places}"
        lines += [
            f"void @p_anchor(@p_state *state, {export.program.format.c_type} drift_dph)",
            "{",
            f"    state->drift = {value};",
            "    state->last.drift_dph = drift_dph;",
            "}",
            "",
        ]
    return "\n".join(lines)


def _update(export: Export) -> str:
    """Function of a chain with memory."""
    structure = export.chain.structure
    lines = [
        "uint32_t @p_update(@p_state *state, const @p_in *in, @p_out *out)",
        "{",
        "    uint32_t status = @P_OK;",
        "",
        f"    if ({_invalid(export)}) {{",
        "        *out = state->last;",
        "        status = @P_INVALID;",
        "    } else {",
        *(f"        {line}" for line in (*_sides(export), *_chain(export))),
        "",
        *(f"        state->{memory.source} = {memory.source};" for memory in structure.memories),
        *(COUNTED if structure.counting else []),
        *(f"        {line}" for line in _results(export)),
        "        state->last = *out;",
        "    }",
        "    return status;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _selftest(export: Export) -> str:
    """Vectors and the function that holds the chain against them."""
    structure, rows = export.chain.structure, len(export.vectors.status)
    memory, zero = structure.interval_s is not None, c_steps.Body(export.program).zero
    lines = [
        "#ifndef CAL_NO_SELFTEST",
        f"#define @P_TESTS {rows}U",
        "",
        *([] if export.program.format.fixed else [c_helpers.NEAR]),
        *_rows(export, "in", [entry.name for entry in structure.inputs]),
        *_rows(export, "out", [output.name for output in structure.outputs]),
        *([_words("updates", [f"{count}U" for count in export.vectors.updates])] if memory else []),
        _words("status", [f"0x{status:x}U" for status in export.vectors.status]),
        "",
        "int32_t @p_selftest(void)",
        "{",
        "    int32_t failed = 0;",
        "    uint32_t k;",
        *(["    @p_state state;"] if memory else []),
        *(["", "    @p_reset(&state);"] if memory and not structure.summing else [""]),
        "    for (k = 0U; k < @P_TESTS; k++) {",
        *(
            ["        @p_out out = {" + ", ".join([zero] * len(structure.outputs)) + "};"]
            if memory
            else ["        @p_out out;"]
        ),
        *_calls(structure),
        "",
        "        if (" + "\n            || ".join(_differences(export)) + ") {",
        "            failed = 1;",
        "        }",
        "    }",
        "    return failed;",
        "}",
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def _calls(structure: Structure) -> list[str]:
    """Lines that evaluate one vector, as often as it says where the chain has memory."""
    if structure.interval_s is None:
        return ["        const uint32_t status = @p_correct(&@p_test_in[k], &out);"]
    return [
        "        uint32_t status = @P_OK;",
        "        uint32_t n;",
        "",
        *(["        @p_reset(&state);"] if structure.summing else []),
        "        for (n = 0U; n < @p_test_updates[k]; n++) {",
        "            status = @p_update(&state, &@p_test_in[k], &out);",
        "        }",
    ]


def _differences(export: Export) -> list[str]:
    """Conditions under which the results of a vector are not those that it states."""
    number = export.program.format
    checks = ["(status != @p_test_status[k])"]
    for name in (output.name for output in export.chain.structure.outputs):
        if number.fixed:
            checks.append(f"(out.{name} != @p_test_out[k].{name})")
        else:
            tolerance = number.text(tolerance_of(export, name))
            checks.append(f"(@p_near(out.{name}, @p_test_out[k].{name}, {tolerance}) == 0U)")
    return checks


def _words(name: str, texts: list[str]) -> str:
    """Table of one word a vector."""
    rows = (", ".join(texts[k : k + 12]) for k in range(0, len(texts), 12))
    return (
        f"static const uint32_t @p_test_{name}[@P_TESTS] = {{\n    " + ",\n    ".join(rows) + "\n};"
    )


def tolerance_of(export: Export, output: str) -> float:
    """Difference that the self-test allows: both sides may be off by the bound, which a sum adds
    up.
    """
    summed = vectors.SUMMED if export.chain.structure.summing else 1
    jumps = (
        2.0 if export.chain.condition else 1.0
    )  # the test's temperatures jump, which the bound leaves out
    return float(f"{2.0 * jumps * export.bounds[output] * summed:.2g}")


def _rows(export: Export, side: str, names: list[str]) -> list[str]:
    """Rows of a table of structs."""
    table = export.vectors.inputs if side == "in" else export.vectors.outputs
    text = export.program.format.text
    rows = [
        "    {" + ", ".join(text(table[name][k]) for name in names) + "}"
        for k in range(len(export.vectors.status))
    ]
    return [f"static const @p_{side} @p_test_{side}[@P_TESTS] = {{", ",\n".join(rows), "};"]


def _listing(export: Export) -> str:
    """The steps in a form that is read back."""
    lines = [
        "The steps above as `calibkit verify` reads them again:",
        *layout.lines(export.program),
    ]
    return "\n".join(["/*", *(f" * {line}" for line in lines), " */"]) + "\n"
