"""C99 that takes a chain's numbers from a blob: one loader for all devices of a layout, one blob per
device.
"""

from calibkit.firmware import (
    blob,
    c_header,
    c_helpers,
    c_load,
    c_load_text,
    c_reader,
    c_source,
    c_text,
)
from calibkit.firmware.blob import Shape
from calibkit.firmware.c_steps import Home
from calibkit.firmware.export import FirmwareRun
from calibkit.firmware.twin import INVALID

NOT_LOADED = 0x4000
UNIT = "const @p_unit *unit, "
HOME = Home(f"n->{c_load.FIELD}", "const @p_numbers *n, ", "n, ")
LOAD = """/** Forgets all numbers: nothing is corrected before the next load. A static unit begins so. */
void @p_init(@p_unit *unit);
/** Takes the numbers of a blob into the slot that is not in use, and changes over to it where all of
    them are right; else the numbers in use stay. The blob must stay where it is for @p_selftest.
    serial: the device that the blob must be for, or a null pointer; least_revision: the lowest
    revision that is taken. Returns @P_LOADED, or why not. Not to be called again while a call with
    the numbers before is still under way. */
uint32_t @p_load(@p_unit *unit, const uint8_t blob[], uint32_t size, const char *serial,
    uint32_t least_revision);
/** What is loaded: its device, revision, effective date and digest of run.json (32 bytes); of a
    unit without numbers "", 0, "" and a null pointer. */
const char *@p_serial(const @p_unit *unit);
uint32_t @p_revision(const @p_unit *unit);
const char *@p_date(const @p_unit *unit);
const uint8_t *@p_digest(const @p_unit *unit);
"""
GETTERS = """static const @p_numbers *@p_in_use(const @p_unit *unit)
{
    const uint32_t active = unit->active;

    return ((active == 1U) || (active == 2U)) ? &unit->slots[active - 1U] : NULL;
}

void @p_init(@p_unit *unit)
{
    unit->active = 0U;
}

const char *@p_serial(const @p_unit *unit)
{
    const @p_numbers *n = @p_in_use(unit);

    return (n != NULL) ? n->serial : "";
}

uint32_t @p_revision(const @p_unit *unit)
{
    const @p_numbers *n = @p_in_use(unit);

    return (n != NULL) ? n->revision : 0U;
}

const char *@p_date(const @p_unit *unit)
{
    const @p_numbers *n = @p_in_use(unit);

    return (n != NULL) ? n->date : "";
}

const uint8_t *@p_digest(const @p_unit *unit)
{
    const @p_numbers *n = @p_in_use(unit);

    return (n != NULL) ? n->digest : NULL;
}
"""
SELFTEST = """#ifndef CAL_NO_SELFTEST
int32_t @p_selftest(const @p_unit *unit)
{
    const @p_numbers *n = @p_in_use(unit);
    int32_t failed = 1;

    if ((n != NULL) && (@p_hold(n) != 0U)) {
        failed = 0;
    }
    return failed;
}
#endif
"""
"""Self-test of what was loaded."""


def header(export: FirmwareRun) -> bytes:
    """Header of the loader."""
    blob_shape, guard = blob.shape(export.program), f"{export.prefix.upper()}_H"
    reasons = [
        f"#define @P_{name} {number}U /* {meaning} */"
        for number, (name, meaning) in enumerate(c_load.REASONS)
    ]
    parts = [
        c_text.comment(_title(export, blob_shape)),
        f"#ifndef {guard}\n#define {guard}\n\n#include <stdint.h>\n",
        '#ifdef __cplusplus\nextern "C" {\n#endif\n',
        c_header.statuses(export)
        + f"#define @P_NOT_LOADED 0x{NOT_LOADED:04x}U /* no blob was accepted: no number out (with"
        " @P_INVALID) */\n",
        "/* what @p_load returns */\n" + "\n".join(reasons) + "\n",
        c_header.structs(export, ranges=False),
        c_load.structs(export, blob_shape),
        LOAD,
        c_header.prototypes(export, UNIT),
        "#ifdef __cplusplus\n}\n#endif\n",
        f"#endif /* {guard} */\n",
    ]
    text = "\n".join(parts).replace("@real", export.program.format.c_type)
    return c_text.seal(c_text.fill_prefix(text, export.prefix)).encode("ascii")


def _title(export: FirmwareRun, blob_shape: Shape) -> list[str]:
    """Text at the top of both files; nothing in it belongs to one device."""
    structure = export.structure
    number = export.program.format.name
    return [
        f"{export.prefix}: {c_reader.LOADER}, correction chain as firmware; C99, no library",
        c_text.LICENCE,
        "",
        f"layout        {blob_shape.digest.hex()}: a blob of any other is refused",
        f"forms         {', '.join(structure.forms)}",
        f"number        {number}: {c_text.NUMBERS[number]}",
        c_text.ascii_only(f"formula       {structure.formula}"),
        (
            "units         of every input and output below; ranges and error bounds are each unit's"
            " own and stand in"
        ),
        "              the text of its blob",
    ]


def source(export: FirmwareRun) -> bytes:
    """Source of the loader: what fills a unit, the chain, and wrappers that correct nothing
    before.
    """
    blob_shape = blob.shape(export.program)
    name = "updated" if export.structure.has_memory else "corrected"
    body = "\n".join(
        [
            c_source.functions(export, HOME, name),
            c_helpers.NEAR,
            GETTERS,
            _wrapper(export, name),
            c_load.functions(export, blob_shape),
            SELFTEST,
        ]
    )
    parts = [
        c_text.comment([*_title(export, blob_shape), "", c_source.CONTRACT[False]]),
        f'#include <stddef.h>\n\n#include "{export.prefix}.h"\n',
        c_load_text.BARRIER,
        c_source.FLOAT_GUARD,
        c_source.windows(export),
        *c_helpers.called_helpers(body),
        c_load.numbers(export),
        body,
        c_source.listing("The steps above:", blob_shape.lines),
    ]
    return c_source.seal_source(parts, export).encode("ascii")


def _wrapper(export: FirmwareRun, inner: str) -> str:
    """The function that the application calls."""
    memory = export.structure.has_memory
    name = "update" if memory else "correct"
    declared, passed = "", ""
    if memory:
        declared, passed = "@p_state *state, uint32_t elapsed_ms, ", "state, elapsed_ms, "
    lines = [
        f"uint32_t @p_{name}({UNIT}{declared}const @p_in *in, @p_out *out)",
        "{",
        "    const @p_numbers *n = @p_in_use(unit);",
        f"    uint32_t status = 0x{INVALID | NOT_LOADED:04x}U;",
        "",
        "    if (n != NULL) {",
        f"        status = @p_{inner}(n, {passed}in, out);",
        "    } else {",
        *(f"        out->{output.name} = @p_none();" for output in export.structure.outputs),
        "    }",
        "    return status;",
        "}",
    ]
    return "\n".join(lines) + "\n"
