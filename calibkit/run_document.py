"""What a run.json holds: the verdict in its three values, the keys that every format ever released
has, and their types.
"""

import datetime as dt
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

from calibkit import names, sealed
from calibkit.coefficients import Criterion
from calibkit.errors import CoefficientError
from calibkit.frame import KEPT_DIGITS

FORMAT = "calibkit-run/2"
VALIDATION_FORMAT = "calibkit-validation/2"
Verdict = Literal["accepted", "rejected", "no verdict"]
ACCEPTED: Mapping[str, bool | None] = {"accepted": True, "rejected": False, "no verdict": None}
"""Verdict → `accepted` of a JSON document."""
NO_VERDICT = "No verdict: the recipe sets no [acceptance] limits"
Kind = type | tuple[type, ...]
SHAPE: dict[str, Kind] = {
    "serial": str,
    "revision": int,
    "procedure": str,
    "effective_from": str,
    "software": str,
    "python": str,
    "libraries": dict,
    "recipe": dict,
    "inputs": list,
    "excluded": list,
    "accepted": (bool, type(None)),
    "verdict": str,
    "acceptance": list,
    "flags": list,
    "files": list,
}
"""Keys that every run.json that was loaded has, and what they hold."""
TABLES: dict[str, dict[str, Kind]] = {
    "inputs": {"name": str, "sha256": str, "rows": int},
    "acceptance": {
        "name": str,
        "value": (int, float),
        "limit": (int, float),
        "unit": str,
        "passed": bool,
    },
    "files": {"name": str, "sha256": str},
}
RECIPE_SHAPE: dict[str, Kind] = {"name": str, "sha256": str, "text": str, "overrides": list}
FLEET_SHAPE: dict[str, Kind] = {
    "software": str,
    "effective_from": str,
    "units": list,
    "figures": list,
    "files": list,
}
MANIFEST_SHAPE: dict[str, Kind] = {"software": str, "files": list, "units": list}
DELIVERED_SHAPE: dict[str, Kind] = {
    "serial": str,
    "revision": int,
    "accepted": (bool, type(None)),
    "files": list,
}
"""What a manifest holds of each device."""
_HEX = re.compile(r"[0-9a-f]+")
_FILE_NAME = re.compile(r"[^\W_][\w.+-]*", re.UNICODE)


def judge(criteria: Iterable[Criterion]) -> Verdict:
    """Rejected where a criterion failed, accepted where limits of the recipe are met, else no
    verdict.
    """
    tested = tuple(criteria)
    if not all(criterion.passed for criterion in tested):
        return "rejected"
    return "accepted" if any(criterion.set_by == "recipe" for criterion in tested) else "no verdict"


def loads(text: str, name: str) -> dict[str, Any]:
    """run.json of its text; CoefficientError for a wrong digest or format."""
    return sealed.unseal(text, name, FORMAT)


def require_shape(document: Mapping[str, Any], path: str) -> None:
    """Raise CoefficientError for a sealed run.json that lacks something, or whose files are not in
    the folder.
    """
    faults = (
        _misshapen(document, SHAPE, "")
        or _misshapen(document["recipe"], RECIPE_SHAPE, "recipe.")
        or _wrong_contents(document)
    )
    _refuse(faults, document, path, "a run document", "the run folder")


def require_fleet_shape(document: Mapping[str, Any], path: str) -> None:
    """Raise CoefficientError for a sealed fleet.json that lacks something, or whose files are not
    in the folder.
    """
    faults = _misshapen(document, FLEET_SHAPE, "") or _misshapen_entries(document, "files")
    _refuse(faults, document, path, "a fleet's record", "the folder")


def list_manifest(document: Mapping[str, Any], path: str) -> list[Mapping[str, str]]:
    """Entries of all files that a sealed manifest lists; CoefficientError where it lacks something,
    or lists a file that is not in its folder.
    """
    faults = _misshapen(document, MANIFEST_SHAPE, "")
    if not faults:
        units = [
            fault for unit in document["units"] for fault in _misshapen(unit, DELIVERED_SHAPE, "")
        ]
        lists = () if units else (document, *document["units"])
        faults = units + [
            fault for listing in lists for fault in _misshapen_entries(listing, "files")
        ]
    entries = (
        []
        if faults
        else [e for listing in (document, *document["units"]) for e in listing["files"]]
    )
    _refuse(faults, {"files": entries}, path, "a manifest", "the delivery")
    return entries


def _refuse(
    faults: Sequence[str], document: Mapping[str, Any], path: str, kind: str, folder: str
) -> None:
    """Raise CoefficientError for the first fault, or for a listed file that is not in the folder
    itself.
    """
    if faults:
        raise CoefficientError(f"{path}: not {kind}: {faults[0]}", hint=f"restore {folder}")
    for entry in document["files"]:
        if not _FILE_NAME.fullmatch(entry["name"]):
            raise CoefficientError(
                f"{path}: file name '{entry['name']}' leaves the folder", hint="do not use it"
            )


def _wrong_contents(document: Mapping[str, Any]) -> list[str]:
    """What is wrong with the lists of a run document whose keys are all there, and with its date
    and number.
    """
    faults = [fault for key in TABLES for fault in _misshapen_entries(document, key)]
    if faults:  # what follows looks into the entries
        return faults
    faults += [
        f"inputs: {key}: {entry[key]!r:.40}"
        for entry in document["inputs"]
        for key in ("fingerprint", "sample")
        if key in entry and not _is_fingerprint(entry[key])
    ]
    texts = {"flags": document["flags"], "recipe.overrides": document["recipe"]["overrides"]}
    faults += [
        f"{key}: {text!r:.40}"
        for key, entries in texts.items()
        for text in entries
        if not isinstance(text, str)
    ]
    accepted = document.get("accepted", "absent")
    if ACCEPTED.get(document["verdict"], "") is not accepted:
        faults.append(f"verdict: {document['verdict']!r:.40}, accepted: {accepted}")
    if not _is_date(document["effective_from"]):
        faults.append(f"effective_from: {document['effective_from']!r:.40}")
    if document["revision"] <= 0 or document["revision"] is True:
        faults.append(f"revision: {document['revision']}")
    if not names.is_serial(document["serial"]):
        faults.append(f"serial: {document['serial']!r:.40} is none that fit takes")
    return faults


def _is_fingerprint(text: object) -> bool:
    """Whether a log's fingerprint is one: digests of rows behind each other."""
    return (
        isinstance(text, str) and not len(text) % KEPT_DIGITS and _HEX.fullmatch(text) is not None
    )


def _is_date(text: str) -> bool:
    """Whether a text is a date as calibkit writes it."""
    try:
        return dt.date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False


def _misshapen(value: object, shape: Mapping[str, Kind], prefix: str) -> list[str]:
    """What an object lacks or holds in another type."""
    if not isinstance(value, dict):
        return [f"{prefix}{value!r:.40} is not a table"]
    wrong = [key for key, kind in shape.items() if not isinstance(value.get(key), kind)]
    return [f"{prefix}{key}: {value.get(key)!r:.40}" for key in wrong]


def _misshapen_entries(document: Mapping[str, Any], key: str) -> list[str]:
    """What the entries of one list of a document lack or hold in another type."""
    return [
        fault for entry in document[key] for fault in _misshapen(entry, TABLES[key], f"{key}: ")
    ]
