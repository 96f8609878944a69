"""Generated C: compilers, standards, warnings, sanitizers, cores, every temperature against the
twin, mutations, MISRA.
"""

import re
import shutil
import subprocess
from dataclasses import replace

import pytest

from calibkit.firmware import ranges, steps as chain_steps, vectors
from conftest import slow_after
from outputs.firmware_driver import C_ONLY, COMMON, LINKER, WARNINGS, expected, exported, write
from outputs.firmware_runs import RUNS, cached

HOST_LANES, CORE_LANES = 65536, 1024
CORES = {
    "cortex-m0": ("microbit", ()),
    "cortex-m3": ("mps2-an385", ()),
    "cortex-m4": ("mps2-an386", ("-mfpu=fpv4-sp-d16", "-mfloat-abi=hard")),
    "cortex-m7": ("mps2-an500", ("-mfpu=fpv5-d16", "-mfloat-abi=hard")),
}
ARM = "arm-none-eabi-gcc"
DOUBLE = ("lagged", "grown", "affine", "rate")


def needs(tool):
    """Skip where a tool is missing, and say so."""
    if shutil.which(tool) is None:
        pytest.skip(f"{tool} is not installed")


def ran(*command, cwd):
    """Run a command that must succeed; returns what it printed."""
    done = subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr[:3000]
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def exports(tmp_path_factory):
    """Return every chain in single precision and some in double: test_firmware_blob has all."""
    chosen = [*((name, "f32") for name in RUNS), *((name, "f64") for name in DOUBLE)]
    return [
        exported(cached(name, tmp_path_factory).chain, number, f"{name}_{number}")
        for name, number in chosen
    ]


@pytest.fixture(scope="module")
def sources(exports, tmp_path_factory):
    """Return the folder with their headers, sources and the driver."""
    folder = tmp_path_factory.mktemp("c")
    write(exports, folder)
    (folder / "core.ld").write_text(LINKER)
    return folder


_TWINS = {}


def remembered(one, lanes):
    """Number that the twin makes, worked out once."""
    if (one.prefix, lanes) not in _TWINS:
        _TWINS[one.prefix, lanes] = expected(one, lanes)
    return _TWINS[one.prefix, lanes]


def said(text):
    """Prefix → hash of all outputs with the self-test's verdict, from what the driver printed."""
    return dict(
        line.split() for line in text.splitlines() if re.fullmatch(r"\w+ [0-9a-f]{8}[+-]", line)
    )


@pytest.mark.parametrize("standard", slow_after(1, ["c99", "c11", "c17"]))
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_sources_compile_without_a_warning_under_every_c_standard(compiler, standard, sources):
    """All warnings are errors; nothing but the C language is used."""
    needs(compiler)
    ran(compiler, f"-std={standard}", *WARNINGS, *C_ONLY, "-fsyntax-only", "all.c", cwd=sources)


HOSTILE = 'a*/ int stolen; /*/ "\\" ?\u003f/\n#error\n é\x01 @p_ @real */ int other; \\'


@pytest.mark.parametrize("compiler", [("gcc", "-std=c99"), ("g++", "-x", "c++", "-std=c++11")])
def test_texts_enter_c_only_escaped(compiler, exports, tmp_path):
    """Whatever serial, date, form, formula and sources hold, the header and the source compile to
    what they were, and the serial is the text's own bytes.
    """
    needs(compiler[0])
    first = exports[0]
    structure = replace(first.structure, forms=(HOSTILE,), formula=HOSTILE)
    hostile = replace(
        first,
        identity=replace(first.identity, serial=HOSTILE, effective_from=HOSTILE, software=HOSTILE),
        chain=replace(first.chain, structure=structure, ranges=(HOSTILE,)),
        sources=(HOSTILE,),
    )
    write([hostile], tmp_path)
    ran(*compiler, *WARNINGS, "-fsyntax-only", "all.c", cwd=tmp_path)
    (tmp_path / "say.c").write_text(
        f'#include "all.c"\n#include <stdio.h>\n'
        "int stolen = 7, other = 8;\nint main(void) {\n"
        f"return fputs({hostile.prefix.upper()}_SERIAL, stdout) < 0 || stolen + other != 15; }}\n"
    )
    ran(*compiler, "-o", "say", "say.c", cwd=tmp_path)
    done = subprocess.run([tmp_path / "say"], capture_output=True, check=True, timeout=20)
    assert done.stdout == HOSTILE.encode()


