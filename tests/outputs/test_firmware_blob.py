"""Blobs: bytes of one unit, the C that takes them, every damage refused, and the same numbers read
again.
"""

import shutil
import struct
import subprocess
import zlib
from dataclasses import replace

import pytest

from calibkit import instruments
from calibkit.firmware import blob, c_code, chain, export, formats
from calibkit.recipe import tables
from conftest import ROOT, slow_after
from outputs import firmware_damage, page_parser
from outputs.firmware_driver import C_ONLY, IDENTITY, WARNINGS, exported
from outputs.firmware_runs import cached

CHAINS = ("lagged", "grown", "gradient", "affine", "k", "rate", "scale")
DRIVER = """#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "unit.h"

static uint8_t bytes[1048576];
static uint8_t damaged[1048576];
static unit_unit one;
static unit_unit other;

static void seen(const unit_unit *unit)
{
    (void)printf("%d '%s' %u '%s' %d;", (int)unit_selftest(unit), unit_serial(unit),
        (unsigned)unit_revision(unit), unit_date(unit),
        (unit_digest(unit) != NULL) ? (int)unit_digest(unit)[0] : -1);
}

/* argument: whole | flips | cuts | slots; the blob on standard input */
int main(int count, char **arguments)
{
    const uint32_t size = (uint32_t)fread(bytes, 1U, sizeof bytes, stdin);
    const char what = (count < 2) ? 'w' : arguments[1][0];
    uint32_t wrong = 0U;
    uint32_t i;

    if (what == 'w') {
        const uint32_t before = (uint32_t)unit_selftest(&one);
        const uint32_t reason = unit_load(&one, bytes, size, NULL, 0U);

        (void)printf("%u %u %d", (unsigned)before, (unsigned)reason, (int)unit_selftest(&one));
    } else if (what == 'f') {
        for (i = 0U; i < (size * 8U); i++) {
            bytes[i / 8U] = (uint8_t)(bytes[i / 8U] ^ (1U << (i % 8U)));
            wrong += (unit_load(&one, bytes, size, NULL, 0U) == UNIT_LOADED) ? 1U : 0U;
            wrong += (unit_selftest(&one) == 0) ? 1U : 0U;
            bytes[i / 8U] = (uint8_t)(bytes[i / 8U] ^ (1U << (i % 8U)));
        }
        (void)printf("%u of %u", (unsigned)wrong, (unsigned)(size * 8U));
    } else if (what == 'c') {
        for (i = 0U; i < size; i++) {
            damaged[i] = bytes[i];
            wrong += (unit_load(&one, damaged, i, NULL, 0U) == UNIT_LOADED) ? 1U : 0U;
        }
        (void)printf("%u of %u", (unsigned)wrong, (unsigned)size);
    } else {
        seen(&one);
        (void)printf(" %u ", (unsigned)unit_load(&one, bytes, size, "FW-1", 1U));
        seen(&one);
        (void)memcpy(damaged, bytes, size);
        damaged[size / 2U] ^= 1U;
        (void)printf(" %u %u %u %u %u ", (unsigned)unit_load(&one, damaged, size, NULL, 0U),
            (unsigned)unit_load(&one, bytes, size, "FW-2", 0U),
            (unsigned)unit_load(&one, bytes, size, "FW-", 0U),
            (unsigned)unit_load(&one, bytes, size, "FW-11", 0U),
            (unsigned)unit_load(&one, bytes, size, "FW-1", 2U));
        seen(&one);
        seen(&other);
        (void)printf(" %u ", (unsigned)unit_load(&one, bytes, size, NULL, 1U));
        seen(&one);
        unit_init(&one);
        seen(&one);
    }
    return 0;
}
"""


def export_of(name, number, factory, prefix="unit"):
    """One of the test runs in a number format."""
    return exported(cached(name, factory).chain, number, prefix)


def built(export, folder, compiler="gcc", *options):
    """Compile loader and driver; returns what runs a blob through it."""
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    (folder / "unit.h").write_bytes(c_code.loader_header(export))
    (folder / "unit.c").write_bytes(c_code.loader_source(export))
    (folder / "driver.c").write_text(DRIVER)
    flags = ("-std=c99", *WARNINGS, *C_ONLY, "-O2", "-ffp-contract=off", *options)
    command = (compiler, *flags, "unit.c", "driver.c", "-o", f"unit_{compiler}")
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[:3000]

    def run(content, what="whole"):
        arguments = [str(folder / f"unit_{compiler}"), what]
        done = subprocess.run(
            arguments, input=content, capture_output=True, check=False, timeout=120
        )
        assert done.returncode == 0, done.stderr[:2000]
        assert not done.stderr
        return done.stdout.decode()

    return run


