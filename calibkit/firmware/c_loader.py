"""C99 that takes a chain's numbers from a blob: one loader for all devices of a layout, one blob per
device.
"""

from calibkit.firmware import blob, c_header, c_helpers, c_reader, c_selftest, c_source, c_text
from calibkit.firmware.blob import Shape
from calibkit.firmware.chain import Limit, Play, Slope, Sum
from calibkit.firmware.export import Export
from calibkit.firmware.twin import INVALID

NOT_LOADED = 0x4000
REASONS = (
    ("LOADED", "ready to correct"),
    ("LOAD_CRC_ENGINE", "the CRC of 123456789 is not 0xCBF43926 on this core"),
    ("LOAD_LENGTH", "shorter than it says it is"),
    ("LOAD_MAGIC", "not a blob"),
    ("LOAD_SCHEMA", "a major version that this loader does not know"),
    ("LOAD_CRC", "its CRC is wrong"),
    ("LOAD_LAYOUT", "made for another loader"),
    ("LOAD_REJECTED", "of a run that failed its acceptance limits; -DCAL_ALLOW_REJECTED takes it"),
    ("LOAD_VALUES", "a number that is not finite, or a range without a width"),
    ("LOAD_VECTORS", "its numbers do not give the results that it states"),
)
"""What a load returns, counted from 0, with the meaning."""

CONTENT = f"""        for (k = 0U; k < 8U; k++) {{
            same &= (blob[16U + k] == layout[k]) ? 1U : 0U;
        }}
        if ((same == 0U) || (length < @P_NEEDED)) {{
            reason = @P_LOAD_LAYOUT;
#ifndef CAL_ALLOW_REJECTED
        }} else if ((blob[14] & 1U) == 0U) {{
            reason = @P_LOAD_REJECTED;
#endif
        }} else if ((@p_fill(&blob[{blob.HEADER.size}]) == 0U) || (@p_sane() == 0U)) {{
            reason = @P_LOAD_VALUES;
        }} else if (@p_hold(&blob[@P_TESTS_AT]) == 0U) {{
            reason = @P_LOAD_VECTORS;
        }} else {{
            @p_tests = &blob[@P_TESTS_AT];
            @p_ready = 1U;
        }}
"""
"""What is done with a blob whose frame and CRC are right."""
LOAD = """/* takes the numbers of a blob, which must stay where it is for @p_selftest; 0 = loaded; until then, and after a
   rejection, nothing is corrected */
uint32_t @p_load(const uint8_t blob[], uint32_t size);
"""
BYTES = """
/* one byte after the other, whatever the core's own order */
static uint32_t @p_u32(const uint8_t bytes[])
{
    return (uint32_t)bytes[0] | ((uint32_t)bytes[1] << 8U) | ((uint32_t)bytes[2] << 16U)
        | ((uint32_t)bytes[3] << 24U);
}

/* CRC-32 of IEEE 802.3 */
static uint32_t @p_crc(const uint8_t bytes[], uint32_t count)
{
    uint32_t crc = 0xFFFFFFFFU;
    uint32_t i;

    for (i = 0U; i < count; i++) {
        uint32_t k;

        crc ^= (uint32_t)bytes[i];
        for (k = 0U; k < 8U; k++) {
            crc = ((crc & 1U) != 0U) ? ((crc >> 1U) ^ 0xEDB88320U) : (crc >> 1U);
        }
    }
    return crc ^ 0xFFFFFFFFU;
}

/* MISRA C:2012 rule 19.2, deviation: a union turns the bits of a number into the number */
typedef union {
    @bits bits;
    @real value;
} @p_bits;

static @real @p_number(const uint8_t bytes[])
{
    @p_bits number;

    number.bits = @take;
    return number.value;
}

static @real @p_none(void)
{
    @p_bits number;

    number.bits = @nan;
    return number.value;
}
"""
SELFTEST = """#ifndef CAL_NO_SELFTEST
int32_t @p_selftest(void)
{
    int32_t failed = 1;

    if (@p_ready != 0U) {
        failed = (@p_hold(@p_tests) != 0U) ? 0 : 1;
    }
    return failed;
}
#endif
"""
"""Self-test of what was loaded."""
MAP_FIELDS = [".middle", ".reciprocal", ".range[0]", ".range[1]"]
TAKE = {
    24: ("uint32_t", "@p_u32(bytes)", "0x7FC00000U"),
    53: (
        "uint64_t",
        "(uint64_t)@p_u32(bytes) | ((uint64_t)@p_u32(&bytes[4]) << 32U)",
        "0x7FF8000000000000U",
    ),
}


