"""A C program that runs many generated chains over every temperature and prints one number each;
the same from the twin.
"""

from math import frexp

import numpy as np

from calibkit.firmware import c_code, export, formats, ranges, twin, twin_clock

IDENTITY = export.RunIdentity(
    "FW-1",
    1,
    "2026-11-21",
    "0" * 64,
    {"coefficients.json": "0" * 64},
    "calibkit test",
    verdict="accepted",
)
STRIDES = (1, 40503, 30029, 20011)
PAUSES = (1000, 1000, 250, 3000, 1000, 900, 1200, 70000)
"""Time from call to call, in thousandths of an interval."""
UPDATES = 12
"""Updates of a chain with memory from each reset: a window and more."""


def exported(chain, number, prefix):
    """Export of a chain under a prefix of its own."""
    return export.prepare(chain, IDENTITY, formats.Format.find(number), prefix)


def write(exports, folder):
    """Write headers and sources, and one file that includes them all."""
    for one in exports:
        (folder / f"{one.prefix}.h").write_bytes(c_code.header(one))
        (folder / f"{one.prefix}.c").write_bytes(c_code.source(one))
    (folder / "all.c").write_text("".join(f'#include "{one.prefix}.c"\n' for one in exports))
    (folder / "driver.c").write_text(driver(exports))


def units(one):
    """Physical step of one count of each input: 16 bits reach beyond its range."""
    known = one.chain.find_ranges(usual=False).values
    return [
        2.0 ** (frexp(1.02 * float(ranges.magnitude(known[entry.name])))[1] - 15)
        for entry in one.chain.structure.inputs
    ]


