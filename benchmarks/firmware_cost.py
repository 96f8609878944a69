"""What generated firmware costs: bytes of flash and instructions a call, by core and number format;
and what a loader costs, with its instance struct, its load and its self-test.

    PYTHONPATH=.:tests python benchmarks/firmware_cost.py

Bytes are those of the object file without the self-test (arm-none-eabi-size, -O2). Instructions are
counted on qemu-system-arm, which runs one instruction a nanosecond of its own time: 1000 calls on
the first vector against 1000 of an empty function.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from pathlib import Path

import firmware_runs
from calibkit.firmware import blob, c_code, export, formats

RUNS = {
    "gyro K(T), F0(T)": "rate",
    "accelerometer triad, affine to third order": "affine",
    "drift, level": "level",
    "drift, lagged": "lagged",
    "drift, bank": "bank",
    "drift, bank with all parts": "grown",
}
"""Chain → its run among those of the firmware tests."""
CORES = {
    "cortex-m0": ("microbit", ()),
    "cortex-m4": ("mps2-an386", ("-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")),
}
CALLS = 1000
TICK = 40
"""Instructions a tick of SysTick: 25 MHz where an instruction takes a nanosecond."""
MAIN = """
#include "unit.h"
extern uint32_t stack_top[];
int main(void);
void reset(void);
static uint32_t call(const unit_in *in, unit_out *out) __attribute__((noinline));
static uint32_t empty(const unit_in *in, unit_out *out) __attribute__((noinline));
STATE
static uint32_t call(const unit_in *in, unit_out *out) { return CALL; }
static uint32_t empty(const unit_in *in, unit_out *out) { __asm__ volatile("" : : "r"(in), "r"(out)); return 0U; }
static void put(const char *text)
{
    register uint32_t operation __asm__("r0") = 4U;
    register const char *argument __asm__("r1") = text;
    __asm__ volatile("bkpt 0xAB" : "+r"(operation) : "r"(argument) : "memory");
}
static void print(uint32_t word)
{
    char digits[10];
    uint32_t k;
    for (k = 0U; k < 8U; k++) { digits[k] = "0123456789abcdef"[(word >> (28U - (4U * k))) & 15U]; }
    digits[8] = ' '; digits[9] = 0; put(digits);
}
#define TIMER ((volatile uint32_t *)0xE000E010U)
static uint32_t ticks(uint32_t (*f)(const unit_in *, unit_out *))
{
    static const unit_in in = {INPUT};
    unit_out out;
    uint32_t k, start;
    TIMER[1] = 0xFFFFFFU; TIMER[2] = 0U; TIMER[0] = 5U;
    start = TIMER[2];
    for (k = 0U; k < 1000U; k++) { (void)f(&in, &out); }
    return (start - TIMER[2]) & 0xFFFFFFU;
}
int main(void) { START print(ticks(empty)); print(ticks(call)); print(KEPT); return 0; }
void reset(void)
{
#ifdef __ARM_FP
    *(volatile uint32_t *)0xE000ED88U |= 0xFU << 20U;
#endif
    (void)main();
    { register uint32_t o __asm__("r0") = 0x18U; register uint32_t r __asm__("r1") = 0x20026U;
      __asm__ volatile("bkpt 0xAB" : : "r"(o), "r"(r)); }
}
__attribute__((section(".vectors"), used)) static const uintptr_t vectors[2] = {(uintptr_t)stack_top, (uintptr_t)reset};
"""
LOADED = MAIN.replace("STATE", '#include "blob.inc"\nstatic unit_unit unit;').replace(
    "return CALL;",
    "(void)in; (void)out; return what != 0U ? (uint32_t)unit_selftest(&unit)"
    " : unit_load(&unit, blob, sizeof blob, (const char *)0, 0U);",
)
LOADED = LOADED.replace("int main(void);", "int main(void);\nstatic uint32_t what;")
LOADED = LOADED.replace("k < 1000U", "k < 1U").replace("INPUT", "0")
LOADED = re.sub(
    r"\{ START print.*?return 0; \}",
    "{ print(ticks(call)); what = 1U; print(ticks(call)); print(sizeof unit); return 0; }",
    LOADED,
)
"""The same program around a loader, which loads and tests once."""
LINKER = """
MEMORY { FLASH (rx) : ORIGIN = 0, LENGTH = 256K RAM (rwx) : ORIGIN = 0x20000000, LENGTH = 16K }
stack_top = ORIGIN(RAM) + LENGTH(RAM);
SECTIONS { .text : { KEEP(*(.vectors)) *(.text*) *(.rodata*) } > FLASH .data : { *(.data*) *(.bss*) *(COMMON) } > RAM }
"""


def ran(*command: str, cwd: Path) -> str:
    """Output of a command that must succeed."""
    done = subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, check=False, timeout=120
    )
    if done.returncode:
        raise SystemExit(done.stderr)
    return done.stdout + done.stderr


def cost(one: export.FirmwareRun, folder: Path, core: str) -> tuple[int, int, int]:
    """Bytes of flash, instructions a call, and bytes of the state."""
    machine, options = CORES[core]
    memory = one.chain.structure.interval_s is not None
    texts = [
        one.program.format.text(one.vectors.inputs[entry.name][0])
        for entry in one.chain.structure.inputs
    ]
    main = MAIN.replace("INPUT", ", ".join(texts))
    main = main.replace("STATE", "static unit_state state;" if memory else "")
    main = main.replace("START", "unit_reset(&state);" if memory else "")
    main = main.replace("KEPT", "sizeof state" if memory else "0U")
    main = main.replace(
        "CALL",
        "unit_update(&state, UNIT_INTERVAL_MS, in, out)" if memory else "unit_correct(in, out)",
    )
    files = {
        "unit.h": c_code.header(one).decode(),
        "unit.c": c_code.source(one).decode(),
        "main.c": main,
        "core.ld": LINKER,
    }
    for name, text in files.items():
        (folder / name).write_text(text, encoding="ascii")
    flags = (
        "-mthumb",
        f"-mcpu={core}",
        *options,
        "-O2",
        "-ffp-contract=off",
        "-ffreestanding",
        "-DCAL_NO_SELFTEST",
    )
    ran("arm-none-eabi-gcc", *flags, "-c", "unit.c", "-o", "unit.o", cwd=folder)
    size = int(ran("arm-none-eabi-size", "unit.o", cwd=folder).splitlines()[1].split()[0])
    ran(
        "arm-none-eabi-gcc",
        *flags,
        "-nostdlib",
        "-T",
        "core.ld",
        "main.c",
        "unit.o",
        "-lgcc",
        "-o",
        "e.elf",
        cwd=folder,
    )
    console = ("-nographic", "-semihosting-config", "enable=on,target=native", "-icount", "shift=0")
    said = ran("qemu-system-arm", "-M", machine, *console, "-kernel", "e.elf", cwd=folder)
    empty, called, kept = (int(word, 16) for word in re.findall(r"[0-9a-f]{8}", said)[:3])
    tick = TICK if core != "cortex-m0" else 62  # the microbit's core runs at 16 MHz
    return size, round((called - empty) * tick / CALLS), kept


def loader_cost(one: export.FirmwareRun, folder: Path, core: str) -> tuple[int, int, int, int, int]:
    """Bytes of a loader with its self-test, of the blob and of the instance struct; instructions of
    a load and of a self-test.
    """
    machine, options = CORES[core]
    content = blob.render(one)
    (folder / "unit.h").write_bytes(c_code.loader_header(one))
    (folder / "unit.c").write_bytes(c_code.loader_source(one))
    array = f"static const uint8_t blob[{len(content)}] = {{{', '.join(map(str, content))}}};\n"
    (folder / "blob.inc").write_text(array, encoding="ascii")
    (folder / "main.c").write_text(LOADED, encoding="ascii")
    (folder / "core.ld").write_text(LINKER, encoding="ascii")
    flags = ("-mthumb", f"-mcpu={core}", *options, "-O2", "-ffp-contract=off", "-ffreestanding")
    ran("arm-none-eabi-gcc", *flags, "-c", "unit.c", "-o", "unit.o", cwd=folder)
    size = int(ran("arm-none-eabi-size", "unit.o", cwd=folder).splitlines()[1].split()[0])
    link = ("-nostdlib", "-T", "core.ld", "main.c", "unit.o", "-lgcc", "-o", "e.elf")
    ran("arm-none-eabi-gcc", *flags, *link, cwd=folder)
    console = ("-nographic", "-semihosting-config", "enable=on,target=native", "-icount", "shift=0")
    said = ran("qemu-system-arm", "-M", machine, *console, "-kernel", "e.elf", cwd=folder)
    load, test, unit = (int(word, 16) for word in re.findall(r"[0-9a-f]{8}", said)[:3])
    tick = TICK if core != "cortex-m0" else 62
    return size, len(content), unit, load * tick, test * tick


def print_loaders() -> None:
    """Print the table of loaders."""
    print(
        "\n| chain, f32 | blob: bytes | struct: bytes | core | loader: bytes | load | self-test |"
    )
    print("|---|---|---|---|---|---|---|")
    identity = export.RunIdentity(
        "U", 1, "2026-11-21", "0" * 64, {"a": "0" * 64}, "calibkit", verdict="accepted"
    )
    with tempfile.TemporaryDirectory() as place:
        for chain, name in RUNS.items():
            folder = Path(place) / name
            fitted = firmware_runs.fitted(name, folder)
            one = export.prepare(fitted.chain, identity, formats.Format.find("f32"), "unit")
            for core in CORES:
                size, content, unit, load, test = loader_cost(one, folder, core)
                print(
                    f"| {chain} | {content} | {unit} | {core} | {size} | {load:.2g} | {test:.2g} |"
                )


def main() -> None:
    """Print the tables."""
    print(
        "| chain | number | state: bytes | "
        + " | ".join(f"{core}: bytes | instructions" for core in CORES)
        + " |"
    )
    print("|---|---|---|" + "---|---|" * len(CORES))
    identity = export.RunIdentity(
        "U", 1, "2026-11-21", "0" * 64, {"a": "0" * 64}, "calibkit", verdict="accepted"
    )
    with tempfile.TemporaryDirectory() as place:
        for chain, name in RUNS.items():
            folder = Path(place) / name
            fitted = firmware_runs.fitted(name, folder)
            for number in ("f32", "f64"):
                one = export.prepare(fitted.chain, identity, formats.Format.find(number), "unit")
                found = [cost(one, folder, core) for core in CORES]
                cells = [f"{size} | {count}" for size, count, _ in found]
                print(f"| {chain} | {number} | {found[0][2]} | {' | '.join(cells)} |")
    print_loaders()


if __name__ == "__main__":
    main()
