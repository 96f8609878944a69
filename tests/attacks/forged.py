"""Sealed runs, column names, special files, marks of accreditations and signatures that a stranger
made, with digests that fit wherever a forger could compute them.
"""

import contextlib
import copy
import json
import os
import random
import shutil
import subprocess
import tomllib
from pathlib import Path

from attacks import documents, signed
from calibkit import instruments, recipe
from calibkit.certificate import certify, signature_trust, verify_signature
from calibkit.certificate.signing_key import Key
from calibkit.commands import inspection, pipeline
from calibkit.errors import CalibkitError, RecipeError
from calibkit.records import sealed, store
from outputs import authority

ROOT = Path(__file__).resolve().parents[2]
GOLDEN = ROOT / "tests" / "golden"
RUN = GOLDEN / "0.2" / "inclinometer" / "G-1" / "r001"
RECORD = "inclinometer_scale.json"
TEXTS = (
    "*/ int stolen(void) { return 1; } /*",
    '"; int stolen; char *more = "',
    "X\\",
    "X\n#error stolen\n",
    "\r\n[[exclude]]\r\nlog = 'a'\r\nreason = 'r'\r\nperson = 'p'\r\n#",
    '"\n[site]\nlatitude_deg = 1.0\n# "',
    "??/",
    "%s%n@p_@P_",
    "=cmd|' /C calc'!A0",
    "<script>stolen()</script>",
    "\u202e\u2028\u0085\x00\x7f",
    "a/../../b",
    "",
)
PLACES = (
    ("serial",), ("effective_from",), ("stage",), ("software",), ("recipe_sha256",),
    ("models", 0, "form"), ("models", 0, "name"), ("models", 0, "residual_unit"),
    ("models", 0, "coefficients", 0, "name"), ("models", 0, "coefficients", 0, "unit"),
    ("inputs",), ("inputs", 0), ("inputs", 0, "name"), ("flags",), ("revision",),
    ("procedure",), ("verdict",), ("recipe", "text"), ("recipe", "name"), ("acceptance",),
)  # fmt: skip
"""Members that a forger would write into, of run.json, of the coefficient file, or of both."""
JUNK = (None, [None], [1], {}, True, -1, [[]])
FORMS = ("inclinometer-scale/2", "accel-k/1", "fog-drift-bank/1", "polynomial/1")


def _end(call):
    """How a call ends: passed, refused in one line, or what must never be."""
    try:
        call()
    except CalibkitError as error:
        lines = 1 if isinstance(error, RecipeError) else str(error).count("\n") + 1
        right = error.exit_code in {2, 3, 4} and lines == 1
        return "refused" if right else f"exit code {error.exit_code}: {error}"
    except Exception as error:  # noqa: BLE001 (what is not calibkit's own is what is looked for)
        return f"{type(error).__name__}: {error}"
    return "passed"


def _put(document, place, value):
    """Put a value into a place of a document, where it has one."""
    with contextlib.suppress(KeyError, IndexError, TypeError):
        node = document
        for key in place[:-1]:
            node = node[key]
        if place[-1] in node or isinstance(node, list):
            node[place[-1]] = value


def forge_run(folder, generator):
    """Write a copy of the kept run with one or two members forged and every digest right."""
    if folder.exists():
        shutil.rmtree(folder)
    shutil.copytree(RUN, folder)
    run, record = (documents.read_json(folder / name) for name in ("run.json", RECORD))
    for _ in range(generator.randrange(1, 3)):
        place = generator.choice(PLACES)
        value = generator.choice(TEXTS if generator.random() < 0.7 else JUNK)
        if place[-1] == "form" and generator.random() < 0.5:
            value = generator.choice(FORMS) + generator.choice(("", *TEXTS))
        for document in generator.choice(((run,), (record,), (run, record))):
            _put(document, place, copy.deepcopy(value))
    if generator.random() < 0.2:
        (folder / RECORD).write_bytes(documents.forge(record, generator))
    else:
        (folder / RECORD).write_text(sealed.seal(record), encoding="utf-8")
    files = {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "run.json"}
    (folder / "run.json").write_text(
        sealed.seal(run | {"files": store.list_files(files)}), encoding="utf-8"
    )