def header(export: Export) -> bytes:
    """Header of the loader."""
    found, guard = blob.shape(export.program), f"{export.prefix.upper()}_H"
    reasons = [
        f"#define @P_{name} {number}U /* {meaning} */"
        for number, (name, meaning) in enumerate(REASONS)
    ]
    parts = [
        c_text.comment(_title(export, found)),
        f"#ifndef {guard}\n#define {guard}\n\n#include <stdint.h>\n",
        '#ifdef __cplusplus\nextern "C" {\n#endif\n',
        c_header.statuses(export)
        + f"#define @P_NOT_LOADED 0x{NOT_LOADED:04x}U /* no blob was accepted: no number out (with"
        " @P_INVALID) */\n",
        "/* what @p_load returns */\n" + "\n".join(reasons) + "\n",
        c_header.structs(export, ranges=False),
        LOAD,
        c_header.prototypes(export),
        "#ifdef __cplusplus\n}\n#endif\n",
        f"#endif /* {guard} */\n",
    ]
    return c_text.seal(c_text.fill_prefix("\n".join(parts), export.prefix)).encode("ascii")


def _title(export: Export, found: Shape) -> list[str]:
    """Text at the top of both files; nothing in it belongs to one device."""
    structure = export.structure
    number = export.program.format.name
    return [
        f"{export.prefix}: {c_reader.LOADER}, correction chain as firmware; C99, no library",
        "",
        f"layout        {found.digest.hex()}: a blob of any other is refused",
        f"forms         {', '.join(structure.forms)}",
        f"number        {number}: {c_text.NUMBERS[number]}",
        c_text.ascii_only(f"formula       {structure.formula}"),
        (
            "units         of every input and output below; ranges and error bounds are each unit's"
            " own and stand in"
        ),
        "              the text of its blob",
    ]


def source(export: Export) -> bytes:
    """Source of the loader: empty tables, what fills them, the chain, and a wrapper that corrects
    nothing before.
    """
    found = blob.shape(export.program)
    bits, take, nan = TAKE[export.program.format.bits]
    numbers = (
        BYTES.lstrip("\n")
        .replace("@bits bits", f"{bits} bits")
        .replace("@take", take)
        .replace("@nan", nan)
    )
    body = "\n".join(
        [
            c_source.functions(export, "evaluated"),
            _wrapper(export),
            c_helpers.NEAR,
            _fill(export, found),
            _sane(export, found),
            _vectors(export),
            _load(found),
            SELFTEST,
        ]
    )
    parts = [
        c_text.comment([*_title(export, found), "", c_source.CONTRACT[False]]),
        f'#include "{export.prefix}.h"\n',
        c_source.FLOAT_GUARD,
        c_source.windows(export),
        _places(export, found),
        _tables(export, found),
        *c_helpers.called_helpers(body, fixed=False),
        numbers,
        body,
        c_source.listing("The steps above:", found.lines),
    ]
    return c_source.seal_source(parts, export).encode("ascii")


def _places(export: Export, found: Shape) -> str:
    """Where things are in a blob."""
    structure, size = export.structure, export.program.format.size
    tests = blob.HEADER.size + size * found.numbers
    width = len(structure.inputs) + len(structure.outputs) + 2
    needed = tests + size * (len(structure.outputs) + width * len(export.vectors.status)) + 4
    return (
        f"#define @P_TESTS_AT {tests}U /* tolerances, then vectors */\n#define @P_NEEDED"
        f" {needed}U\n"
    )


def _members(export: Export, found: Shape) -> dict[str, list[str]]:
    """Table → what its numbers are called in C: fields of a map, entries of what the chain indexes,
    else one number.
    """
    structure = export.structure
    maps = {step.table for step in structure.maps}
    indexed = {entry.table for entry in structure.inputs}
    for step in structure.steps:
        if isinstance(step, Limit | Play | Slope):
            indexed.add(step.table)
        elif isinstance(step, Sum):
            indexed |= {term.table for term in step.terms if term.table and term.over}
    members = {}
    for name, length in found.tables:
        ends = [f"[{k}]" for k in range(length)] if name in indexed else [""]
        members[name] = MAP_FIELDS if name in maps else ends
    return members


def _tables(export: Export, found: Shape) -> str:
    """Empty tables."""
    lines = []
    if export.structure.maps:
        lines.append(
            "typedef struct {\n    @real middle;\n    @real reciprocal;\n    @real range[2];\n}"
            " @p_map;\n"
        )
    for name, ends in _members(export, found).items():
        if ends is MAP_FIELDS:
            lines.append(f"static @p_map @p_{name};")
        else:
            lines.append(f"static @real @p_{name}{f'[{len(ends)}]' if ends[0] else ''};")
    lines += ["static uint32_t @p_ready = 0U; /* 1: a blob was accepted */"]
    lines += [
        "static const uint8_t *@p_tests = (const uint8_t *)0; /* its tolerances and vectors */"
    ]
    return "\n".join(lines) + "\n"


