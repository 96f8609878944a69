"""Optional parts: what is missing is named once, with what installs it where calibkit runs."""

import importlib.util
import sys

import pytest

from calibkit.libraries import extras


@pytest.mark.parametrize(
    ("python", "pip", "expected"),
    [
        ("/opt/venv/bin/python", True, "/opt/venv/bin/python -m pip install 'calibkit[pdf]'"),
        ("/a b/python", True, "\"/a b/python\" -m pip install 'calibkit[pdf]'"),
        ("/tool/python", None, "install calibkit[pdf] in place of calibkit (docs/installation.md)"),
    ],
)
def test_a_missing_part_is_installed_where_calibkit_runs(monkeypatch, python, pip, expected):
    """The hint calls the pip of the environment that runs, and none where there is none."""
    monkeypatch.setattr(sys, "executable", python)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: pip)
    assert extras.install_hint("pdf") == expected
