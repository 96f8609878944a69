"""Traces of a signature that is not there any more: whoever takes it off a certificate, or damages
what names it, leaves some of them.
"""

import re
from collections.abc import Sequence
from typing import Any

from calibkit.certificate.verify_text import compact
from calibkit.certificate.words import SENTENCES

_BYTES = re.compile(
    rb"/ByteRan|/SubFil|ETSI\.|/Adobe\.PPK|adbe\.pkcs7|/DocMDP|/SigFlags|/SigRef|/AcroForm"
    rb"|/DocTimeStamp|/TransformP|<30[0-9A-Fa-f]{400}"
)
_KEYS = frozenset({"/AcroForm", "/Perms", "/DSS", "/ByteRange", "/SubFilter", "/SigFlags"})
_TYPES = frozenset({"/Sig", "/DocTimeStamp", "/SigRef", "/TransformParams", "/DSS"})


def find_mark(document: bytes) -> str:
    """First bytes in a PDF that signatures alone have, quoted; empty where there are none."""
    match = _BYTES.search(document)
    return f"'{match.group()[:20].decode('ascii')}'" if match else ""


def find_trace(document: bytes, reader: Any, pages: Sequence[str]) -> str:  # noqa: ANN401 (a class of an optional library)
    """What is left of a signature in a PDF, in words; empty where nothing is.

    `reader` is pypdf's of the document, `pages` are the texts of its pages.
    """
    if mark := find_mark(document):
        return mark
    printed = compact("".join(pages))
    if any(compact(text) in printed for text in (SENTENCES["signed"].en, SENTENCES["signed"].zh)):
        return "the printed words that it is signed electronically"
    for number in sorted(
        {n for offsets in reader.xref.values() for n in offsets} | set(reader.xref_objStm)
    ):
        value = reader.get_object(number)
        if isinstance(value, dict):
            marks = _KEYS & value.keys() | _TYPES & {value.get("/Type"), value.get("/FT")}
            if marks:
                return f"'{min(marks)}'"
    return ""
