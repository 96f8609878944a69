"""The C of a loader that decides about a blob: its frame, whom it is for, its numbers and its
vectors; every number is proven before it decides a loop, an index or a conversion.
"""

from calibkit.firmware import blob, c_load_text, c_selftest
from calibkit.firmware.blob import Shape
from calibkit.firmware.chain import Limit, Play, Slope, Sum
from calibkit.firmware.export import FirmwareRun

FIELD = "t_"
"""What stands before the name of a table, which may be a word of C."""
MOST_ROWS = 1024
MOST_UPDATES = 8192
"""Rows of vectors, and their updates together, that a loader runs."""
MOST_COUNT = 1 << 24
"""Whole numbers below it are exact in single precision."""
REASONS = (
    ("LOADED", "ready to correct"),
    ("LOAD_CRC_ENGINE", "the CRC of 123456789 is not 0xCBF43926 on this core"),
    ("LOAD_LENGTH", "shorter than it says it is"),
    ("LOAD_MAGIC", "not a blob"),
    ("LOAD_SCHEMA", "a major version that this loader does not know"),
    ("LOAD_CRC", "its CRC is wrong"),
    ("LOAD_LAYOUT", "made for another loader"),
    ("LOAD_REJECTED", "of a run that failed its acceptance limits; -DCAL_ALLOW_REJECTED takes it"),
    ("LOAD_VALUES", "a number that is not finite or not possible, or a range without a width"),
    ("LOAD_VECTORS", "its numbers do not give the results that it states"),
    ("LOAD_SERIAL", "for another device"),
    ("LOAD_REVISION", "older than the lowest revision that is taken"),
)
"""What a load returns, counted from 0, with the meaning."""
MAP_FIELDS = [".middle", ".reciprocal", ".range[0]", ".range[1]"]
TAKE = {
    24: ("uint32_t", "@p_u32(bytes)", "0x7FC00000U"),
    53: (
        "uint64_t",
        "(uint64_t)@p_u32(bytes) | ((uint64_t)@p_u32(&bytes[4]) << 32U)",
        "0x7FF8000000000000U",
    ),
}


def _members(export: FirmwareRun, blob_shape: Shape) -> dict[str, list[str]]:
    """Table → what its numbers are called in C: fields of a map, entries of what the chain indexes,
    else one number.
    """
    structure = export.structure
    maps = {step.table for step in structure.maps}
    indexed = {entry.table for entry in structure.inputs}
    indexed |= {structure.pace.table} if structure.pace else set()
    for step in structure.steps:
        if isinstance(step, Limit | Play | Slope):
            indexed.add(step.table)
        elif isinstance(step, Sum):
            indexed |= {term.table for term in step.terms if term.table and term.over}
    members = {}
    for name, length in blob_shape.tables:
        ends = [f"[{k}]" for k in range(length)] if name in indexed else [""]
        members[name] = MAP_FIELDS if name in maps else ends
    return members


def structs(export: FirmwareRun, blob_shape: Shape) -> str:
    """Types of the numbers of one blob, and of a unit with two slots for them."""
    lines = []
    if export.structure.maps:
        lines += ["typedef struct {", "    @real middle;", "    @real reciprocal;"]
        lines += ["    @real range[2];", "} @p_map;", ""]
    lines.append("typedef struct { /* the numbers of one blob, which @p_load writes */")
    for name, ends in _members(export, blob_shape).items():
        if ends is MAP_FIELDS:
            lines.append(f"    @p_map {FIELD}{name};")
        else:
            lines.append(f"    @real {FIELD}{name}{f'[{len(ends)}]' if ends[0] else ''};")
    lines += [
        "    const uint8_t *tests; /* tolerances and vectors, in the blob */",
        "    uint32_t rows;",
        "    uint32_t revision;",
        f"    char serial[{blob.SERIAL_BYTES + 1}];",
        "    char date[13];",
        "    uint8_t digest[32];",
        "} @p_numbers;",
        "",
        "typedef struct { /* one sensor; a product has as many as it likes */",
        "    @p_numbers slots[2];",
        "    volatile uint32_t active; /* 0 none, else the number of the slot in use */",
        "} @p_unit;",
    ]
    return "\n".join(lines) + "\n"


