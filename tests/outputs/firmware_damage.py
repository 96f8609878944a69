"""A C program that damages a blob in many ways and loads what comes out, under the sanitizers of
addresses and undefined behaviour: every bit wrong and every truncation, bursts of wrong bits, and
mutants whose CRC was made right again. It counts what is accepted, how long the longest load took,
and by how many tolerances an accepted mutant whose vectors are intact differs from the blob over
300 calls. The command prints what was taken, a row per chain.

    PYTHONPATH=.:tests python -m outputs.firmware_damage [COUNT] [SEED]

COUNT bursts and mutants a chain, 10000 unless given.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from types import SimpleNamespace

from calibkit.firmware import blob, c_code

SANITIZED = ("-std=c99", "-O1", "-g", "-w", "-ffp-contract=off")
SANITIZERS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
PROGRAM = Path(__file__).with_suffix(".c")


def program(export):
    """Text of the program for the loader of one chain."""
    structure = export.structure
    known = export.chain.find_ranges(usual=False).values
    spans = [known[entry.name] for entry in structure.inputs]
    fields = "\n".join(f"    in->{e.name} = (@real)x[{k}];" for k, e in enumerate(structure.inputs))
    calls = "        (void)unit_correct(a, &in, &x); (void)unit_correct(b, &in, &y);"
    begin = ""
    if structure.has_memory:
        begin = "    unit_state s, t;\n    unit_reset(&s); unit_reset(&t);"
        calls = "\n".join(
            f"        (void)unit_update({one}, &{state}, k % 10U == 9U ? 10000000U :"
            f" UNIT_INTERVAL_MS, &in, &{out});"
            for one, state, out in (("a", "s", "x"), ("b", "t", "y"))
        )
    size = export.program.format.size
    compare = "\n".join(
        f"        found = fmax(found, fabs((double)x.{o.name} - (double)y.{o.name})"
        f" / (double)unit_number(&a->slots[a->active - 1U].tests[{k * size}]));"
        for k, o in enumerate(structure.outputs)
    )
    text = PROGRAM.read_text(encoding="ascii")
    for mark, filled in {
        "@fields": fields,
        "@begin": begin,
        "@calls": calls,
        "@compare": compare,
        "@inputs": str(len(spans)),
        "@least": ", ".join(repr(float(low)) for low, _ in spans),
        "@most": ", ".join(repr(float(high)) for _, high in spans),
        "@size": str(export.program.format.size),
        "@real": export.program.format.c_type,
    }.items():
        text = text.replace(mark, filled)
    return text


def damage(export, folder, times, seed=1, timeout=300, *, every_bit=False):
    """What the program counts: flips and cuts, bursts and mutants that were taken, the worst
    difference of an accepted mutant with intact vectors [tolerances], the longest load [s].
    """
    (folder / "unit.h").write_bytes(c_code.loader_header(export))
    (folder / "unit.c").write_bytes(c_code.loader_source(export))
    (folder / "damage.c").write_text(program(export))
    command = ("gcc", *SANITIZED, *SANITIZERS, "damage.c", "-lm", "-o", "damage")
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:3000]
    done = subprocess.run(
        [str(folder / "damage"), str(times), str(seed), *(["every"] if every_bit else [])],
        input=blob.render(export),
        capture_output=True,
        check=False,
        timeout=timeout,
    )
    said = done.stdout.decode()
    assert done.returncode == 0, said + done.stderr.decode()[:3000]
    flipped, taken, mutants, intact = (int(x) for x in re.findall(r"(?:taken|intact) (\d+)", said))
    apart, longest = (float(x) for x in re.findall(r"(?:apart|longest) ([\d.e+-]+|inf)", said))
    return {
        "flipped": flipped,
        "bursts": taken,
        "mutants": mutants,
        "intact": intact,
        "apart": apart,
        "longest_s": longest,
    }


def main():
    """Damage the blobs of several chains."""
    from outputs import firmware_runs
    from outputs.firmware_driver import exported

    given = [int(x) for x in sys.argv[1:]]
    times, seed = (*given, *(10000, 1)[len(given) :])
    assert shutil.which("gcc"), "gcc is not installed"
    write = sys.stdout.write
    write(f"seed {seed}, {times} bursts and {times} mutants a chain, f32\n\n")
    write(
        "| chain | bytes | bits and lengths: taken | bursts: taken | mutants: taken |"
        " vectors intact | off by [tolerances] | longest load [s] |\n" + "|---" * 8 + "|\n"
    )
    for name in ("scale", "affine", "rate", "lagged", "level", "gradient", "grown"):
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            chain = firmware_runs.cached(
                name, SimpleNamespace(getbasetemp=partial(Path, place))
            ).chain
            one = exported(chain, "f32", "unit")
            found = damage(one, folder, times, seed, timeout=3600, every_bit=True)
            write(
                f"| {name} | {len(blob.render(one))} | {found['flipped']} | {found['bursts']} |"
                f" {found['mutants']} | {found['intact']} | {found['apart']:.2g} |"
                f" {found['longest_s']:.2g} |\n"
            )
            sys.stdout.flush()
            assert found["flipped"] + found["bursts"] == 0


if __name__ == "__main__":
    main()
