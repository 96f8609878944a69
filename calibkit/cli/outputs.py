"""Commands that hand a run on: certify, sign, export, report."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from calibkit.cli.console import SETTINGS, print_flags, print_message, print_result
from calibkit.cli.options import DETAILS, DRY, JSON, PATH, RUN, RUNS, command
from calibkit.cli.progress import working
from calibkit.errors import UsageError
from calibkit.records.clock import date_or_today, now

if TYPE_CHECKING:
    from calibkit.certificate.certify import Issued
    from calibkit.certificate.signing_key import Key
    from calibkit.certificate.words import Lang

_SERVER = "CALIBKIT_TIMESTAMP_URL"
_TIMESTAMP = click.option(
    "--timestamp",
    envvar=_SERVER,
    default="",
    metavar="URL",
    help=f"server that states when it was signed (RFC 3161; default: {_SERVER})",
)
_MOST_MISSING = 20
"""Lines on what a certificate lacks."""


@command()
@RUN
@click.option("--out", default=None, type=PATH, help="PDF file to write")
@click.option("--check", is_flag=True, help="list what a certificate would lack; write nothing")
@click.option("--profile", type=PATH, help="laboratory profile; without one: a DRAFT")
@click.option("--validation", type=PATH, help="as found and as left, from calibkit validate")
@click.option("--date", default=None, metavar="YYYY-MM-DD", help="date of issue (default: today)")
@click.option("--lang", type=click.Choice(["en", "zh", "both"]), default="en", show_default=True)
@click.option("--sign", "key", type=PATH, help="PKCS#12 key; CALIBKIT_SIGN_PASSPHRASE opens it")
@_TIMESTAMP
@click.option("--schema-dir", type=PATH, help="folder with dcc.xsd, to check the DCC by it")
@click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="table.key=value",
    help="override a key of the profile",
)
@RUNS
@DRY
@DETAILS
@JSON
def certify(
    run: str,
    out: Path | None,
    profile: Path | None,
    validation: Path | None,
    date: str | None,
    lang: "Lang",
    key: Path | None,
    timestamp: str,
    schema_dir: Path | None,
    overrides: tuple[str, ...],
    runs: Path,
    *,
    check: bool,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Write the calibration certificate of a run as PDF/A-3 with its DCC; what is missing makes it
    a DRAFT. With --check: exit code 1 where something is missing.

    \b
    calibkit certify FOG-0001 --profile lab.toml --out certificate.pdf
    calibkit certify FOG-0001 --profile lab.toml --validation v.json --out c.pdf
    calibkit certify FOG-0001 --profile lab.toml --check
    calibkit certify FOG-0001 --profile lab.toml --sign key.p12 --out c.pdf
    """
    from calibkit.certificate import certify as certificates
    from calibkit.instruments import certificate_layout
    from calibkit.records import store

    if (out is None) != check:
        raise UsageError(
            "--out and --check: one of them is needed",
            hint="name the PDF with --out, or leave it out and ask with --check",
        )
    if timestamp and not key and _SERVER not in os.environ:
        raise UsageError("--timestamp stamps a signature", hint="add --sign KEY.p12")
    with working("typesetting"):
        issued = certificates.certify(
            store.find(run, runs),
            out,
            certificate_layout,
            date=date_or_today(date),
            profile_path=profile,
            validation=validation,
            lang=lang,
            overrides=overrides,
            schema_dir=schema_dir,
            key=_read_key(key, timestamp) if key else None,
            dry_run=dry_run,
        )
    return _print_issued(issued, check=check, as_json=as_json, dry_run=dry_run)


def _print_issued(issued: "Issued", *, check: bool, as_json: bool, dry_run: bool) -> int:
    """Print a certificate, or what one would lack, which is 1."""
    print_flags(filter(None, (issued.certificate.rejection.en, *issued.warnings)))
    missing = [f"  {item.key}: {item.description.en}" for item in issued.missing]
    if check and not as_json:
        _print_check(issued, missing)
        return int(bool(missing))
    if missing and not as_json:
        from calibkit.report.screen import shorten

        print_message(f"DRAFT: not a calibration certificate; {len(missing)} missing:")
        for line in missing if SETTINGS.details else shorten(missing, _MOST_MISSING):
            print_message(line)
    print_result(issued.summarise(), issued.files, as_json=as_json, dry_run=dry_run)
    return int(check and bool(missing))


def _print_check(issued: "Issued", missing: Sequence[str]) -> None:
    """Print what a certificate would be, and what it would say that a laboratory may not expect."""
    from calibkit.certificate import accreditation

    certificate, results = issued.certificate, issued.certificate.results
    outside = sum(result.outside_scope for result in results)
    raised = sum(accreditation.is_raised(result) for result in results)
    unused = ", ".join(certificate.unused_terms)
    verdict = "nothing is missing for a certificate"
    if missing:
        verdict = f"a DRAFT, {len(missing)} missing"
    lines = (
        f"{certificate.run.name}: {verdict}",
        f"{outside} of {len(results)} results are outside the scope" if outside else "",
        f"U of {raised} results is raised to the CMC" if raised else "",
        f"type B terms that enter no result: {unused}" if unused else "",
        *missing,
    )
    for line in filter(None, lines):
        click.echo(line)


