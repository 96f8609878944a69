"""The source: tables, helpers, the chain as one function, the self-test, and the steps as
`calibkit verify` reads them.
"""

from collections.abc import Iterator, Sequence

from calibkit.firmware import c_clock, c_helpers, c_selftest, c_steps, c_text, layout
from calibkit.firmware.c_steps import Home
from calibkit.firmware.chain import Limit, Map, Play, Select, Slope, Step, Sum
from calibkit.firmware.export import FirmwareRun

CONTRACT = (
    "Results are bit for bit those of calibkit's twin with -ffp-contract=off; else within twice"
    " the error bound."
)

FLOAT_GUARD = """#include <float.h>

#if defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0)
#error -ffast-math and -ffinite-math-only delete the guard against NaN
#endif
"""
"""Refuses compilers that take every number for finite."""

COUNTED = (
    "    if (state->updates < UINT32_MAX) {",
    "        state->updates++;",
    "    }",
)
"""Counts the updates, and never starts anew."""


def render(export: FirmwareRun) -> str:
    """Text of the source."""
    body = "\n".join([functions(export, Home()), c_selftest.render(export)])
    title = f"{export.prefix}: correction chain as firmware; C99, no library"
    parts = [
        c_text.comment([title, c_text.LICENCE, "", *c_text.facts(export), "", CONTRACT]),
        f'#include "{export.prefix}.h"\n',
        FLOAT_GUARD,
        windows(export),
        _tables(export),
        *c_helpers.called_helpers(body),
        body,
        listing(
            "The steps above as `calibkit verify` reads them again:",
            layout.write_program(export.program),
        ),
    ]
    return seal_source(parts, export)


def listing(title: str, lines: Sequence[str]) -> str:
    """Comment with the steps in a form that is read back."""
    return "\n".join(["/*", *(f" * {line}" for line in (title, *lines)), " */"]) + "\n"


def seal_source(parts: Sequence[str], export: FirmwareRun) -> str:
    """Text of the parts with types and prefix filled in, and its digest."""
    text = "\n".join(part for part in parts if part)
    program = export.program
    for mark, word in {
        "@real": program.format.c_type,
        "@zero": program.format.text(0.0),
        "@max": "FLT_MAX" if program.format.bits == 24 else "DBL_MAX",
    }.items():
        text = text.replace(mark, word)
    return c_text.seal(c_text.fill_prefix(text, export.prefix))


def windows(export: FirmwareRun) -> str:
    """Constants of the clock, and lengths of the histories."""
    slopes, clock = export.structure.slopes, c_clock.defines(export)
    if not slopes:
        return clock
    return (
        clock
        + f"#define @P_WINDOW {slopes[0].length}U\n#define @P_WINDOW_LEAST {slopes[0].least}U\n"
    )


def _tables(export: FirmwareRun) -> str:
    """Every number of the chain."""
    program, lines = export.program, []
    if program.structure.maps:
        kind = program.format.c_type
        fields = "".join(f"    {kind} {name};\n" for name in ("middle", "reciprocal", "range[2]"))
        lines.append(f"typedef struct {{\n{fields}}} @p_map;\n")
    lines += [
        _array(export, entry.table, f"least and greatest {entry.name} [{entry.unit}]")
        for entry in program.structure.inputs
    ]
    if pace := program.structure.pace:
        description = (
            f"updates until the lags have settled; farthest move of {pace.followed} an interval"
        )
        lines.append(_array(export, pace.table, description))
    for step in program.structure.steps:
        lines += list(_step_tables(export, step))
    return "\n".join(lines) + "\n"


def _step_tables(export: FirmwareRun, step: Step) -> Iterator[str]:
    """Tables of one step."""
    program = export.program
    match step:
        case Map():
            texts = [program.format.text(x) for x in program.tables[step.table]]
            numbers = [*texts[:2], f"{{{texts[2]}, {texts[3]}}}"]
            yield f"static const @p_map @p_{step.table} = {{{', '.join(numbers)}}};"
        case Limit() | Play():
            description = "least and greatest" if isinstance(step, Limit) else "reach of"
            yield _array(export, step.table, f"{description} {step.name}")
        case Slope():
            yield _array(export, step.table, "a row for each number of values")
        case Select():
            yield from (_scalar(export, case.table) for case in step.cases)
        case Sum():
            for entry in step.terms:
                if entry.table and entry.over:
                    yield _array(export, entry.table, "")
                elif entry.table:
                    yield _scalar(export, entry.table)
        case _:
            pass


def _array(export: FirmwareRun, name: str, remark: str) -> str:
    """A table."""
    kind = export.program.format.c_type
    numbers = [export.program.format.text(x) for x in export.program.tables[name]]
    text = f"static const {kind} @p_{name}[{len(numbers)}] = {{{', '.join(numbers)}}};"
    if len(text) > c_text.WIDTH:
        width = 4 if len(numbers) <= 16 else export.structure.slopes[0].length - 1
        rows = (", ".join(numbers[k : k + width]) for k in range(0, len(numbers), width))
        text = (
            f"static const {kind} @p_{name}[{len(numbers)}] = {{\n    "
            + ",\n    ".join(rows)
            + "\n};"
        )
    return f"{text} /* {remark} */" if remark else text