def raw(one, lanes):
    """Counts [updates][inputs][lanes] as signed 16-bit numbers: the first input takes every
    value.
    """
    lane = (np.arange(lanes, dtype=np.int64) * (65536 // lanes)) & 0xFFFF
    updates = UPDATES if one.chain.structure.interval_s is not None else 1
    rows = []
    for j in range(updates):
        row = []
        for i in range(len(one.chain.structure.inputs)):
            counts = (lane * STRIDES[i] + 977 * i + 24 * (i + 1) * j) & 0xFFFF
            row.append(np.where(counts >= 32768, counts - 65536, counts))
        rows.append(row)
    return rows


def expected(one, lanes):
    """Number that the twin's outputs and statuses make."""
    program, names = one.program, [entry.name for entry in one.chain.structure.inputs]
    state = twin.reset(program, lanes) if one.chain.structure.interval_s is not None else None
    rows, total = raw(one, lanes), 0
    outputs = [output.name for output in one.chain.structure.outputs]
    for j, row in enumerate(rows):
        words = {}
        for name, counts, unit in zip(names, row, units(one), strict=True):
            words[name] = (counts * unit).astype(twin.dtype(program))
        if state is None:
            result = twin.call(program, words)
        else:
            places = (7 * np.arange(lanes) + 3 * j) % len(PAUSES)
            elapsed = np.array(PAUSES)[places] * one.chain.structure.interval_ms // 1000
            result = twin_clock.update(program, words, elapsed, state)
            state = result.after
        index = (np.arange(lanes) * len(rows) + j) * (2 * len(outputs) + 1)
        total = (total + mixed(result.status, index)) & 0xFFFFFFFF
        for k, output in enumerate(outputs):
            for half, word in enumerate(bits(program, result.outputs[output])):
                total = (total + mixed(word, index + 1 + 2 * k + half)) & 0xFFFFFFFF
    return total


def bits(program, words):
    """Words of 32 bits of a number, one of a double's two after the other; one pattern for every
    NaN.
    """
    if program.format.bits == 24:
        return [np.where(np.isnan(words), 0x7FC00000, words.astype(np.float32).view(np.uint32))]
    whole = np.where(np.isnan(words), np.uint64(0x7FF8000000000000), words.view(np.uint64))
    return [whole & np.uint64(0xFFFFFFFF), whole >> np.uint64(32)]


def mixed(word, index):
    """Sum over lanes of a hash of words and their places."""
    h = word.astype(np.uint32) ^ (index.astype(np.uint32) * np.uint32(2654435761))
    h = (h ^ (h >> np.uint32(15))) * np.uint32(0x85EBCA6B)
    h = (h ^ (h >> np.uint32(13))) * np.uint32(0xC2B2AE35)
    return int(h.astype(np.uint64).sum()) & 0xFFFFFFFF


COMMON = """
#include <stdint.h>
#ifndef LANES
#define LANES 65536U
#endif
#ifdef BARE
static void put(const char *text)
{
    register uint32_t r0 __asm__("r0") = 4U;
    register const char *r1 __asm__("r1") = text;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}
#else
#include <stdio.h>
static void put(const char *text) { (void)fputs(text, stdout); }
#endif
static uint32_t mixed(uint32_t word, uint32_t index)
{
    uint32_t h = word ^ (index * 2654435761U);
    h = (h ^ (h >> 15)) * 0x85EBCA6BU;
    return (h ^ (h >> 13)) * 0xC2B2AE35U;
}
static int32_t count_of(uint32_t lane, uint32_t i, uint32_t j)
{
    static const uint32_t strides[4] = {1U, 40503U, 30029U, 20011U};
    const uint32_t k = (lane * (65536U / LANES)) & 0xFFFFU;
    const uint32_t c = (k * strides[i] + 977U * i + 24U * (i + 1U) * j) & 0xFFFFU;
    return (c >= 32768U) ? (int32_t)c - 65536 : (int32_t)c;
}
static uint32_t pause(uint32_t lane, uint32_t j)
{
    static const uint32_t pauses[8] = {1000U, 1000U, 250U, 3000U, 1000U, 900U, 1200U, 70000U};
    return pauses[(7U * lane + 3U * j) % 8U];
}
static void say(const char *name, uint32_t total, int32_t failed)
{
    static const char digits[] = "0123456789abcdef";
    char text[12];
    uint32_t k;
    put(name);
    text[0] = ' ';
    for (k = 0U; k < 8U; k++) { text[1U + k] = digits[(total >> (28U - 4U * k)) & 0xFU]; }
    text[9] = (failed == 0) ? '+' : '-';
    text[10] = '\\n';
    text[11] = '\\0';
    put(text);
}
typedef union { float f; uint32_t u; } single;
typedef union { double f; uint64_t u; } twice;
static uint32_t sum_float(float x, uint32_t index)
{
    single s;
    s.f = x;
    if ((s.u & 0x7FFFFFFFU) > 0x7F800000U) { s.u = 0x7FC00000U; }
    return mixed(s.u, index);
}
static uint32_t sum_double(double x, uint32_t index)
{
    twice s;
    s.f = x;
    if ((s.u & 0x7FFFFFFFFFFFFFFFULL) > 0x7FF0000000000000ULL) { s.u = 0x7FF8000000000000ULL; }
    return mixed((uint32_t)s.u, index) + mixed((uint32_t)(s.u >> 32), index + 1U);
}
"""

BARE = """
#ifdef BARE
extern uint32_t stack_top;
void reset(void);
__attribute__((section(".vectors"), used)) static void *const vectors[2] = {&stack_top, (void *)reset};
int main(void);
void reset(void)
{
#ifdef __ARM_FP
    *(volatile uint32_t *)0xE000ED88U |= 0xFU << 20;
    __asm__ volatile("dsb\\n isb");
#endif
    (void)main();
    {
        register uint32_t r0 __asm__("r0") = 0x18U;
        register uint32_t r1 __asm__("r1") = 0x20026U;
        __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    }
    for (;;) { }
}
#endif
"""

LINKER = """
MEMORY { FLASH (rx) : ORIGIN = 0x00000000, LENGTH = 256K RAM (rwx) : ORIGIN = 0x20000000, LENGTH = 16K }
stack_top = ORIGIN(RAM) + LENGTH(RAM);
SECTIONS {
    .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) } > FLASH
    .ARM.exidx : { *(.ARM.exidx*) } > FLASH
    .data : { *(.data*) *(.bss*) *(COMMON) } > RAM
}
"""


def driver(exports):
    """Text of the program."""
    return "\n".join(
        [
            '#include "all.c"',
            COMMON,
            *(_function(one) for one in exports),
            "int main(void)\n{",
            *(f"    run_{one.prefix}();" for one in exports),
            "    return 0;\n}",
            BARE,
        ]
    )


def _function(one):
    """One chain over all lanes."""
    program, p = one.program, one.prefix
    memory = one.chain.structure.interval_s is not None
    outputs = one.chain.structure.outputs
    kind, lines = program.format.c_type, []
    for i, (entry, unit) in enumerate(zip(one.chain.structure.inputs, units(one), strict=True)):
        value = f"({kind})count_of(lane, {i}U, j) * ({kind}){unit!r}"
        lines.append(f"            in.{entry.name} = {value};")
    elapsed = f"pause(lane, j) * {one.chain.structure.interval_ms}U / 1000U"
    call = f"{p}_update(&state, {elapsed}, &in, &out)" if memory else f"{p}_correct(&in, &out)"
    lines.append(
        f"            index = (lane * {UPDATES if memory else 1}U + j) * {2 * len(outputs) + 1}U;"
    )
    lines.append(f"            total += mixed({call}, index);")
    lines += [
        f"            total += sum_{kind}(out.{o.name}, index + {1 + 2 * k}U);"
        for k, o in enumerate(outputs)
    ]
    return (
        f"static void run_{p}(void)\n{{\n    uint32_t total = 0U, lane, j, index;\n    {p}_in in;\n"
        f"    {p}_out out;\n"
        + (f"    {p}_state state;\n" if memory else "")
        + "    for (lane = 0U; lane < LANES; lane++) {\n"
        + (f"        {p}_reset(&state);\n" if memory else "")
        + f"        for (j = 0U; j < {UPDATES if memory else 1}U; j++) {{\n"
        + "\n".join(lines)
        + f'\n        }}\n    }}\n    say("{p}", total, {p}_selftest());\n}}\n'
    )


C_ONLY = ("-Wstrict-prototypes", "-Wmissing-prototypes")


WARNINGS = (
    *(
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Wconversion",
        "-Wsign-conversion",
        "-Wdouble-promotion",
        "-Wfloat-equal",
    ),
    *("-Wshadow", "-Wundef", "-Wcast-qual", "-Werror"),
)