def attack_runs(folder, count, seed):
    """Return how many forged runs were exported, and those that were neither refused in one line
    nor gave C that compiles to what it was.
    """
    generator, exported, bad = random.Random(seed), 0, []  # noqa: S311 (a fixed seed, not a secret)
    compiler = shutil.which("gcc")
    for number in range(count):
        forge_run(folder / "INC-1" / "r001", generator)
        out = folder / "c"

        def export(run=folder / "INC-1" / "r001", out=out):
            pipeline.export([store.load(run)], "c", "f32", "cal", out)

        end = _end(export)
        if end == "passed":
            exported += 1
            text = "".join(path.read_text("ascii") for path in out.iterdir())
            if "stolen" in text or (compiler and _compile(compiler, out)):
                bad.append(f"forged run {number} writes C")
            shutil.rmtree(out)
        elif end != "refused" or out.exists():
            bad.append(f"forged run {number}: {end}")
    return exported, bad


def _compile(compiler, folder):
    """What a compiler says of the header and the source in a folder."""
    flags = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only")
    done = subprocess.run(
        [compiler, *flags, "cal.c"], cwd=folder, capture_output=True, text=True, check=False
    )
    return done.stderr


def attack_names(folder, count, seed):
    """Return the proposals for logs with a stranger's names of columns that hold more than a
    shipped recipe and columns of the log.
    """
    generator, bad = random.Random(seed), []  # noqa: S311 (a fixed seed, not a secret)
    rows = [[0.5 * k, 20.0 + 0.01 * k, 9.0 + 0.1 * (k % 7)] for k in range(60)]
    shipped = {name: tomllib.loads(path.read_text()) for name, path in recipe.shipped().items()}
    for number in range(count):
        extra = [
            f"extra{k}{''.join(generator.sample(TEXTS, generator.randrange(1, 4)))}"
            for k in range(2)
        ]
        names = ["time_s", "temp_case_degc", "gyro_dph", *extra]
        found = _propose(folder, names, [[*row, row[2], row[2]] for row in rows])
        if isinstance(found, str):
            bad += [f"names {number}: {found}"] * (found != "refused")
        elif not found.keys() <= shipped[found["procedure"]].keys() | {"columns"} or not {
            column["from"] for column in found.get("columns", {}).values()
        } <= set(names):
            bad.append(f"names {number}: {extra}")
    return bad


def _propose(folder, names, rows):
    """The proposed recipe of a log as tables, or how the proposal ended."""
    (folder / "a.json").write_text(json.dumps({"columns": list(names), "data": rows}))
    found = []

    def propose():
        text = inspection.init(folder).text
        found.append(tomllib.loads(text))

    end = _end(propose)
    return found[0] if end == "passed" else end


def attack_special_files(folder):
    """Return how many times a pipe, a device, a folder or a sparse file stood in the place of a
    file of a run, a plan or a delivery, and what `verify` did but refuse it.
    """
    tried, bad = 0, []
    delivery = GOLDEN / "exports-2" / "blob"
    for name, source, asked in (
        ("run", RUN, ""),
        ("plan", GOLDEN / "plan-1", "plan.json"),
        ("delivery", delivery, "cal_manifest.json"),
    ):
        for file in sorted(path.name for path in source.iterdir()):
            for kind in ("pipe", "device", "folder", "sparse"):
                copied = folder / f"{name}-{tried}"
                shutil.copytree(source, copied)
                replace_file(copied / file, kind)
                end = _end(lambda path=copied / asked: pipeline.verify(path))
                tried += 1
                if end != "refused":
                    bad.append(f"{kind} for {name} {file}: {end}")
                shutil.rmtree(copied)
    return tried, bad


