"""What a run.json holds: the keys that every format ever released has, and their types."""

import datetime as dt
import re
from collections.abc import Mapping, Sequence
from typing import Any

from calibkit.errors import CoefficientError
from calibkit.frame import KEPT_DIGITS

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
    "accepted": bool,
    "acceptance": list,
    "flags": list,
    "files": list,
}
"""Keys that every run.json ever released has, and what they hold."""
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
_HEX = re.compile(r"[0-9a-f]+")
_FILE_NAME = re.compile(r"[^\W_][\w.+-]*", re.UNICODE)


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
                f"{path}: file name '{entry['name']}' leaves the folder", hint="do not use this run"
            )


def _wrong_contents(document: Mapping[str, Any]) -> list[str]:
    """What is wrong with the lists of a run document whose keys are all there, and with its date
    and number.
    """
    faults = [fault for key in TABLES for fault in _misshapen_entries(document, key)]
    faults += [
        f"inputs: fingerprint: {entry['fingerprint']!r:.40}"
        for entry in document["inputs"]
        if "fingerprint" in entry and not _is_fingerprint(entry["fingerprint"])
    ]
    texts = {"flags": document["flags"], "recipe.overrides": document["recipe"]["overrides"]}
    faults += [
        f"{key}: {text!r:.40}"
        for key, found in texts.items()
        for text in found
        if not isinstance(text, str)
    ]
    if not _is_date(document["effective_from"]):
        faults.append(f"effective_from: {document['effective_from']!r:.40}")
    if document["revision"] <= 0:
        faults.append(f"revision: {document['revision']}")
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


def _misshapen(found: object, shape: Mapping[str, Kind], where: str) -> list[str]:
    """What an object lacks or holds in another type."""
    if not isinstance(found, dict):
        return [f"{where}{found!r:.40} is not a table"]
    wrong = [key for key, kind in shape.items() if not isinstance(found.get(key), kind)]
    return [f"{where}{key}: {found.get(key)!r:.40}" for key in wrong]


def _misshapen_entries(document: Mapping[str, Any], key: str) -> list[str]:
    """What the entries of one list of a document lack or hold in another type."""
    return [
        fault for entry in document[key] for fault in _misshapen(entry, TABLES[key], f"{key}: ")
    ]