def numbers(export: FirmwareRun) -> str:
    """Functions that take bytes, numbers and counts."""
    bits, take, nan = TAKE[export.program.format.bits]
    text = c_load_text.BYTES.replace("@bits bits", f"{bits} bits").replace("@take", take)
    return text.replace("@nan", nan)


def functions(export: FirmwareRun, blob_shape: Shape) -> str:
    """Where things are in a blob, and the functions that decide about one."""
    structure, size = export.structure, export.program.format.size
    width = size * blob.width(structure)
    tests_at = blob.HEADER.size + size * blob_shape.numbers
    places = [
        f"#define @P_NUMBERS {blob_shape.numbers}U",
        f"#define @P_TESTS_AT {tests_at}U /* tolerances, vectors */",
        f"#define @P_ROW {width}U /* bytes of a vector */",
        f"#define @P_MOST_ROWS {MOST_ROWS}U",
        f"#define @P_MOST_UPDATES {MOST_UPDATES}U",
        f"#define @P_MOST_COUNT {MOST_COUNT}U",
    ]
    head = c_load_text.HEAD
    for mark, text in {
        "@layout": ", ".join(f"0x{byte:02x}U" for byte in blob_shape.digest),
        "@head": str(blob.HEADER.size),
        "@least": str(blob.HEADER.size + 4),
        "@magic": f"0x{int.from_bytes(blob.MAGIC, 'little'):08X}U",
        "@major": str(blob.MAJOR),
        "@width": str(8 * size),
        "@outs": str(size * len(structure.outputs)),
        "@serial": str(blob.SERIAL_BYTES),
    }.items():
        head = head.replace(mark, text)
    parts = [
        _fill(export, blob_shape),
        _testable(export),
        _sane(export, blob_shape),
        _hold(export),
        head,
    ]
    return "\n".join(["\n".join(places) + "\n", *parts])


