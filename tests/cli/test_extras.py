"""Optional parts: what is missing is named once, with what installs it where calibkit runs."""

import importlib.util
import sys

import pytest

from calibkit.libraries import extras
from written_logs import still


def test_certify_without_any_part_names_the_one_that_brings_all(tmp_path, calibkit, monkeypatch):
    """Without typst and lxml it asks for calibkit[pdf], which has both, and not first for
    calibkit[dcc].
    """
    data = still(tmp_path / "logs", 2)
    call = ("--serial", "S-1", "--out", tmp_path / "runs")
    assert calibkit("fit", "bias_temperature", "--data", data, *call).code == 0
    for module in ("typst", "lxml.etree"):
        monkeypatch.setitem(sys.modules, module, None)
    refused = calibkit("certify", "S-1", "--runs", tmp_path / "runs", "--out", tmp_path / "c.pdf")
    assert (refused.code, "calibkit[pdf]" in refused.err) == (4, True)


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