def _scalar(export: FirmwareRun, name: str) -> str:
    """A single number."""
    return (
        f"static const {export.program.format.c_type} @p_{name} ="
        f" {export.program.format.text(export.program.tables[name][0])};"
    )


def functions(export: FirmwareRun, home: Home, name: str = "") -> str:
    """The chain as functions: of one without memory, and the update of one with, the name where it
    is private.
    """
    if not export.structure.has_memory:
        return _correct(export, home, name)
    head = f"uint32_t @p_{name or 'update'}({home.declared}@p_state *state, uint32_t elapsed_ms,"
    if name:
        head = f"static {head}"
    clock = c_clock.render(export, home, f"{head} const @p_in *in, @p_out *out)", _invalid(export))
    return "\n".join([_reset(export), _step(export, home), clock])


def _correct(export: FirmwareRun, home: Home, name: str) -> str:
    """Function that refuses an input that is no number, and else computes the steps of the chain."""
    kind = "static uint32_t" if name else "uint32_t"
    outputs = export.structure.outputs
    lines = [
        f"{kind} @p_{name or 'correct'}({home.declared}const @p_in *in, @p_out *out)",
        "{",
        "    uint32_t status = @P_OK;",
        "",
        f"    if ({_invalid(export)}) {{",
        *(f"        {line}".rstrip() for line in _spoiled_outputs(export)),
        "        status = @P_INVALID;",
        "    } else {",
        *(f"        {line}" for line in _chain(export, home)),
        "",
        *(f"        out->{o.name} = {o.source};" for o in outputs),
        "    }",
        "    return status;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _step(export: FirmwareRun, home: Home) -> str:
    """Function that takes the steps of a chain with memory over one interval."""
    structure = export.structure
    groups = dict.fromkeys(step.group for step in structure.maps if step.group)
    last = [f"state->last.{o.name} = {o.source};" for o in structure.outputs]
    lines = [
        "/* one interval, for inputs that are numbers */",
        f"static uint32_t @p_step({home.declared}@p_state *state, const @p_in *in)",
        "{",
        "    uint32_t status = @P_OK;",
        *(f"    uint32_t status_{group} = @P_OK;" for group in groups),
        *(f"    {line}" for line in _chain(export, home)),
        "",
        *(f"    state->{memory.source} = {memory.source};" for memory in structure.memories),
        *COUNTED,
        *(f"    {line}" for line in last),
        "    return status;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _spoiled_outputs(export: FirmwareRun) -> list[str]:
    """Lines that set every output to what stands for no number."""
    structure = export.structure
    spoiled = [f"(in->{entry.name} - in->{entry.name})" for entry in structure.inputs]
    text = spoiled[0][1:-1] if len(spoiled) == 1 else "\n            + ".join(spoiled)
    none = f"const {export.program.format.c_type} none = {text}; /* a NaN */"
    return [none, "", *(f"out->{output.name} = none;" for output in structure.outputs)]


def _chain(export: FirmwareRun, home: Home) -> list[str]:
    """Inputs and steps as statements."""
    body = c_steps.Body(export.program, home)
    lines = [body.input(entry) for entry in export.structure.inputs]
    for step in export.structure.steps:
        lines += body.statements(step)
    return "\n".join(lines).split("\n")


def _invalid(export: FirmwareRun) -> str:
    """Condition that an input is no number."""
    checks = [f"(@p_finite(in->{entry.name}) == 0U)" for entry in export.structure.inputs]
    return checks[0][1:-1] if len(checks) == 1 else "\n        || ".join(checks)


def _reset(export: FirmwareRun) -> str:
    """Functions that set the state."""
    structure, zero = export.structure, export.program.format.text(0.0)
    lines = ["void @p_reset(@p_state *state)", "{"]
    if structure.slopes:
        lines += ["    uint32_t i;", "", "    for (i = 0U; i < @P_WINDOW; i++) {"]
        lines += [f"        state->{slope.name}_history[i] = {zero};" for slope in structure.slopes]
        lines.append("    }")
    lines += [f"    state->{memory.source} = {zero};" for memory in structure.memories]
    for output_copy in ("last", "before"):
        lines += [
            f"    state->{output_copy}.{output.name} = {zero};" for output in structure.outputs
        ]
    lines += [f"    state->in.{entry.name} = {zero};" for entry in structure.inputs]
    lines += ["    state->updates = 0U;", "    state->waited_ms = 0U;"]
    lines += ["}", ""]
    if structure.summing:
        output = structure.outputs[0]
        lines += [
            f"void @p_anchor(@p_state *state, {export.program.format.c_type} {output.name})",
            "{",
            f"    state->{output.source} = {output.name};",
            f"    state->last.{output.name} = {output.name};",
            f"    state->before.{output.name} = {output.name};",
            "}",
            "",
        ]
    return "\n".join(lines)