@pytest.mark.parametrize(
    "command",
    slow_after(
        1,
        [
            "gcc -O2 -ffp-contract=off",
            "clang -O2 -ffp-contract=off",
            "gcc -O1 -ffp-contract=off -fsanitize=undefined -fno-sanitize-recover=all",
        ],
    ),
)
def test_every_representable_temperature_gives_the_twins_bits_on_the_host(
    command, sources, exports, tmp_path
):
    """All 65,536 values of the first input, the others in step, NaN words and clamping included; no
    undefined behaviour.
    """
    compiler, *flags = command.split()
    needs(compiler)
    program = tmp_path / "host"
    ran(compiler, "-std=c99", *flags, "driver.c", "-o", str(program), cwd=sources)
    found = said(ran(str(program), cwd=tmp_path))
    assert found == {one.prefix: f"{remembered(one, HOST_LANES):08x}+" for one in exports}


@pytest.mark.parametrize("core", slow_after(1, CORES))
def test_emulated_cores_give_the_twins_bits_without_a_library(core, sources, exports, tmp_path):
    """Cortex-M0, M3, M4F and M7 under qemu-system-arm; linked with the compiler's own arithmetic
    alone.
    """
    needs(ARM)
    needs("qemu-system-arm")
    machine, flags = CORES[core]
    image = tmp_path / "image.elf"
    options = (
        "-mthumb",
        f"-mcpu={core}",
        *flags,
        "-O1",
        "-ffp-contract=off",
        "-ffreestanding",
        "-std=gnu99",
    )
    bare = ("-DBARE", f"-DLANES={CORE_LANES}U", "-nostdlib", "-T", "core.ld", "driver.c", "-lgcc")
    ran(ARM, *options, *bare, "-o", str(image), cwd=sources)
    console = ("-nographic", "-semihosting-config", "enable=on,target=native")
    found = said(
        ran("qemu-system-arm", "-M", machine, *console, "-kernel", str(image), cwd=tmp_path)
    )
    assert found == {one.prefix: f"{remembered(one, CORE_LANES):08x}+" for one in exports}


def test_contraction_to_fused_multiply_add_stays_within_the_self_tests_tolerance(sources, tmp_path):
    """With -ffp-contract=fast on a core that fuses, bits differ and every self-test still
    passes.
    """
    needs(ARM)
    needs("qemu-system-arm")
    image, flags = tmp_path / "fused.elf", CORES["cortex-m7"][1]
    options = (
        "-mthumb",
        "-mcpu=cortex-m7",
        *flags,
        "-O2",
        "-ffp-contract=fast",
        "-ffreestanding",
        "-std=gnu99",
    )
    ran(
        ARM,
        *options,
        "-DBARE",
        "-DLANES=16U",
        "-nostdlib",
        "-T",
        "core.ld",
        "driver.c",
        "-lgcc",
        "-o",
        str(image),
        cwd=sources,
    )
    assembly = ran("arm-none-eabi-objdump", "-d", str(image), cwd=tmp_path)
    assert "vfma.f32" in assembly
    console = ("-nographic", "-semihosting-config", "enable=on,target=native")
    found = said(
        ran("qemu-system-arm", "-M", "mps2-an500", *console, "-kernel", str(image), cwd=tmp_path)
    )
    assert len(found) == len(RUNS) + len(DOUBLE)
    assert all(verdict.endswith("+") for verdict in found.values())


@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_fast_math_is_refused_and_the_self_test_can_be_left_out(compiler, sources, tmp_path):
    """-ffast-math would delete the guard against NaN; CAL_NO_SELFTEST removes the vectors and their
    function.
    """
    needs(compiler)
    fast = subprocess.run(
        [compiler, "-ffast-math", "-fsyntax-only", "lagged_f32.c"],
        cwd=sources,
        capture_output=True,
        text=True,
        check=False,
    )
    assert fast.returncode != 0
    assert "guard against NaN" in fast.stderr
    ran(
        compiler,
        "-DCAL_NO_SELFTEST",
        *WARNINGS,
        "-std=c99",
        "-c",
        "lagged_f32.c",
        "-o",
        str(tmp_path / "x.o"),
        cwd=sources,
    )
    assert "selftest" not in ran("nm", str(tmp_path / "x.o"), cwd=tmp_path)


