"""Licences of the libraries that calibkit and its extras need, as their packages state them."""

import re
from importlib import metadata

import pytest

from conftest import ROOT

PERMISSIVE = ("MIT", "BSD", "Apache", "PSF", "ISC", "Python Software Foundation", "Zlib", "0BSD")
STATED = {"nptdms": "LGPL"}
"""Library under another licence, which docs/trust.md states."""
FOR_WORK = {"test", "docs", "dev"}


def requirements():
    """Name of each library that users get, by itself or with an extra."""
    lines = metadata.requires("calibkit") or []
    kept = (line for line in lines if not re.search(rf"extra == .({'|'.join(FOR_WORK)}).", line))
    names = {re.split(r"[\s\[<>=!~;(]", line)[0] for line in kept}
    return sorted(names - {"calibkit"})


def licence(name):
    """What a package states of its licence."""
    about = metadata.metadata(name)
    stated = [about.get("License-Expression", ""), (about.get("License") or "")[:200]]
    stated += [one for one in about.get_all("Classifier", []) if one.startswith("License")]
    return " ".join(filter(None, stated))


@pytest.mark.parametrize("name", requirements())
def test_every_library_that_users_get_is_permissive_or_stated(name):
    """A licence that asks something of users must be known before it is installed."""
    try:
        found = licence(name)
    except metadata.PackageNotFoundError:
        pytest.skip("not installed")
    if name in STATED:
        assert STATED[name] in found
        assert f"{name} (" in (ROOT / "docs" / "trust.md").read_text(encoding="utf-8").lower()
        return
    assert any(word in found for word in PERMISSIVE), found
    assert "GPL" not in found