def sealed(content):
    """A blob with its CRC made right again."""
    return content[:-4] + struct.pack("<I", zlib.crc32(content[:-4]))


@pytest.mark.parametrize("number", ["f32", "f64"])
@pytest.mark.parametrize("name", slow_after(3, CHAINS))
def test_a_blob_loads_and_gives_the_results_that_it_states(
    tmp_path, tmp_path_factory, name, number
):
    """Self-test fails before the load; load returns 0; self-test passes: on gcc with the
    undefined-behaviour sanitizer.
    """
    export = export_of(name, number, tmp_path_factory)
    run = built(export, tmp_path, "gcc", "-fsanitize=undefined", "-fno-sanitize-recover")
    assert run(blob.render(export)) == "1 0 0"


def test_a_refused_load_leaves_the_good_numbers_and_says_why(tmp_path, tmp_path_factory):
    """A damaged blob, that of another device (also with a serial that is longer or shorter), an
    older revision: the numbers in use stay, another instance knows nothing of them, and a good
    load changes over to the other slot.
    """
    export = export_of("lagged", "f32", tmp_path_factory)
    run = built(export, tmp_path, "gcc", "-fsanitize=address,undefined", "-fno-sanitize-recover")
    none, loaded = "1 '' 0 '' -1;", "0 'FW-1' 1 '2026-11-21' 0;"
    expected = f"{none} 0 {loaded} 5 10 10 10 11 {loaded}{none} 0 {loaded}{none}"
    assert run(blob.render(export), "slots") == expected


@pytest.mark.parametrize("name", slow_after(1, ["scale", "lagged", "level"]))
def test_bursts_and_mutants_with_a_right_crc_do_no_harm(name, tmp_path, tmp_path_factory):
    """500 of each, every bit and every length under the sanitizers of addresses and undefined
    behaviour: no flip, cut or burst is taken, no load is long, and a mutant that is taken though
    its vectors are intact is the blob within a few tolerances. 10,000 of each are `.ci/nightly`.
    """
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    one = export_of(name, "f32", tmp_path_factory)
    found = firmware_damage.damage(one, tmp_path, 500, every_bit=True)
    assert found["flipped"] == found["bursts"] == 0
    assert found["intact"] > 10
    assert found["apart"] < 4.0
    assert found["longest_s"] < 1.0


def test_every_flipped_bit_and_every_truncation_is_refused(tmp_path, tmp_path_factory):
    """All bits of a blob, one at a time, and all its lengths: not one is loaded, and nothing is
    corrected afterwards.
    """
    export = export_of("scale", "f32", tmp_path_factory)
    content = blob.render(export)
    run = built(export, tmp_path)
    assert run(content, "flips") == f"0 of {len(content) * 8}"
    assert run(content, "cuts") == f"0 of {len(content)}"


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("nan", 8),
        ("range", 8),
        ("coefficient", 9),
        ("layout", 6),
        ("schema", 4),
        ("rejected", 7),
        ("magic", 3),
    ],
)
def test_a_blob_with_a_right_crc_and_a_wrong_content_is_refused(
    tmp_path, tmp_path_factory, how, reason
):
    """NaN, a range without a width, one changed coefficient, another layout or schema, a rejected
    run: each by its reason.
    """
    export = export_of("scale", "f32", tmp_path_factory)
    content, names = bytearray(blob.render(export)), blob.shape(export.program).tables
    start, at = blob.HEADER.size, {}
    for name, length in names:
        at[name] = start
        start += 4 * length
    inputs = {entry.table for entry in export.chain.structure.inputs}
    first = next(name for name, _ in names if name not in inputs)
    ranged = next(name for name, _ in names if name in inputs)
    if how == "nan":
        content[at[first] : at[first] + 4] = struct.pack("<f", float("nan"))
    elif how == "range":
        content[at[ranged] + 4 : at[ranged] + 8] = content[at[ranged] : at[ranged] + 4]
    elif how == "coefficient":
        (value,) = struct.unpack_from("<f", content, at[first])
        struct.pack_into("<f", content, at[first], value * 1.01 + 0.01)
    else:
        offset, new = {"layout": (16, 0), "schema": (4, 2), "rejected": (14, 0), "magic": (0, 88)}[
            how
        ]
        content[offset] = new if content[offset] != new else new + 1
    assert built(export, tmp_path)(sealed(bytes(content))).split()[1:] == [str(reason), "1"]