CONSTANT = re.compile(r"static const (?!uint32_t)\w+ (\w+)(?:\[\w+\])? = ([^;]*);")
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d*)?(?:e[-+]?\d+)?(?=F?\b)")
CODE = (
    ("const float u = (x - map->middle)", "const float u = (x + map->middle)"),
    ("y = (y * x) + c[k - 1U];", "y = (y * x) - c[k - 1U];"),
    ("for (k = count - 1U; k > 0U; k--)", "for (k = count - 1U; k > 1U; k--)"),
    ("float y = c[count - 1U];", "float y = c[0];"),
    ("if (x < range[0])", "if (x > range[0])"),
    ("} else if (x > range[1])", "} else if (x < range[1])"),
    ("*status |= flag;", "*status |= 0U;"),
    ("history[i] = history[i - 1U];", "history[i] = history[i];"),
    ("history[0] = x;", "history[1] = x;"),
    ("state->lag = lag;", "state->lag = x;"),
    ("state->fall = fall;", ""),
    ("state->x = x;", ""),
    ("state->increment = increment;", ""),
    ("state->waited_ms += elapsed_ms;", ""),
    ("state->waited_ms %= ", "state->waited_ms += "),
    ("status |= M_STARTING;", ""),
    ("state->in.temp_case_degc = in->temp_case_degc;", ""),
    ("from->temp_case_degc + ((", "from->temp_case_degc - (("),
    ("if (k < count) {", "if (k > count) {"),
    ("(count <= M_LONGEST) &&", "(count > M_LONGEST) &&"),
    ("? 1U : count;", "? 1U : 1U;"),
    ("state->lag = 0.0F;\n        }\n        for", "}\n        for"),
    ("return ((away < -most) || (away > most))", "return ((away > -most) || (away > most))"),
    ("state->drift = drift;", ""),
    ("state->updates++;", ""),
    ("status |= status_heating;", "status |= status_cooling;"),
    ("out->accel_y_g = k_y;", "out->accel_y_g = k_x;"),
    ("out->drift_dph = drift;", "out->drift_dph = -drift;"),
)
"""Faults of the code: what stands there, and what might."""


def mutants(one, text):
    """What is wrong, and the text of a source, with one number doubled (a 0 made 1/16) or one line
    of code wrong.

    Left out is what no test can see: the padding of rows of weights, the limit of a summed drift,
    which lies thousands of updates away, ranges within which a map limits again, and coefficients
    below the resolution of the format.
    """
    body, _, test = text.partition("#ifndef CAL_NO_SELFTEST")
    untold, found = immaterial(one), []
    ranges_within = {entry.table for entry in one.chain.structure.inputs if not entry.flag} | {
        "drift_limits",
        *unheard(one),
    }
    for constant in CONSTANT.finditer(body):
        table = constant.group(1).removeprefix(f"{one.prefix}_")
        for place, number in enumerate(NUMBER.finditer(constant.group(2))):
            value = float(number.group())
            padding = value == 0.0 and table.endswith("_weights")
            wide = (
                table in {"x_map", "wide_gradient_map"}
                and place > 1
                and bool(one.chain.structure.slopes)
            )
            never = table == "pace" and value == 0.0  # without lags nothing is starting
            if padding or never or wide or table in ranges_within or (table, place) in untold:
                continue
            at = constant.start(2) + number.start()
            other = "0.0625" if value == 0.0 else f"{2.0 * value:.9g}"
            other = other if any(mark in other for mark in ".e") else f"{other}.0"
            changed = body[:at] + other + body[at + len(number.group()) :]
            found.append((f"{table} {number.group()}", changed + "#ifndef CAL_NO_SELFTEST" + test))
    for fault in CODE:
        right, wrong = (text.replace("M_", f"{one.prefix.upper()}_") for text in fault)
        if right in body:
            found.append((right, body.replace(right, wrong, 1) + "#ifndef CAL_NO_SELFTEST" + test))
    return found