def _fill(export: Export, found: Shape) -> str:
    """Function that takes every number of a blob; it returns whether all are finite."""
    size, members = export.program.format.size, _members(export, found)
    places = [f"@p_{name}{end}" for name, ends in members.items() for end in ends]
    lines = [
        "static uint32_t @p_fill(const uint8_t at[])",
        "{",
        "    uint32_t finite = 1U;",
        "    uint32_t k;",
        "",
        *(f"    {place} = @p_number(&at[{size * k}]);" for k, place in enumerate(places)),
        f"    for (k = 0U; k < {len(places)}U; k++) {{",
        f"        finite &= @p_finite(@p_number(&at[k * {size}U]));",
        "    }",
        "    return finite;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _sane(export: Export, found: Shape) -> str:
    """Function that returns whether every range has a width."""
    ranges = [entry.table for entry in export.structure.inputs]
    ranges += [
        f"{name}.range" for name, ends in _members(export, found).items() if ends is MAP_FIELDS
    ]
    checks = [f"(@p_{name}[0] < @p_{name}[1])" for name in dict.fromkeys(ranges)]
    test = "\n        && ".join(checks)
    return f"static uint32_t @p_sane(void)\n{{\n    return ({test}) ? 1U : 0U;\n}}\n"


def _vectors(export: Export) -> str:
    """Function that runs the vectors of a blob."""
    structure, size = export.structure, export.program.format.size
    inputs, outputs = structure.inputs, structure.outputs
    width, first = len(inputs) + len(outputs) + 2, len(outputs)
    differences = [f"(status != (uint32_t)@p_number(&row[{size * (width - 1)}]))"]
    differences += [
        f"(@p_near(out.{output.name}, @p_number(&row[{size * (len(inputs) + k)}]),"
        f" @p_number(&at[{size * k}])) == 0U)"
        for k, output in enumerate(outputs)
    ]
    call = ["status = @p_evaluated(&in, &out);"]
    if structure.has_memory:
        call = c_selftest.updating_lines(structure, "updates", "@p_evaluated(&state, &in, &out)")
        place = 1 if structure.summing else 0  # behind the reset
        call.insert(place, f"updates = (uint32_t)@p_number(&row[{size * (width - 2)}]);")
    body = [
        f"const uint8_t *row = &at[({first}U + (k * {width}U)) * {size}U];",
        "@p_in in;",
        "@p_out out;",
        "uint32_t status = @P_OK;",
        *(["uint32_t updates;", "uint32_t n;"] if structure.has_memory else []),
        "",
        *(f"in.{entry.name} = @p_number(&row[{size * k}]);" for k, entry in enumerate(inputs)),
        *call,
    ]
    lines = [
        "/* whether the chain gives what the blob says it gives */",
        *c_selftest.comparing_function(
            structure,
            "static uint32_t @p_hold(const uint8_t at[])",
            ("uint32_t holds", "1U", "0U"),
            f"{len(export.vectors.status)}U",
            body,
            differences,
        ),
    ]
    return "\n".join(lines) + "\n"


def _load(found: Shape) -> str:
    """Function that accepts a blob or returns why not."""
    layout = [f"0x{byte:02x}U" for byte in found.digest]
    return f"""uint32_t @p_load(const uint8_t blob[], uint32_t size)
{{
    static const uint8_t digits[9] = {{0x31U, 0x32U, 0x33U, 0x34U, 0x35U, 0x36U, 0x37U, 0x38U, 0x39U}};
    static const uint8_t layout[8] = {{{", ".join(layout)}}};
    const uint32_t length = (size >= {blob.HEADER.size}U) ? @p_u32(&blob[8]) : 0U;
    uint32_t reason = @P_LOADED;
    uint32_t same = 1U;
    uint32_t k;

    @p_ready = 0U;
    if (@p_crc(digits, 9U) != 0xCBF43926U) {{
        reason = @P_LOAD_CRC_ENGINE;
    }} else if ((length < {blob.HEADER.size + 4}U) || (length > size)) {{
        reason = @P_LOAD_LENGTH;
    }} else if (@p_u32(blob) != 0x{int.from_bytes(blob.MAGIC, "little"):08X}U) {{
        reason = @P_LOAD_MAGIC;
    }} else if (((uint32_t)blob[4] | ((uint32_t)blob[5] << 8U)) != {blob.MAJOR}U) {{
        reason = @P_LOAD_SCHEMA;
    }} else if (@p_crc(blob, length - 4U) != @p_u32(&blob[length - 4U])) {{
        reason = @P_LOAD_CRC;
    }} else {{
{CONTENT}    }}
    return reason;
}}
"""


def _wrapper(export: Export) -> str:
    """The function that the application calls."""
    memory = export.structure.has_memory
    name = "update" if memory else "correct"
    state, passed = ("@p_state *state, ", "state, ") if memory else ("", "")
    lines = [
        f"uint32_t @p_{name}({state}const @p_in *in, @p_out *out)",
        "{",
        f"    uint32_t status = 0x{INVALID | NOT_LOADED:04x}U;",
        "",
        "    if (@p_ready != 0U) {",
        f"        status = @p_evaluated({passed}in, out);",
        "    } else {",
        *(f"        out->{output.name} = @p_none();" for output in export.structure.outputs),
        "    }",
        "    return status;",
        "}",
    ]
    return "\n".join(lines) + "\n"
