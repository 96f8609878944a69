"""Write the tables of attacks into docs/trust.md: `python tests/attacks [NAME …]`, names forged,
files, signed, writes and silent, all without one, in an hour; `--quick` prints a hundredth.
"""

import contextlib
import os
import sys
import tempfile
import warnings
from functools import partial
from itertools import islice
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
PAGE = TESTS.parent / "docs" / "trust.md"
MARK = "<!-- attacks: {} -->\n"
SHARES = {
    "inclinometer": 440,
    "bias_temperature": 220,
    "gyro_pair": 40,
    "rate_table": 12,
    "accelerometer": 4,
    "fog_thermal": 4,
}
"""Procedure → damages of each of the seven kinds: 5,040 in all."""
APART = 20
"""Damages of each kind that is not detectable, to the logs of the inclinometer."""


def attack_files(folder, share):
    """Rows of the table on mutated logs and documents."""
    from attacks import documents, logs

    count, refused, bad = logs.attack(folder, round(20_000 * share), 7)
    yield f"mutated logs of ten formats ({refused} refused, the rest read)", count, bad
    golden = TESTS / "golden"
    manifest = golden / "exports-2" / "blob" / "cal_manifest.json"
    forged = partial(documents.forge, documents.read_json(manifest))
    for path in manifest.parent.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    count, bad = documents.attack(folder / manifest.name, forged, round(2000 * share), 1)
    yield "forged manifests with a right digest", count, bad
    damage = partial(documents.damage_xml, (golden / "dcc.xml").read_bytes())
    count, bad = documents.attack(folder / "a.xml", damage, round(2000 * share), 2)
    yield "damaged DCCs", count, bad


def attack_writes(folder, share):
    """Rows of the table on faults of the file system and kills."""
    from attacks import faults

    faults.quick()
    counted, bad = faults.attack(folder, faults.FAULTS, every=max(1, round(1 / share)))
    names = ", ".join(dict.fromkeys(command for command, _ in counted))
    for fault in faults.FAULTS:
        count = sum(number for (_, named), number in counted.items() if named == fault)
        what = f"each call of its files failed with {fault}"
        yield f"{what}: {names}", count, [one for one in bad if f", {fault}: " in one]
    count, bad = faults.kill(folder, round(500 * share), 3)
    yield "kill -9 at a call of its files", count, bad


def attack_silently(folder, share):
    """Rows of the table on damages that leave a log readable."""
    from attacks import campaigns, silent

    made = {name: campaigns.make(name, folder) for name in SHARES}
    for kind in silent.KINDS:
        outcomes = [
            silent.attack(made[name], kind, [2026, seed])
            for name, count in SHARES.items()
            for seed in range(round(count * share) or 1)
        ]
        bad = [f"{where}, {ratio:.2f} U" for end, ratio, where in outcomes if end == "silent"]
        yield f"readable log, {kind}", len(outcomes), bad
    for kind in silent.APART:
        outcomes = [
            silent.attack(made["inclinometer"], kind, [1, seed])[0]
            for seed in range(round(APART * share) or 1)
        ]
        yield f"*not detectable:* {kind}", len(outcomes), ["x" for o in outcomes if o == "silent"]


def attack_signed(folder, share):
    """Rows of the table on signed certificates; what passes as intact is a fault."""
    from attacks import documents, signed
    from outputs import authority

    issuer = authority.Authority("Stamp authority", 500)
    own = authority.Authority().issue(folder / "own.p12")
    stranger = authority.Authority("stranger", 400).issue(folder / "stranger.p12", number=1)
    plain = signed.unsigned_part(signed.certified(folder, own).read_bytes())
    path = folder / "attacked.pdf"
    with authority.serve_stamps(issuer) as url:
        stamped = signed.signed(plain, own, stamps=f"{url}/tsa")
        bare, other = signed.signed(plain, own), signed.signed(plain, stranger)
        flipped = signed.flipped(stamped, round(500 * share), 4)
        forged = islice(signed.forgeries(bare, other, stranger), max(1, round(127 * share)))
        for row, made in (
            ("a bit of a signed certificate flipped, a third of them in the signature", flipped),
            ("structure of one changed, also with a stranger's signature over it", forged),
        ):
            ends = [(name, documents.outcome(path, content)) for name, content in made]
            yield row, len(ends), [f"{name}: {end}" for name, end in ends if end != "refused"]
        count = round(50 * share) or 1
        asked = signed.genuine(plain, folder, url, issuer, count)
        ends = [documents.outcome(path, content, **demands) for content, demands in asked]
    row = "genuine certificate accepted with --trust, every fifth signed five years ago"
    yield row, count, [end for end in ends if end != "passed"]