def with_orders(this, order):
    """Chain of a fitted run whose polynomials over temperature end at an order."""
    records = {}
    for name, record in this.run.records.items():
        models = []
        for model in record.models:
            kept = [
                c for c in model.coefficients if c.name[0] not in "ps" or int(c.name[1:]) <= order
            ]
            size = len(kept)
            cut = tuple(tuple(row[:size]) for row in model.covariance[:size])
            models.append(replace(model, coefficients=tuple(kept), covariance=cut))
        records[name] = replace(record, models=tuple(models))
    chain = instruments.optional(this.run.document["procedure"], "chain")
    return lambda spec: chain(spec, records)


@pytest.mark.parametrize("name", ["rate", "triad", "scale"])
def test_one_loader_takes_devices_of_all_orders(name, tmp_path_factory):
    """Tables are padded to the largest order of the form, unless the recipe asks for fitted ones:
    a device whose scale factor is straight over temperature has the layout of one with a cubic.
    """
    this = cached(name, tmp_path_factory)
    fitted = this.spec.model_copy(update={"export": tables.ExportTable(layout="fitted")})
    found = {"padded": set(), "fitted": set()}
    for order in (0, 1, 3):
        chain = with_orders(this, order)
        for layout, spec in (("padded", this.spec), ("fitted", fitted)):
            quantised = chain(spec).quantise(formats.Format.find("f32"))
            found[layout].add(blob.shape(quantised).digest)
    assert len(found["padded"]) == 1
    assert len(found["fitted"]) > 1


GOLDEN = sorted((ROOT / "tests" / "golden_blobs").glob("*.bin"))


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: path.stem)
def test_blobs_of_older_schemas_are_read_again(path):
    """Blobs that calibkit 0.1.0 wrote, and one of each schema since: their vectors are recomputed
    from their numbers; a drift without a clock too.
    """
    said = blob.verify(path.name, path.read_bytes())
    assert said.startswith("blob of GOLDEN-1 revision 3")
    assert "vectors recomputed" in said


@pytest.mark.parametrize(
    "stem", ["scale_f32_1.0", "scale_f64_1.0", "scale_f32_1.2", "lagged_f32_1.2"]
)
def test_blobs_of_older_schemas_load(stem, tmp_path):
    """A loader of today for the layout of an older blob takes it; layouts whose meaning was changed
    since (indications that were clamped, a drift without a clock) need the loader that was exported
    with them.
    """
    path = ROOT / "tests" / "golden_blobs" / f"{stem}.bin"
    content = path.read_bytes()
    head = blob.HEADER.unpack_from(content)
    read, stated = blob._read(content, head[4], head[6], head[-2], head[-1], path.name)
    assert blob.shape(read).digest == head[6]
    known = chain.Chain(read.structure, read.tables)
    one = export.FirmwareRun("unit", IDENTITY, known, read, {}, {}, stated)
    assert built(one, tmp_path)(content) == "1 0 0"


@pytest.mark.parametrize(
    "name", ["affine", "rate", "scale", "triad", "lagged", "level", "gradient", "grown"]
)
def test_a_parser_written_from_the_page_alone_reads_a_blob_and_gives_its_results(
    name, tmp_path_factory
):
    """Header, layout, tables and vectors as docs/firmware.md has them: results within
    the stated tolerances, in double precision, and every status, by the clock too.
    """
    found = page_parser.Blob(blob.render(export_of(name, "f32", tmp_path_factory)))
    count, rows = len(found.inputs), list(zip(found.rows, found.run(), strict=True))
    assert len(rows) > 10
    assert found.pace is None or any(row[-2] for row, _ in rows)
    for row, (outputs, status) in rows:
        for k, (value, allowed) in enumerate(zip(outputs, found.allowed, strict=True)):
            assert abs(value - row[count + k]) <= allowed
        assert status == round(row[-1])
