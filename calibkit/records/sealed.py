"""JSON documents with their own digest inside: whoever changes one is noticed, and what does not
hold what its dataclass states is refused.
"""

import hashlib
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from calibkit.errors import CoefficientError

if TYPE_CHECKING:
    from pydantic import TypeAdapter

_Stored = TypeVar("_Stored")
_ADAPTERS: "dict[object, TypeAdapter[Any]]" = {}
"""Dataclass → what checks values of it; each is made where it is needed first."""


def _digest(document: Mapping[str, Any]) -> str:
    """SHA-256 of the canonical JSON (RFC 8785) of every key but `sha256`; raises CoefficientError
    for what JSON lacks.
    """
    import rfc8785

    try:
        canonical = rfc8785.dumps(
            {key: value for key, value in document.items() if key != "sha256"}
        )
    except (rfc8785.CanonicalizationError, RecursionError, UnicodeError) as error:
        raise CoefficientError(
            f"not a JSON document: {error}", hint="a NaN or an infinity is not a coefficient"
        ) from None
    return hashlib.sha256(canonical).hexdigest()


def seal(document: Mapping[str, Any]) -> str:
    """Text of a JSON document with its own digest beside it, one line per scalar, keys in order,
    ending in a newline.
    """
    # as a reader finds it: tuples are lists; a NaN passes here, the digest refuses it with advice
    fields: dict[str, Any] = json.loads(json.dumps(document, allow_nan=True))
    body = {"format": fields.pop("format"), "sha256": "", **fields}
    body["sha256"] = _digest(body)
    return json.dumps(body, ensure_ascii=False, indent=1, allow_nan=False) + "\n"


def unseal(text: str, name: str, *formats: str) -> dict[str, Any]:
    """Document of a sealed JSON text, or CoefficientError that states why it cannot be trusted."""
    try:
        document = json.loads(text, object_pairs_hook=_distinct)
    except (ValueError, RecursionError) as error:
        reason = "a key stands twice, or too many brackets lie within each other"
        if isinstance(error, json.JSONDecodeError):
            reason = f"line {error.lineno}, column {error.colno}"
        raise CoefficientError(
            f"{name}: not a whole JSON document: {reason}", hint="restore it from the run's copy"
        ) from None
    if not isinstance(document, dict) or not isinstance(document.get("format"), str):
        raise CoefficientError(
            f"{name}: no 'format' key", hint=f"expected one of {', '.join(formats)}"
        )
    if document["format"] not in formats:
        kind, _, version = document["format"].rpartition("/")
        first_release = version == "1" and f"{kind}/2" in formats
        raise CoefficientError(
            f"{name}: format '{document['format']}', expected one of {', '.join(formats)}",
            hint="calibkit 0.1.0 wrote it, calibkit 0.2 reads it"
            if first_release
            else "use the calibkit that wrote it, or a newer one",
        )
    expected = _digest(document)
    if document.get("sha256") != expected:
        raise CoefficientError(
            f"{name}: digest {str(document.get('sha256'))[:12]}… is not that of its content,"
            f" {expected[:12]}…",
            hint="the file was changed after it was written; do not use it",
        )
    return document


def _distinct(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object whose keys are distinct; two values for one key would make the digest
    meaningless.
    """
    json_object = dict(pairs)
    if len(json_object) != len(pairs):
        raise ValueError("a key stands twice")
    return json_object


def read_as(kind: type[_Stored], content: object, name: str, title: str) -> _Stored:
    """Dataclass of a value of JSON: numbers where it states numbers, no key that it requires left
    out. CoefficientError names the file, the place in it, what was found and what was expected.
    """
    from pydantic import TypeAdapter, ValidationError

    if kind not in _ADAPTERS:
        _ADAPTERS[kind] = TypeAdapter(kind)
    try:
        # as JSON, in which a list is a tuple; only there does a strict check know that
        stored: _Stored = _ADAPTERS[kind].validate_json(json.dumps(content), strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, first["loc"]))
        reason = str(first.get("ctx", {}).get("error", ""))
        if not reason:
            found = "nothing" if first["type"] == "missing" else f"{first['input']!r:.40}"
            reason = f"found {found}, {first['msg'].replace('Input should be', 'expected')}"
        raise CoefficientError(
            f"{name}: not {title}: {': '.join(filter(None, (place, reason)))}",
            hint="calibkit did not write it so; restore it from a copy",
        ) from None
    return stored
