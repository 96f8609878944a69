"""Files that calibkit wrote, but for certificates: what each is, if its digests are right."""

from pathlib import Path

from calibkit.errors import CoefficientError, UsageError
from calibkit.records import coefficients, run_document, sealed, store


def identify(path: Path) -> str:
    """Check a file's digest or recompute an export's vectors; returns what the file is."""
    if (path / store.FLEET_FILE).is_file():
        fleet = store.load_fleet(path)
        return f"fleet of {len(fleet['units'])} devices, {len(fleet['files'])} files"
    if path.is_dir():
        run = store.load(path)
        return f"run {run.name}, {len(run.document['files'])} files"
    if not path.is_file():
        raise UsageError(
            f"{path}: no such file", hint="name a coefficient file, a validation or a run folder"
        )
    from calibkit.firmware import facts, targets

    if path.suffix in targets.READERS:
        description = targets.READERS[path.suffix](str(path), store.read_bytes(path))
        if path.suffix == ".c" and path.with_suffix(".h").is_file():
            facts.require_same_export(path, path.with_suffix(".h"))
        return description
    return _check_document(path)


def _check_document(path: Path) -> str:
    """Check the digest of a JSON document; returns what it is."""
    from calibkit.firmware import targets
    from calibkit.planning import document as plan_file

    text = store.read_utf8(path)
    if not text.lstrip().startswith("{"):
        raise UsageError(
            f"{path}: no file with a digest of its own",
            hint="name the run folder, which has those of all its files, a JSON file, a certificate"
            " or an export",
        )
    of_runs = run_document.FORMAT, run_document.VALIDATION_FORMAT
    formats = coefficients.FORMAT, *of_runs, targets.MANIFEST, plan_file.FORMAT
    document = sealed.unseal(text, str(path), *formats)
    if document["format"] == targets.MANIFEST:
        return targets.verify_manifest(path)
    if document["format"] == plan_file.FORMAT:
        plan_file.load_plan(path.parent, path.name)
        return f"plan of {document['procedure']}: {document['plan']}"
    if document["format"] == coefficients.FORMAT:
        record = coefficients.loads(text, str(path))
        return (
            f"{record.stage} of {record.serial} r{record.revision:03d}, effective from"
            f" {record.effective_from}"
        )
    if not (isinstance(document.get("serial"), str) and isinstance(document.get("revision"), int)):
        raise CoefficientError(
            f"{path}: states no serial and revision", hint="calibkit did not write it"
        )
    return f"{document['format']} of {document['serial']} r{document['revision']:03d}"