def unheard(one):
    """Tables of steps that reach an output only through a coefficient of 0 (of a padded chain those
    of drivers that its model does not use), limits that no value reaches, and those of layers that
    count for less than the self-test allows.
    """
    heard = {output.source for output in one.chain.structure.outputs}
    steps, before = one.chain.structure.steps, set()
    while heard != before:
        before = set(heard)
        for step in (step for step in steps if step.name in heard):
            if isinstance(step, chain_steps.Sum):
                for term in step.terms:
                    if not term.table or any(one.program.tables[term.table]):
                        heard |= {term.over, *term.factors} - {""}
            else:
                heard |= {*step.sources}
    silent = [step for step in steps if step.name not in heard]
    known = one.chain.find_ranges(usual=False).values
    silent += [
        step
        for step in steps
        if isinstance(step, chain_steps.Limit)
        and ranges.magnitude(known[step.source]) < min(map(abs, one.chain.tables[step.table]))
    ]
    tables, allowed = one.chain.tables, vectors.tolerances(one.chain, one.bounds)
    for k in range(1, 1 + sum(step.name.startswith("at_") for step in steps)):
        # after a step of u the excess (0.25 − 2.5 s) and the rate 2.5 s have a product of 1/64
        largest = abs(tables[f"by_own_{k}"][1] * tables[f"rate_of_{k}"][0]) / 64
        if largest < 2.0 * allowed["drift_dph"]:
            silent += [step for step in steps if step.name == f"at_{k}"]
    return {table.name for step in silent for table in step.tables}


def immaterial(one):
    """Table and number of coefficients whose doubling moves no result, anywhere in range, by what
    the self-test allows.
    """
    if one.chain.structure.interval_s is not None:
        return set()
    allowed = vectors.tolerances(one.chain, one.bounds)
    anywhere = vectors.candidates(one.chain, one.program)
    found = vectors.find_unnoticed(one.program, anywhere, allowed)
    # the cofactors of a matrix that hardly varies with temperature have high powers of next to
    # nothing, and so have averages over orders of a line
    small = {(table, place) for table, place in found if one.program.tables[table][place]}
    most = {"triad": 60, "rate": 5}
    assert len(small) <= most.get(one.prefix.partition("_")[0], 2), small
    return found


@pytest.mark.parametrize("name", slow_after(1, RUNS))
def test_the_self_test_notices_every_changed_coefficient_and_every_fault_of_the_code(
    name, sources, exports, tmp_path
):
    """Each number of a source doubled, each line broken: compiled, run, and reported by its own
    vectors.
    """
    needs("gcc")
    prefix, one = f"{name}_f32", next(e for e in exports if e.prefix == f"{name}_f32")
    text = (sources / f"{prefix}.c").read_text()
    header = (sources / f"{prefix}.h").read_text()
    found = [("nothing", text), *mutants(one, text)]
    parts = [COMMON, header]
    for k, (_, mutant) in enumerate(found):
        renamed = re.sub(rf"\b{prefix}_(?!in\b|out\b|state\b)", f"m{k}_", mutant).replace(
            f'#include "{prefix}.h"', ""
        )
        renamed = re.sub(
            r"#define (\w+_(?:TESTS|WINDOW|WINDOW_LEAST)) ", r"#undef \1\n#define \1 ", renamed
        )
        parts.append(re.sub(r"/\*.*?\*/", "", renamed, flags=re.DOTALL))
    calls = "".join(
        f'    if (m{k}_selftest() != 0) {{ put("{k}\\n"); }}\n' for k in range(len(found))
    )
    (tmp_path / "mutants.c").write_text(
        "\n".join(parts) + f"\nint main(void)\n{{\n{calls}    return 0;\n}}\n"
    )
    ran("gcc", "-w", "-O0", "-ffp-contract=off", "mutants.c", "-o", "mutants", cwd=tmp_path)
    caught = set(map(int, ran("./mutants", cwd=tmp_path).split()))
    assert [what for k, (what, _) in enumerate(found) if k and k not in caught] == []
    assert 0 not in caught