def _read_key(path: Path, timestamp: str) -> "Key":
    """A key file with its passphrase, which stands in the environment, and the time."""
    from calibkit.certificate.signing_key import PASSPHRASE, Key

    return Key(path, os.environ.get(PASSPHRASE, ""), now(), timestamp)


@command()
@click.argument("certificate", type=PATH)
@click.option(
    "--key", required=True, type=PATH, help="PKCS#12 key; CALIBKIT_SIGN_PASSPHRASE opens it"
)
@click.option("--role", required=True, type=click.Choice(["checked", "approved"]))
@click.option(
    "--trust",
    multiple=True,
    type=PATH,
    help="certificate of the signers before, or their authority's: no other's is signed",
)
@click.option("--out", required=True, type=PATH, help="PDF file to write")
@_TIMESTAMP
@DRY
@JSON
def sign(
    certificate: Path,
    key: Path,
    role: str,
    trust: tuple[Path, ...],
    out: Path,
    timestamp: str,
    *,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Add a signature to a certificate that is signed already: of who checked it, or approved it.

    The signatures before it stay valid. A certificate that does not verify is not signed; what
    `verify` warns of is printed.

    \b
    calibkit sign certificate.pdf --key own.p12 --role checked --out checked.pdf
    calibkit sign c.pdf --key head.p12 --role approved --trust lab.pem --out d.pdf
    """
    from calibkit.certificate.certify import countersign
    from calibkit.instruments import certificate_layout

    warnings = countersign(
        certificate,
        out,
        certificate_layout,
        _read_key(key, timestamp),
        role,
        trust,
        dry_run=dry_run,
    )
    print_flags(warnings)
    print_result({"out": [str(out)], "role": role}, [out], as_json=as_json, dry_run=dry_run)
    return 0


def _address(context: click.Context, parameter: click.Parameter, value: str | None) -> int | None:
    """Read an address, in hexadecimal with 0x or decimal."""
    del context, parameter
    try:
        return None if value is None else int(value, 0)
    except ValueError:
        raise click.BadParameter(
            f"'{value}' is no address; write 0x08040000 or 134479872"
        ) from None


@command()
@click.argument("run", nargs=-1, required=True)
@click.option("--target", required=True, help="c, blob, hex, px4, ardupilot or csv")
@click.option("--number", default="f32", show_default=True, help="f32 or f64")
@click.option(
    "--prefix", default="cal", show_default=True, help="what every generated name starts with"
)
@click.option("--out", required=True, type=PATH, help="folder to write into")
@click.option(
    "--address",
    callback=_address,
    help="where hex places the blob, which it needs: 0x08040000",
)
@click.option(
    "--layout-of", metavar="RUN", help="refuse runs that the loader of this run does not take"
)
@click.option(
    "--allow-rejected", is_flag=True, help="export a run that failed its limits, marked as rejected"
)
@RUNS
@DRY
@DETAILS
@JSON
def export(
    run: tuple[str, ...],
    target: str,
    number: str,
    prefix: str,
    out: Path,
    address: int | None,
    layout_of: str | None,
    runs: Path,
    *,
    allow_rejected: bool,
    dry_run: bool,
    as_json: bool,
) -> int:
    """Write the correction chain of a run as firmware that can prove itself.

    \b
    calibkit export FOG-0001 --target c --prefix gyro --out firmware
    calibkit export GYRO-7 GYRO-8 --target hex --address 0x08040000 --out delivery

    Several runs make one row or one blob per device, and a manifest with the digests of all files.
    """
    from calibkit.commands import pipeline
    from calibkit.records import store

    with working("writing firmware") as progress:
        stored_runs = [store.load(store.find(name, runs)) for name in progress(run, "reading runs")]
        files = pipeline.export(
            stored_runs,
            target,
            number,
            prefix,
            out,
            address=address,
            layout_of=store.load(store.find(layout_of, runs)) if layout_of else None,
            allow_rejected=allow_rejected,
            dry_run=dry_run,
        )
    document = {
        "runs": [stored_run.name for stored_run in stored_runs],
        "files": list(map(str, files)),
    }
    print_result(document, files, as_json=as_json, dry_run=dry_run)
    return 0


@command()
@RUN
@click.option("--out", required=True, type=PATH, help="PDF or HTML file to write")
@RUNS
@DRY
@JSON
def report(run: str, out: Path, runs: Path, *, dry_run: bool, as_json: bool) -> int:
    """Write the report of a run again, as PDF or as the page that it keeps; no log is needed.

    \b
    calibkit report FOG-0001 --out report.pdf
    calibkit report FOG-0001@r002 --out report.html

    The PDF has the content and the figures of the page, set by typst (calibkit[pdf]).
    """
    from calibkit.commands import run_content
    from calibkit.records import new_files, store

    if out.suffix not in (".pdf", ".html"):
        raise UsageError(f"--out {out}: neither .pdf nor .html", hint="name report.pdf")
    new_files.refuse_existing(out)
    stored_run = store.load(store.find(run, runs))
    with working("typesetting"):
        content = run_content.read_report(stored_run, out.suffix)
    new_files.write_new(out, content, dry_run=dry_run)
    document = {"run": stored_run.name, "out": str(out)}
    print_result(document, (out,), as_json=as_json, dry_run=dry_run)
    return 0