def replace_file(path, kind):
    """Put a pipe, a link to a device, a folder or a sparse file of 20 GB in the place of a file."""
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "folder":
        path.mkdir()
    else:
        with path.open("wb") as stream:
            stream.truncate(20_000_000_000)


SHAPES = (
    '<image href="{}" width="5" height="5"/>', '<image xlink:href="{}" width="5" height="5"/>',
    '<use href="#a"/><g id="a"><use href="#a"/></g>', "{}", "<style>@import url({});</style>",
    '<rect width="1e300" height="-1"/>', '<path d="{}"/>', '<filter id="f"><feTile/></filter>',
)  # fmt: skip
LINKS = ("/etc/passwd", "http://127.0.0.1:9/a.png", "a.png", "data:image/png;base64,AAAA", "&a9;")


def marks(count, seed):
    """Marks of accreditations that a stranger drew: links, bombs, damaged images."""
    generator = random.Random(seed)  # noqa: S311 (a fixed seed, not a secret)
    for number in range(count):
        inside = "".join(generator.sample(SHAPES, 2)).replace("{}", generator.choice(LINKS))
        if number % 5 == 0:
            inside = '<g id="a0"><path d="M0 0"/></g>' + "".join(
                f'<g id="a{k}">' + 10 * f'<use href="#a{k - 1}"/>' + "</g>" for k in range(1, 9)
            )
        if number % 5 == 1:
            inside = generator.randrange(1, 30_000) * "<g>"
        text = f'<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9">{inside}</svg>'
        cut = generator.randrange(len(text)) if number % 5 == 2 else len(text)
        yield text[:cut].encode()


def attack_marks(folder, run, profile, count, seed):
    """Return what a stranger's mark did to `certify` but be drawn or refused in one line."""
    bad = []
    stated = 'accreditation={body="B",number="N",mark="mark.svg"}'
    shutil.copy(profile, folder / "lab.toml")
    for number, content in enumerate(marks(count, seed)):
        (folder / "mark.svg").write_bytes(content)
        out = folder / f"{number}.pdf"

        def issue(out=out):
            certify.certify(
                run,
                out,
                instruments.certificate_layout,
                date="2026-11-21",
                profile_path=folder / "lab.toml",
                overrides=(signed.STATED, stated),
            )

        end = _end(issue)
        if end not in {"passed", "refused"} or (end == "refused") == out.exists():
            bad.append(f"mark {number}: {end}")
    return bad


def attack_trust(plain, own, stranger, folder, url, root, count):
    """Return the strangers' signatures and time stamps that were trusted, or that `sign` added its
    own to where trust was asked for.
    """
    bad = []
    for number in range(count):
        by = (stranger, own)[number % 2]
        document = signed.signed(plain, by)
        if number % 3:
            document = signed.signed(document, stranger, ("checked", "approved")[number % 3 - 1])
        if number % 4 > 1:
            document = signed.stamped(document, url)
        strange = by is stranger or number % 3 > 0
        trusted = {"trust": (root,)}
        found = verify_signature.check_signatures(document, signature_trust.Demands(**trusted))
        own_marks = [one for one in found if one.trusted]
        if any(one.role for one in own_marks) or len(own_marks) != (by is own):
            bad.append(f"signatures {number}: {list(map(str, found))}")
        path, out = folder / f"t{number}.pdf", folder / f"u{number}.pdf"
        path.write_bytes(document)
        key = Key(own, authority.SECRET, authority.NOW)

        def approve(path=path, out=out, key=key):
            certify.countersign(
                path, out, instruments.certificate_layout, key, "approved", (root,), dry_run=False
            )

        end = _end(approve)
        if end != ("refused" if strange else "passed"):
            bad.append(f"approval {number}: {end}")
    return bad
