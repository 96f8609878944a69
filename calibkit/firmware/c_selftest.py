"""The self-test of a source: vectors, and the function that compares the chain with them."""

from collections.abc import Sequence

from calibkit.firmware import c_helpers
from calibkit.firmware.chain import Structure
from calibkit.firmware.export import FirmwareRun
from calibkit.firmware.vectors import tolerances


def render(export: FirmwareRun) -> str:
    """Tables of the vectors and the function of the self-test."""
    structure, rows = export.structure, export.vectors
    out, words = "@p_out out;", []
    call = ["const uint32_t status = @p_correct(&@p_test_in[k], &out);"]
    if structure.has_memory:
        zeros = [export.program.format.text(0.0)] * len(structure.outputs)
        out = f"@p_out out = {{{', '.join(zeros)}}};"
        call = ["uint32_t status = @P_OK;", "uint32_t i;", ""]
        call += updating_lines(
            structure,
            ("@p_test_updates[k]", "@p_test_elapsed[k]"),
            "@p_step(&state, &@p_test_in[k])",
            "@p_update(&state, @p_test_elapsed[k], &@p_test_in[k], &out)",
        )
        words = [
            _words("updates", [f"{count}U" for count in rows.updates]),
            _words("elapsed", [f"{count}U" for count in rows.elapsed_ms]),
        ]
    lines = [
        "#ifndef CAL_NO_SELFTEST",
        f"#define @P_TESTS {len(rows.status)}U",
        "",
        c_helpers.NEAR,
        *_structs(export, "in", [entry.name for entry in structure.inputs]),
        *_structs(export, "out", [output.name for output in structure.outputs]),
        *words,
        _words("status", [f"0x{status:x}U" for status in rows.status]),
        "",
        *comparing_function(
            structure,
            "int32_t @p_selftest(void)",
            ("int32_t failed", "0", "1"),
            "@P_TESTS",
            [out, *call, ""],
            _differences(export),
        ),
        "#endif",
    ]
    return "\n".join(lines) + "\n"


def comparing_function(
    structure: Structure,
    head: str,
    result: tuple[str, str, str],
    count: str,
    body: Sequence[str],
    differences: Sequence[str],
) -> list[str]:
    """Lines of a function that evaluates every vector; its result (declaration, value) becomes
    another value where a vector differs.
    """
    declaration, value, otherwise = result
    state = ["    @p_state state;"] if structure.has_memory else []
    name = declaration.split()[-1]
    return [
        head,
        "{",
        f"    {declaration} = {value};",
        "    uint32_t k;",
        *state,
        "",
        *(["    @p_reset(&state);"] if state else []),
        f"    for (k = 0U; k < {count}; k++) {{",
        *(f"        {line}".rstrip() for line in body),
        "        if (" + "\n            || ".join(differences) + ") {",
        f"            {name} = {otherwise};",
        "        }",
        "    }",
        f"    return {name};",
        "}",
    ]


def updating_lines(
    structure: Structure, counts: tuple[str, str], step: str, update: str
) -> list[str]:
    """Lines that evaluate one vector of a chain with memory: as many updates as it states, by the
    clock where it states a time, else from a reset where the chain sums.
    """
    updates, elapsed = counts
    return [
        *([f"if ({elapsed} == 0U) {{", "    @p_reset(&state);", "}"] if structure.summing else []),
        f"for (i = 0U; i < {updates}; i++) {{",
        f"    if ({elapsed} == 0U) {{",
        f"        status = {step};",
        *(f"        out.{o.name} = state.last.{o.name};" for o in structure.outputs),
        "    } else {",
        f"        status = {update};",
        "    }",
        "}",
    ]


def _differences(export: FirmwareRun) -> list[str]:
    """Conditions under which the results of a vector are not those that it states."""
    number = export.program.format
    checks = ["(status != @p_test_status[k])"]
    for name in (output.name for output in export.structure.outputs):
        tolerance = number.text(tolerance_of(export, name))
        checks.append(f"(@p_near(out.{name}, @p_test_out[k].{name}, {tolerance}) == 0U)")
    return checks


def _words(name: str, texts: Sequence[str]) -> str:
    """Table of one word per vector."""
    rows = (", ".join(texts[k : k + 12]) for k in range(0, len(texts), 12))
    return (
        f"static const uint32_t @p_test_{name}[@P_TESTS] = {{\n    " + ",\n    ".join(rows) + "\n};"
    )


def _structs(export: FirmwareRun, side: str, names: Sequence[str]) -> list[str]:
    """Table of one struct per vector."""
    table = export.vectors.inputs if side == "in" else export.vectors.outputs
    text = export.program.format.text
    rows = [
        "    {" + ", ".join(text(table[name][k]) for name in names) + "}"
        for k in range(len(export.vectors.status))
    ]
    return [f"static const @p_{side} @p_test_{side}[@P_TESTS] = {{", ",\n".join(rows), "};"]


def tolerance_of(export: FirmwareRun, output: str) -> float:
    """Difference that the self-test allows an output."""
    return tolerances(export.chain, export.bounds, export.vectors.updates)[output]