def _fill(export: FirmwareRun, blob_shape: Shape) -> str:
    """Function that takes every number of a blob; it returns whether all are finite."""
    size, members = export.program.format.size, _members(export, blob_shape)
    places = [f"n->{FIELD}{name}{end}" for name, ends in members.items() for end in ends]
    lines = [
        "static uint32_t @p_fill(@p_numbers *n, const uint8_t at[])",
        "{",
        "    uint32_t finite = 1U;",
        "    uint32_t k;",
        "",
        *(f"    {place} = @p_number(&at[{size * k}]);" for k, place in enumerate(places)),
        "    for (k = 0U; k < @P_NUMBERS; k++) {",
        f"        finite &= @p_finite(@p_number(&at[k * {size}U]));",
        "    }",
        "    return finite;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _sane(export: FirmwareRun, blob_shape: Shape) -> str:
    """Function that returns whether every range has a width, and the vectors can be run."""
    structure = export.structure
    ranges = [entry.table for entry in structure.inputs]
    ranges += [step.table for step in structure.steps if isinstance(step, Limit)]
    ranges += [
        f"{name}.range" for name, ends in _members(export, blob_shape).items() if ends is MAP_FIELDS
    ]
    checks = [f"(n->{FIELD}{name}[0] < n->{FIELD}{name}[1])" for name in dict.fromkeys(ranges)]
    if pace := structure.pace:
        table = f"n->{FIELD}{pace.table}"
        checks += [f"(@p_count({table}[0], @P_MOST_COUNT) < @P_MOST_COUNT)"]
        checks += [f"({table}[1] > @zero)"]
    lines = [
        "static uint32_t @p_sane(const @p_numbers *n)",
        "{",
        "    uint32_t sane = 0U;",
        "",
        "    if (" + "\n        && ".join(checks) + ") {",
        "        sane = @p_testable(n);",
        "    }",
        "    return sane;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _testable(export: FirmwareRun) -> str:
    """Function that returns whether every tolerance is one, and the vectors ask for no more than is
    run.
    """
    structure, size = export.structure, export.program.format.size
    outputs, width = len(structure.outputs), blob.width(structure)
    counts_and_limits = [(width - 1, "0x10000U")]
    if structure.has_memory:
        counts_and_limits += [(width - 2, "@P_MOST_COUNT")]
    read = [
        f"        sane &= (@p_count(@p_number(&row[{size * place}]), {limit}) < {limit}) ? 1U : 0U;"
        for place, limit in counts_and_limits
    ]
    updates = f"@p_count(@p_number(&row[{size * blob.updates_at(structure)}]), @P_MOST_UPDATES)"
    lines = [
        "static uint32_t @p_testable(const @p_numbers *n)",
        "{",
        "    uint32_t sane = 1U;",
        "    uint32_t updates = 0U;",
        "    uint32_t k;",
        "",
        f"    for (k = 0U; k < {outputs}U; k++) {{",
        f"        const @real tolerance = @p_number(&n->tests[k * {size}U]);",
        "",
        "        sane &= ((tolerance >= @zero) && (@p_finite(tolerance) != 0U)) ? 1U : 0U;",
        "    }",
        "    for (k = 0U; k < n->rows; k++) {",
        f"        const uint8_t *row = &n->tests[{outputs * size}U + (k * @P_ROW)];",
        f"        const uint32_t count = {updates};",
        "",
        *read,
        "        sane &= (count > 0U) ? 1U : 0U;",
        "        updates += count;",
        "    }",
        "    return ((sane != 0U) && (updates < @P_MOST_UPDATES)) ? 1U : 0U;",
        "}",
    ]
    return "\n".join(lines) + "\n"


def _calls(export: FirmwareRun, width: int) -> tuple[list[str], list[str]]:
    """Declarations and statements that evaluate one vector of so many numbers."""
    structure, size = export.structure, export.program.format.size
    if not structure.has_memory:
        return [], ["status = @p_corrected(n, &in, &out);"]
    words = [
        f"const @real calls = @p_number(&row[{size * (width - 3)}]);",
        f"const @real later = @p_number(&row[{size * (width - 2)}]);",
        "const uint32_t updates = @p_count(calls, @P_MOST_UPDATES);",
        "const uint32_t elapsed = @p_count(later, @P_MOST_COUNT);",
        "uint32_t i;",
    ]
    return words, c_selftest.updating_lines(
        structure,
        ("updates", "elapsed"),
        "@p_step(n, &state, &in)",
        "@p_updated(n, &state, elapsed, &in, &out)",
    )


def _hold(export: FirmwareRun) -> str:
    """Function that runs the vectors of a blob."""
    structure, size = export.structure, export.program.format.size
    inputs, outputs = structure.inputs, structure.outputs
    first, width = len(outputs), blob.width(structure)
    differences = [f"(status != @p_count(@p_number(&row[{size * (width - 1)}]), 0x10000U))"]
    differences += [
        f"(@p_near(out.{output.name}, @p_number(&row[{size * (len(inputs) + k)}]),"
        f" @p_number(&n->tests[{size * k}])) == 0U)"
        for k, output in enumerate(outputs)
    ]
    words, call = _calls(export, width)
    body = [
        f"const uint8_t *row = &n->tests[{first * size}U + (k * @P_ROW)];",
        *words,
        "uint32_t status = @P_OK;",
        "@p_in in;",
        "@p_out out;",
        "",
        *(f"in.{entry.name} = @p_number(&row[{size * k}]);" for k, entry in enumerate(inputs)),
        *(f"out.{output.name} = @zero;" for output in outputs),
        *call,
    ]
    lines = [
        "/* whether the chain gives what the blob says it gives */",
        *c_selftest.comparing_function(
            structure,
            "static uint32_t @p_hold(const @p_numbers *n)",
            ("uint32_t holds", "1U", "0U"),
            "n->rows",
            body,
            differences,
        ),
    ]
    return "\n".join(lines) + "\n"