def attack_forged(folder, share):
    """Rows of the table on what strangers wrote: runs, names, files, marks, signatures."""
    from attacks import forged, signed
    from outputs import authority

    count = round(1000 * share)
    exported, bad = forged.attack_runs(folder / "runs", count, 11)
    yield f"forged runs with right digests ({exported} exported to C, the rest refused)", count, bad
    (folder / "logs").mkdir()
    count = round(500 * share)
    yield (
        "line ends, quotes and tables in names of columns that `init` reads",
        count,
        forged.attack_names(folder / "logs", count, 12),
    )
    (folder / "special").mkdir()
    count, bad = forged.attack_special_files(folder / "special")
    yield "a pipe, a device, a folder or 20 GB in the place of a file", count, bad
    key = authority.Authority()
    root, own = key.write(folder / "own.pem"), key.issue(folder / "own.p12")
    stranger = authority.Authority("stranger", 400).issue(folder / "stranger.p12", number=1)
    plain = signed.unsigned_part(signed.certified(folder, own).read_bytes())
    (folder / "marks").mkdir()
    count = max(5, round(50 * share))
    bad = forged.attack_marks(folder / "marks", folder / "P" / "r001", signed.PROFILE, count, 13)
    yield "marks of an accreditation with links, bombs or damage", count, bad
    (folder / "trust").mkdir()
    count = max(12, round(48 * share))
    with authority.serve_stamps(authority.Authority("Stamp authority", 500)) as url:
        bad = forged.attack_trust(plain, own, stranger, folder / "trust", f"{url}/tsa", root, count)
    row = "strangers' signatures and time stamps, and `sign --trust` over each"
    yield row, count, bad


PARTS = {
    "forged": attack_forged,
    "files": attack_files,
    "signed": attack_signed,
    "writes": attack_writes,
    "silent": attack_silently,
}


def main(names, share):
    """Attack and write, or print, the tables of these parts."""
    warnings.simplefilter("ignore")
    for name in names:
        table, faults = ["| class | tried | survived |", "|---|---|---|"], []
        with tempfile.TemporaryDirectory() as folder, quiet():
            for row, count, bad in PARTS[name](Path(folder), share):
                table.append(f"| {row} | {count} | {count - len(bad)} |")
                faults += [f"{row}: {one}" for one in bad]
        text = "\n".join(table) + "\n"
        if share == 1.0:
            mark, page = MARK.format(name), PAGE.read_text(encoding="utf-8")
            head, _, tail = page.split(mark)
            PAGE.write_text(f"{head}{mark}\n{text}\n{mark}{tail}", encoding="utf-8")
        sys.stdout.write(text + "".join(f"{one}\n" for one in faults))
        sys.stdout.flush()


@contextlib.contextmanager
def quiet():
    """Send what commands print nowhere."""
    sys.stdout.flush()
    kept, nowhere = [os.dup(1), os.dup(2)], os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
    try:
        yield
    finally:
        sys.stdout.flush()
        for stream, own in zip((1, 2), kept, strict=True):
            os.dup2(own, stream)


if __name__ == "__main__":
    sys.path[:0] = [str(TESTS.parent), str(TESTS)]
    main(
        [name for name in PARTS if name in sys.argv] or PARTS,
        0.01 if "--quick" in sys.argv else 1.0,
    )
