"""The header: facts, statuses, inputs and outputs with units, functions."""

from calibkit.firmware import c_text, exact
from calibkit.firmware.export import FirmwareRun
from calibkit.firmware.twin import INVALID

STATUS = {
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
VERDICTS = ("rejected", "accepted", "no verdict")
"""Verdicts by the number that a header states."""


def render(export: FirmwareRun) -> str:
    """Text of the header."""
    guard = f"{export.prefix.upper()}_H"
    parts = [
        c_text.comment(
            [
                f"{export.prefix}: correction chain as firmware",
                c_text.LICENCE,
                "",
                *c_text.facts(export),
            ]
        ),
        f"#ifndef {guard}\n#define {guard}\n\n#include <stdint.h>\n",
        '#ifdef __cplusplus\nextern "C" {\n#endif\n',
        _identity(export),
        statuses(export),
        structs(export),
        prototypes(export),
        "#ifdef __cplusplus\n}\n#endif\n",
        f"#endif /* {guard} */\n",
    ]
    return c_text.seal(c_text.fill_prefix("\n".join(part for part in parts if part), export.prefix))


def _identity(export: FirmwareRun) -> str:
    """Whose chain it is, for code that reports it."""
    identity = export.identity
    name, digest = next(iter(identity.files.items()))
    return (
        f"#define @P_SERIAL {c_text.string(identity.serial)}\n#define @P_REVISION {identity.revision}\n"
        f"/* {c_text.CONTENT} of {name} */\n"
        f'#define @P_COEFFICIENTS_SHA256 "{digest}"\n'
        f"/* {', '.join(f'{k} {verdict}' for k, verdict in enumerate(VERDICTS))} */\n"
        f"#define @P_VERDICT {VERDICTS.index(identity.verdict)}\n"
        f"#define @P_ACCEPTED {int(identity.verdict == 'accepted')}\n"
    )


def statuses(export: FirmwareRun) -> str:
    """One bit per status."""
    structure = export.structure
    none = "drift and state are held" if structure.has_memory else "no number in, no number out"
    lines = [
        "/* status: 0, or the sum of */",
        "#define @P_OK 0x0000U",
        *(
            f"#define @P_{flag} 0x{1 << k:04x}U /* {STATUS[flag]} */"
            for k, flag in enumerate(structure.flags)
            if flag != "FULL_SCALE"  # floating point holds every indication
        ),
        f"#define @P_INVALID 0x{INVALID:04x}U /* an input is a NaN or an infinity: {none} */",
    ]
    return "\n".join(lines) + "\n"


def structs(export: FirmwareRun, *, ranges: bool = True) -> str:
    """Inputs, with their ranges unless left out, outputs and what is kept between updates."""
    structure, tables = export.structure, export.chain.tables
    kind = export.program.format.c_type
    lines = ["typedef struct {"]
    for entry in structure.inputs:
        low, high, *full = (float(limit) for limit in tables[entry.table])
        reach = f"; {exact.limits_text(low, high, 6)}" if ranges else ""
        if ranges and full:
            reach += f", full scale {exact.limits_text(full[0], full[1], 6)}"
        meaning = c_text.within_comment(f"[{entry.unit}] {entry.meaning}{reach}")
        lines.append(f"    {kind} {entry.name}; /* {meaning} */")
    lines += ["} @p_in;", "", "typedef struct {"]
    for output in structure.outputs:
        meaning = c_text.within_comment(f"[{output.unit}] {output.meaning}")
        lines.append(f"    {kind} {output.name}; /* {meaning} */")
    lines.append("} @p_out;")
    if structure.has_memory:
        lines += ["", "typedef struct { /* call @p_reset before the first update */"]
        lines += [f"    {kind} {memory.source};" for memory in structure.memories]
        lines += [f"    {kind} {slope.name}_history[{slope.length}];" for slope in structure.slopes]
        lines += ["    @p_out last;", "    @p_out before; /* the update before */"]
        lines += ["    @p_in in; /* the last that was used */"]
        lines += ["    uint32_t updates;", "    uint32_t waited_ms;"]
        lines.append("} @p_state;")
    return "\n".join(lines) + "\n"


def prototypes(export: FirmwareRun, unit: str = "") -> str:
    """Functions that the application calls; `unit` is the argument that a loader's functions take
    first.
    """
    structure, kind = export.structure, export.program.format.c_type
    lines = [
        "/** Corrects one set of indications; returns a status, of which 0 is all right. */",
        f"uint32_t @p_correct({unit}const @p_in *in, @p_out *out);",
    ]
    if structure.has_memory:
        anchor = [
            "/** Sets the drift where a bias reference tells it, in the unit of the output. */",
            f"void @p_anchor(@p_state *state, {kind} {structure.outputs[0].name});",
        ]
        lines = [
            f"#define @P_INTERVAL_MS {structure.interval_ms}U /* from update to update */",
            "",
            "/** Forgets the past: the next update starts at rest, in equilibrium. */",
            "void @p_reset(@p_state *state);",
            *(anchor if structure.summing else []),
            "/** Call it every @P_INTERVAL_MS with means over them; elapsed_ms is the time since the",
            "    call before by a clock. Returns a status, of which 0 is all right. */",
            f"uint32_t @p_update({unit}@p_state *state, uint32_t elapsed_ms, const @p_in *in,",
            "    @p_out *out);",
            "/** Output elapsed_ms after the last update, in a straight line from the output of the",
            "    update before to that of the last: one interval late, and without steps. */",
            "void @p_between(const @p_state *state, uint32_t elapsed_ms, @p_out *out);",
        ]
    return "\n".join([*lines, *selftest(unit)]) + "\n"


def selftest(unit: str = "") -> tuple[str, ...]:
    """Prototype of the self-test."""
    return (
        "",
        "#ifndef CAL_NO_SELFTEST",
        "/** 0 = pass; run it once after every start. */",
        f"int32_t @p_selftest({unit.removesuffix(', ') or 'void'});",
        "#endif",
    )
