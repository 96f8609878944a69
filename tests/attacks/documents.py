"""Manifests, DCCs and PDFs that somebody changed, with digests made to fit where a forger could."""

import base64
import copy
import json
import random
import re

from calibkit.certificate.signature_trust import Demands
from calibkit.commands import pipeline
from calibkit.errors import CalibkitError
from calibkit.records import sealed

JUNK = (None, True, -1, 1e300, "x", [], {}, [1], {"a": 1}, "../..", "/etc/passwd", "\0", "a" * 300)
TEXTS = (b"", b"nan", b"1e999", b"-", b"&#0;", b"1 2 3", "é٣".encode(), b"9" * 5000, b"\\metre")
FILES = (b"", b"\xff\xfe", b"{}", b"[]", b"[" * 40_000, b'{"format":1}', b"1e999")


def outcome(path, content, **demands):
    """Return how `verify` of these bytes, held against demands, ends: passed, refused, or what must
    never be.
    """
    path.write_bytes(content)
    try:
        pipeline.verify(path, Demands(**demands))
    except CalibkitError as error:
        right = error.exit_code == 4 and "\n" not in str(error)
        return "refused" if right else f"exit code {error.exit_code}: {error}"
    except Exception as error:  # noqa: BLE001 (what is not calibkit's own is what is looked for)
        return f"{type(error).__name__}: {error}"
    return "passed"


def forge(document, generator):
    """One to three members of a sealed JSON document replaced or removed, its digest right."""
    forged = copy.deepcopy(document)
    for _ in range(generator.randrange(1, 4)):
        node = forged
        while True:
            keys = list(node) if isinstance(node, dict) else list(range(len(node)))
            if not keys:
                break
            key = generator.choice(keys)
            if isinstance(node[key], (dict, list)) and node[key] and generator.random() < 0.7:
                node = node[key]
                continue
            if generator.random() < 0.3:
                del node[key]
            else:
                node[key] = generator.choice(JUNK)
            break
    forged.setdefault("format", document["format"])
    return sealed.seal(forged).encode()


def damage_xml(content, generator):
    """A byte, a text, an element, an attribute or an attached file of an XML text changed."""
    kind = generator.randrange(6)
    patterns = (rb">([^<]+)<", rb"<([\w:]+)[^<>]*>[^<]*</\1>", rb'="([^"]*)"')
    if kind < 3:
        found = generator.choice(list(re.finditer(patterns[kind], content)))
        put = (generator.choice(TEXTS), b"", b"")[kind]
        start, stop = found.span(0 if kind == 1 else 1)
        return content[:start] + put + content[stop:]
    if kind == 3:
        files = list(re.finditer(rb"<dcc:dataBase64>([^<]+)<", content))
        if files:
            start, stop = generator.choice(files).span(1)
            return content[:start] + base64.b64encode(generator.choice(FILES)) + content[stop:]
    at = generator.randrange(len(content))
    if kind == 4:
        return content[:at]
    return content[:at] + bytes([generator.randrange(256)]) + content[at + 1 :]


def attack(path, damage, count, seed):
    """Return number of attacks on `verify` and those that were not survived; `damage(generator)`
    makes the bytes of each.
    """
    generator = random.Random(seed)  # noqa: S311 (a fixed seed, not a secret)
    outcomes = [outcome(path, damage(generator)) for _ in range(count)]
    return count, [found for found in outcomes if found not in {"passed", "refused"}]


def read_json(path):
    """Document of a JSON file."""
    return json.loads(path.read_text(encoding="utf-8"))
